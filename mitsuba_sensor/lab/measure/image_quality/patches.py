"""Mean and noise of patches of a chart over some frames: temporal, fixed-pattern and total noise (ISO 15739)."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

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
    columns = np.array([_measure_one(_cut(stack, region), stack) for region in regions]).T
    patches = Patches(*columns)
    black = [
        black_dn[top : top + rows, left : left + width].mean()
        for top, left, rows, width in regions
    ]
    return patches._replace(mean=patches.mean - np.array(black))


def _cut(stack: Stack, region: Region) -> Float64Array:
    """The pixels of a patch, (N, rows, columns)."""
    rows, columns = slices_of(region, stack.shape)
    return stack.frames[:, rows, columns].astype(np.float64)


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


def _measure_one(pixels: Float64Array, stack: Stack) -> tuple[float, ...]:
    """The fields of :class:`Patches` of one patch."""
    frames, rows, columns = pixels.shape
    count = rows * columns
    temporal = float(pixels.var(axis=0, ddof=1).mean())
    temporal_error = temporal * np.sqrt(2 / (count * (frames - 1)))
    fixed_share = variance_about_plane(pixels.mean(axis=0))  # with what averaging leaves
    fixed = max(fixed_share - temporal / frames, 0.0)
    total = fixed_share + temporal * (1 - 1 / frames)
    square = fixed_share**2 + temporal**2 * (frames - 1) / frames**2
    total_error = np.sqrt(2 * square / (count - 3))
    mean_error = np.sqrt((fixed + temporal / frames) / count)
    at_ends = pixels.min() <= 0
    if stack.bits is not None:
        at_ends |= pixels.max() >= 2**stack.bits - 1
    mean = float(pixels.mean())
    return mean, mean_error, temporal, temporal_error, total, total_error, float(at_ends)


def variance_about_plane(image: Float64Array) -> float:
    """Variance of a picture without a plane that is fitted to it."""
    y, x = np.indices(image.shape)
    design = np.column_stack([np.ones(image.size), x.ravel(), y.ravel()])
    residual = image.ravel() - design @ np.linalg.lstsq(design, image.ravel(), rcond=None)[0]
    return float(residual @ residual) / (image.size - 3)
