"""The operations that the stages are written in; the type of the array chooses who does them.

Stages import these and never NumPy, so that a second array type needs one new branch here and no new physics.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def floor(x: Any) -> Any:
    """Largest whole number not above ``x``."""
    return np.floor(x)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` where ``condition`` holds, else ``no``."""
    return np.where(condition, yes, no)


def sqrt(x: Any) -> Any:
    """√x."""
    return np.sqrt(x)


def exp(x: Any) -> Any:
    """e^x."""
    return np.exp(x)


def expm1(x: Any) -> Any:
    """e^x − 1 without cancellation."""
    return np.expm1(x)


def count_at_or_below(levels: Any, x: Any) -> Any:
    """How many of the sorted ``levels`` are ≤ x, as floats."""
    return np.searchsorted(np.asarray(levels), x, side="right").astype(np.float64)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of the two."""
    return np.minimum(x, y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of the two."""
    return np.maximum(x, y)


def pick(table: Any, index: Any) -> Any:
    """``table[index]``: row ``index`` of a small table for every pixel."""
    return np.asarray(table)[index]


def interpolate(x: Any, points: Any, values: Any) -> Any:
    """Linear between the points, 0 outside them."""
    return np.interp(x, points, values, left=0.0, right=0.0)


def weigh(layers: Any, weights: Any) -> Any:
    """Σ_k layers[..., k]·weights[..., k], (H, W); an infinite layer of weight 0 adds nothing."""
    return product(layers, np.asarray(weights)).sum(axis=-1)


def product(x: Any, y: Any) -> Any:
    """x·y with ∞·0 = 0: no light is no light, whatever it is multiplied by."""
    with np.errstate(invalid="ignore"):
        xy = x * y
    return np.where(np.isnan(xy), 0.0, xy)


def ratio(x: Any, y: Any, otherwise: float) -> Any:
    """x/y where y is positive and finite, else ``otherwise``."""
    good = np.isfinite(y) & (np.asarray(y) > 0)
    return np.where(good, x / np.where(good, y, 1.0), otherwise)


def table(rows: Any) -> Any:
    """A small table of Python numbers as an array."""
    return np.asarray(rows, dtype=np.float64)


def any_positive(x: Any) -> bool:
    """Whether anything in ``x`` is above zero."""
    return bool(np.any(np.asarray(x) > 0))


def index(x: Any) -> Any:
    """Whole numbers as indices."""
    return np.asarray(x).astype(np.intp)


def scalar_log(x: float) -> float:
    """ln x of a Python number, in float64."""
    return math.log(x)


def scalar_exp(x: float) -> float:
    """e^x of a Python number, in float64."""
    return math.exp(x)


def scalar_sqrt(x: float) -> float:
    """√x of a Python number, in float64."""
    return math.sqrt(x)
