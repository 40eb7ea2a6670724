"""Interval of the noncentrality of a χ² law: what a sum of squares of normal values has beside their noise."""

from __future__ import annotations

import numpy as np
import scipy

from ...core.types import Float64Array
from ..quantity import LEVEL

SMALLEST = 1e-9
"""Noncentrality below which it is 0: the inverse ends at rounding, or NaN, where none is so small."""


def noncentrality_interval(
    square: Float64Array, freedom: int
) -> tuple[Float64Array, Float64Array]:
    """(low, high): noncentralities at which so large a sum of squares, or so small a one, is as rare as the tail.

    square : sums of squares over the variance of each value.  freedom : how many values each has.
    """
    tail = (1 - LEVEL) / 2
    ends = [scipy.special.chndtrinc(square, freedom, share) for share in (1 - tail, tail)]
    low, high = (np.where(end > SMALLEST, end, 0.0) for end in ends)
    return low, high
