"""The place of an edge in a picture: a line, or a polynomial where the lens distorts, in an upright picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....core import InputError
from ....core.types import Float64Array

WIDTHS_PX = (16.0, 8.0, 6.0, 4.0, 4.0, 4.0)
"""Of the normal windows about the edge, one after the other: noise far from the edge counts less and less."""


class Upright(NamedTuple):
    """A picture turned so that its edge is nearer to the columns and its bright side is on the right."""

    picture: Float64Array
    transposed: bool
    mirrored: bool

    def turn(self, picture: Float64Array) -> Float64Array:
        """Another picture of the same pixels, turned in the same way."""
        if self.transposed:
            picture = picture.T
        if self.mirrored:
            picture = picture[:, ::-1]
        return picture


def upright(picture: Float64Array) -> Upright:
    """Turn a picture by what its sides differ: an edge makes this difference along its normal, noise hardly any."""
    across, along = _side_differences(picture)
    transposed = abs(along) > abs(across)
    if transposed:
        across = along
    mirrored = across < 0
    turned = Upright(picture, transposed, mirrored)
    return turned._replace(picture=turned.turn(picture))


def _side_differences(picture: Float64Array) -> tuple[float, float]:
    """Sum of the last column less that of the first, and of the rows."""
    across = float((picture[:, -1] - picture[:, 0]).sum())
    return across, float((picture[-1] - picture[0]).sum())


@dataclass(frozen=True, eq=False)
class EdgeLine:
    """The edge of an upright picture.  coefficients : of x [px] by y [px], lowest power first; y is 0 in the middle."""

    coefficients: Float64Array

    @property
    def angle_deg(self) -> float:
        """Of the edge in the middle, from the columns; positive where it goes to the right from top to bottom."""
        return math.degrees(math.atan(self.coefficients[1]))

    def distance(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Distance of points from the edge, positive on its right [px]."""
        polynomial = np.polynomial.Polynomial(self.coefficients)
        slope = polynomial.deriv()(y)
        return np.asarray((x - polynomial(y)) / np.hypot(1, slope))

    def moved(self, shift_px: Float64Array) -> EdgeLine:
        """The edge moved along its normal by a polynomial of y; shift_px : its coefficients from the first power on."""
        along_x = shift_px * math.hypot(1, self.coefficients[1])
        return EdgeLine(self.coefficients + np.concatenate([[0.0], along_x]))


def middles(shape: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    """x and y of the middle of every pixel, flat; y is 0 in the middle of the picture."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5 - rows / 2)
    return x.ravel(), y.ravel()


def find_line(picture: Float64Array, order: int) -> EdgeLine:
    """The edge of an upright picture, about as well as its noise allows; raises InputError where there is none.

    order : of the polynomial; what it has beyond a line is 0 here.
    """
    steps = picture[1:, 1:] - picture[:-1, :-1], picture[:-1, 1:] - picture[1:, :-1]
    across, along = _side_differences(picture)
    size = math.hypot(across, along)
    if not size:
        raise InputError(
            "the picture has no edge: opposite sides are equally bright; pass one with one edge."
        )
    normal = across / size, along / size
    # A gradient from the four pixels about each corner, along the normal.
    weight = 0.5 * ((steps[0] + steps[1]) * normal[0] + (steps[0] - steps[1]) * normal[1])
    rows, columns = weight.shape
    x, y = np.meshgrid(np.arange(columns) + 1.0, np.arange(rows) + 0.5 - rows / 2)
    offset = (weight * (x * normal[0] + y * normal[1])).sum() / weight.sum()
    line = np.array([offset / normal[0], -normal[1] / normal[0]])
    for width_px in WIDTHS_PX:
        distance = EdgeLine(line).distance(x, y)
        near = weight * np.exp(-0.5 * np.square(distance / width_px))
        moments = near.sum(), (near * y).sum(), (near * y * y).sum()
        matrix = np.array([[moments[0], moments[1]], [moments[1], moments[2]]])
        line = np.linalg.solve(matrix, [(near * x).sum(), (near * x * y).sum()])
    if not (np.isfinite(line).all() and 0 < line[0] < picture.shape[1] and abs(line[1]) < 1.5):
        raise InputError(
            "the picture has no edge that can be found; cut out a part with one straight edge through its middle."
        )
    return EdgeLine(np.concatenate([line, np.zeros(order - 1)]))
