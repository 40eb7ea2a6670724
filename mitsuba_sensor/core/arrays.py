"""Element-wise operations, branches and loops on NumPy and Dr.Jit arrays.

The stages import these instead of NumPy or Dr.Jit, so the physics is written once. In float32, every operation on a
pixel is + − × ÷ √ floor, a comparison, or a shift or mask of bits. IEEE 754 defines their results exactly, so NumPy and
Dr.Jit-LLVM return the same bytes. Fused multiply-adds and library logarithms are not used. (Dr.Jit flushes numbers
below 1.2e-38 to 0; a chain has none.)
"""

import math
import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from .types import Array, DrJitModule

_NUMPY_TYPES = (np.ndarray, np.generic, float, int)


def is_numpy(*values: Array) -> bool:
    """Return True if none of these is a Dr.Jit array."""
    for x in values:  # noqa: SIM110  (called a thousand times per traced kernel)
        if not isinstance(x, _NUMPY_TYPES):
            return False
    return True


def drjit_module() -> DrJitModule:
    """Return Dr.Jit, which is imported if one of its arrays exists."""
    return sys.modules["drjit"]


def _is_float32(x: Array) -> bool:
    """Return True if ``x`` is computed in float32."""
    return not is_numpy(x) or getattr(x, "dtype", None) == np.float32


def floor(x: Array) -> Array:
    """Return the largest whole number not above ``x``."""
    if is_numpy(x):
        return np.floor(x)
    return drjit_module().floor(x)


def where(condition: Array, yes: Array, no: Array) -> Array:
    """Return ``yes`` where ``condition`` holds, else ``no``."""
    if is_numpy(condition, yes, no):
        return np.where(condition, yes, no)
    return drjit_module().select(condition, yes, no)


def minimum(x: Array, y: Array) -> Array:
    """Return the smaller value."""
    if is_numpy(x, y):
        return np.minimum(x, y)
    return drjit_module().select(x < y, x, y)


def maximum(x: Array, y: Array) -> Array:
    """Return the larger value."""
    if is_numpy(x, y):
        return np.maximum(x, y)
    return drjit_module().select(x > y, x, y)


def sqrt(x: Array) -> Array:
    """Return √x."""
    if is_numpy(x):
        return np.sqrt(x)
    return drjit_module().sqrt(x)


def exp(x: Array) -> Array:
    """Return e^x."""
    if _is_float32(x):
        return _exponential(x)
    return np.exp(x)


def expm1(x: Array) -> Array:
    """Return e^x − 1 without cancellation."""
    if not _is_float32(x):
        return np.expm1(x)
    return _exponential(x, minus_one=True)


# ln 2 as a sum; the first term has ten bits, so its multiples are exact in float32 (Cody & Waite 1980).
LN2_HIGH, LN2_LOW = 0.693359375, -2.12194440e-4
# (e^r − 1 − r)/r² for |r| ≤ ½ln 2, to 4e-9: from d57d910e:benchmarks/fit_quantiles.py.
EXP_TAIL = (0.5000000096, 0.1666651817, 0.0416662037, 0.008368969906, 0.001395063153)


def _exponential(x: Array, minus_one: bool = False) -> Array:
    """Return e^x or e^x − 1 from e^r − 1 and 2^n with x = r + n·ln 2, in float32; x is clipped to −69 and 88."""
    x = minimum(maximum(x, -69.0), 88.0)  # avoids subnormals, which only Dr.Jit flushes to 0
    n = floor(x * (1 / math.log(2)) + 0.5)
    r = (x - n * LN2_HIGH) - n * LN2_LOW
    fraction = r + (r * r) * polynomial(r, EXP_TAIL)
    power = from_float_bits((int32(n) + 127) << 23)
    return fraction * power + (power - 1.0 if minus_one else power)


# (2·atanh(t) − 2t)/t³ as a series in t², for t = x/(2 + x) ≤ 1/3: 2/3, 2/5, …, to 1e-8.
ATANH_TAIL = (2 / 3, 2 / 5, 2 / 7, 2 / 9, 2 / 11, 2 / 13, 2 / 15)


def log1p(x: Array) -> Array:
    """Return ln(1 + x) = 2·atanh(x/(2 + x)) for 0 ≤ x ≤ 1."""
    if not _is_float32(x):
        return np.log1p(x)
    t = x / (2.0 + x)
    square = t * t
    return 2.0 * t + (t * square) * polynomial(square, ATANH_TAIL)


def polynomial(x: Array, coefficients: Sequence[float]) -> Array:
    """Return Σ_k c_k·x^k by Estrin's scheme, whose pairs a processor computes in parallel."""
    terms: list[Array] = list(coefficients)
    while True:
        pairs = [_add(terms[i + 1] * x, terms[i]) for i in range(0, len(terms) - 1, 2)]
        terms = pairs + terms[2 * len(pairs) :]
        if len(terms) == 1:
            return terms[0]
        x = x * x


def _add(fresh: Array, y: Array) -> Array:
    """Return fresh + y in the memory of the temporary ``fresh``, so a row strip fits into the cache."""
    if not isinstance(fresh, np.ndarray):
        return fresh + y
    fresh += y
    return fresh


def _converted(x: Array, kind: str) -> Array:
    if is_numpy(x):
        return np.asarray(x).astype(kind)
    return getattr(drjit_module(), f"{kind}_array_t")(x)(x)


def _reinterpreted(x: Array, kind: str) -> Array:
    if is_numpy(x):
        return np.asarray(x).view(kind)
    return drjit_module().reinterpret_array(getattr(drjit_module(), f"{kind}_array_t")(x), x)


# Conversions of values, and 32 bits reinterpreted as a signed integer or a float32.
float32, float64, int32 = (
    partial(_converted, kind=kind) for kind in ("float32", "float64", "int32")
)
signed_bits, from_float_bits = (
    partial(_reinterpreted, kind=kind) for kind in ("int32", "float32")
)


def wide_product(x: Array, factor: int) -> tuple[Array, Array]:
    """Return the upper and lower 32 bits of x·factor; in uint64 on NumPy."""
    if is_numpy(x):
        both = x * np.uint64(factor)
        high = both >> np.uint64(32)
        both &= np.uint64(0xFFFF_FFFF)
        return high, both
    return drjit_module().mul_hi(x, type(x)(factor)), x * type(x)(factor)


def xor3(fresh: Array, x: Array, key: Array) -> Array:
    """Return fresh ^ x ^ key, in the memory of ``fresh`` if its shape fits."""
    if not isinstance(fresh, np.ndarray) or fresh.shape != np.broadcast_shapes(
        fresh.shape, np.shape(x)
    ):
        return fresh ^ x ^ key
    fresh ^= x
    fresh ^= np.uint64(key)
    return fresh


def count_at_or_below(levels: Array, x: Array) -> Array:
    """Return how many of the sorted ``levels`` are ≤ x, as floats with the precision of ``x``."""
    if is_numpy(x):
        precision = np.asarray(x).dtype
        table = np.asarray(levels, dtype=precision)
        return np.searchsorted(table, x, side="right").astype(precision)
    dr = drjit_module()
    index, table = dr.uint32_array_t(type(x)), type(x)(np.asarray(levels, dtype=np.float32))
    count = index(0)
    for bit in reversed(range(len(levels).bit_length())):
        probe = count + (1 << bit)
        there = probe <= len(levels)
        level = dr.gather(type(x), table, probe - 1, there)
        count = dr.select(there & (level <= x), probe, count)
    return type(x)(count)


def any_positive(x: Array) -> bool:
    """Return True if any element of ``x`` is above zero, and for Dr.Jit arrays, which are not evaluated."""
    return not is_numpy(x) or bool(np.any(np.asarray(x) > 0))


def product(x: Array, y: Array) -> Array:
    """Return x·y with ∞·0 = 0. (Dr.Jit arrays are finite, because from_numpy clips them.)"""
    if not is_numpy(x, y):
        return x * y
    with np.errstate(invalid="ignore"):
        xy = x * y
    if np.isnan(xy).any():
        return np.where(np.isnan(xy), np.float32(0), xy)
    return xy


def replace_where(
    condition: Array, base: Array, function: Callable[..., Array], *arguments: Array
) -> Array:
    """Return ``function(*arguments)`` where the rare ``condition`` holds, else ``base``; computed only where needed."""
    if not is_numpy(condition):
        return drjit_module().if_stmt(
            (base, *arguments), condition, lambda _, *a: function(*a), lambda same, *_: same
        )
    needed = np.flatnonzero(condition)
    if needed.size:
        base = np.array(base)
        base.ravel()[needed] = function(*(x.ravel()[needed] for x in arguments))
    return base


def branch(
    condition: Array, yes: Callable[..., Array], no: Callable[..., Array], *arguments: Array
) -> Array:
    """Return ``yes(*arguments)`` where ``condition`` holds, else ``no(*arguments)``, each only for its pixels."""
    if not is_numpy(condition):
        return drjit_module().if_stmt(arguments, condition, yes, no)
    if not condition.any():
        return no(*arguments)
    if condition.all():
        return yes(*arguments)
    chosen = yes(*(x[condition] for x in arguments))
    result = np.empty(condition.shape, dtype=chosen.dtype)
    result[condition] = chosen
    result[~condition] = no(*(x[~condition] for x in arguments))
    return result


def loop(
    going: Callable[..., Array],
    step: Callable[..., tuple[Array, ...]],
    state: tuple[Array, ...],
) -> Array:
    """Repeat ``state = step(*state)`` for every pixel while ``going(*state)`` holds; return its last array."""
    if not is_numpy(state[0]):
        return drjit_module().while_loop(state, going, step)[-1]
    result = np.empty_like(state[-1])
    index, live = np.arange(result.size), tuple(x.ravel() for x in state)
    while index.size:
        on = going(*live)
        done, rest = np.flatnonzero(~on), np.flatnonzero(on)
        result.ravel()[index[done]] = live[-1][done]
        index, live = index[rest], step(*(x[rest] for x in live))
    return result


def interpolate(x: Array, points: Array, values: Array) -> Array:
    """Return the linear interpolation between points, 0 outside."""
    return np.interp(x, points, values, left=0.0, right=0.0)


def weighted_sum(layers: Array, weights: Array) -> Array:
    """Return Σ_k layers[..., k]·weights[k], shape (H, W); an infinite layer of weight 0 adds 0."""
    weights = np.asarray(weights)
    with np.errstate(invalid="ignore"):
        if weights.size == 1:  # einsum is ten times slower
            total = layers[..., 0] * weights[0]
        else:
            total = np.einsum("...k,k->...", layers, weights)
    if not weights.all() and np.isnan(np.min(total, initial=0.0)):  # ∞·0
        lost = np.isnan(total)
        total[lost] = product(layers[lost], weights).sum(axis=-1)
    return total


def ratio(x: Array, y: Array, otherwise: float) -> Array:
    """Return x/y where y is positive and finite, else ``otherwise``."""
    good = np.isfinite(y) & (np.asarray(y) > 0)
    return np.where(good, x / np.where(good, y, 1.0), otherwise)


scalar_exp, scalar_log, scalar_sqrt = math.exp, math.log, math.sqrt  # of Python numbers
