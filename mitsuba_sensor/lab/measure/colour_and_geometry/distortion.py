"""Geometric distortion of a chart of known points (ISO 17850), and lateral colour between two channels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers, require
from ....core.checks import require_pair
from ....core.types import Float64Array
from ...quantity import Figures, Quantity, student_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION, LINE_SECTION = "ISO 17850 local geometric distortion", "ISO 17850 line distortion"
TV_SECTION = "SMIA TV distortion"
LATERAL_SECTION = "ISO 19084"
POINTS_MIN = 12


@dataclass(frozen=True, eq=False)
class Distortion(Figures):
    """Distortion of a lens from points of a plane chart.

    local : distortion in the corner, real over ideal image height minus 1 [%].
    tv : relative height of the image at its sides over its middle, minus 1 [%].
    lines : bend of a horizontal and a vertical line that would be a side of the undistorted image: distance of its ends
    outside of its middle, over the height and the width of the image [%]; negative for barrel distortion.
    coefficients : k1, k2 of the growth 1 + k1·h² + k2·h⁴ at image height h, 1 in the corner.
    """

    local: Quantity
    tv: Quantity
    lines: tuple[Quantity, Quantity]
    coefficients: tuple[float, float]

    def plot(self, ax: Axes) -> None:
        """Plot local distortion versus image height."""
        height = np.linspace(0, 1, 101)
        first, second = self.coefficients
        ax.plot(height, 100 * (first * height**2 + second * height**4))
        ax.set(xlabel="ideal image height, 1 in the corner", ylabel="local distortion [%]")


def distortion(points_px: ArrayLike, chart: ArrayLike, shape: tuple[int, int]) -> Distortion:
    """Measure distortion in an image of a plane chart, which may be rotated, tilted and off-centre.

    ::

        chart = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), axis=-1).reshape(-1, 2)
        points = 50 + 20 * chart + np.random.default_rng(1).normal(0, 0.05, chart.shape)
        print(ms.lab.distortion(points, chart, (220, 260)).local)

    points_px : x and y of points of the chart in the image, from its corner, shape (N, 2) [px].
    chart : x and y of the same points on the chart, shape (N, 2), in any unit.
    shape : (rows, columns) of the image; the lens is centred on its middle.
    Raises InputError for fewer than 12 points.
    """
    points, plane = _pair("points_px", points_px, "chart", chart)
    half = _half(shape)
    corner = float(np.hypot(*half))
    heights = (points - half) / corner
    flat = (plane - plane.mean(axis=0)) / np.ptp(plane, axis=0).max()
    start = np.linalg.lstsq(np.column_stack([np.ones(len(flat)), flat]), heights, rcond=None)[0]

    def residual(values: Float64Array) -> Float64Array:
        weight = 1 + flat @ values[6:8]
        ideal = (values[:2] + flat @ values[2:6].reshape(2, 2)) / weight[:, None]
        square = np.square(ideal).sum(axis=1, keepdims=True)
        return np.asarray((ideal * _growth(square, values[8:]) - heights).ravel())

    first = np.concatenate([start.ravel(), np.zeros(4)])
    solution = scipy.optimize.least_squares(residual, first, xtol=1e-12, ftol=1e-12)
    freedom = solution.fun.size - first.size
    variance = float(solution.fun @ solution.fun) / freedom
    covariance = variance * np.linalg.pinv(solution.jac.T @ solution.jac)[8:, 8:]
    lens = _Lens(solution.x[8:], covariance, freedom)
    local = Quantity(
        "D", "local distortion in the corner", *lens.weighted(100, 100), "%", SECTION
    )
    tv = _tv(lens, half[1] / corner)
    horizontal = _line(lens, half[1] / corner, "D_h", "bend of a horizontal line")
    vertical = _line(lens, half[0] / corner, "D_v", "bend of a vertical line")
    k1, k2 = lens.coefficients.tolist()
    return Distortion(local, tv, (horizontal, vertical), (k1, k2))


class _Lens(NamedTuple):
    """Coefficients k1 and k2 with their covariance and its degrees of freedom."""

    coefficients: Float64Array
    covariance: Float64Array
    freedom: int

    def weighted(self, *weights: float) -> tuple[float, float, float]:
        """Return (value, low, high) of a sum of weighted coefficients."""
        slopes = np.array(weights)
        error = float(np.sqrt(slopes @ self.covariance @ slopes))
        return student_interval(float(slopes @ self.coefficients), error, self.freedom)


def _growth(square: Float64Array, coefficients: Float64Array) -> Float64Array:
    """Return real over ideal image height."""
    return np.asarray(1 + square * (coefficients[0] + square * coefficients[1]))


def _tv(lens: _Lens, top: float) -> Quantity:
    """Return the growth in the corner over the growth in the middle of the upper side, minus 1.  top : its height."""
    side, middle = (float(_growth(np.array(h**2), lens.coefficients)) for h in (1.0, top))
    ratio = side / middle
    slopes = (np.ones(2) - ratio * np.array([top**2, top**4])) / middle
    error = float(np.sqrt(slopes @ lens.covariance @ slopes))
    interval = student_interval(100 * (ratio - 1), 100 * error, lens.freedom)
    return Quantity("D_TV", "TV distortion", *interval, "%", TV_SECTION)


def _line(lens: _Lens, middle: float, symbol: str, name: str) -> Quantity:
    """Return half the difference of growth between the corner and the middle of a side.  middle : its height."""
    interval = lens.weighted(50 * (1 - middle**2), 50 * (1 - middle**4))
    return Quantity(symbol, name, *interval, "%", LINE_SECTION)


def lateral_colour(
    points_px: ArrayLike, other_px: ArrayLike, shape: tuple[int, int]
) -> Quantity:
    """Measure how much farther from the centre one channel has the corner than another [px].

    ::

        green = np.random.default_rng(1).uniform(0, 200, (60, 2))
        red = 100 + 1.002 * (green - 100)
        print(ms.lab.lateral_colour(red, green, (200, 200)))

    points_px, other_px : x and y of the same points of a chart in two channels, from the corner, shape (N, 2) [px].
    shape : (rows, columns) of the image.
    Raises InputError for fewer than 12 points.
    """
    points, other = _pair("points_px", points_px, "other_px", other_px)
    half = _half(shape)
    corner = float(np.hypot(*half))
    place = (other - half) / corner
    square = np.square(place).sum(axis=1, keepdims=True)
    shapes = np.stack([place, place * square], axis=-1).reshape(-1, 2)
    shift = np.tile(np.eye(2), (len(place), 1))  # of the whole channel, not lateral colour
    design = np.column_stack([shapes, shift])
    values = (points - other).ravel()
    inverse = np.linalg.pinv(design)
    solution = inverse @ values
    rest = values - design @ solution
    freedom = values.size - design.shape[1]
    slopes = inverse[:2].sum(axis=0)
    error = float(np.sqrt(rest @ rest / freedom * (slopes @ slopes)))
    interval = student_interval(float(solution[:2].sum()), error, freedom)
    return Quantity("LCD", "lateral colour in the corner", *interval, "px", LATERAL_SECTION)


def _half(shape: tuple[int, int]) -> Float64Array:
    """Return half the columns and rows of an image, (x, y)."""
    wanted = "(rows, columns) of the image"
    rows, columns = require_pair("shape", shape, wanted)
    for count in (rows, columns):
        require("shape", count, 2, 1e6, wanted)
    return np.array([columns, rows]) / 2


def _pair(
    name: str, points: ArrayLike, other_name: str, others: ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Return two arrays (N, 2) of the same points. Raises InputError."""
    wanted = f"x and y (N, 2) of at least {POINTS_MIN} points"
    pair = finite_numbers(name, points, wanted), finite_numbers(other_name, others, wanted)
    for title, array in zip((name, other_name), pair, strict=True):
        alike = array.shape == pair[0].shape and array.ndim == 2 and array.shape[1:] == (2,)
        if not alike or len(array) < POINTS_MIN:
            raise InputError(f"{title} has shape {array.shape}; pass {wanted}.")
        if np.linalg.matrix_rank(array - array.mean(axis=0)) < 2:
            raise InputError(
                f"{title} has all points on a line; pass points from the whole image."
            )
    return pair
