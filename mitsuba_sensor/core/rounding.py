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


def rounded(mean: Array, temporal: Array, spatial: Array) -> tuple[Array, Array, Array]:
    """Mean, temporal and spatial variance after rounding to whole numbers, all in steps; scalars or (H, W)."""
    shape = np.broadcast_shapes(*(np.shape(x) for x in (mean, temporal, spatial)))
    mean, temporal, spatial = (
        np.broadcast_to(np.asarray(x, dtype=np.float64), shape).ravel() for x in (mean, temporal, spatial)
    )
    noiseless, same = temporal == 0, _spatial_part(temporal)
    out = mean.copy(), np.where(noiseless, 0.0, temporal + 1 / 12 - same), spatial + np.where(noiseless, 1 / 12, same)
    rough = temporal + spatial < SMOOTH_FROM**2
    if rough.any():
        noise = np.where(noiseless[rough], 0.0, np.maximum(temporal[rough], FINEST**2))
        for whole, part in zip(out, _with_phase(mean[rough], noise, spatial[rough]), strict=True):
            whole[rough] = part
    return out[0].reshape(shape), out[1].reshape(shape), out[2].reshape(shape)


def _spatial_part(temporal: Float64Array) -> Array:
    """The part of the variance 1/12 that is the same in every frame: Σ exp(−4π²k²T)/(2π²k²)."""
    k = HARMONICS[:3]
    return np.sum(np.exp(-4 * (np.pi * k) ** 2 * temporal[..., None]) / (2 * (np.pi * k) ** 2), axis=-1)


def _with_phase(m: Float64Array, temporal: Float64Array, spatial: Float64Array) -> tuple[Array, Array, Array]:
    """As :func:`rounded`, for noise below a step, where the fraction of the mean m matters."""
    noiseless = temporal + spatial == 0
    total = np.maximum(temporal + spatial, FINEST**2)
    k, sign = HARMONICS, (-1.0) ** HARMONICS
    fall = np.exp(-2 * (np.pi * k) ** 2 * total[:, None])
    cosine = np.cos(2 * np.pi * k * m[:, None]) * fall
    error = np.sum(sign / (np.pi * k) * np.sin(2 * np.pi * k * m[:, None]) * fall, axis=1)
    squared = 1 / 12 + np.sum(sign / (np.pi * k) ** 2 * cosine, axis=1)
    slope = np.sum(2 * sign * cosine, axis=1)
    variance = np.maximum(total * (1 + 2 * slope) + squared - error**2, 0.0)
    shared = np.clip(spatial * (1 + 2 * slope) + _shared(m, temporal, spatial) - error**2, 0.0, variance)
    shared = np.where(temporal == 0, variance, shared)
    mean = np.where(noiseless, np.floor(m + 0.5), m + error)
    return mean, np.where(noiseless, 0.0, variance - shared), np.where(noiseless, 0.0, shared)


def _shared(m: Float64Array, temporal: Float64Array, spatial: Float64Array) -> Array:
    """E[e₁·e₂], the rounding errors of two frames of one pixel."""
    total = np.zeros_like(m)
    for k, n in itertools.product(HARMONICS, HARMONICS):
        weight = (-1.0) ** (k + n) / (2 * np.pi**2 * k * n)
        for step, sign in ((k - n, 1.0), (k + n, -1.0)):
            fall = np.exp(-2 * np.pi**2 * (step**2 * spatial + (k**2 + n**2) * temporal))
            total += sign * weight * np.cos(2 * np.pi * step * m) * fall
    return total
