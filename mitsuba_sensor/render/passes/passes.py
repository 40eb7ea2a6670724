"""Render passes: their number, samples, seeds and strips of rows; mean and variance of equal passes (Welford)."""

from __future__ import annotations

import hashlib
import math
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array, InputError, require
from ..limits import MOST_IN_ALL, MOST_REPEATABLE, MOST_SPP

SAMPLER = "multijitter"  # at 64 samples per pixel a quarter of the noise of "independent", at the same cost
FEWEST, MOST = (
    8,
    16,
)  # passes of a fixed number of samples: few large ones have less noise; pooled.py does the rest
MOST_IN_FLIGHT = 2**22  # samples per pass: 45 MB a million in LLVM variants
VALUES_AT_ONCE = 2**14  # that stay in a processor's cache
MOST_VALUES = (
    2**22
)  # pixels × bands per strip: 32 MB for each float64 array of the running mean


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
    if spp < FEWEST:
        return max(spp, 2), 1
    if repeatable:
        samples = whole_grid(spp / FEWEST, repeatable)
        return round(spp / samples), samples
    fewest = max(FEWEST, math.ceil(spp / MOST_SPP))
    plans = [
        (k, n) for k in range(fewest, max(MOST, 2 * fewest) + 1) for n in _kept_counts(spp / k)
    ]

    return min(plans, key=lambda plan: (abs(plan[0] * plan[1] - spp), plan[0]))


def _kept_counts(samples: float) -> list[int]:
    """Counts near ``samples`` that multijitter keeps, at most 1024: r², r(r+1) and r(r+2) for r about the root."""
    root = math.isqrt(int(samples))
    grids = [
        rows * (rows + more)
        for rows in (root - 1, root, root + 1)
        if rows > 0
        for more in (0, 1, 2)
    ]
    return [n for n in grids if n <= MOST_SPP]


def whole_grid(samples: float, repeatable: bool = False) -> int:
    """The largest count up to ``samples`` (1 … 1024) that multijitter keeps.  repeatable : see :func:`pass_plan`."""
    if repeatable:
        return 1 << (int(max(min(samples, MOST_REPEATABLE), 1)).bit_length() - 1)
    return max([n for n in _kept_counts(min(samples, MOST_SPP)) if n <= samples], default=1)


def row_strips(size: tuple[int, int], bands: int, samples: int) -> list[tuple[int, int]]:
    """Cut (columns, rows) into strips of whole rows of nearly equal height that fit into memory."""
    columns, rows = size
    most = max(min(MOST_IN_FLIGHT // (columns * samples), MOST_VALUES // (columns * bands)), 1)
    count = -(-rows // most)
    return list(pairwise(rows * k // count for k in range(count + 1)))


def hashed_seed(seed: int, strip: int, number: int) -> int:
    """A 32-bit seed for one pass, unrelated to that of any other pass, strip or seed."""
    return int.from_bytes(
        hashlib.blake2b(f"{seed}/{strip}/{number}".encode(), digest_size=4).digest(), "little"
    )


class Cleaned(NamedTuple):
    """Values without NaN, −inf and negatives, which became 0; +inf became 0 too and is marked, to saturate later."""

    values: Float64Array
    infinite: NDArray[np.bool_] | None
    negative: int
    non_finite: int


def clean(raw: NDArray[np.floating]) -> Cleaned:
    """Replace NaN, −inf and negative radiance by 0 and +inf by a mark, and count them."""
    values = np.array(raw, dtype=np.float64, order="C")
    if values.min() >= 0 and np.isfinite(values.sum()):  # nearly always
        return Cleaned(values, None, 0, 0)
    bad, infinite = ~np.isfinite(values), values == np.inf
    negative = (values < 0) & ~bad
    values[bad | negative] = 0.0
    return Cleaned(values, infinite, int(negative.sum()), int(bad.sum()))


class RunningMean:
    """Mean of equal passes.  mean : zeros at first; of few passes float32 loses less than the film does."""

    def __init__(self, mean: NDArray[np.floating]) -> None:
        self.count, self.mean = 0, mean

    def add(self, values: Float64Array) -> None:
        """Add one pass."""
        self.begin(1)
        self.add_rows(values[None])

    def begin(self, passes: int) -> None:
        """What :meth:`add_rows` is given from now on belongs to so many more passes."""
        self.count += passes

    def add_rows(self, values: Float64Array, first: int = 0) -> None:
        """Add rows of the passes that have begun, (passes, rows, …), a few at a time; they are written over.  first :
        number of the first one."""
        step = max(VALUES_AT_ONCE // max(math.prod(values.shape[2:]), 1), 1)
        for start in range(0, values.shape[1], step):
            some = values[:, start : start + step]
            rows = slice(first + start, first + start + some.shape[1])
            mean = some.mean(axis=0) if len(some) > 1 else some[0].copy()
            delta = mean - self.mean[rows]
            self.mean[rows] += delta * (len(some) / self.count)
            self._note(rows, some, mean, delta)

    def _note(
        self, rows: slice, values: Float64Array, mean: Float64Array, delta: Float64Array
    ) -> None:
        """What else is to be known of values in some rows, whose mean was ``delta`` from that of the passes before."""


class Welford(RunningMean):
    """Mean and variance of equal passes, of several at once by the formula of Chan, Golub and LeVeque 1983, doi
    10.1080/00031305.1983.10483115.

    mean, spread : zeros at first; ``spread`` is the root of the sum of squared deviations, which may be too large or
        too small for float32.
    """

    def __init__(self, mean: NDArray[np.floating], spread: NDArray[np.floating]) -> None:
        super().__init__(mean)
        self._spread = spread

    @classmethod
    def of_shape(cls, shape: tuple[int, ...]) -> Self:
        """In float64."""
        return cls(np.zeros(shape), np.zeros(shape))

    def _note(
        self, rows: slice, values: Float64Array, mean: Float64Array, delta: Float64Array
    ) -> None:
        here, before = len(values), self.count - len(values)
        if self.count == 1:
            return
        delta *= delta
        delta *= before * here / self.count
        if here > 1:
            values -= mean
            delta += np.einsum("p...,p...->...", values, values)
        delta += np.square(
            self._spread[rows], dtype=np.float64
        )  # of float32: neither too large nor too small
        self._spread[rows] = np.sqrt(delta, out=delta)

    @property
    def variance_of_mean(self) -> Float64Array:
        """Variance of the mean of the passes; 0 for a single pass."""
        return self._spread.astype(np.float64) ** 2 / max(self.count * (self.count - 1), 1)
