"""Estimates with intervals: medians and ratios of times, slopes of runs, Pareto fronts, limits of many comparisons."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ...core.types import Float64Array

SMALLEST_NONCENTRALITY = 1e-9
"""Noncentrality below which it is 0: the inverse ends at rounding, or NaN, where none is so small."""


class Spread(NamedTuple):
    """Median of what two turns or more gave, between the quartiles."""

    low: float
    median: float
    high: float


def spread(values: Iterable[float]) -> Spread:
    """Median and quartiles of the values of turns."""
    return Spread(*statistics.quantiles(values, n=4, method="inclusive"))


def ratio(slow: Iterable[float], fast: Iterable[float]) -> float:
    """How many times as fast the second is: the median of the turns' own ratios, whose times lie next to each other."""
    pairs = zip(slow, fast, strict=True)
    return statistics.median(slow_s / fast_s for slow_s, fast_s in pairs)


class Slope(NamedTuple):
    """d log y / d log x: the mean of the runs' own slopes, and half the width of its 95 % interval (Student's t)."""

    value: float
    half_width: float


def slope_of_runs(runs: Iterable[tuple[Sequence[float], Sequence[float]]]) -> Slope:
    """Least squares in 2 or more runs of (x, y); points of one run share samples, so its residuals give no interval."""
    slopes = np.array([np.polyfit(np.log(x), np.log(y), 1)[0] for x, y in runs])
    t = float(scipy.special.stdtrit(len(slopes) - 1, 0.975))
    return Slope(float(slopes.mean()), t * standard_error(slopes))


def standard_error(values: Float64Array) -> float:
    """Standard error of the mean of independent values."""
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def pareto(points: Sequence[tuple[float, float]]) -> tuple[int, ...]:
    """Indices of the points that no other beats (as small in both, smaller in one), by x; of equal ones all, no NaN."""
    numbers = [i for i, point in enumerate(points) if not np.isnan(point).any()]
    front: list[int] = []
    for i in sorted(numbers, key=lambda i: points[i]):
        if not front or points[i][1] < points[front[-1]][1] or points[i] == points[front[-1]]:
            front.append(i)
    return tuple(front)


def z_limit(comparisons: int, false_alarm: float = 0.01) -> float:
    """|z| that none of so many right independent comparisons exceeds, but in this share of all studies."""
    return float(
        -scipy.special.ndtri(0.5 * (1 - (1 - false_alarm) ** (1 / max(comparisons, 1))))
    )


def as_normal(t: float, freedom: int) -> float:
    """The standard normal that is as unlikely as this Student's t."""
    if not t:
        return 0.0
    tail = max(scipy.special.stdtr(freedom, -abs(t)), 1e-300)
    return math.copysign(-float(scipy.special.ndtri(tail)), t)


def noncentrality_interval(
    square: Float64Array, freedom: int
) -> tuple[Float64Array, Float64Array]:
    """(low, high): noncentralities at which so large a sum of squares, or so small a one, is as rare as the tail.

    square : sums of squares over the variance of each value.  freedom : how many values each has.
    """
    ends = [scipy.special.chndtrinc(square, freedom, share) for share in (0.975, 0.025)]
    low, high = (np.where(end > SMALLEST_NONCENTRALITY, end, 0.0) for end in ends)
    return low, high
