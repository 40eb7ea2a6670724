"""Demosaicing: of a Bayer pattern by directional filters, of others by bilinear means.

Menon, Andriani and Calvagno 2007, doi:10.1109/TIP.2006.884928:

1. Green at red and blue pixels is interpolated along the row and along the column. Of both the one is taken along
   which the colour differences around the pixel change less, so that no interpolation crosses an edge.
2. Red and blue follow from their differences to green, which vary less than the colours.
3. The differences between colours are averaged over three pixels along the direction of step 1.

The same algorithm and bits as demosaicing_CFA_Bayer_Menon2007 of colour-demosaicing, whose import takes seconds.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from ..camera.camera import Camera

Picture: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

ROW, COLUMN = 1, 0  # axes along which values are interpolated
NEXT = [0.0, 0.5, 0.0, 0.5, 0.0]  # green
OWN = [-0.25, 0.0, 0.5, 0.0, -0.25]  # curvature of the other colour
BOTH_SIDES, THREE = [0.5, 0.0, 0.5], [1 / 3, 1 / 3, 1 / 3]
AROUND = np.array(
    [[0, 0, 1, 0, 1], [0, 0, 0, 1, 0], [0, 0, 3, 0, 3], [0, 0, 0, 1, 0], [0, 0, 1, 0, 1]], float
)
"""Weights of the changes along a row about a pixel: its own row counts three times."""
NEAR, CORNER = 2.0, 1.0  # bilinear weights of the four neighbours beside and across
BAYER = 2  # rows and columns of a tile of two greens, and of the smallest picture that has one


def demosaic_bayer(mosaic: Picture, red: Mask, blue: Mask) -> Picture:
    """Red, green and blue (H, W, 3) of a mosaic (H, W).  red, blue : its pixels of these colours, the others are green.

    Every pixel keeps what it measured but for rounding. The picture is continued beyond its border as in a mirror.
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


def _fill_at_green(colour: Picture, g: Picture, green: Mask, rows: Mask) -> Picture:
    """Red or blue at green pixels, from its differences to green.  rows : those that have pixels of the colour."""
    near, near_g = _choose(rows, colour, BOTH_SIDES), _choose(rows, g, BOTH_SIDES)
    return np.where(green, g + near - near_g, colour)


def _interpolate_green(mosaic: Picture, green: Mask, axis: int) -> Picture:
    return np.where(green, mosaic, _weighted(mosaic, NEXT, axis) + _weighted(mosaic, OWN, axis))


def _change_around(difference: Picture, axis: int) -> Picture:
    """How much the differences of a colour to green change along an axis, in the neighbourhood of each pixel."""
    padding, later = [(0, 0), (0, 0)], [slice(None), slice(None)]
    padding[axis], later[axis] = (0, 2), slice(2, None)
    change = np.abs(difference - np.pad(difference, padding, mode="reflect")[tuple(later)])
    if axis == ROW:
        weights = AROUND
    else:
        weights = AROUND.T
    return np.asarray(scipy.ndimage.convolve(change, weights, mode="constant"))


def _choose(is_row: Mask, picture: Picture, weights: list[float]) -> Picture:
    """Weighted means along the row where this is chosen, along the column elsewhere."""
    return np.where(
        is_row, _weighted(picture, weights, ROW), _weighted(picture, weights, COLUMN)
    )


def _weighted(picture: Picture, weights: list[float], axis: int) -> Picture:
    return np.asarray(scipy.ndimage.convolve1d(picture, weights, axis=axis, mode="mirror"))


def demosaic(
    mosaic: NDArray[np.float64], filters: NDArray[np.integer], camera: Camera
) -> NDArray[np.float64]:
    """(H, W) values and filter numbers → (H, W, F): by Menon, Andriani and Calvagno 2007 behind a Bayer pattern (the
    edges that it follows stay without colour), else by bilinear means."""
    if not _is_bayer(filters, camera):
        return bilinear(mosaic, filters, len(camera.filter_names))
    order = [name[:1].upper() for name in camera.filter_names]
    red, blue = (filters == order.index(name) for name in "RB")
    return demosaic_bayer(mosaic, red, blue)[..., ["RGB".index(name) for name in order]]


def _is_bayer(filters: NDArray[np.integer], camera: Camera) -> bool:
    """Whether the filters of a picture are one red, two green and one blue in two rows and columns."""
    if len(camera.filter_names) != 3 or np.shape(camera.tile) != (BAYER, BAYER):
        return False
    numbers = filters[:BAYER, :BAYER].ravel()
    return sorted(camera.filter_names[number][:1].upper() for number in numbers) == list("BGGR")


def bilinear(
    mosaic: NDArray[np.float64], filters: NDArray[np.integer], count: int
) -> NDArray[np.float64]:
    """Every pixel keeps what it measured and takes the weighted mean of its neighbours for the rest.

    mosaic, filters : (H, W), value and filter number of each pixel; count : F, how many filters → (H, W, F).
    """
    planes = []
    for number in range(count):
        own = filters == number
        weight = _sum_neighbours(own.astype(float))
        total = _sum_neighbours(np.where(own, mosaic, 0.0))
        mean = np.divide(total, weight, out=np.zeros_like(mosaic), where=weight > 0)
        planes.append(np.where(own, mosaic, mean))
    return np.stack(planes, axis=-1)


def _sum_neighbours(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the eight neighbours with the bilinear weights, zero outside the image."""
    padded, total, (height, width) = np.pad(image, 1), np.zeros_like(image), image.shape
    for down, right in np.ndindex(3, 3):
        weight = (0.0, NEAR, CORNER)[abs(down - 1) + abs(right - 1)]
        total += weight * padded[down : down + height, right : right + width]
    return total
