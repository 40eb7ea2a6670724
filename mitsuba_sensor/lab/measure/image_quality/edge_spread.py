"""Position of an edge in an image, uneven light about it, and its edge spread function.

The edge spread is a cubic spline of the distance from the edge, fitted to all pixels; its transform is the MTF.

ISO 12233 sorts pixels into bins of a quarter of a pixel. A spline with equally dense knots has no error from pixels off
the middle of their bin, works for any direction of the edge, and has known errors: the influence of each pixel's noise
on the result is kept, and the sum of the squared influences is the variance. This needs no noise model, but assumes
independent noise.

Uneven light is a polynomial of position that both sides share: far from the edge the image is level·(1 + polynomial).
Light that a lens spreads falls as 1/d with the distance from the edge, with opposite signs on both sides; it is also
fitted, and stays in the image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ....core import InputError
from ....core.types import Float64Array

KNOT_PX = 0.25
"""Distance of the knots, the bin width of ISO 12233."""
HALF_WIDTH_PX = 24.0
"""Largest half-width of the edge spread function."""
HALF_WIDTH_MIN_PX = 6.0
GAP_MAX_PX = 0.4
"""Largest gap between distances of pixels near the edge; edges along diagonals have larger gaps."""
TAPER = 0.5
"""Tapered fraction of the line spread function in the Tukey window of ISO 12233:2023."""
SMOOTHING = 1e-6
"""Weight of third differences relative to the pixels, for knots without pixels in between."""
STEPS = 4
DEGREE = 3
FINE = 16
"""Number of points of each knot interval at which the window and the waves are evaluated."""
WIDTHS_PX = (16.0, 8.0, 6.0, 4.0, 4.0, 4.0)
"""Widths of successive normal windows about the edge, which reduce noise far from the edge."""
FAR_PX = 8.0
"""Distance from the edge from which on pixels show the light of their side."""


class Upright(NamedTuple):
    """An image turned so its edge is nearer to the columns and its bright side is on the right."""

    picture: Float64Array
    transposed: bool
    mirrored: bool

    def turn(self, picture: Float64Array) -> Float64Array:
        """Return another image of the same pixels, turned in the same way."""
        if self.transposed:
            picture = picture.T
        if self.mirrored:
            picture = picture[:, ::-1]
        return picture


def upright(picture: Float64Array) -> Upright:
    """Turn an image by the differences of its sides, which an edge causes along its normal."""
    across, along = _side_differences(picture)
    transposed = abs(along) > abs(across)
    if transposed:
        across = along
    mirrored = across < 0
    turned = Upright(picture, transposed, mirrored)
    return turned._replace(picture=turned.turn(picture))


def _side_differences(picture: Float64Array) -> tuple[float, float]:
    """Return the sum of the last minus the first column, and of the last minus the first row."""
    across = float((picture[:, -1] - picture[:, 0]).sum())
    return across, float((picture[-1] - picture[0]).sum())


@dataclass(frozen=True, eq=False)
class EdgeLine:
    """The edge of an upright image.

    coefficients : of x [px] as a polynomial of y [px], lowest power first; y is 0 in the middle.
    """

    coefficients: Float64Array

    @property
    def angle_deg(self) -> float:
        """Angle of the edge from the columns in the middle; positive if it moves to the right from top to bottom."""
        return math.degrees(math.atan(self.coefficients[1]))

    def distance(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the distance of points from the edge, positive on its right [px]."""
        polynomial = np.polynomial.Polynomial(self.coefficients)
        slope = polynomial.deriv()(y)
        return np.asarray((x - polynomial(y)) / np.hypot(1, slope))

    def moved(self, shift_px: Float64Array) -> EdgeLine:
        """Return the edge moved along its normal.  shift_px : coefficients of a polynomial of y."""
        along_x = shift_px * math.hypot(1, self.coefficients[1])
        return EdgeLine(self.coefficients + np.concatenate([[0.0], along_x]))


def middles(shape: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    """Return x and y of the centre of each pixel, flat; y is 0 in the middle of the image."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5 - rows / 2)
    return x.ravel(), y.ravel()


def find_line(picture: Float64Array, order: int) -> EdgeLine:
    """Find the edge of an upright image as a line. Raises InputError if there is none.

    order : order of the returned polynomial, whose higher coefficients are 0.
    """
    steps = picture[1:, 1:] - picture[:-1, :-1], picture[:-1, 1:] - picture[1:, :-1]
    across, along = _side_differences(picture)
    size = math.hypot(across, along)
    if not size:
        raise InputError(
            "picture has no edge, its opposite sides are equally bright; pass an image with one edge."
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
            "picture has no edge that can be found; pass a part with one straight edge through its middle."
        )
    return EdgeLine(np.concatenate([line, np.zeros(order - 1)]))


class UnevenLight(NamedTuple):
    """gain : of each pixel.  shapes : powers of position, (N, k).  influence : of pixels on coefficients, (N, k)."""

    gain: Float64Array
    shapes: Float64Array
    influence: Float64Array


def fit_uneven_light(
    values: Float64Array, distance: Float64Array, x: Float64Array, y: Float64Array
) -> UnevenLight:
    """Fit a polynomial of second order.  x, y : position of each pixel, from −½ to ½."""
    shapes = np.column_stack([x, y, x**2, x * y, y**2])
    influence = np.zeros_like(shapes)
    far = np.abs(distance) > FAR_PX
    right = distance[far] > 0
    sides = np.column_stack([right, ~right]).astype(float)
    levels = np.linalg.lstsq(sides, values[far], rcond=None)[0]
    coefficients = np.zeros(shapes.shape[1])
    for _ in range(STEPS):  # Gauss–Newton, because the model is a product
        level, gain = sides @ levels, 1 + shapes[far] @ coefficients
        design = np.column_stack(
            [sides * gain[:, None], 1 / distance[far], level[:, None] * shapes[far]]
        )
        known = level * (gain - 1)
        solution = np.linalg.lstsq(design, values[far] + known, rcond=None)[0]
        residual = values[far] + known - design @ solution
        levels, coefficients = solution[:2], solution[3:]
    inverse = np.linalg.pinv(design)[3:]
    influence[far] = (inverse * residual).T
    return UnevenLight(1 + shapes @ coefficients, shapes, influence)


class Samples(NamedTuple):
    """Values and positions of all pixels, flat; y is 0 in the middle."""

    values: Float64Array
    x: Float64Array
    y: Float64Array


@dataclass(frozen=True, eq=False)
class EdgeSpread:
    """A fitted spline.

    line : fitted edge.  knots, coefficients : of the spline.  inside : mask of the pixels near the edge, (N,).
    basis : sparse basis of these pixels.  moves : derivatives by a shift of the edge by each power of y, (n, order).
    inverse : of the normal equations, (K, K + order).  residual : of the pixels near the edge.
    """

    line: EdgeLine
    knots: Float64Array
    coefficients: Float64Array
    inside: NDArray[np.bool_]
    basis: scipy.sparse.csr_array
    moves: Float64Array
    inverse: Float64Array
    residual: Float64Array

    @property
    def half_width_px(self) -> float:
        """Distance from the edge up to which the spline is fitted [px]."""
        return float(self.knots[-1 - DEGREE])

    def at(self, distance_px: Float64Array) -> Float64Array:
        """Return the edge spread function at distances from the edge."""
        spline = scipy.interpolate.BSpline(self.knots, self.coefficients, DEGREE)
        return np.asarray(spline(distance_px))

    def transform(self, frequency: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the complex transform of the windowed line spread function (F,), and the weight of each pixel (n, F).

        frequency : [cycles per pixel].
        """
        half = self.half_width_px
        count = round(2 * half / KNOT_PX) * FINE + 1
        fine = np.linspace(-half, half, count)
        spline = scipy.interpolate.BSpline(self.knots, np.eye(len(self.coefficients)), DEGREE)
        slopes = spline.derivative()(fine)
        window = scipy.signal.windows.tukey(count, TAPER) * (fine[1] - fine[0])
        waves = np.exp(-2j * np.pi * np.outer(frequency, fine)) * window
        by_coefficient = waves @ slopes
        by_solution = (by_coefficient @ self.inverse).T
        size = len(self.coefficients)
        weights = self.basis @ by_solution[:size] + self.moves @ by_solution[size:]
        return by_coefficient @ self.coefficients, weights


def fit_edge_spread(samples: Samples, line: EdgeLine) -> EdgeSpread:
    """Fit the spline and the edge together (Gauss–Newton). Raises InputError for edges that it cannot resolve."""
    knots = _knots(line.distance(samples.x, samples.y))
    for _ in range(STEPS):
        spread, shift = _fit_spline(samples, line, knots)
        line = line.moved(-shift)
    return replace(spread, line=line)


def _fit_spline(
    samples: Samples, line: EdgeLine, knots: Float64Array
) -> tuple[EdgeSpread, Float64Array]:
    """Fit the spline and a small shift of the edge by least squares, and return the coefficients of the shift."""
    distance = line.distance(samples.x, samples.y)
    half = knots[-1 - DEGREE]
    inside = np.abs(distance) < half * (1 - 1e-9)
    values, near = samples.values[inside], distance[inside]
    basis = scipy.interpolate.BSpline.design_matrix(near, knots, DEGREE)
    size = basis.shape[1]
    square = (basis.T @ basis).toarray()
    third = np.diff(np.eye(size), 3, axis=0)
    square += SMOOTHING * np.trace(square) / size * third.T @ third
    right = basis.T @ values
    first = scipy.interpolate.BSpline(knots, np.linalg.solve(square, right), DEGREE)
    scale, powers = max(float(np.ptp(samples.y)), 1.0), np.arange(1, len(line.coefficients))
    moves = first.derivative()(near)[:, None] * (samples.y[inside] / scale)[:, None] ** powers
    mixed = basis.T @ moves
    inverse = np.linalg.inv(np.block([[square, mixed], [mixed.T, moves.T @ moves]]))
    solution = inverse @ np.concatenate([right, moves.T @ values])
    coefficients = solution[:size]
    fitted = coefficients, inside, basis, moves, inverse[:size], values - basis @ coefficients
    return EdgeSpread(line, knots, *fitted), solution[size:] / scale**powers


def _knots(distance: Float64Array) -> Float64Array:
    """Return knots over the pixels on both sides. Raises InputError if these are too few or have gaps."""
    reach = -np.quantile(distance, 0.02), np.quantile(distance, 0.98)
    half = min(HALF_WIDTH_PX, *reach)
    if half < HALF_WIDTH_MIN_PX:
        raise InputError(
            f"picture has {max(half, 0):.1f} pixels beside its edge; pass at least {HALF_WIDTH_MIN_PX:g} on each side, "
            f"better {HALF_WIDTH_PX:g}."
        )
    near = np.sort(distance[np.abs(distance) < 0.5 * half])
    gap = float(np.diff(near).max())
    if gap > GAP_MAX_PX:
        raise InputError(
            f"distances of the pixels from the edge have gaps of {gap:.2f} pixels, above {GAP_MAX_PX:g}: the edge is "
            "along rows, columns or a diagonal; turn it by a few degrees, or pass a longer edge."
        )
    count = int(2 * half / KNOT_PX)
    ends = KNOT_PX * (np.arange(-DEGREE, count + DEGREE + 1) - count / 2)
    return np.asarray(ends)
