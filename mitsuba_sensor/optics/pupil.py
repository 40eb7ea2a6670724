"""Where light comes out of a lens, seen from each image height: the part of its back that is worth a ray.

Vignetting and the slant of the pupil leave of the back of a lens what only a few per cent of random rays hit at the
corner of a picture. Here a grid of rays is traced from each of many image heights, and an ellipse in the plane of the
last vertex is found that holds all that pass; the renderer then samples that ellipse. The lens is round: each height
is traced on one radius, for one half of the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .glass import D_NM
from .ray_trace import Ray, Surface, trace

INTERVALS = 32  # of the table; what passes at their middles must fit too
GRID = 64  # rays across the window, in each narrowing
NARROWINGS = 3
WINDOW = 1.5  # of the last clear aperture: where a slanting ray that hits it may cross the plane of its vertex
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pupil:
    """An ellipse in the plane of the last vertex for each image height, (INTERVALS + 1,) [mm].

    highest : image height of the last entry; the first is the axis.  centre : on the line through axis and image point,
    positive on the side of the point.  radial, tangential : half axes along that line and across; 0 where all is dark.
    """

    highest: float
    centre: Array
    radial: Array
    tangential: Array


def ray_to(distance: float, height: Array, radial: Array, tangential: Array) -> Ray:
    """The ray from an image point at (height, 0), ``distance`` before the last vertex, to a point in its plane [mm]."""
    dx, dy = np.broadcast_arrays(radial - height, tangential)
    size = np.sqrt(dx * dx + dy * dy + distance * distance)
    unvignetted = np.ones(dx.shape, dtype=bool)
    return Ray(height + 0.0 * dx, 0.0 * dy, -distance, dx / size, dy / size, distance / size, unvignetted)


def find_pupil(
    surfaces: tuple[Surface, ...], distance: float, highest: float, wavelengths_nm: tuple[float, ...] = (D_NM,)
) -> Pupil:
    """The pupil of a lens whose sensor is ``distance`` behind its last vertex, out to an image height [mm].

    wavelengths_nm : what passes at any of them must fit.
    """
    heights = np.linspace(0.0, highest, 2 * INTERVALS + 1)
    high = np.full(heights.shape, WINDOW * surfaces[0].semi_diameter)
    low, top = -high, high
    for _ in range(NARROWINGS):
        cell, row = (high - low) / GRID, top / (GRID // 2)
        radial = low[:, None] + cell[:, None] * (np.arange(GRID) + 0.5)
        tangential = row[:, None] * (np.arange(GRID // 2) + 0.5)
        passes = _passing(surfaces, distance, (heights, radial, tangential), wavelengths_nm)
        along, across = passes.any(axis=2), passes.any(axis=1)
        low, high = high - cell * _reach(along[:, ::-1]), low + cell * _reach(along)
        top = row * _reach(across)
    if not passes[0].any():
        raise InputError("no ray passes this lens on its axis; set lens.f_number to a smaller value, e.g. 8.")
    corners = (radial, cell, tangential, row)
    return _ellipses(highest, passes, corners, (low, high, top))


def _passing(
    surfaces: tuple[Surface, ...],
    distance: float,
    rays: tuple[Array, Array, Array],
    wavelengths_nm: tuple[float, ...],
) -> NDArray[np.bool_]:
    """Which rays of the grid pass, (heights, GRID, GRID/2)."""
    heights, radial, tangential = rays
    start = ray_to(distance, heights[:, None, None], radial[:, :, None], tangential[:, None, :])
    with np.errstate(all="ignore"):  # rays that miss
        return np.logical_or.reduce([trace(surfaces, start, nm).unvignetted for nm in wavelengths_nm])


def _reach(passes: NDArray[np.bool_]) -> Array:
    """Cells up to the last that passes, and one more: (heights, cells) → (heights,); 0 if none does."""
    count = passes.shape[1]
    return np.where(passes.any(axis=1), count - np.argmax(passes[:, ::-1], axis=1) + 1.0, 0.0)


def _ellipses(highest: float, passes: NDArray[np.bool_], cells: tuple[Array, ...], window: tuple[Array, ...]) -> Pupil:
    """Ellipses as wide as the windows, grown until the corners of all cells that pass are inside.

    What passes between two entries of the table must fit into the mean of their ellipses: both grow until it does.
    """
    (radial, cell, tangential, row), (low, high, top) = cells, window
    lit = passes.any(axis=(1, 2))
    nearest = np.abs(np.flatnonzero(lit)[None, :] - np.arange(len(lit))[:, None]).argmin(axis=1)
    centre = ((low + high) / 2)[np.flatnonzero(lit)[nearest]]
    half, across = np.where(lit, (high - low) / 2, 0.0), np.where(lit, top, 0.0)

    def growth(middle: Array, a: Array, b: Array, rows: slice) -> Array:
        x = np.abs(radial[rows] - middle[:, None]) + cell[rows, None] / 2
        y = tangential[rows] + row[rows, None] / 2
        tiny = 1e-150  # for an ellipse that is none, its square still a number
        size = (x / np.maximum(a, tiny)[:, None])[:, :, None] ** 2 + (y / np.maximum(b, tiny)[:, None])[:, None] ** 2
        return np.sqrt(np.where(passes[rows], size, 0.0).max(axis=(1, 2)))

    at, between = slice(0, None, 2), slice(1, None, 2)
    grown = growth(centre[at], half[at], across[at], at)
    centre, half, across = centre[at], half[at] * grown, across[at] * grown
    middle = growth(*((v[1:] + v[:-1]) / 2 for v in (centre, half, across)), between)
    grown = np.maximum(np.maximum(np.append(middle, 1.0), np.insert(middle, 0, 1.0)), 1.0)
    return Pupil(highest, centre, half * grown, across * grown)
