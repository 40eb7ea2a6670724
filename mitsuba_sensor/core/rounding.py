"""Moments of a normal signal after rounding, also where its noise is smaller than a step of the ADC.

round(x) = x + e with e = Σ_k c_k·sin(2πkx), c_k = (−1)^k/(πk). Every moment of e is a sum of Gaussian characteristic
functions (Widrow & Kollár, *Quantization Noise*, 2008, ch. 5 and 9), for one frame and for two frames of one pixel.
"""

import itertools

import numpy as np

from .types import Array, Float64Array

SMOOTH_FROM = 1.0  # σ [steps] above which the fraction of the mean does not matter: its weight exp(−2π²σ²) is < 3e-9
FINEST = 0.1  # a temporal σ below this, unless 0, is set to this, so that eight harmonics are enough [steps]
HARMONICS = np.arange(1, 9)
NO_HARMONIC = 1.2  # σ·k [steps] from which on harmonic k of the rounding error is below 1e-12
MOST_HARMONICS = 512
"""Harmonics of the steps that are added up for a Poisson count: the next one is 6e-4 DN at most."""

SAME = 1e-4
"""Slopes that differ by a smaller share, of a count of one, are damped alike."""

NOTHING_LEFT = 30.0
"""A harmonic that is damped by e to this power adds nothing."""


def rounded(mean: Array, temporal: Array, spatial: Array) -> tuple[Array, Array, Array]:
    """Mean, temporal and spatial variance after rounding to whole numbers, all in steps; scalars or (H, W)."""
    shape = np.broadcast_shapes(*(np.shape(x) for x in (mean, temporal, spatial)))
    mean, temporal, spatial = (
        np.broadcast_to(np.asarray(x, dtype=np.float64), shape).ravel()
        for x in (mean, temporal, spatial)
    )
    noiseless, same = temporal == 0, _spatial_part(temporal)
    out = (
        mean.copy(),
        np.where(noiseless, 0.0, temporal + 1 / 12 - same),
        spatial + np.where(noiseless, 1 / 12, same),
    )
    rough = temporal + spatial < SMOOTH_FROM**2
    if rough.any():
        noise = np.where(noiseless[rough], 0.0, np.maximum(temporal[rough], FINEST**2))
        for whole, part in zip(
            out, _with_phase(mean[rough], noise, spatial[rough]), strict=True
        ):
            whole[rough] = part
    return out[0].reshape(shape), out[1].reshape(shape), out[2].reshape(shape)


def _spatial_part(temporal: Float64Array) -> Array:
    """The part of the variance 1/12 that is the same in every frame: Σ exp(−4π²k²T)/(2π²k²)."""
    k = HARMONICS[:3]
    return np.sum(
        np.exp(-4 * (np.pi * k) ** 2 * temporal[..., None]) / (2 * (np.pi * k) ** 2), axis=-1
    )


def _with_phase(
    m: Float64Array, temporal: Float64Array, spatial: Float64Array
) -> tuple[Array, Array, Array]:
    """As :func:`rounded`, for noise below a step, where the fraction of the mean m matters."""
    noiseless = temporal + spatial == 0
    total = np.maximum(temporal + spatial, FINEST**2)
    error, squared, slope = rounding_error(m, total, HARMONICS.size)
    variance = np.maximum(total * (1 + 2 * slope) + squared - error**2, 0.0)
    shared = np.clip(
        spatial * (1 + 2 * slope) + _shared(m, temporal, spatial) - error**2, 0.0, variance
    )
    shared = np.where(temporal == 0, variance, shared)
    mean = np.where(noiseless, np.floor(m + 0.5), m + error)
    return mean, np.where(noiseless, 0.0, variance - shared), np.where(noiseless, 0.0, shared)


def rounding_error(
    mean: Array, variance: Array, harmonics: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """E e, E e² and E de/dx of e = round(x) − x for normal x, from so many harmonics; all of one shape.

    The k-th is exp(−2π²k²σ²): three are enough from σ = 0.3 on (1e-12), eight from 0.1 on.
    """
    angle = 2 * np.pi * (mean - np.floor(mean))
    sine, cosine, fall = np.sin(angle), np.cos(angle), np.exp(-2 * np.pi**2 * variance)
    error, squared, slope = (
        np.zeros(sine.shape),
        np.full(sine.shape, 1 / 12),
        np.zeros(sine.shape),
    )
    s, c = sine, cosine
    for k in range(1, harmonics + 1):
        left = (-1.0) ** k * fall ** (k * k)
        error += left / (np.pi * k) * s
        squared += left / (np.pi * k) ** 2 * c
        slope += 2 * left * c
        s, c = s * cosine + c * sine, c * cosine - s * sine
    return error, squared, slope


def _shared(m: Float64Array, temporal: Float64Array, spatial: Float64Array) -> Array:
    """E[e₁·e₂], the rounding errors of two frames of one pixel."""
    total = np.zeros_like(m)
    for k, n in itertools.product(HARMONICS, HARMONICS):
        weight = (-1.0) ** (k + n) / (2 * np.pi**2 * k * n)
        for step, sign in ((k - n, 1.0), (k + n, -1.0)):
            fall = np.exp(-2 * np.pi**2 * (step**2 * spatial + (k**2 + n**2) * temporal))
            total += sign * weight * np.cos(2 * np.pi * step * m) * fall
    return total


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
    same_slope = (
        slope.size > 0 and float(np.ptp(slope)) <= SAME * float(np.max(slope)) / fewest_e**0.5
    )
    for k in range(1, min(int(np.ceil(NO_HARMONIC / max(smallest, 1e-3))), MOST_HARMONICS) + 1):
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
