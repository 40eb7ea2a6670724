"""Estimates: medians and ratios of times, standard errors, limits of many comparisons, noncentral χ² intervals."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable
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


def standard_error(values: Float64Array) -> float:
    """Standard error of the mean of independent values."""
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def z_limit(comparisons: int, false_alarm: float = 0.01) -> float:
    """|z| that none of so many right independent comparisons exceeds, but in this share of all studies."""
    return float(
        -scipy.special.ndtri(0.5 * (1 - (1 - false_alarm) ** (1 / max(comparisons, 1))))
    )


def noncentrality_interval(
    square: Float64Array, freedom: int
) -> tuple[Float64Array, Float64Array]:
    """(low, high): noncentralities at which so large a sum of squares, or so small a one, is as rare as the tail.

    square : sums of squares over the variance of each value.  freedom : how many values each has.
    """
    ends = [scipy.special.chndtrinc(square, freedom, share) for share in (0.975, 0.025)]
    low, high = (np.where(end > SMALLEST_NONCENTRALITY, end, 0.0) for end in ends)
    return low, high
