"""Samples of a render: how many passes of how many samples, their seeds, strips of rows; limits of its options."""

from __future__ import annotations

import hashlib
import math
from itertools import pairwise
from typing import TYPE_CHECKING

from ..core import InputError, require

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SHORTEST_NM, LONGEST_NM = 200.0, 2500.0  # ranges of silicon, InGaAs and HgCdTe sensors
NARROWEST_NM = 0.5  # below it the float32 nodes of a band lose accuracy
MOST_SPP = 1024  # per pass: the float32 film loses about 1e-8 per sample
MOST_REPEATABLE = 8  # per pass, where the sum must not depend on threads: what a vector of AVX2 or AVX-512 holds
MOST_IN_ALL = 2**24  # samples per pixel, over all passes

SHORTEST_METERED_S = 1e-5
"""Exposure time below which light is brighter than the electronic shutters of most cameras allow."""

MITSUBA_NM = (360.0, 830.0)
"""Where Mitsuba's own emitters and its spectra of colours are not zero."""

SAMPLER = "multijitter"
"""At 64 samples per pixel it has a quarter of the noise of "independent" at the same cost, but its dimensions are
correlated where a pass has few samples, because its permutations are hashed. Mean of Π(½ + u) over D numbers of one
sample, which is 1, with Mitsuba 3.9.1 (600 000 samples or more; errors 0.1 %, 0.2 % and 0.5 %):

    sampler       samples of a pass   D = 8     D = 16    D = 48
    independent                   4    −0.1 %    −0.4 %    −0.6 %
    multijitter                   4    −4.2 %    −9.7 %     −45 %
    multijitter                   8    −2.4 %    −1.4 %     −23 %
    multijitter                   9    −0.1 %    −0.7 %    −1.5 %
    multijitter                  16    −0.8 %    −0.6 %      −5 %
    multijitter                  20    −0.4 %    +0.5 %    −0.9 %
    multijitter                  64     0.0 %    −0.3 %    +1.4 %
    stratified                    4     +15 %      −6 %    +123 %
    stratified                   16      −3 %      +4 %    +157 %
    orthogonal                    4    +0.3 %      +6 %    +972 %
    orthogonal                    9    −0.1 %    +0.4 %     +35 %
    ldsampler                     4      +5 %     +12 %    +445 %
    ldsampler                    16      −9 %      −8 %     −21 %

Of light it moves little: a translucent ball in rough glass is −0.05 % with 9 samples of a pass, +0.16 % with 4 and
+0.21 % with 8 (standard error 0.05 %). All others are worse or, "independent", have 16 times the variance.
"""
PASSES_MIN = 8  # below it error bars are guesses
PASSES_MAX = 16  # of a fixed number of samples: few large passes have less noise
IN_FLIGHT_MAX = 2**22  # samples per launch: 45 MB a million in LLVM variants


def pass_plan(spp: int, repeatable: bool = False) -> tuple[int, int]:
    """(passes, samples per pixel and pass) whose product comes closest to ``spp``; at least two passes.

    Multijitter fills a grid of about equal sides: it keeps 1, 2, 4, 6, 9, 12, 16 … samples and rounds others up. Only
    such counts are chosen, with 8 to 16 passes (more only to stay at 1024 samples per pass); of equal plans the one
    with fewer passes.

    repeatable : passes of 1, 2, 4 or 8 samples. Threads of Dr.Jit share a film in vectors of pixels; the samples of a
    pixel within one vector are always added in the same order, those in several by whichever thread comes first.
    """
    if require("spp", spp, 1, MOST_IN_ALL, "samples per pixel, e.g. 256") != int(spp):
        raise InputError(
            f"spp is {spp!r}; it must be a whole number of samples per pixel (e.g. 256)."
        )
    spp = int(spp)
    if spp < PASSES_MIN:
        return max(spp, 2), 1
    if repeatable:
        samples = whole_grid(spp / PASSES_MIN, repeatable)
        return round(spp / samples), samples
    fewest = max(PASSES_MIN, math.ceil(spp / MOST_SPP))
    counts = range(fewest, max(PASSES_MAX, 2 * fewest) + 1)
    plans = [(k, n) for k in counts for n in _grids(spp / k)]
    return min(plans, key=lambda plan: (abs(plan[0] * plan[1] - spp), plan[0]))


def _grids(samples: float) -> list[int]:
    """Counts near ``samples`` that multijitter keeps, at most 1024: r², r(r+1) and r(r+2) for r about the root."""
    root = math.isqrt(int(samples))
    rows = [row for row in (root - 1, root, root + 1) if row > 0]
    return [
        n
        for row in rows
        for n in (row * row, row * (row + 1), row * (row + 2))
        if n <= MOST_SPP
    ]


def whole_grid(samples: float, repeatable: bool = False) -> int:
    """Return the largest count up to ``samples`` that multijitter keeps.  repeatable : see :func:`pass_plan`."""
    if repeatable:
        return 1 << (int(max(min(samples, MOST_REPEATABLE), 1)).bit_length() - 1)
    return max([n for n in _grids(min(samples, MOST_SPP)) if n <= samples], default=1)


def row_strips(size: tuple[int, int], samples: int) -> list[tuple[int, int]]:
    """Cut (columns, rows) into strips of whole rows of nearly equal height whose samples fit into memory."""
    columns, rows = size
    count = -(-rows // max(IN_FLIGHT_MAX // (columns * samples), 1))
    return list(pairwise(rows * k // count for k in range(count + 1)))


def hashed_seed(seed: int, strip: int, number: int) -> int:
    """Return a 32-bit seed for one pass, unrelated to that of any other pass, strip or seed."""
    text = f"{seed}/{strip}/{number}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=4).digest(), "little")


def clean(
    values: NDArray[np.floating],
) -> tuple[NDArray[np.floating], NDArray[np.bool_], int, int]:
    """Return the values with 0 for those that are negative or not finite, where they were +∞, and how many were
    negative and not finite."""
    import numpy as np  # not before the command line shows its help

    bad, infinite = ~np.isfinite(values), values == np.inf
    negative = (values < 0) & ~bad
    return np.where(bad | negative, 0, values), infinite, int(negative.sum()), int(bad.sum())
