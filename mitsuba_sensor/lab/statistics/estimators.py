"""Estimates: medians and ratios of times, standard errors, limits of many comparisons, noncentral χ² intervals."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array

SMALLEST_NONCENTRALITY = 1e-9
"""Smaller noncentralities are set to 0: the inverse ends at rounding errors or NaN."""


class Spread(NamedTuple):
    """Quartiles of the values of repetitions."""

    low: float
    median: float
    high: float


def spread(values: Iterable[float]) -> Spread:
    """Return median and quartiles of at least two values."""
    return Spread(*statistics.quantiles(values, n=4, method="inclusive"))


def ratio(slow: Iterable[float], fast: Iterable[float]) -> float:
    """Return the median ratio of times that were measured in pairs."""
    pairs = zip(slow, fast, strict=True)
    return statistics.median(slow_s / fast_s for slow_s, fast_s in pairs)


def standard_error(values: Float64Array) -> float:
    """Return the standard error of the mean of independent values."""
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def require_probability(false_alarm: float) -> None:
    """Raise InputError for a probability that is not between 0 and 1."""
    if not 0 < false_alarm < 1:
        raise InputError(f"false_alarm is {false_alarm!r}; pass a probability between 0 and 1.")


def z_limit(comparisons: int, false_alarm: float = 0.01) -> float:
    """Return the |z| that one of this many correct independent comparisons exceeds with this probability."""
    return float(
        -scipy.special.ndtri(0.5 * (1 - (1 - false_alarm) ** (1 / max(comparisons, 1))))
    )


def noncentrality_interval(
    square: Float64Array, freedom: int
) -> tuple[Float64Array, Float64Array]:
    """Return (low, high) noncentralities at which a sum of squares this large, or this small, has probability 2.5 %.

    square : sums of squares over the variance of each value.  freedom : number of values of each sum.
    """
    ends = [scipy.special.chndtrinc(square, freedom, share) for share in (0.975, 0.025)]
    low, high = (np.where(end > SMALLEST_NONCENTRALITY, end, 0.0) for end in ends)
    return low, high
