"""Straight lines by least squares, through the origin and with an offset, with tests of straightness."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from ...core.types import Float64Array
from ..quantity import normal_interval, student_interval

CURVED_FALSE_ALARM = 0.01
"""Fraction of straight lines that are reported as curved."""
UNSURE_FALSE_ALARM = 0.2
"""Fraction of straight lines whose interval is extended, because a hidden curvature would shift the slope by more than
its standard error. The extension raises the coverage by about 0.5 %."""
SCATTER_FALSE_ALARM = 1e-3
"""Fraction of lines whose points are wrongly reported to scatter more than their covariance explains."""
CROOKED = 0.01
"""Probability of a larger scatter below which points are reported to be off a line with an offset."""


@dataclass(frozen=True)
class LineThroughOrigin:
    """Slope with its interval, and results of the tests.

    initial : (value, low, high) of the slope at zero of a parabola; NaN for fewer than 3 points.
    curved, unsure : the points are, or may be, curved.  scattered : they scatter more than their covariance explains.
    """

    slope: float
    low: float
    high: float
    initial: tuple[float, float, float]
    curved: bool
    unsure: bool
    scattered: bool

    @property
    def note(self) -> str:
        """Remarks on the slope, or an empty text."""
        notes = []
        if self.curved:
            value, low, high = self.initial
            notes.append(
                f"not straight: the slope at zero is {value:.4g} ({low:.4g} to {high:.4g}), within the interval"
            )
        elif self.unsure:
            notes.append("the interval is extended, because the points may be curved")
        if self.scattered:
            notes.append(
                "the points scatter more than noise explains, which widens the interval"
            )
        return "; ".join(notes)


def line_through_origin(
    x: Float64Array, y: Float64Array, covariance: Float64Array
) -> LineThroughOrigin:
    """Fit y = a·x to at least one point by generalised least squares; x and y of shape (n,).

    A parabola through the origin is fitted alongside. If the points may be curved, the interval is extended to its
    slope at zero.
    """
    slope, error, chi2 = _fit(x[:, None], y, covariance)
    freedom = len(x) - 1
    initial = (math.nan, math.nan, math.nan)
    curvature = 0.0
    if len(x) > 2:
        scale = float(np.abs(x).max())
        both, errors, chi2_curved = _fit(np.stack([x, x**2 / scale], axis=1), y, covariance)
        worse = 1.0
        if len(x) > 5:
            worse = max(1.0, chi2_curved / (len(x) - 2))
        curvature = abs(both[1]) / errors[1] / math.sqrt(worse)
        initial = normal_interval(both[0], errors[0] * math.sqrt(worse))
    _, low, high = normal_interval(slope[0], error[0])
    scattered = freedom > 0 and chi2 > float(scipy.special.chdtri(freedom, SCATTER_FALSE_ALARM))
    if scattered:
        wider = error[0] * math.sqrt(chi2 / freedom)
        _, low, high = student_interval(slope[0], wider, freedom)
    curved = curvature > _two_sided_limit(CURVED_FALSE_ALARM)
    unsure = curvature > _two_sided_limit(UNSURE_FALSE_ALARM)
    if unsure:
        reach = 1.0 if curved else 0.5  # two standard errors outside the slope at zero, or one
        low = min(low, initial[0] - reach * (initial[0] - initial[1]))
        high = max(high, initial[0] + reach * (initial[2] - initial[0]))
    return LineThroughOrigin(
        slope[0], low, high, initial, curved, unsure and not curved, scattered
    )


def _two_sided_limit(false_alarm: float) -> float:
    """Return the absolute normal value that is exceeded with this probability."""
    return -float(scipy.special.ndtri(false_alarm / 2))


def _fit(
    basis: Float64Array, y: Float64Array, covariance: Float64Array
) -> tuple[list[float], list[float], float]:
    """Return coefficients, their standard errors, and chi-square."""
    cholesky = np.linalg.cholesky(covariance)
    white = scipy.linalg.solve_triangular(cholesky, np.column_stack([basis, y]), lower=True)
    white_basis, white_y = white[:, :-1], white[:, -1]
    inverse = np.linalg.pinv(white_basis.T @ white_basis)
    coefficients = inverse @ (white_basis.T @ white_y)
    rest = white_y - white_basis @ coefficients
    errors = np.sqrt(np.diag(inverse))
    return coefficients.tolist(), errors.tolist(), float(rest @ rest)


@dataclass(frozen=True)
class StraightLine:
    """Line offset + slope·x by weighted least squares.

    slope_error, offset_error : standard errors.  freedom : their degrees of freedom, infinite for exact errors.
    crooked : True if the points scatter by more than their errors, so the standard errors come from the scatter.
    """

    slope: float
    offset: float
    slope_error: float
    offset_error: float
    freedom: float
    crooked: bool

    @property
    def interval(self) -> tuple[float, float, float]:
        """(value, low, high) of the slope."""
        return self._interval(self.slope, self.slope_error)

    @property
    def offset_interval(self) -> tuple[float, float, float]:
        """(value, low, high) of the offset."""
        return self._interval(self.offset, self.offset_error)

    def _interval(self, value: float, error: float) -> tuple[float, float, float]:
        if math.isinf(self.freedom):
            return normal_interval(value, error)
        return student_interval(value, error, self.freedom)

    @property
    def note(self) -> str:
        """Remark on the slope, or an empty text."""
        return (
            "the points are not on a straight line, which widens the interval"
            if self.crooked
            else ""
        )


def straight_line(
    x: Float64Array, y: Float64Array, error: Float64Array, freedom: float = math.inf
) -> StraightLine:
    """Fit a line to at least 2 points by weighted least squares.

    error : standard errors of y with this many degrees of freedom; NaN if unknown.

    With unknown errors all points have equal weights, and 2 points give a slope without an interval.
    """
    errors_known = bool(np.isfinite(error).all() and (error > 0).all())
    weight = 1 / error**2 if errors_known else np.ones(len(x))
    total = weight.sum()
    centre = float(weight @ x / total)
    power = float(weight @ (x - centre) ** 2)
    slope = float(weight @ ((x - centre) * y)) / power
    offset = float(weight @ y / total) - slope * centre
    scatter, free = float(weight @ (y - offset - slope * x) ** 2), len(x) - 2
    crooked = errors_known and free > 0 and float(scipy.special.chdtrc(free, scatter)) < CROOKED
    slope_error, offset_error = power**-0.5, math.sqrt(1 / total + centre**2 / power)
    if errors_known and not crooked:
        return StraightLine(slope, offset, slope_error, offset_error, freedom, False)
    wider = math.sqrt(scatter / free) if free else math.inf
    ends = slope_error * wider, offset_error * wider
    return StraightLine(slope, offset, *ends, max(free, 1), crooked)
