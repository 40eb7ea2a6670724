"""Straight line through points with known standard errors, and whether they lie on one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from .quantity import normal_interval, student_interval

Float64Array = NDArray[np.float64]
CROOKED = 0.01
"""Probability of a larger scatter, below which points are said not to lie on a straight line."""


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
        return "the points do not lie on a straight line, which widens the interval" if self.crooked else ""


def straight_line(x: Float64Array, y: Float64Array, error: Float64Array, freedom: float = math.inf) -> StraightLine:
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
