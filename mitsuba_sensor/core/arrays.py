"""The operations that the stages are written in; the type of the array chooses who does them.

Stages import these and never NumPy or Dr.Jit, so the physics is written once. On float32 every operation that touches
a pixel is one of + − × ÷ √ floor, a comparison or a move of bits, each of which IEEE 754 rounds in one way only: that
is why NumPy and Dr.Jit-LLVM deliver the same bytes. No fused multiply-add, no library logarithm. (Dr.Jit takes what is
below 1.2e-38 for 0; nothing in a chain comes near.)
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

_HOST = (np.ndarray, np.generic, float, int)


def on_host(*values: Any) -> bool:
    """Whether NumPy does the arithmetic with these: none of them is a Dr.Jit array."""
    for x in values:  # noqa: SIM110  (a kernel asks this a thousand times while it is traced)
        if not isinstance(x, _HOST):
            return False
    return True


def _drjit() -> Any:
    """Dr.Jit, which is there already where one of its arrays is."""
    return sys.modules["drjit"]


def _single(x: Any) -> bool:
    """Whether ``x`` is computed in float32."""
    return not on_host(x) or getattr(x, "dtype", None) == np.float32


def floor(x: Any) -> Any:
    """Largest whole number not above ``x``."""
    return np.floor(x) if on_host(x) else _drjit().floor(x)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` where ``condition`` holds, else ``no``."""
    return np.where(condition, yes, no) if on_host(condition, yes, no) else _drjit().select(condition, yes, no)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of the two."""
    return np.minimum(x, y) if on_host(x, y) else _drjit().select(x < y, x, y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of the two."""
    return np.maximum(x, y) if on_host(x, y) else _drjit().select(x > y, x, y)


def along(line: Callable[[Any, Any], Any], function: Callable[[Any], Any], x: Any) -> Any:
    """``function(x)``; where derivatives are asked for, it has those of ``line(x, function(x))`` instead of its own."""
    if on_host(x) or not _drjit().grad_enabled(x):
        return function(x)
    value = function(_drjit().detach(x))
    return _drjit().replace_grad(value, line(x, value))


def sqrt(x: Any) -> Any:
    """√x; its derivative at 0 is taken for 0."""
    return np.sqrt(x) if on_host(x) else along(lambda x, y: where(y > 0, x * (0.5 / y), 0.0), _drjit().sqrt, x)


def exp(x: Any) -> Any:
    """e^x."""
    return along(lambda x, y: x * y, _exp, x) if _single(x) else np.exp(x)


def expm1(x: Any) -> Any:
    """e^x − 1 without cancellation."""
    return along(lambda x, y: x * (y + 1.0), _expm1, x) if _single(x) else np.expm1(x)


LN2_HIGH, LN2_LOW = 0.693359375, -2.12194440e-4
"""ln 2 in two parts; the first has ten bits, so that its multiples are exact in float32 (Cody & Waite 1980)."""

EXP_TAIL = (0.5000000096, 0.1666651817, 0.0416662037, 0.008368969906, 0.001395063153)
"""(e^r − 1 − r)/r² for |r| ≤ ½ln 2, to 4e-9: from benchmarks/fit_quantiles.py."""


def _exp(x: Any) -> Any:
    fraction, power = _exponential(x)
    return fraction * power + power


def _expm1(x: Any) -> Any:
    fraction, power = _exponential(x)
    return fraction * power + (power - 1.0)


def _exponential(x: Any) -> tuple[Any, Any]:
    """(e^r − 1, 2^n) with x = r + n·ln 2, in float32, for x from −69 to 88; beyond, as at these ends.

    Further down a part of the result would be subnormal, which Dr.Jit takes for 0 and NumPy does not.
    """
    x = minimum(maximum(x, -69.0), 88.0)
    n = floor(x * (1 / math.log(2)) + 0.5)
    r = (x - n * LN2_HIGH) - n * LN2_LOW
    return r + (r * r) * polynomial(r, EXP_TAIL), of_bits((whole(n) + 127) << 23)


def polynomial(x: Any, coefficients: Sequence[float]) -> Any:
    """Σ_k c_k·x^k by Estrin's scheme: pairs first, so that a processor can do several at once."""
    terms: list[Any] = list(coefficients)
    while True:
        pairs = [_sum(terms[i + 1] * x, terms[i]) for i in range(0, len(terms) - 1, 2)]
        terms = pairs + terms[2 * len(pairs) :]
        if len(terms) == 1:
            return terms[0]
        x = x * x


def _sum(fresh: Any, y: Any) -> Any:
    """fresh + y, in the memory of ``fresh``, which nobody else holds: what is in flight must fit into the cache."""
    if not isinstance(fresh, np.ndarray):
        return fresh + y
    fresh += y
    return fresh


def real(x: Any) -> Any:
    """Any numbers as float32."""
    return np.asarray(x).astype(np.float32) if on_host(x) else _drjit().float32_array_t(x)(x)


def double(x: Any) -> Any:
    """Any numbers as float64."""
    return np.asarray(x).astype(np.float64) if on_host(x) else _drjit().float64_array_t(x)(x)


def whole(x: Any) -> Any:
    """Whole numbers in floats as int32."""
    return np.asarray(x).astype(np.int32) if on_host(x) else _drjit().int32_array_t(x)(x)


def wide_product(x: Any, factor: int) -> tuple[Any, Any]:
    """Upper and lower 32 bits of the 64 bits of x·factor. On NumPy both are 32-bit values in uint64."""
    if on_host(x):
        both = x * np.uint64(factor)
        high = both >> np.uint64(32)
        both &= np.uint64(0xFFFF_FFFF)
        return high, both
    return _drjit().mul_hi(x, type(x)(factor)), x * type(x)(factor)


def xor3(fresh: Any, x: Any, key: Any) -> Any:
    """fresh ^ x ^ key, written into the memory of ``fresh`` where that has the shape of the result."""
    if not isinstance(fresh, np.ndarray) or fresh.shape != np.broadcast_shapes(fresh.shape, np.shape(x)):
        return fresh ^ x ^ key
    fresh ^= x
    fresh ^= np.uint64(key)
    return fresh


def signed(x: Any) -> Any:
    """The same 32 bits as a signed number."""
    return x.view(np.int32) if on_host(x) else _drjit().int32_array_t(x)(x)


def bits(x: Any) -> Any:
    """The 32 bits of a float32, as a signed number."""
    if on_host(x):
        return np.asarray(x).view(np.int32)
    dr = _drjit()
    return dr.reinterpret_array(dr.int32_array_t(x), x)


def of_bits(x: Any) -> Any:
    """The float32 that has these 32 bits."""
    if on_host(x):
        return np.asarray(x).view(np.float32)
    dr = _drjit()
    return dr.reinterpret_array(dr.float32_array_t(x), x)


def amend(condition: Any, base: Any, repair: Callable[..., Any], *arguments: Any) -> Any:
    """``base``, but ``repair(*arguments)`` where ``condition`` holds, for conditions that hold rarely.

    NumPy repairs only those pixels; a compiled kernel jumps over the repair where no pixel of a vector needs it.
    """
    if on_host(condition):
        needed = np.flatnonzero(condition)
        if needed.size:
            base = np.array(base)
            base.ravel()[needed] = repair(*(x.ravel()[needed] for x in arguments))
        return base
    return _drjit().if_stmt((base, *arguments), condition, lambda _, *a: repair(*a), lambda same, *_: same)


def choose(condition: Any, yes: Callable[..., Any], no: Callable[..., Any], *arguments: Any) -> Any:
    """``yes(*arguments)`` where ``condition`` holds, else ``no(*arguments)``; neither sees the other's pixels."""
    if not on_host(condition):
        return _drjit().if_stmt(arguments, condition, yes, no)
    if not condition.any():
        return no(*arguments)
    if condition.all():
        return yes(*arguments)
    chosen = yes(*(x[condition] for x in arguments))
    result = np.empty(condition.shape, dtype=chosen.dtype)
    result[condition] = chosen
    result[~condition] = no(*(x[~condition] for x in arguments))
    return result


def repeat(going: Callable[..., Any], step: Callable[..., tuple[Any, ...]], state: tuple[Any, ...]) -> Any:
    """The last part of every pixel's ``state``, after the steps that it takes until ``going(*state)`` does not hold."""
    if not on_host(state[0]):
        return _drjit().while_loop(state, going, step)[-1]
    result = np.empty_like(state[-1])
    index, live = np.arange(result.size), tuple(x.ravel() for x in state)
    while index.size:
        on = going(*live)
        done, rest = np.flatnonzero(~on), np.flatnonzero(on)
        result.ravel()[index[done]] = live[-1][done]
        index, live = index[rest], step(*(x[rest] for x in live))
    return result


def count_at_or_below(levels: Any, x: Any) -> Any:
    """How many of the sorted ``levels`` are ≤ x, as floats of the precision of ``x``."""
    if on_host(x):
        precision = np.asarray(x).dtype
        return np.searchsorted(np.asarray(levels, dtype=precision), x, side="right").astype(precision)
    dr = _drjit()
    index, table = dr.uint32_array_t(type(x)), type(x)(np.asarray(levels, dtype=np.float32))
    count = index(0)
    for bit in reversed(range(len(levels).bit_length())):
        probe = count + (1 << bit)
        there = probe <= len(levels)
        level = dr.gather(type(x), table, probe - 1, there)
        count = dr.select(there & (level <= x), probe, count)
    return type(x)(count)


def any_positive(x: Any) -> bool:
    """Whether anything in ``x`` is above zero; yes, for an array that is not computed yet."""
    return bool(np.any(np.asarray(x) > 0)) if on_host(x) else True


def product(x: Any, y: Any) -> Any:
    """x·y with ∞·0 = 0: no light is no light, whatever it is multiplied by. (In a kernel nothing is infinite.)"""
    if not on_host(x, y):
        return x * y
    with np.errstate(invalid="ignore"):
        xy = x * y
    return np.where(np.isnan(xy), np.float32(0), xy) if np.isnan(xy).any() else xy


def pick(table: Any, index: Any) -> Any:
    """``table[index]``: row ``index`` of a small table for every pixel."""
    return np.asarray(table)[index]


def interpolate(x: Any, points: Any, values: Any) -> Any:
    """Linear between the points, 0 outside them."""
    return np.interp(x, points, values, left=0.0, right=0.0)


def weigh(layers: Any, weights: Any) -> Any:
    """Σ_k layers[..., k]·weights[..., k], (H, W); an infinite layer of weight 0 adds nothing."""
    return product(layers, np.asarray(weights)).sum(axis=-1)


def ratio(x: Any, y: Any, otherwise: float) -> Any:
    """x/y where y is positive and finite, else ``otherwise``."""
    good = np.isfinite(y) & (np.asarray(y) > 0)
    return np.where(good, x / np.where(good, y, 1.0), otherwise)


def table(rows: Any) -> Any:
    """A small table of Python numbers as an array."""
    return np.asarray(rows, dtype=np.float64)


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
