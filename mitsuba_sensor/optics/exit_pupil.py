"""Exit-pupil bounds of a traced lens: the part of its rear that passes light, for each image height.

Vignetting and the slant of the pupil leave only a few per cent of the rear of a lens unvignetted for the corner of an
image. A grid of rays is traced from each of many image heights, and an ellipse in the reference plane of the lens is
found that contains all unvignetted rays; the renderer then samples that ellipse. The lens is rotationally symmetric, so
each height is traced along one radius, for one half of the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Float64Array, InputError
from .ray_trace import D_NM, ray_to
from .traced_lens import TracedLens

INTERVALS = 32
"""Intervals of the table; the ellipses also contain what passes half-way between its entries."""
GRID = 64  # rays across the window, in each refinement
REFINEMENTS = 3
TINY = 1e-150  # half axis of an empty ellipse; its square is still above 0


@dataclass(frozen=True, eq=False)
class ExitPupilBounds:
    """An ellipse in the reference plane of the lens for each image height, (INTERVALS + 1,) [mm].

    highest : image height of the last entry; the first is the axis.
    centre : on the line through axis and image point, positive on the side of the point.
    radial, tangential : half axes along that line and across; 0 where no light passes.
    """

    highest: float
    centre: Float64Array
    radial: Float64Array
    tangential: Float64Array


def exit_pupil_bounds(
    lens: TracedLens,
    distance: float,
    highest: float,
    wavelengths_nm: tuple[float, ...] = (D_NM,),
) -> ExitPupilBounds:
    """The bounds for a sensor ``distance`` behind the reference plane, up to the image height ``highest`` [mm].

    wavelengths_nm : rays that pass at any of them are inside.
    """
    heights = np.linspace(0.0, highest, 2 * INTERVALS + 1)
    high = np.full(heights.shape, lens.reach(distance, highest))
    low, top = -high, high
    for _ in range(REFINEMENTS):
        cell, row = (high - low) / GRID, top / (GRID // 2)
        radial = low[:, None] + cell[:, None] * (np.arange(GRID) + 0.5)
        tangential = row[:, None] * (np.arange(GRID // 2) + 0.5)
        start = ray_to(
            distance, heights[:, None, None], radial[:, :, None], tangential[:, None, :]
        )
        with np.errstate(all="ignore"):  # rays that miss a surface give NaN
            passes = np.logical_or.reduce(
                [lens.unvignetted(start, nm) for nm in wavelengths_nm]
            )
        along, across = passes.any(axis=2), passes.any(axis=1)
        cells_below, cells_above = _cells_to_last(along[:, ::-1]), _cells_to_last(along)
        low, high = high - cell * cells_below, low + cell * cells_above
        top = row * _cells_to_last(across)
    if not passes[0].any():
        raise InputError(
            "no ray on the axis passes this lens; set lens.f_number to a smaller value, e.g. 8."
        )
    # Ellipses as wide as the windows, enlarged until the corners of all cells that pass are inside.
    half, edge = cell[:, None] / 2, tangential + row[:, None] / 2

    def enlargement(first: int, centre: Float64Array, *half_axes: Float64Array) -> Float64Array:
        """Factors at which ellipses contain the cells of every second height, from the first one on, that pass."""
        offset = np.abs(radial[first::2] - centre[:, None]) + half[first::2]
        x, y = (
            reach / np.maximum(half_axis, TINY)[:, None]
            for reach, half_axis in zip((offset, edge[first::2]), half_axes, strict=True)
        )
        squares = np.where(passes[first::2], x[:, :, None] ** 2 + y[:, None] ** 2, 0.0)
        return np.asarray(np.sqrt(squares.max(axis=(1, 2))))

    lit = np.asarray(passes.any(axis=(1, 2)))
    lit_rows = np.flatnonzero(lit)
    nearest = np.abs(lit_rows[None, :] - np.arange(len(lit))[:, None]).argmin(axis=1)
    centre = ((low + high) / 2)[lit_rows[nearest]][::2]
    half_axes = [np.where(lit, size, 0.0)[::2] for size in ((high - low) / 2, top)]
    scale = enlargement(0, centre, *half_axes)
    half_axes = [half_axis * scale for half_axis in half_axes]
    # What passes half-way between two entries of the table must be inside the mean of their ellipses.
    between = enlargement(1, *((v[1:] + v[:-1]) / 2 for v in (centre, *half_axes)))
    scale = np.maximum(np.append(between, 1.0), np.insert(between, 0, 1.0))
    scale = np.maximum(scale, 1.0)
    return ExitPupilBounds(highest, centre, *(half_axis * scale for half_axis in half_axes))


def _cells_to_last(passes: NDArray[np.bool_]) -> Float64Array:
    """Cells up to the last that passes, and one more: (heights, cells) → (heights,); 0 if none does."""
    cells = passes.shape[1] - np.argmax(passes[:, ::-1], axis=1) + 1.0
    return np.where(passes.any(axis=1), cells, 0.0)
