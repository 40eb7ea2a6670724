"""One figure of several filters, or of several stacks, that measure the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from ..quantity import normal_interval, unknown
from .evidence import Fitted

DIFFERENT = 1e-3
"""Probability of a larger scatter, below which filters are said to differ."""


def weighted_mean(found: Sequence[Fitted]) -> Fitted:
    """By the width of their intervals; wider where they differ by more than these allow."""
    some = [one for one in found if one.known and math.isfinite(one.quantity.high)]
    if len(some) < 2:
        return some[0] if some else found[0]
    values = np.array([one.quantity.value for one in some])
    errors = np.array([one.quantity.standard_error for one in some])
    errors = np.maximum(errors, 1e-12 * np.abs(values).max() + 1e-300)
    weights = errors**-2 / (errors**-2).sum()
    mean = float(weights @ values)
    scatter = float((((values - mean) / errors) ** 2).sum())
    differ = float(scipy.special.chdtrc(len(values) - 1, scatter)) < DIFFERENT
    error = float((errors**-2).sum()) ** -0.5 * (math.sqrt(scatter / (len(values) - 1)) if differ else 1.0)
    value, low, high = normal_interval(mean, error)
    one = replace(some[0].quantity, value=value, low=low, high=high)
    one = one.noted("the filters differ by more than noise explains") if differ else one
    return Fitted(one, _frames(some))


def root_mean_square(found: Sequence[Fitted], alike: int = 1) -> Fitted:
    """Of standard deviations of equally many pixels each; distances to the ends of the intervals in quadrature.

    alike : how many of them are of the same lines, which makes the whole less certain.
    """
    if len(found) == 1:
        return found[0]
    if not all(one.known for one in found):
        return Fitted(unknown(found[0].quantity, "not known of every filter"), _frames(found))
    squares = [tuple(x**2 for x in (q.value, q.low, q.high)) for q in (one.quantity for one in found)]
    value = sum(one[0] for one in squares) / len(squares)
    down = math.sqrt(alike * sum((one[0] - one[1]) ** 2 for one in squares)) / len(squares)
    up = math.sqrt(alike * sum((one[2] - one[0]) ** 2 for one in squares)) / len(squares)
    middle, low, high = (math.sqrt(max(one, 0.0)) for one in (value, value - down, value + up))
    return Fitted(replace(found[0].quantity, value=middle, low=low, high=high), _frames(found))


def _frames(some: Sequence[Fitted]) -> str:
    """Filters of one mosaic come from the same files."""
    return "; ".join(dict.fromkeys(one.frames for one in some))
