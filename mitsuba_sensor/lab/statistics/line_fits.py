"""Straight lines by least squares: through the origin, and with an offset; and whether the points lie on one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from ...core.types import Float64Array
from ..quantity import normal_interval, student_interval

CURVED_FALSE_ALARM = 0.01
"""Share of the straight lines that are said to be curved."""
UNSURE_FALSE_ALARM = 0.2
"""Share of the straight lines whose interval is extended, because a curvature that noise hides would shift the slope by
more than its own standard error. It raises the coverage of the interval by about half a per cent."""
SCATTER_FALSE_ALARM = 1e-3
"""Share of the lines whose points are said to scatter more than their covariance explains although they do not."""
CROOKED = 0.01
"""Probability of a larger scatter, below which points are said not to lie on a line with an offset."""


@dataclass(frozen=True)
class LineThroughOrigin:
    """Slope with its interval, the slope at zero of a parabola with its interval, and what was found.

    initial : (value, low, high) at zero; NaN where there are fewer than 3 points.
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
        """What restricts the slope, or nothing."""
        found = []
        if self.curved:
            value, low, high = self.initial
            found.append(
                f"not straight: the slope at zero is {value:.4g} ({low:.4g} to {high:.4g}), inside the interval"
            )
        elif self.unsure:
            found.append("the interval is extended, since the points may be curved")
        if self.scattered:
            found.append(
                "the points scatter more than noise explains; the interval is as much wider"
            )
        return "; ".join(found)


def line_through_origin(
    x: Float64Array, y: Float64Array, covariance: Float64Array
) -> LineThroughOrigin:
    """y = a·x for (n,) points, n at least 1, by generalised least squares.

    A parabola through the origin is fitted too. Where it may be curved, the interval is extended to hold its slope at
    zero, so that a response that is not linear widens what is said of a.
    """
    slope, error, chi2 = _fit(x[:, None], y, covariance)
    freedom = len(x) - 1
    initial = (math.nan, math.nan, math.nan)
    curvature = 0.0
    if len(x) > 2:
        scale = float(np.abs(x).max())
        both, errors, chi2_curved = _fit(np.stack([x, x**2 / scale], axis=1), y, covariance)
        worse = max(1.0, chi2_curved / (len(x) - 2)) if len(x) > 5 else 1.0
        curvature = abs(both[1]) / errors[1] / math.sqrt(worse)
        initial = normal_interval(both[0], errors[0] * math.sqrt(worse))
    scattered = freedom > 0 and chi2 > float(scipy.special.chdtri(freedom, SCATTER_FALSE_ALARM))
    interval = normal_interval(slope[0], error[0])
    if scattered:
        interval = student_interval(slope[0], error[0] * math.sqrt(chi2 / freedom), freedom)
    low, high = interval[1:]
    curved, unsure = (
        curvature > -float(scipy.special.ndtri(share / 2))
        for share in (CURVED_FALSE_ALARM, UNSURE_FALSE_ALARM)
    )
    if unsure:
        reach = 1.0 if curved else 0.5  # two standard errors beyond the slope at zero, or one
        low = min(low, initial[0] - reach * (initial[0] - initial[1]))
        high = max(high, initial[0] + reach * (initial[2] - initial[0]))
    return LineThroughOrigin(
        slope[0], low, high, initial, curved, unsure and not curved, scattered
    )


def _fit(
    basis: Float64Array, y: Float64Array, covariance: Float64Array
) -> tuple[list[float], list[float], float]:
    """Coefficients, their standard errors, and chi-square."""
    white = np.linalg.cholesky(covariance)
    whitened = scipy.linalg.solve_triangular(white, np.column_stack([basis, y]), lower=True)
    inverse = np.linalg.pinv(whitened[:, :-1].T @ whitened[:, :-1])
    found = inverse @ (whitened[:, :-1].T @ whitened[:, -1])
    rest = whitened[:, -1] - whitened[:, :-1] @ found
    return (
        [float(one) for one in found],
        [float(one) for one in np.sqrt(np.diag(inverse))],
        float(rest @ rest),
    )


@dataclass(frozen=True)
class StraightLine:
    """offset + slope·x, of weighted least squares.

    slope_error : standard error.  freedom : degrees of freedom that it comes from, infinite where the errors are known.
    crooked : the points scatter by more than their errors; the standard error then comes from the scatter.
    """

    slope: float
    offset: float
    slope_error: float
    freedom: float
    crooked: bool

    @property
    def interval(self) -> tuple[float, float, float]:
        """(value, low, high) of the slope."""
        if math.isinf(self.freedom):
            return normal_interval(self.slope, self.slope_error)
        return student_interval(self.slope, self.slope_error, self.freedom)

    @property
    def note(self) -> str:
        """What to say of the points."""
        return (
            "the points do not lie on a straight line, which widens the interval"
            if self.crooked
            else ""
        )


def straight_line(
    x: Float64Array, y: Float64Array, error: Float64Array, freedom: float = math.inf
) -> StraightLine:
    """Through 2 points or more.  error : of y, with so many degrees of freedom; NaN where nobody knows.

    Without known errors all points weigh the same, and 2 points give a slope without an interval.
    """
    known = bool(np.isfinite(error).all() and (error > 0).all())
    weight = 1 / error**2 if known else np.ones(len(x))
    total = weight.sum()
    centre = float(weight @ x / total)
    power = float(weight @ (x - centre) ** 2)
    slope = float(weight @ ((x - centre) * y)) / power
    offset = float(weight @ y / total) - slope * centre
    scatter, free = float(weight @ (y - offset - slope * x) ** 2), len(x) - 2
    crooked = known and free > 0 and float(scipy.special.chdtrc(free, scatter)) < CROOKED
    if known and not crooked:
        return StraightLine(slope, offset, power**-0.5, freedom, False)
    spread = math.sqrt(scatter / free / power) if free else math.inf
    return StraightLine(slope, offset, spread, max(free, 1), crooked)
