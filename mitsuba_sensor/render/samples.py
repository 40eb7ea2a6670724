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
"""Mitsuba's sampler. At 64 samples per pixel its variance is 1/16 of the variance of "independent" in even light.

Its hashed permutations correlate the dimensions of a sample if a pass has few samples. The table shows the mean of
Π(½ + u) over D numbers of one sample, which should be 1 (3 million samples, Mitsuba 3.9.1; standard errors 0.03, 0.07
and 0.35 %), and the light behind a slab of fog (random walks of up to 14 scatterings with 10 numbers each, 8 million
samples; 0.04 %) with its variance relative to "independent":

    samples of a pass    D = 8     D = 16    D = 48    light behind fog    variance
                    2  −13.5 %   −29.2 %   −67.6 %             −1.40 %        0.79
                    3   −0.2 %    +3.1 %    −0.9 %             +0.59 %        0.70
                    4   −4.4 %   −15.0 %   −39.2 %             +0.45 %        0.67
                    6   +4.7 %   +12.0 %   +20.5 %             +0.40 %        0.61
                    8   −2.4 %    −6.0 %   −17.7 %             +0.35 %        0.59
                    9   −0.3 %    −1.1 %    −2.1 %              0.00 %        0.59
                   12   +0.6 %    +1.5 %    +4.6 %             +0.10 %        0.59
                   15   −0.2 %    −0.8 %   −12.4 %             −0.06 %        0.58
                   16   −1.1 %    −2.3 %   −12.7 %             −0.13 %        0.58
                   20   −0.4 %    −0.9 %    −3.7 %             +0.03 %        0.57
                   25   −0.3 %    −0.5 %    −2.1 %             +0.04 %        0.57
                   64   +0.1 %     0.0 %    +1.3 %

In three other slabs, passes of 3 are +0.2 to +0.8 % off, passes of 9 −0.1 to 0.0 % and passes of 15 −0.2 to −0.1 %.
Rendered with passes of 9, seven scenes with media, rough glass, facing mirrors, diamond and diffuse walls differ from
"independent" by −0.06 to +0.11 % (standard errors 0.06 to 0.14 %; 4 to 5 million samples each).
With 4 samples, the mean of Π over 48 numbers is 123 % off with "stratified", 445 % with "ldsampler" and 972 % with
"orthogonal". `python benchmarks/sampler_bias.py` measures both.
"""
CORRELATED = (1, 2, 3, 4, 6, 8, 15, 16)
"""Samples of a pass whose dimensions are correlated, or not stratified (1)."""

PASSES_MIN = 8  # fewer passes only guess their error bars
PASSES_MAX = 16  # for a fixed number of samples; large passes have less noise
SPP_TOLERANCE = (
    1 / 8
)  # fraction of the requested samples by which a plan without correlation may differ
IN_FLIGHT_MAX = 2**22  # samples per launch: 45 MB a million in LLVM variants


def pass_plan(spp: int, repeatable: bool = False) -> tuple[int, int]:
    """Return the passes, at least two, and the samples per pixel of each pass, for about ``spp`` samples per pixel.

    Multijitter rounds a count up to the next one that fills a grid: 1, 2, 3, 4, 6, 8, 9, 12, 15, 16, 20, 24, 25 … Only
    such counts are chosen, with 8 to 16 passes; more passes keep a pass below 1025 samples. The product comes closest
    to ``spp`` among plans without correlated dimensions, if one is within an eighth of ``spp``, else among all plans.

    repeatable : passes of 1, 2, 4 or 8 samples. Threads of Dr.Jit share a film in vectors of pixels. The samples of a
    pixel within one vector are always added in the same order, but vectors are added in the order of their arrival.
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
    plans = [(passes, n) for passes in counts for n in _grids(spp / passes)]

    def cost(plan: tuple[int, int]) -> tuple[bool, bool, int, int]:
        passes, samples = plan
        difference = abs(passes * samples - spp)
        return difference > SPP_TOLERANCE * spp, samples in CORRELATED, difference, passes

    return min(plans, key=cost)


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
