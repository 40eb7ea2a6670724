"""Code of an ideal ADC: mean and variance for a normal signal with both clips, and for a Poisson count.

round(x) = x + e with e = Σ_k (−1)^k/(πk)·sin(2πkx); the moments of e are sums of characteristic functions (Widrow &
Kollár, *Quantization Noise*, 2008, ch. 5 and 9).
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from .types import Float64Array

INTEGRAL_SIGMA_DN, REACH_SIGMAS = 2.0, 7.0
"""From this σ, an integral replaces the sum over steps (first-order Euler-Maclaurin; the next term is 6e-5 DN). Below
it, the sum includes codes within 7 σ of the mean."""

UNIFORM_SIGMA_DN = 1.2
"""From this σ, rounding far from both clips adds a variance of 1/12, to 1e-12."""

CLIP_SIGMAS = 9.0
"""Clips further away have no effect."""

SIGMA_MAX = 1e5
"""Largest σ over the range of codes; only the two end codes remain."""

SIGMA_MIN_DN = 1e-3
"""Smallest σ for the probability of a code."""

HARMONICS_MAX = 512
"""Harmonics of the steps summed for a Poisson count; the next harmonic is at most 6e-4 DN."""

SLOPE_TOLERANCE = 1e-4
"""Relative spread of slopes, for a count of one, up to which all pixels damp harmonics equally."""

DAMPING_MAX = 30.0
"""Exponent above which a damped harmonic is negligible."""

TRANSITION_TOLERANCE = 2.0**-22
"""A noise-free signal this close below a transition (relative) has the upper code, as in frames: whole electrons at a
gain such as 5/14 DN/e- come this close at every 14th count."""

BLOCK = 2**13


def code_moments(
    ideal_dn: Float64Array,
    sigma_dn: Float64Array,
    highest: int,
) -> tuple[Float64Array, Float64Array]:
    """Return mean and variance of the code of x ~ Normal(ideal, σ²), rounded half up and clipped at 0 and ``highest``.

    ideal_dn, sigma_dn : broadcast together; σ may be 0.  highest : full-scale code.
    """
    ideal, sigma = np.broadcast_arrays(ideal_dn, sigma_dn)
    s = np.minimum(np.nan_to_num(sigma.ravel()), SIGMA_MAX * (highest + 1))
    reach = CLIP_SIGMAS * s
    x = np.clip(np.nan_to_num(ideal.ravel()), -reach - 1, highest + reach + 1)
    mean, variance = x.copy(), s**2 + 1 / 12
    special = (s < UNIFORM_SIGMA_DN) | (x < reach) | (x > highest - reach)
    for law, is_wide in ((_integrated, True), (_summed, False)):
        pixels = np.flatnonzero(special & ((s >= INTEGRAL_SIGMA_DN) == is_wide))
        for block in np.array_split(pixels, max(pixels.size // BLOCK, 1)):
            mean[block], variance[block] = law(x[block], s[block], highest)
    return mean.reshape(ideal.shape), variance.reshape(ideal.shape)


def _integrated(
    x: Float64Array, s: Float64Array, highest: int
) -> tuple[Float64Array, Float64Array]:
    """Return the moments of y = min(max(X, 0), highest) for normal X, with the correction for equal steps.

    Σ f(k − ½) = ∫ f − [f′]/24 for f(t) = Φ((x − t)/s), and for 2(t − c)·f(t). Squares are taken about c to avoid
    cancellation.
    """
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
    """Return the moments of the code from the probabilities of transitions near c, the code of the mean."""
    centre = np.clip(np.floor(x + 0.5), 0, highest)
    neighbours = math.ceil(REACH_SIGMAS * s.max(initial=0.0)) + 1
    j = np.arange(1.0 - neighbours, neighbours + 1)
    number, at, width = centre[:, None] + j, x[:, None], s[:, None]
    distance = at - (number - 0.5)
    with np.errstate(divide="ignore", invalid="ignore"):
        passed = scipy.special.ndtr(
            distance / width
        )  # probability of a code of at least number
    passed = np.where(width > 0, passed, distance >= -TRANSITION_TOLERANCE * np.abs(at))
    passed = np.where(number < 1, 1.0, np.where(number > highest, 0.0, passed))
    mean = passed.sum(axis=1) - neighbours
    square = passed @ (2 * j - 1) + neighbours**2
    return centre + mean, np.maximum(square - mean**2, 0.0)


def rounded_poisson(
    mean_dn: Float64Array, sigma_dn: Float64Array, slope: Float64Array, mean_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return mean and variance of ⌊x + ½⌋ for x = slope·n + normal noise and a Poisson count n, also for few electrons.

    mean_dn : E x.  sigma_dn : of the normal noise.  slope : [DN/e-].  mean_e : E n.

    ⌊x + ½⌋ = x + Σ (−1)^k/(πk)·sin 2πkx, and the square of that sum is 1/12 + Σ (−1)^k/(πk)²·cos 2πkx. With θ = 2πk,
    ψ = E e^(iθx) = exp(iθ(E x − slope·E n) + E n·(e^(iθ·slope) − 1) − θ²σ²/2),  E (x − E x)·e^(iθx) = −i ψ′ − E x·ψ.
    """
    error, covariance = np.zeros((2, *mean_dn.shape))
    square = np.full(mean_dn.shape, 1 / 12)
    sigma_min, mean_min_e = (float(np.min(x, initial=np.inf)) for x in (sigma_dn, mean_e))
    spread = float(np.ptp(slope)) if slope.size else np.inf
    same_slope = spread * mean_min_e**0.5 <= SLOPE_TOLERANCE * float(np.max(slope, initial=0.0))
    count = min(int(np.ceil(UNIFORM_SIGMA_DN / max(sigma_min, 1e-3))), HARMONICS_MAX)
    for k in range(1, count + 1):
        theta, amplitude = 2 * np.pi * k, (-1.0) ** k / (np.pi * k)
        if same_slope:
            damping = mean_min_e * (1 - np.cos(theta * slope.flat[0]))
            if damping + 0.5 * (theta * sigma_min) ** 2 > DAMPING_MAX:
                continue
        turned = np.expm1(1j * theta * slope)
        phase = 1j * theta * (mean_dn - slope * mean_e)
        psi = np.exp(phase + mean_e * turned - 0.5 * (theta * sigma_dn) ** 2)
        error += amplitude * psi.imag
        square += amplitude / (np.pi * k) * psi.real
        slopes = slope * mean_e * turned + 1j * theta * sigma_dn**2
        covariance += amplitude * (psi * slopes).imag
    variance = sigma_dn**2 + slope**2 * mean_e + 2 * covariance + square - error**2
    return mean_dn + error, variance


def log_chance_of_code(
    codes: Float64Array, mean_dn: Float64Array, sigma_dn: Float64Array, highest: int
) -> Float64Array:
    """Return the log-probability of a code of a normal signal; finite even for distant codes."""
    sigma = np.maximum(sigma_dn, SIGMA_MIN_DN)
    low = np.where(codes <= 0, -np.inf, (codes - 0.5 - mean_dn) / sigma)
    high = np.where(codes >= highest, np.inf, (codes + 0.5 - mean_dn) / sigma)
    mirrored = low + high > 0  # the difference of small tails is exact
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    above, below = scipy.special.log_ndtr(high), scipy.special.log_ndtr(low)
    return np.asarray(above + np.log1p(-np.exp(below - above)))
