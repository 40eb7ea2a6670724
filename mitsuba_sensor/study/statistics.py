"""Estimates with intervals: means and slopes of independent runs, Pareto fronts, limits of what chance explains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr, stdtrit

from ..core import InputError

Array = NDArray[np.float64]
Numbers = NDArray[Any]  # of any type, digital numbers for example
Values = dict[str, Any]  # measured values by name
Known = Mapping[str, Any]  # the same for reading


class Slope(NamedTuple):
    """d log y / d log x: the mean of the runs' own slopes, and half the width of its 95 % interval (Student's t)."""

    value: float
    half_width: float
    runs: int

    def within(self, theory: float, distance: float) -> bool:
        """Whether the slope lies no farther than ``distance`` from theory."""
        return abs(self.value - theory) <= distance


def log_slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of the straight line of least squares through (log x, log y)."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def mean_of_runs(values: Sequence[float]) -> tuple[float, float]:
    """Mean of independent runs, and half the width of its 95 % interval. Raises InputError for fewer than two runs."""
    count = len(values)
    if count < 2:
        raise InputError(f"there is {count} run; an interval needs at least 2.")
    return float(np.mean(values)), float(stdtrit(count - 1, 0.975)) * standard_error(np.array(values))


def slope_of_runs(runs: Sequence[tuple[Sequence[float], Sequence[float]]]) -> Slope:
    """Slope of independent runs of (x, y); points of one run share samples, so its residuals give no interval."""
    return Slope(*mean_of_runs([log_slope(x, y) for x, y in runs]), len(runs))


def pareto(points: Sequence[tuple[float, float]]) -> tuple[int, ...]:
    """Indices of the points that no other beats (as small in both, smaller in one), by x; of equal ones all, no NaN."""
    front: list[int] = []
    for i in sorted((i for i, point in enumerate(points) if not np.isnan(point).any()), key=lambda i: points[i]):
        if not front or points[i][1] < points[front[-1]][1] or points[i] == points[front[-1]]:
            front.append(i)
    return tuple(front)


def standard_error(values: Array) -> float:
    """Of the mean of independent values."""
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def t_limit(freedom: int, false_alarm: float, comparisons: int) -> float:
    """|t| that none of so many right comparisons exceeds, but in this share of all studies (Student, Bonferroni)."""
    return float(stdtrit(freedom, 1 - false_alarm / (2 * comparisons)))


def z_limit(comparisons: int, false_alarm: float = 0.01) -> float:
    """|z| that none of so many right independent comparisons exceeds, but in this share of all studies."""
    return float(-ndtri(0.5 * (1 - (1 - false_alarm) ** (1 / max(comparisons, 1)))))


def as_normal(t: float, freedom: int) -> float:
    """The standard normal that is as unlikely as this Student's t."""
    return math.copysign(-float(ndtri(max(stdtr(freedom, -abs(t)), 1e-300))), t) if t else 0.0
