"""Code of a converter of equal steps: mean and variance for a normal signal with both clips, and for a Poisson count.

round(x) = x + e with e = Σ_k (−1)^k/(πk)·sin(2πkx); every moment of e is a sum of characteristic functions (Widrow &
Kollár, *Quantization Noise*, 2008, ch. 5 and 9).
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from .types import Float64Array

NARROW_DN, REACH_SIGMAS = 2.0, 7.0
"""σ from which on the sum over equal steps is its integral, by Euler-Maclaurin to first order: the next term is
6e-5 DN there. Below it, codes farther from the mean than so many σ are not reached."""

NO_HARMONICS = 1.2
"""σ [DN] from which on rounding far from both clips adds 1/12, to 1e-12."""

SIGMAS = 9.0
"""Clips further away are not reached."""

BROADEST = 1e5
"""σ over the range of codes, beyond which only two codes are left: nothing more is lost to rounding."""

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

BLOCK = 2**13


def code_moments(
    ideal_dn: Float64Array,
    sigma_dn: Float64Array,
    highest: int,
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the code of x ~ Normal(ideal, σ²): x rounded half up, and clipped at 0 and ``highest``.

    ideal_dn, sigma_dn : of one shape; σ may be 0.  highest : the largest code.
    """
    ideal, sigma = np.broadcast_arrays(ideal_dn, sigma_dn)
    s = np.minimum(np.nan_to_num(sigma.ravel()), BROADEST * (highest + 1))
    x = np.clip(np.nan_to_num(ideal.ravel()), -SIGMAS * s - 1, highest + SIGMAS * s + 1)
    mean, variance = x.copy(), s**2 + 1 / 12
    clipped = (s < NO_HARMONICS) | (x < SIGMAS * s) | (x > highest - SIGMAS * s)
    for law, chosen in ((_integrated, s >= NARROW_DN), (_summed, s < NARROW_DN)):
        some = np.flatnonzero(chosen & clipped)
        for part in np.array_split(some, max(some.size // BLOCK, 1)):
            mean[part], variance[part] = law(x[part], s[part], highest)
    return mean.reshape(ideal.shape), variance.reshape(ideal.shape)


def _integrated(
    x: Float64Array, s: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """Of y = min(max(X, 0), highest) for normal X, and what equal steps add: Σ f(k − ½) = ∫ f − [f′]/24 for
    f(t) = Φ((x − t)/s), and the same for 2(t − c)·f(t), with squares about c, so that nothing large is subtracted."""
    c = np.clip(x, 0.0, highest)
    low, high = -x / s, (highest - x) / s
    p_low, p_high = scipy.special.ndtr(low), scipy.special.ndtr(-high)
    d_low, d_high = (np.exp(-0.5 * u * u) / math.sqrt(2 * math.pi) for u in (low, high))
    inside = np.maximum(1 - p_low - p_high, 0.0)
    off = s * (d_low - d_high + low * p_low + high * p_high)
    square = s**2 * (inside - (high * d_high - low * d_low) + low**2 * p_low + high**2 * p_high)
    square += 2 * (x - c) * off + (x - c) ** 2
    off = off + (x - c) + (d_high - d_low) / s / 24
    square += (inside + (c * d_low + (highest - c) * d_high) / s) / 12
    return c + off, np.maximum(square - off**2, 0.0)


def _summed(
    x: Float64Array, s: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """E d and E d² of d = code − c from the chances of the transitions near c, the code of the mean."""
    centre = np.clip(np.floor(x + 0.5), 0, highest)
    neighbours = math.ceil(REACH_SIGMAS * s.max(initial=0.0)) + 1
    j = np.arange(1.0 - neighbours, neighbours + 1)
    number, at, width = centre[:, None] + j, x[:, None], s[:, None]
    distance = at - (number - 0.5)
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = scipy.special.ndtr(distance / width)
    chance = np.where(width > 0, chance, distance >= -NEAR * np.abs(at))
    chance = np.where(number < 1, 1.0, np.where(number > highest, 0.0, chance))
    mean = chance.sum(axis=1) - neighbours
    square = chance @ (2 * j - 1) + neighbours**2
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
