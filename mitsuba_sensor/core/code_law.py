"""Code of a converter of equal steps: mean and variance for a normal signal with both clips, and for a Poisson count.

round(x) = x + e with e = Σ_k (−1)^k/(πk)·sin(2πkx); every moment of e is a sum of characteristic functions (Widrow &
Kollár, *Quantization Noise*, 2008, ch. 5 and 9).
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from .types import Float64Array

NARROW = 1.0
"""σ [DN] from which on the sum over equal steps is its integral, by Euler-Maclaurin: there the next term is 4e-5 DN."""

NO_HARMONICS = 1.2
"""σ [DN] from which on rounding far from both clips adds 1/12, to 1e-12."""

BROAD = 0.25
"""σ as a share of the range from which on the integral is a quadrature."""

HUGE = 1e90
"""Numbers beyond this one are as good as infinite, and their powers are not."""

REACH = 7.0
"""Transitions further away than so many σ are sure."""

LEAST_DN = 1e-3
"""A smaller σ counts as this one for the chance of a code."""

MOST_HARMONICS = 512
"""Harmonics of the steps that are added up for a Poisson count: the next one is 6e-4 DN at most."""

SAME = 1e-4
"""Slopes that differ by a smaller share, of a count of one, are damped alike."""

NOTHING_LEFT = 30.0
"""A harmonic that is damped by e to this power adds nothing."""

NEAR = 2.0**-22
"""So near below a transition, in shares of itself, a signal without noise has the code above, as in frames: whole
electrons at a gain such as 5/14 DN/e- come that near at every 14th count."""


def code_moments(
    ideal_dn: Float64Array,
    sigma_dn: Float64Array,
    highest: int,
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the code of x ~ Normal(ideal, σ²): x rounded half up, and clipped at 0 and ``highest``.

    ideal_dn, sigma_dn : of one shape; σ may be 0.  highest : the largest code.
    """
    ideal, sigma = np.broadcast_arrays(ideal_dn, sigma_dn)
    x, s = (np.clip(np.nan_to_num(part.ravel()), -HUGE, HUGE) for part in (ideal, sigma))
    mean, variance = np.empty(x.size), np.empty(x.size)
    even = (s >= NO_HARMONICS) & (x > 9 * s) & (x < highest - 9 * s)
    mean[even], variance[even] = x[even], s[even] ** 2 + 1 / 12
    wide = (s >= NARROW) & ~even
    mean[wide], variance[wide] = _integrated(x[wide], s[wide], highest)
    narrow = np.flatnonzero(~wide & ~even)
    for part in np.array_split(narrow, max(narrow.size // 2**15, 1)):
        mean[part], variance[part] = _summed(x[part], s[part], highest)
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
    if broad.any():
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
    x: Float64Array, s: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """E d and E d² of d = code − c from P(d ≥ j) and P(d ≤ −j), c the code of the mean."""
    if not x.size:
        return x, s
    centre = np.clip(np.floor(x + 0.5), 0, highest).astype(np.int64)
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
            distance, width = sign * (x[here] - (number - 0.5)), s[here]
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


def rounded_poisson(
    mean_dn: Float64Array, sigma_dn: Float64Array, slope: Float64Array, mean_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of ⌊x + ½⌋ for x = slope·n + normal noise, n of Poisson's law, exact also for single electrons.

    mean_dn : E x.  sigma_dn : of the normal noise.  slope : [DN/e-].  mean_e : E n.

    ⌊x + ½⌋ = x + Σ (−1)^k/(πk)·sin 2πkx, and the square of that sum is 1/12 + Σ (−1)^k/(πk)²·cos 2πkx. With θ = 2πk,
    ψ = E e^(iθx) = exp(iθ(E x − slope·E n) + E n·(e^(iθ·slope) − 1) − θ²σ²/2),  E (x − E x)·e^(iθx) = −i ψ′ − E x·ψ.
    """
    error, square, together = (
        np.zeros(mean_dn.shape),
        np.full(mean_dn.shape, 1 / 12),
        np.zeros(mean_dn.shape),
    )
    smallest, fewest_e = (float(np.min(x, initial=np.inf)) for x in (sigma_dn, mean_e))
    same_slope = slope.size > 0 and float(np.ptp(slope)) * fewest_e**0.5 <= SAME * float(
        np.max(slope)
    )
    for k in range(
        1, min(int(np.ceil(NO_HARMONICS / max(smallest, 1e-3))), MOST_HARMONICS) + 1
    ):
        theta, sign = 2 * np.pi * k, (-1.0) ** k
        if (
            same_slope
            and fewest_e * (1 - np.cos(theta * slope.flat[0])) + 0.5 * (theta * smallest) ** 2
            > NOTHING_LEFT
        ):
            continue
        turned = np.expm1(1j * theta * slope)
        psi = np.exp(
            1j * theta * (mean_dn - slope * mean_e)
            + mean_e * turned
            - 0.5 * (theta * sigma_dn) ** 2
        )
        error += sign / (np.pi * k) * psi.imag
        square += sign / (np.pi * k) ** 2 * psi.real
        together += (
            sign
            / (np.pi * k)
            * (psi * (slope * mean_e * turned + 1j * theta * sigma_dn**2)).imag
        )
    return mean_dn + error, sigma_dn**2 + slope**2 * mean_e + 2 * together + square - error**2


def log_chance_of_code(
    codes: Float64Array, mean_dn: Float64Array, sigma_dn: Float64Array, highest: int
) -> Float64Array:
    """Logarithm of the chance of a code of a normal signal; finite however far away the code is."""
    sigma = np.maximum(sigma_dn, LEAST_DN)
    low = np.where(codes <= 0, -np.inf, (codes - 0.5 - mean_dn) / sigma)
    high = np.where(codes >= highest, np.inf, (codes + 0.5 - mean_dn) / sigma)
    mirrored = (
        low + high > 0
    )  # the difference of two small tails is exact, of two near 1 it is not
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    above, below = scipy.special.log_ndtr(high), scipy.special.log_ndtr(low)
    return np.asarray(above + np.log1p(-np.exp(below - above)))
