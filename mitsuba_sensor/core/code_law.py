"""Mean and variance of the code of a normal signal: ΣΦ over the transition levels of the converter, and both clips."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from .rounding import rounding_error
from .types import Float64Array

NARROW = 1.0
"""σ [DN] from which on the sum over equal steps is its integral, by Euler-Maclaurin: there the next term is 4e-5 DN."""

FEW_HARMONICS = 0.3
"""σ [DN] from which on, far from both clips, three harmonics give the rounding of equal steps to 1e-12."""

BROAD = 0.25
"""σ as a share of the range from which on the integral is a quadrature."""

HUGE = 1e90
"""Numbers beyond this one are as good as infinite, and their powers are not."""

REACH = 7.0
"""Transitions further away than so many σ are sure."""


def code_moments(
    ideal_dn: Float64Array, sigma_dn: Float64Array, highest: int, inl_lsb: Float64Array | None = None
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the code of x ~ Normal(ideal, σ²): code = number of transition levels T_k ≤ x.

    ideal_dn, sigma_dn : of one shape; σ may be 0.  highest : the largest code.
    inl_lsb : (highest,) INL of the lower edge of the codes 1 … highest: T_k = k − ½ + INL_k; None: equal steps.
    """
    ideal, sigma = np.broadcast_arrays(ideal_dn, sigma_dn)
    x, s = (np.clip(np.nan_to_num(part.ravel()), -HUGE, HUGE) for part in (ideal, sigma))
    mean, variance = np.empty(x.size), np.empty(x.size)
    inside = (s >= FEW_HARMONICS) & (x > 9 * s) & (x < highest - 9 * s) & (inl_lsb is None)
    wide = (s >= NARROW) & ~inside & (inl_lsb is None)
    error, squared, slope = rounding_error(x[inside], s[inside] ** 2, 3)
    mean[inside] = x[inside] + error
    variance[inside] = s[inside] ** 2 * (1 + 2 * slope) + squared - error**2
    mean[wide], variance[wide] = _integrated(x[wide], s[wide], highest)
    levels = None if inl_lsb is None else np.arange(1, highest + 1) - 0.5 + inl_lsb
    narrow = np.flatnonzero(~wide & ~inside)
    for part in np.array_split(narrow, max(narrow.size // 2**15, 1)):
        mean[part], variance[part] = _summed(x[part], s[part], highest, levels)
    return mean.reshape(ideal.shape), variance.reshape(ideal.shape)


def _integrated(x: Float64Array, s: Float64Array, highest: int) -> tuple[Float64Array, Float64Array]:
    """Equal steps: Σ f(k − ½) = ∫ f − [f′]/24 + 7·[f‴]/5760 for f(t) = Φ((x − t)/s), and the same for 2(t − c)·f(t).

    Squares are about c, the place of the mean between the clips: nothing large is subtracted from its like.
    """
    x = np.clip(x, -9 * s, highest + 9 * s)
    c = np.clip(x, 0.0, highest)
    first, second = np.where(s < BROAD * highest, _clipped(x, s, c, highest), 0.0)
    broad = s >= BROAD * highest
    first[broad], second[broad] = _by_quadrature(x[broad], s[broad], c[broad], highest)
    for edge, sign in ((0.0, 1.0), (float(highest), -1.0)):
        u = (x - edge) / s
        below, density = scipy.special.ndtr(u), np.exp(-0.5 * u * u) / math.sqrt(2 * math.pi)
        slope, second_slope, third = -density / s, -u * density / s**2, -(u * u - 1) * density / s**3
        first += sign * (slope / 24 - 7 * third / 5760)
        slope_of_square = 2 * below + 2 * (edge - c) * slope
        second += sign * (slope_of_square / 24 - 7 * (6 * second_slope + 2 * (edge - c) * third) / 5760)
    return c + first, np.maximum(second - first**2, 0.0)


def _clipped(x: Float64Array, s: Float64Array, c: Float64Array, highest: int) -> tuple[Float64Array, Float64Array]:
    """E(y − c) and E(y − c)² of y = min(max(X, 0), highest) for normal X."""
    low, high = -x / s, (highest - x) / s
    p_low, p_high = scipy.special.ndtr(low), scipy.special.ndtr(-high)
    d_low, d_high = (np.exp(-0.5 * u * u) / math.sqrt(2 * math.pi) for u in (low, high))
    inside = np.maximum(1 - p_low - p_high, 0.0)
    about_x = s * (d_low - d_high) + low * s * p_low + high * s * p_high
    squared = s**2 * (inside - (high * d_high - low * d_low) + low**2 * p_low + high**2 * p_high)
    return about_x + (x - c), squared + 2 * (x - c) * about_x + (x - c) ** 2


def _by_quadrature(
    x: Float64Array, s: Float64Array, c: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """The same where the noise is wide beside the range of codes: ∫ f and ∫ 2(t − c)·f by Gauss-Legendre."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    first, second = -c, c**2
    for t, weight in zip(0.5 * highest * (nodes + 1), 0.5 * highest * weights, strict=True):
        above = scipy.special.ndtr((x - t) / s)
        first = first + weight * above
        second = second + weight * 2 * (t - c) * above
    return first, second


def _summed(
    x: Float64Array, s: Float64Array, highest: int, levels: Float64Array | None
) -> tuple[Float64Array, Float64Array]:
    """Any steps: E d and E d² of d = code − c from P(d ≥ j) and P(d ≤ −j), c the code of the mean."""
    if not x.size:
        return x, s
    centre = _code_of(x, highest, levels)
    mean, square = np.zeros(x.shape), np.zeros(x.shape)
    for sign in (1, -1):
        here, j = np.arange(x.size), 1  # those whose noise reaches the transition that d = ±j lies behind
        while here.size:
            number = centre[here] + (j if sign > 0 else 1 - j)
            exists = (number >= 1) & (number <= highest)
            here, number = here[exists], number[exists]
            distance, width = sign * (x[here] - _level(number, levels)), s[here]
            with np.errstate(divide="ignore", invalid="ignore"):
                sure = (distance >= 0) if sign > 0 else (distance > 0)
                chance = np.where(width > 0, scipy.special.ndtr(distance / width), sure)
            mean[here] += sign * chance
            square[here] += (2 * j - 1) * chance
            here, j = here[distance > -REACH * width], j + 1
    return centre + mean, np.maximum(square - mean**2, 0.0)


def _code_of(x: Float64Array, highest: int, levels: Float64Array | None) -> NDArray[np.int64]:
    if levels is not None:
        return np.searchsorted(levels, x, side="right").astype(np.int64)
    return np.clip(np.floor(x + 0.5), 0, highest).astype(np.int64)


def _level(number: NDArray[np.int64], levels: Float64Array | None) -> Float64Array:
    return np.asarray(number - 0.5 if levels is None else levels[number - 1], dtype=np.float64)
