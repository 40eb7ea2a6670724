"""Mean and variance of the code of a normal signal: ΣΦ over the transition levels of the converter, and both clips."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from .rounding import rounding_error
from .types import Float64Array

NARROW = 1.0
"""σ [DN] from which on the sum over equal steps is its integral, by Euler-Maclaurin: there the next term is 4e-5 DN."""

FEW_HARMONICS = 0.3
"""σ [DN] from which on, far from both clips, three harmonics give the rounding of equal steps to 1e-12."""

NO_HARMONICS = 1.2
"""σ [DN] from which on rounding far from both clips adds 1/12, to 1e-12."""

CACHED = 2**12
"""Signals whose harmonics are summed together: these stay in the cache of a processor, which is four times as fast."""

BROAD = 0.25
"""σ as a share of the range from which on the integral is a quadrature."""

HUGE = 1e90
"""Numbers beyond this one are as good as infinite, and their powers are not."""

REACH = 7.0
"""Transitions further away than so many σ are sure."""

NEAR = 2.0**-22
"""So near below a transition, in shares of itself, a signal without noise has the code above, as in frames: whole
electrons at a gain such as 5/14 DN/e- come that near at every 14th count."""

BLURRED = 4.0
"""σ [DN] of the first table of blurred steps. From √2 of it on unequal steps are looked up, not summed."""

FINE = 32
"""Places in a σ at which blurred steps are tabulated: straight lines between them are right to 5e-5 σ at a clip."""

MOST_BLURRED = 2.0**16
"""Noise of so many ranges of codes decides between the smallest and the largest alone."""

Z: Float64Array = np.linspace(-5.5, 5.5, 22)
"""Nodes of a normal law [σ]: a half apart, so that a blur of 1/2.65 of it or more fills the gaps."""

WEIGHTS: Float64Array = np.exp(-0.5 * Z**2) / np.exp(-0.5 * Z**2).sum()


def code_moments(
    ideal_dn: Float64Array,
    sigma_dn: Float64Array,
    highest: int,
    inl_lsb: Float64Array | None = None,
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the code of x ~ Normal(ideal, σ²): code = number of transition levels T_k ≤ x.

    ideal_dn, sigma_dn : of one shape; σ may be 0.  highest : the largest code.
    inl_lsb : (highest,) INL of the lower edge of the codes 1 … highest: T_k = k − ½ + INL_k; None: equal steps.
    """
    ideal, sigma = np.broadcast_arrays(ideal_dn, sigma_dn)
    x, s = (np.clip(np.nan_to_num(part.ravel()), -HUGE, HUGE) for part in (ideal, sigma))
    mean, variance = np.empty(x.size), np.empty(x.size)
    inside = (s >= FEW_HARMONICS) & (x > 9 * s) & (x < highest - 9 * s) & (inl_lsb is None)
    even = inside & (s >= NO_HARMONICS)
    mean[even], variance[even] = x[even], s[even] ** 2 + 1 / 12
    waved = np.flatnonzero(inside & ~even)
    wide = (s >= NARROW) & ~inside & (inl_lsb is None)
    for part in np.array_split(waved, waved.size // CACHED + 1):
        v = s[part] ** 2
        error, squared, slope = rounding_error(x[part], v, 3)
        mean[part], variance[part] = x[part] + error, v * (1 + 2 * slope) + squared - error**2
    mean[wide], variance[wide] = _integrated(x[wide], s[wide], highest)
    if inl_lsb is None:
        levels = None
    else:
        levels = np.arange(1, highest + 1) - 0.5 + inl_lsb
    narrow = np.flatnonzero(~wide & ~inside)
    if (
        levels is not None and np.sum(s[s >= BLURRED * math.sqrt(2)]) > 4 * FINE * levels.size
    ):  # else sums are faster
        narrow = np.flatnonzero(s < BLURRED * math.sqrt(2))
        widest = MOST_BLURRED * levels.size  # beyond, x and σ count in units of each other
        x, s = (
            np.where(s > widest, x * (widest / np.maximum(s, widest)), x),
            np.minimum(s, widest),
        )
        doubled = np.floor(np.log2(np.maximum(s / (BLURRED * math.sqrt(2)), 0.5))).astype(int)
        for times in np.unique(doubled[doubled >= 0]):
            here = np.flatnonzero(doubled == times)
            mean[here], variance[here] = _blurred(levels.tobytes(), int(times)).moments(
                x[here], s[here]
            )
    for part in np.array_split(narrow, max(narrow.size // 2**15, 1)):
        mean[part], variance[part] = _summed(x[part], s[part], highest, levels)
    return mean.reshape(ideal.shape), variance.reshape(ideal.shape)


def _integrated(
    x: Float64Array, s: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
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
        slope, second_slope, third = (
            -density / s,
            -u * density / s**2,
            -(u * u - 1) * density / s**3,
        )
        first += sign * (slope / 24 - 7 * third / 5760)
        slope_of_square = 2 * below + 2 * (edge - c) * slope
        second += sign * (
            slope_of_square / 24 - 7 * (6 * second_slope + 2 * (edge - c) * third) / 5760
        )
    return c + first, np.maximum(second - first**2, 0.0)


def _clipped(
    x: Float64Array, s: Float64Array, c: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """E(y − c) and E(y − c)² of y = min(max(X, 0), highest) for normal X."""
    low, high = -x / s, (highest - x) / s
    p_low, p_high = scipy.special.ndtr(low), scipy.special.ndtr(-high)
    d_low, d_high = (np.exp(-0.5 * u * u) / math.sqrt(2 * math.pi) for u in (low, high))
    inside = np.maximum(1 - p_low - p_high, 0.0)
    about_x = s * (d_low - d_high) + low * s * p_low + high * s * p_high
    squared = s**2 * (
        inside - (high * d_high - low * d_low) + low**2 * p_low + high**2 * p_high
    )
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
        here, j = (
            np.arange(x.size),
            1,
        )  # those whose noise reaches the transition that d = ±j lies behind
        while here.size:
            number = centre[here] + (j if sign > 0 else 1 - j)
            exists = (number >= 1) & (number <= highest)
            here, number = here[exists], number[exists]
            distance, width = sign * (x[here] - _level(number, levels)), s[here]
            with np.errstate(divide="ignore", invalid="ignore"):
                near = sign * NEAR * np.abs(x[here])
                if sign > 0:
                    sure = distance >= -near
                else:
                    sure = distance > -near
                chance = np.where(width > 0, scipy.special.ndtr(distance / width), sure)
            mean[here] += sign * chance
            square[here] += (2 * j - 1) * chance
            here, j = here[distance > -REACH * width], j + 1
    return centre + mean, np.maximum(square - mean**2, 0.0)


@dataclass(frozen=True, eq=False)
class _Blurred:
    """Unequal steps behind a noise of σ = ``sigma``: mean and variance of the code at even distances of σ/32."""

    sigma: float
    first: float
    mean: Float64Array
    variance: Float64Array

    def moments(self, x: Float64Array, s: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Of signals whose σ is 1.4 to 2.83 times that of the table: an average over what the table has not."""
        rest = np.sqrt(s**2 - self.sigma**2)
        centre, _ = self._at(x)
        mean, square = np.zeros(x.shape), np.zeros(x.shape)
        for z, weight in zip(Z, WEIGHTS, strict=True):
            code, variance = self._at(x + z * rest)
            mean += weight * (code - centre)
            square += weight * ((code - centre) ** 2 + variance)
        return centre + mean, np.maximum(square - mean**2, 0.0)

    def _at(self, x: Float64Array) -> tuple[Float64Array, Float64Array]:
        place = np.clip((x - self.first) * (FINE / self.sigma), 0.0, self.mean.size - 1.001)
        left = place.astype(np.intp)
        share = place - left
        mean, variance = (
            part[left] + share * (part[left + 1] - part[left])
            for part in (self.mean, self.variance)
        )
        return mean, variance


@functools.lru_cache(maxsize=32)
def _blurred(levels: bytes, doubled: int) -> _Blurred:
    """For σ = BLURRED by the sum over all transitions; for the double of a σ from the table of that."""
    transitions = np.frombuffer(levels)
    sigma = math.ldexp(BLURRED, doubled)
    at = np.arange(transitions[0] - 8 * sigma, transitions[-1] + 8.1 * sigma, sigma / FINE)
    s = np.full(at.size, sigma)
    if doubled:
        return _Blurred(sigma, at[0], *_blurred(levels, doubled - 1).moments(at, s))
    return _Blurred(sigma, at[0], *_summed(at, s, transitions.size, transitions))


def _code_of(x: Float64Array, highest: int, levels: Float64Array | None) -> NDArray[np.int64]:
    if levels is not None:
        return np.searchsorted(levels, x, side="right").astype(np.int64)
    return np.clip(np.floor(x + 0.5), 0, highest).astype(np.int64)


def _level(number: NDArray[np.int64], levels: Float64Array | None) -> Float64Array:
    return np.asarray(number - 0.5 if levels is None else levels[number - 1], dtype=np.float64)
