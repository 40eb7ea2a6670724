"""Demosaicing: directional filters for Bayer mosaics, bilinear means for other mosaics.

Menon, Andriani and Calvagno 2007, doi:10.1109/TIP.2006.884928:

1. Green at red and blue pixels is interpolated along the row and along the column. The direction in which the colour
   differences around the pixel change less is chosen, so no interpolation crosses an edge.
2. Red and blue follow from their differences to green, which vary less than the colours.
3. Colour differences are averaged over three pixels along the direction of step 1.

Same algorithm and bits as demosaicing_CFA_Bayer_Menon2007 of colour-demosaicing, whose import takes seconds.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..core import Float64Array

Mask: TypeAlias = NDArray[np.bool_]

ROW, COLUMN = 1, 0  # axes of interpolation
GREEN_NEIGHBOURS = [0.0, 0.5, 0.0, 0.5, 0.0]
CURVATURE = [-0.25, 0.0, 0.5, 0.0, -0.25]  # of the pixel's colour
BOTH_SIDES, THREE = [0.5, 0.0, 0.5], [1 / 3, 1 / 3, 1 / 3]
AROUND = np.array(
    [[0, 0, 1, 0, 1], [0, 0, 0, 1, 0], [0, 0, 3, 0, 3], [0, 0, 0, 1, 0], [0, 0, 1, 0, 1]], float
)
"""Weights of the changes along a row around a pixel: the pixel's row counts three times."""
BILINEAR = np.array([[1, 2, 1], [2, 0, 2], [1, 2, 1]])
BAYER_SHAPE = 2, 2


def demosaic(
    mosaic: Float64Array, filters: NDArray[np.integer], camera: Camera
) -> Float64Array:
    """Return the colours (H, W, F) of values and filter numbers (H, W), by directional filters for a Bayer mosaic (grey
    edges stay without colour), else by bilinear means."""
    order = [name[:1].upper() for name in camera.filter_names]
    tile = filters[: BAYER_SHAPE[0], : BAYER_SHAPE[1]].ravel()
    if (
        len(order) != 3
        or np.shape(camera.tile) != BAYER_SHAPE
        or sorted(order[number] for number in tile) != list("BGGR")
    ):
        return bilinear(mosaic, filters, len(order))
    red, blue = (filters == order.index(name) for name in "RB")
    return demosaic_bayer(mosaic, red, blue)[..., ["RGB".index(name) for name in order]]


def bilinear(mosaic: Float64Array, filters: NDArray[np.integer], count: int) -> Float64Array:
    """Return the colours (H, W, F) of a mosaic (H, W): measured values, and weighted means of the neighbours elsewhere.

    filters : filter number of each pixel, (H, W).  count : number of filters F.
    """
    planes = []
    for number in range(count):
        own = filters == number
        weight, total = (
            scipy.ndimage.convolve(image, BILINEAR, mode="constant")
            for image in (own.astype(float), np.where(own, mosaic, 0.0))
        )
        mean = np.divide(total, weight, out=np.zeros_like(mosaic), where=weight > 0)
        planes.append(np.where(own, mosaic, mean))
    return np.stack(planes, axis=-1)


def demosaic_bayer(mosaic: Float64Array, red: Mask, blue: Mask) -> Float64Array:
    """Return red, green and blue (H, W, 3) of a mosaic (H, W), which is mirrored at its border.

    red, blue : pixels of these colours; all other pixels are green. Measured values change only by rounding.
    """
    green = ~(red | blue)
    along_row = _interpolate_green(mosaic, green, ROW)
    along_column = _interpolate_green(mosaic, green, COLUMN)
    change_row = _change_around(np.where(green, 0.0, mosaic - along_row), ROW)
    change_column = _change_around(np.where(green, 0.0, mosaic - along_column), COLUMN)
    is_row = change_column >= change_row
    g = np.where(is_row, along_row, along_column)

    red_rows, blue_rows = (
        np.any(red, axis=1, keepdims=True),
        np.any(blue, axis=1, keepdims=True),
    )
    r = _fill_at_green(np.where(red, mosaic, 0.0), g, green, red_rows)
    b = _fill_at_green(np.where(blue, mosaic, 0.0), g, green, blue_rows)
    near_r, near_b = _choose(is_row, r, BOTH_SIDES), _choose(is_row, b, BOTH_SIDES)
    r, b = np.where(blue, b + near_r - near_b, r), np.where(red, r + near_b - near_r, b)

    g = np.where(
        red,
        r - _choose(is_row, r - g, THREE),
        np.where(blue, b - _choose(is_row, b - g, THREE), g),
    )
    r = np.where(green, g + _choose(red_rows, r - g, BOTH_SIDES), r)
    b = np.where(green, g + _choose(blue_rows, b - g, BOTH_SIDES), b)
    difference = _choose(is_row, r - b, THREE)
    r, b = np.where(blue, b + difference, r), np.where(red, r - difference, b)
    return np.stack([r, g, b], axis=-1)


def _fill_at_green(
    colour: Float64Array, g: Float64Array, green: Mask, rows: Mask
) -> Float64Array:
    """Interpolate red or blue at green pixels from differences to green.  rows : rows with pixels of the colour."""
    near, near_g = _choose(rows, colour, BOTH_SIDES), _choose(rows, g, BOTH_SIDES)
    return np.where(green, g + near - near_g, colour)


def _interpolate_green(mosaic: Float64Array, green: Mask, axis: int) -> Float64Array:
    return np.where(
        green,
        mosaic,
        _weighted(mosaic, GREEN_NEIGHBOURS, axis) + _weighted(mosaic, CURVATURE, axis),
    )


def _change_around(difference: Float64Array, axis: int) -> Float64Array:
    """Return how much colour differences to green change along an axis around each pixel."""
    padding, later = [(0, 0), (0, 0)], [slice(None), slice(None)]
    padding[axis], later[axis] = (0, 2), slice(2, None)
    change = np.abs(difference - np.pad(difference, padding, mode="reflect")[tuple(later)])
    weights = AROUND if axis == ROW else AROUND.T
    return np.asarray(scipy.ndimage.convolve(change, weights, mode="constant"))


def _choose(is_row: Mask, picture: Float64Array, weights: list[float]) -> Float64Array:
    """Return weighted means along the row where ``is_row``, else along the column."""
    return np.where(
        is_row, _weighted(picture, weights, ROW), _weighted(picture, weights, COLUMN)
    )


def _weighted(picture: Float64Array, weights: list[float], axis: int) -> Float64Array:
    return np.asarray(scipy.ndimage.convolve1d(picture, weights, axis=axis, mode="mirror"))
