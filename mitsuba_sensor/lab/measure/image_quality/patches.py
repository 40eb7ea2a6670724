"""Mean and noise of patches of a chart over several frames: temporal, fixed-pattern and total noise (ISO 15739)."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core import InputError
from ....core.errors import shown
from ....core.types import Float64Array
from ...frames.stack import Stack, coarse_note, rounding_error_dn2, rounding_shift_dn

Region = tuple[int, int, int, int]
"""First row, first column, rows and columns of a patch."""
PIXELS_MIN = 16


class Patches(NamedTuple):
    """Mean [DN] and variances [DN²] of patches with standard errors, shape (P,) each.

    temporal : variance between frames.  total : variance of the pixels of a frame, temporal and fixed pattern.
    clipped : 1 if a pixel has the full-scale code or code 0.  coarse : 1 if rounding hides the temporal noise.
    """

    mean: Float64Array
    mean_error: Float64Array
    temporal: Float64Array
    temporal_error: Float64Array
    total: Float64Array
    total_error: Float64Array
    clipped: Float64Array
    coarse: Float64Array

    def select(self, chosen: NDArray[np.bool_]) -> Patches:
        """Return some of the patches."""
        return Patches(*(field[chosen] for field in self))


def measure_patches(stack: Stack, regions: Sequence[Region], black_dn: Float64Array) -> Patches:
    """Measure patches without the planes that uneven light adds to them.

    black_dn : black level of each pixel, shape (H, W).

    Raises InputError for patches outside of the frames or too small, for one frame, and for a mosaic.
    """
    stack.require_one_filter()
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame shows no temporal noise; pass at least two frames."
        )
    rows = []
    for region in regions:
        place = slices_of(region, stack.shape)
        pixels = stack.frames[:, *place].astype(np.float64)
        rows.append(_measure_one(pixels, float(black_dn[place].mean()), stack))
    return Patches(*np.array(rows).T)


def require_regions(regions: Sequence[Region]) -> Sequence[Region]:
    """Return the patches if they are a sequence. Raises InputError."""
    if isinstance(regions, str) or not isinstance(regions, Sequence | np.ndarray):
        raise InputError(
            f"regions is {shown(regions)}; pass (first row, first column, rows, columns) of each patch."
        )
    return regions


def slices_of(region: Region, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return rows and columns of a patch in an image of this shape. Raises InputError if it is outside or too small."""
    height, width = shape[:2]
    try:
        top, left, rows, columns = map(operator.index, region)
        inside = 0 <= top <= height - rows and 0 <= left <= width - columns
        fits = inside and rows * columns >= PIXELS_MIN and min(rows, columns) >= 2
    except (TypeError, ValueError):  # not four whole numbers
        fits = False
    if not fits:
        raise InputError(
            f"the patch {shown(region)} (first row, first column, rows, columns) must lie inside images of {height} "
            f"× {width} pixels and have at least {PIXELS_MIN} pixels."
        )
    return slice(top, top + rows), slice(left, left + columns)


def _measure_one(pixels: Float64Array, black_dn: float, stack: Stack) -> tuple[float, ...]:
    """Return the fields of :class:`Patches` for one patch."""
    frames, rows, columns = pixels.shape
    count = rows * columns
    temporal = float(pixels.var(axis=0, ddof=1).mean())
    of_mean = variance_about_plane(
        pixels.mean(axis=0)
    )  # fixed pattern and averaged temporal noise
    fixed = max(of_mean - temporal / frames, 0.0)
    total = of_mean + temporal * (1 - 1 / frames)
    mean_error = math.sqrt((fixed + temporal / frames) / count)
    temporal_error = temporal * math.sqrt(2 / (count * (frames - 1)))
    square = of_mean**2 + temporal**2 * (frames - 1) / frames**2
    total_error = math.sqrt(2 * square / (count - 3))
    low, high = float(pixels.min()), float(pixels.max())
    coarse = temporal == 0 or total == 0
    if stack.whole_codes:
        mean_error = math.hypot(mean_error, rounding_shift_dn(total))
        temporal_error = math.hypot(temporal_error, rounding_error_dn2(temporal))
        total_error = math.hypot(total_error, rounding_error_dn2(total))
        coarse = bool(coarse_note(min(temporal, total), high - low))
    clipped = low <= 0 or (stack.bits is not None and high >= 2**stack.bits - 1)
    mean = float(pixels.mean()) - black_dn
    errors = temporal, temporal_error, total, total_error
    return mean, mean_error, *errors, float(clipped), float(coarse)


def variance_about_plane(image: Float64Array) -> float:
    """Return the variance of an image about a fitted plane."""
    y, x = np.indices(image.shape)
    design = np.column_stack([np.ones(image.size), x.ravel(), y.ravel()])
    residual = image.ravel() - design @ np.linalg.lstsq(design, image.ravel(), rcond=None)[0]
    return float(residual @ residual) / (image.size - 3)
