"""Occupied levels of mean photoelectrons in a window: how many pixels see how much light, and their own averages."""

from __future__ import annotations

from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons
from ..core.backend import NUMPY_FLOAT64
from ..core.types import Array, Float64Array
from .detection import Detected
from .light_kind import LightKind
from .run import row_strips_of
from .threads import processors

SHIFT = 15
"""Bits of a float32 that a level leaves out: 256 levels from one power of two to the next."""

LEVELS = 2**31 >> SHIFT

WIDTH = 2.0 ** (SHIFT - 23)
"""Of a level at most, as a share of its light."""

Kind = tuple[Array, Array, Array]
"""Of some pixels: the fields of :class:`LightKind`."""

YIELD_STEP, COMPENSATED_STEP = 1 / 4, 1 / 6
"""Pixels whose quantum yield or share of compensated render noise lies within one step are of one kind."""


@dataclass(frozen=True, eq=False)
class LightLevels:
    """Pixels of one kind.

    light_e : (L,) rising mean photoelectrons of the pixels of each level; inf where they are infinite.
    pixels : (L,) how many there are.
    kind : of the light.
    """

    light_e: Float64Array
    pixels: NDArray[np.int64]
    kind: LightKind


class _Sums:
    """Of one kind: pixels and light by level, and what makes the kind."""

    def __init__(self) -> None:
        self.pixels, self.light, self.kind = np.zeros(LEVELS, dtype=np.int64), np.zeros(LEVELS), np.zeros(3)

    def add(self, light_e: Float64Array, kind: Kind) -> None:
        with np.errstate(over="ignore", under="ignore"):
            level = light_e.astype(np.float32).view(np.uint32) >> SHIFT
        self.pixels += np.bincount(level, minlength=LEVELS)
        self.light += np.bincount(level, light_e, minlength=LEVELS)
        self.kind += [np.sum(np.broadcast_to(x, light_e.shape)) for x in kind]

    def levels(self) -> LightLevels:
        used = np.flatnonzero(self.pixels)
        pixels = self.pixels[used]
        return LightLevels(self.light[used] / pixels, pixels, LightKind(*(self.kind / pixels.sum()).tolist()))


def light_levels(light: Detected) -> list[LightLevels]:
    """Levels 0.2 to 0.4 % apart, by kind of the light."""
    found: dict[int, _Sums] = defaultdict(_Sums)
    shape = light.photons.shape[:2]
    with ThreadPoolExecutor(processors()) as pool:
        rows = row_strips_of((shape[0], shape[1]), NUMPY_FLOAT64.strip_pixels)
        for mean_e, kind, number in pool.map(lambda part: _kinds(light.crop_rows(part)), rows):
            if number is None:
                found[0].add(mean_e, kind)
                continue
            for one in np.unique(number):
                here = number == one
                found[one].add(mean_e[here], tuple(np.broadcast_to(x, mean_e.shape)[here] for x in kind))
    return [found[number].levels() for number in sorted(found)]


def _kinds(strip: Detected) -> tuple[Float64Array, Kind, NDArray[np.int64] | None]:
    """Mean photoelectrons of a strip, what makes their kind, and its number, None where there is only one."""
    mean_e, signal = strip.mean_e.ravel(), strip.signal
    if not isinstance(signal, Electrons) or (signal.variance_e2 is None and np.ndim(signal.yield_mean) == 0):
        return mean_e, LightKind(), None
    variance = 0.0 if signal.variance_e2 is None else np.ravel(signal.variance_e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.where(mean_e > 0, variance / mean_e, 0.0), posinf=0.0)
    share = np.minimum(share, 1.0)
    yields = np.ravel(signal.yield_mean), np.ravel(signal.yield_variance)
    number = np.rint((yields[0] - 1) / YIELD_STEP) * 1000 + np.rint(share / COMPENSATED_STEP)
    return mean_e, (*yields, share), np.broadcast_to(number, mean_e.shape).astype(np.int64)
