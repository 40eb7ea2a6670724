"""The edge spread function: a cubic spline of the distance from the edge, fitted to all pixels, and its transform.

ISO 12233 puts pixels into bins of a quarter of a pixel. A spline with knots as dense has no error of pixels that do not
lie in the middle of their bin, takes any direction of the edge, and its errors are known: what the noise of each pixel
changes in the result is kept (its influence), and the sum of the squares of these is the variance. It needs no model of
the noise, but takes the noise of pixels as independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ....core import InputError
from ....core.types import Float64Array
from .edge_line import EdgeLine

KNOT_PX = 0.25
"""Distance of the knots, the bins of ISO 12233."""
HALF_WIDTH_PX = 24.0
"""Of the edge spread function, at most."""
SMALLEST_HALF_WIDTH_PX = 6.0
LARGEST_GAP_PX = 0.4
"""Between the distances of pixels near the edge; edges along diagonals of few pixels have larger ones."""
TAPER = 0.5
"""Share of the line spread function that the cosine of the window of ISO 12233:2023 (Tukey's) reaches."""
SMOOTHING = 1e-6
"""Weight of third differences over that of the pixels, for knots between which there is none."""
STEPS = 4
DEGREE = 3
FINE = 16
"""Points of each knot interval at which the window and the waves are evaluated."""


class Samples(NamedTuple):
    """Values, x and y of all pixels, flat; y is 0 in the middle."""

    values: Float64Array
    x: Float64Array
    y: Float64Array


@dataclass(frozen=True, eq=False)
class EdgeSpread:
    """A fitted spline.

    line : the edge, fitted with it.  knots, coefficients : of the spline.
    inside : (N,) which pixels are near the edge.  basis : sparse, of these pixels.
    moves : (n, order) what a move of the edge by each power of y changes.
    inverse : of the normal equations, (K, K + order).
    residual : of the pixels inside.
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
        """The spline is fitted up to this distance on either side."""
        return float(self.knots[-1 - DEGREE])

    def at(self, distance_px: Float64Array) -> Float64Array:
        """The edge spread function at distances from the edge."""
        spline = scipy.interpolate.BSpline(self.knots, self.coefficients, DEGREE)
        return np.asarray(spline(distance_px))

    def transform(self, frequency: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Transform of the windowed line spread function, complex, (F,), and the weight of every pixel in it, (n, F).

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
    """Fit the spline and the edge together (Gauss and Newton); raises InputError for edges it cannot resolve."""
    knots = _knots(line.distance(samples.x, samples.y))
    order = len(line.coefficients) - 1
    scale = max(float(np.ptp(samples.y)), 1.0)
    for _ in range(STEPS):
        spread = _fit_spline(samples, line, knots, scale)
        shift = spread.solution[len(knots) - DEGREE - 1 :] / scale ** np.arange(1, order + 1)
        line = line.moved(-shift)
    size = len(knots) - DEGREE - 1
    coefficients = spread.solution[:size]
    residual = samples.values[spread.inside] - spread.basis @ coefficients
    return EdgeSpread(
        line,
        knots,
        coefficients,
        spread.inside,
        spread.basis,
        spread.moves,
        spread.inverse[:size],
        residual,
    )


class _Normal(NamedTuple):
    """Solution of the normal equations of one step, and what they were made of."""

    solution: Float64Array
    inside: NDArray[np.bool_]
    basis: scipy.sparse.csr_array
    moves: Float64Array
    inverse: Float64Array


def _fit_spline(samples: Samples, line: EdgeLine, knots: Float64Array, scale: float) -> _Normal:
    """Least squares of the spline and of small moves of the edge."""
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
    powers = (samples.y[inside] / scale)[:, None] ** np.arange(1, len(line.coefficients))
    moves = first.derivative()(near)[:, None] * powers
    mixed = basis.T @ moves
    whole = np.block([[square, mixed], [mixed.T, moves.T @ moves]])
    inverse = np.linalg.inv(whole)
    solution = inverse @ np.concatenate([right, moves.T @ values])
    return _Normal(solution, inside, basis, moves, inverse)


def _knots(distance: Float64Array) -> Float64Array:
    """Knots over what the picture has on both sides; raises InputError where that is too little, or has gaps."""
    reach = -np.quantile(distance, 0.02), np.quantile(distance, 0.98)
    half = min(HALF_WIDTH_PX, *reach)
    if half < SMALLEST_HALF_WIDTH_PX:
        raise InputError(
            f"the picture has {max(half, 0):.1f} pixels beside its edge; pass one with "
            f"{SMALLEST_HALF_WIDTH_PX:g} or more on each side, better {HALF_WIDTH_PX:g}."
        )
    near = np.sort(distance[np.abs(distance) < 0.5 * half])
    gap = float(np.diff(near).max())
    if gap > LARGEST_GAP_PX:
        raise InputError(
            f"distances of the pixels from the edge have gaps of {gap:.2f} pixels, more than {LARGEST_GAP_PX:g}: the "
            "edge lies along the rows, the columns or a diagonal; turn it by some degrees, or pass a longer edge."
        )
    count = int(2 * half / KNOT_PX)
    ends = KNOT_PX * (np.arange(-DEGREE, count + DEGREE + 1) - count / 2)
    return np.asarray(ends)
