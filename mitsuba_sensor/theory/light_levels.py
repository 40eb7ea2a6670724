"""Occupied levels of mean photoelectrons in a window: how many pixels see about how much light."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.backend import NUMPY_FLOAT64
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.run import row_strips_of
from ..sensor.threads import processors

SHIFT = 15
"""Bits of a float32 that a level leaves out: 256 levels from one power of two to the next."""

LEVELS = 2**31 >> SHIFT

WIDTH = 2.0 ** (SHIFT - 23)
"""Width of a level at most, as a share of its light."""


class LightLevels(NamedTuple):
    """Levels 0.2 to 0.4 % apart.

    light_e : (L,) rising mean photoelectrons of the pixels of each level; inf where they are infinite.
    pixels : (L,) how many there are.
    """

    light_e: Float64Array
    pixels: NDArray[np.int64]


def light_levels(light: Detected) -> LightLevels:
    """Levels of the light of all pixels of a window."""
    height, width = light.photons.shape[:2]
    pixels, sums = np.zeros(LEVELS, dtype=np.int64), np.zeros(LEVELS)
    rows = row_strips_of((height, width), NUMPY_FLOAT64.strip_pixels)
    with ThreadPoolExecutor(processors()) as pool:
        for strip_pixels, strip_sums in pool.map(
            lambda part: _count(light.crop_rows(part).mean_e.ravel()), rows
        ):
            pixels += strip_pixels
            sums += strip_sums
    used = np.flatnonzero(pixels)
    return LightLevels(sums[used] / pixels[used], pixels[used])


def _count(light_e: Float64Array) -> tuple[NDArray[np.intp], Float64Array]:
    """Pixels and sum of the light of every level."""
    with np.errstate(over="ignore", under="ignore"):
        level = light_e.astype(np.float32).view(np.uint32) >> SHIFT
    return np.bincount(level, minlength=LEVELS), np.asarray(
        np.bincount(level, light_e, minlength=LEVELS), np.float64
    )
