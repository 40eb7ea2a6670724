"""Occupied levels of mean photoelectrons in a window: how many pixels see how much light, and their own averages."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame, Photons
from ..core.backend import NUMPY_FLOAT64
from ..core.types import Array, Float64Array
from .run import processors, row_strips_of
from .stage import Stage
from .theory import LightKind

SHIFT = 15
"""Bits of a float32 that a level leaves out: 256 levels from one power of two to the next."""

LEVELS = 2**31 >> SHIFT

WIDTH = 2.0 ** (SHIFT - 23)
"""Of a level at most, as a share of its light."""

YIELD_STEP, COMPENSATED_STEP = 1 / 8, 1 / 24
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

    def add(self, light_e: Float64Array, kind: tuple[Array, Array, Array]) -> None:
        level = light_e.astype(np.float32).view(np.uint32) >> SHIFT
        self.pixels += np.bincount(level, minlength=LEVELS)
        self.light += np.bincount(level, light_e, minlength=LEVELS)
        self.kind += [np.sum(np.broadcast_to(x, light_e.shape)) for x in kind]

    def levels(self) -> LightLevels:
        used = np.flatnonzero(self.pixels)
        pixels = self.pixels[used]
        return LightLevels(self.light[used] / pixels, pixels, LightKind(*(self.kind / pixels.sum()).tolist()))


def light_levels(photons: Photons, detection: Stage, frame: Frame) -> list[LightLevels]:
    """Levels 0.2 to 0.4 % apart, by kind of the light.

    photons : of the window of ``frame``.  detection : the first stage, which makes mean photoelectrons of them.
    """
    found: dict[int, _Sums] = defaultdict(_Sums)
    with ThreadPoolExecutor(processors()) as pool:
        for light, kind, number in pool.map(lambda rows: _strip(photons, detection, frame, rows), _rows(photons)):
            if number is None:
                found[0].add(light, kind)
                continue
            for one in np.unique(number):
                here = number == one
                found[one].add(light[here], tuple(np.broadcast_to(x, light.shape)[here] for x in kind))
    return [found[number].levels() for number in sorted(found)]


def _rows(photons: Photons) -> Iterator[slice]:
    height, width = photons.mean.shape[:2]
    return row_strips_of((height, width), NUMPY_FLOAT64.strip_pixels)


def _strip(
    photons: Photons, detection: Stage, frame: Frame, rows: slice
) -> tuple[Float64Array, tuple[Array, Array, Array], NDArray[np.int64] | None]:
    """Mean photoelectrons of a strip, what makes their kind, and its number, None where there is only one."""
    mean = detected(photons, detection, frame, rows)
    if not isinstance(mean, Electrons):  # chain konnik2014: photons
        return np.asarray(mean, dtype=np.float64).ravel(), LightKind(), None
    light = np.asarray(mean.light, dtype=np.float64).ravel()
    if mean.variance_e2 is None and np.ndim(mean.yield_mean) == 0:
        return light, LightKind(), None
    variance = 0.0 if mean.variance_e2 is None else np.ravel(mean.variance_e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.where(light > 0, variance / light, 0.0), posinf=0.0)
    share = np.minimum(share, 1.0)
    yields = np.ravel(mean.yield_mean), np.ravel(mean.yield_variance)
    number = np.rint((yields[0] - 1) / YIELD_STEP) * 1000 + np.rint(share / COMPENSATED_STEP)
    return light, (*yields, share), np.broadcast_to(number, light.shape).astype(np.int64)


def detected(photons: Photons, detection: Stage, frame: Frame, rows: slice) -> Array:
    """What the first stage makes of some rows, in float64."""
    window = frame.on(NUMPY_FLOAT64).window.crop_rows(rows)
    return detection.sample(photons.crop_rows(rows), replace(frame, window=window, _blocks={}))
