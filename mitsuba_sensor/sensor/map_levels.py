"""Levels of measured maps: how many pixels have about which value, counted strip by strip instead of sorted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..core import SensorWindow
from ..core.types import Float64Array
from .run import row_strips_of
from .threads import for_each

STRIP = 2**16
"""Pixels that are counted together."""

SHIFT = 15
"""Bits of a float32 that a level leaves out: far from the middle 256 levels from one power of two to the next."""

NEAREST = 2.0**-20
"""Distance from the middle, as a share of the range, within which levels are even: 4e-9 of the range each."""

FIRST, LAST = (int(np.float32(one).view(np.int32) >> SHIFT) for one in (NEAREST, 1 + NEAREST))
SIDE = LAST - FIRST + 1
LEVELS = 2 * SIDE

Strip = Callable[[slice], Float64Array]
"""Some rows of a map."""


class MapLevels(NamedTuple):
    """Pixels of nearly the same value.

    pixels : (L,) how many there are.  means, variances : (L,) exact ones of their values, the means rising.
    """

    pixels: Float64Array
    means: Float64Array
    variances: Float64Array

    @classmethod
    def of(cls, values: Float64Array) -> Self:
        """Of a map."""
        (found,) = cls.of_groups(values.__getitem__, (values.shape[0], values.size // values.shape[0]))
        return found

    @classmethod
    def of_groups(
        cls,
        strip: Strip,
        shape: tuple[int, int],
        group: Callable[[slice], NDArray[np.intp]] | None = None,
        groups: int = 1,
    ) -> list[Self]:
        """Of each group of pixels.

        strip : values that broadcast to rows of ``shape``.  group : the numbers of their groups, 0 … ``groups`` − 1.
        """
        middle, scale = _middle_and_scale(strip, shape)
        sums, lock = np.zeros((3, groups * LEVELS)), threading.Lock()
        waiting, done = dict[int, tuple[int, list[Float64Array]]](), [0]  # strips that are counted, and rows added

        def count(rows: slice) -> None:
            values = strip(rows)
            number = None if group is None else group(rows)
            if number is not None:
                values, number = np.broadcast_arrays(values, number)
            like = (rows.stop - rows.start) * shape[1] / values.size  # pixels that share a value
            off = values.ravel() - middle
            place = _levels(off * scale)
            if number is not None:
                place += LEVELS * number.ravel()
            found = [np.bincount(place, weights, sums.shape[1]) for weights in (None, off, off * off)]
            with lock:  # strip after strip, whichever thread was first: sums have the same bits in every run
                waiting[rows.start] = rows.stop, [like * part for part in found]
                while done[0] in waiting:
                    done[0], parts = waiting.pop(done[0])
                    for total, part in zip(sums, parts, strict=True):
                        total += part

        for_each(count, row_strips_of(shape, max(STRIP, groups * LEVELS)))
        return [cls._of_sums(part, middle) for part in sums.reshape(3, groups, LEVELS).swapaxes(0, 1)]

    @classmethod
    def _of_sums(cls, sums: Float64Array, middle: float) -> Self:
        pixels, first, second = sums[:, sums[0] > 0]
        off = first / pixels
        return cls(pixels, middle + off, np.where(pixels > 1, np.maximum(second / pixels - off**2, 0.0), 0.0))

    @property
    def size(self) -> int:
        """Pixels of all levels."""
        return int(self.pixels.sum())

    def mean(self) -> float:
        """Of all pixels."""
        return float(self.pixels @ self.means / self.pixels.sum())

    def variance(self) -> float:
        """Of all pixels."""
        return float(self.pixels @ (self.variances + (self.means - self.mean()) ** 2) / self.pixels.sum())

    def in_groups(self, borders: NDArray[np.intp]) -> Self:
        """Levels together.  borders : number of the first level of each group."""
        pixels = np.add.reduceat(self.pixels, borders)
        centre = self.mean()
        off = self.means - centre  # squares of small numbers are exact
        first, second = (
            np.add.reduceat(self.pixels * part, borders) / pixels for part in (off, self.variances + off**2)
        )
        return type(self)(pixels, centre + first, np.where(pixels > 1, np.maximum(second - first**2, 0.0), 0.0))

    def together(self) -> Self:
        """All pixels in one level."""
        return self.in_groups(np.zeros(1, dtype=np.intp))

    def means_between(self, ranks: NDArray[np.intp]) -> Float64Array:
        """Means of the pixels in order from each of these numbers to the next, from the last one to the end.

        Pixels of one level share its mean, so that groups of nothing else are equal.
        """
        before = np.append(0.0, np.cumsum(self.pixels))
        centre, ends = self.mean(), np.append(ranks, self.size)
        sums = np.interp(ends, before, np.append(0.0, np.cumsum(self.pixels * (self.means - centre))))
        first, last = (np.searchsorted(before, rank, side="right") - 1 for rank in (ranks, ends[1:] - 1))
        return np.where(first == last, self.means[first], centre + np.diff(sums) / np.diff(ends))

    def firsts(self, ranks: NDArray[np.intp]) -> NDArray[np.intp]:
        """First levels of groups that begin with these pixels, of all in order; of pixels of one level the next one."""
        before = np.cumsum(self.pixels) - self.pixels
        found = np.unique(np.searchsorted(before, ranks))
        return np.asarray(found[found < before.size], dtype=np.intp)


def levels_of_map(window: SensorWindow, name: str) -> MapLevels:
    """Of a measured map of this window, counted once."""
    return window.cached(("levels", name), lambda: MapLevels.of(window.given[name]))


def _middle_and_scale(strip: Strip, shape: tuple[int, int]) -> tuple[float, float]:
    """A value about which there are many, and a power of two that makes all distances to it 1 at most."""
    found: list[tuple[float, float, float]] = []

    def look(rows: slice) -> None:
        values = strip(rows)
        some = np.sort(values.ravel()[:: max(values.size // 255, 1)])
        found.append((float(values.min()), float(values.max()), float(some[some.size // 2])))

    for_each(look, row_strips_of(shape, STRIP))
    lows, highs, middles = zip(*found, strict=True)
    middle = sorted(middles)[len(middles) // 2]
    _, exponent = np.frexp(max(max(highs) - middle, middle - min(lows)))
    return middle, float(np.ldexp(1.0, -int(exponent)))


def _levels(share: Float64Array) -> NDArray[np.intp]:
    """Numbers of the levels of values from −1 to 1, rising."""
    bits = (np.abs(share) + NEAREST).astype(np.float32).view(np.int32) >> SHIFT
    bits -= FIRST
    return np.asarray(np.where(share < 0, SIDE - 1 - bits, SIDE + bits), dtype=np.intp)
