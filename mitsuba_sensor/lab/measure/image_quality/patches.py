"""Mean and noise of patches of a chart over some frames: temporal, fixed-pattern and total noise (ISO 15739)."""

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
from ...frames.stack import Stack

Region = tuple[int, int, int, int]
"""First row, first column, rows and columns of a patch."""
FEWEST_PIXELS = 16


class Patches(NamedTuple):
    """Of every patch: mean [DN] and variances [DN²], each beside its standard error; (P,).

    temporal : between frames.  total : of the pixels of a frame, temporal and fixed pattern together.
    clipped : whether a pixel of it has the largest code, or code 0.
    """

    mean: Float64Array
    mean_error: Float64Array
    temporal: Float64Array
    temporal_error: Float64Array
    total: Float64Array
    total_error: Float64Array
    clipped: Float64Array

    def select(self, some: NDArray[np.bool_]) -> Patches:
        """Some of the patches."""
        return Patches(*(field[some] for field in self))


def measure_patches(stack: Stack, regions: Sequence[Region], black_dn: Float64Array) -> Patches:
    """Statistics of the patches; light that rises evenly over a patch is no noise.

    black_dn : (H, W), whose mean over a patch is taken off.

    Raises InputError for patches outside of the frames or too small, for one frame, and for a mosaic.
    """
    stack.require_one_filter()
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame shows no temporal noise; pass two frames or more."
        )
    rows = []
    for region in regions:
        place = slices_of(region, stack.shape)
        pixels = stack.frames[:, *place].astype(np.float64)
        rows.append(_measure_one(pixels, float(black_dn[place].mean()), stack.bits))
    return Patches(*np.array(rows).T)


def require_regions(regions: Sequence[Region]) -> Sequence[Region]:
    """The patches, if they are a sequence of any length. Raises InputError."""
    if isinstance(regions, str) or not isinstance(regions, Sequence | np.ndarray):
        raise InputError(
            f"regions is {shown(regions)}; pass (first row, first column, rows, columns) of each patch."
        )
    return regions


def slices_of(region: Region, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of a patch in a picture of this shape. Raises InputError where it is outside or too small."""
    height, width = shape[:2]
    try:
        top, left, rows, columns = map(operator.index, region)
        inside = 0 <= top <= height - rows and 0 <= left <= width - columns
        fits = inside and rows * columns >= FEWEST_PIXELS and min(rows, columns) >= 2
    except (TypeError, ValueError):  # no four whole numbers
        fits = False
    if not fits:
        raise InputError(
            f"the patch {shown(region)} (first row, first column, rows, columns) must lie inside pictures of {height} "
            f"× {width} pixels and have {FEWEST_PIXELS} pixels or more."
        )
    return slice(top, top + rows), slice(left, left + columns)


def _measure_one(pixels: Float64Array, black_dn: float, bits: int | None) -> tuple[float, ...]:
    """The fields of :class:`Patches` of one patch."""
    frames, rows, columns = pixels.shape
    count = rows * columns
    temporal = float(pixels.var(axis=0, ddof=1).mean())
    fixed_share = variance_about_plane(pixels.mean(axis=0))  # with what averaging leaves
    fixed = max(fixed_share - temporal / frames, 0.0)
    square = fixed_share**2 + temporal**2 * (frames - 1) / frames**2
    at_ends = pixels.min() <= 0 or (bits is not None and pixels.max() >= 2**bits - 1)
    return (
        float(pixels.mean()) - black_dn,
        math.sqrt((fixed + temporal / frames) / count),
        temporal,
        temporal * math.sqrt(2 / (count * (frames - 1))),
        fixed_share + temporal * (1 - 1 / frames),
        math.sqrt(2 * square / (count - 3)),
        float(at_ends),
    )


def variance_about_plane(image: Float64Array) -> float:
    """Variance of a picture without a plane that is fitted to it."""
    y, x = np.indices(image.shape)
    design = np.column_stack([np.ones(image.size), x.ravel(), y.ravel()])
    residual = image.ravel() - design @ np.linalg.lstsq(design, image.ravel(), rcond=None)[0]
    return float(residual @ residual) / (image.size - 3)
