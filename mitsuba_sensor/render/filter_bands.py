"""Spectral bands that agree with denoised photoelectrons: their sum over each colour filter is the filter's."""

from __future__ import annotations

import numpy as np

from ..core import Float64Array
from .combine import BAR_RADII_PX, SMALLEST, box

LEAST_SLOPE = 1e-6  # of the largest: filters that are nearly equal cannot be told apart


def bands_of_filters(bands: Float64Array, weights: Float64Array, electrons: Float64Array) -> Float64Array:
    """The irradiance of each band, scaled smoothly over wavelength until every filter detects what it should.

    bands : (H, W, B).  weights : (F, B) photoelectrons of 1 W m⁻² nm⁻¹.  electrons : (H, W, F) to be detected.
    All bands are scaled by the ratio of all electrons; what is then missing behind single filters changes each band by
    the factor 1 + Σ λ_g s_g, s_g the filter's own response with a peak of 1; never negative. A pixel without light has
    the picture's mean spectrum.
    """
    dark = ~((bands @ weights.T).sum(axis=-1) > 0)
    if dark.any():
        bands = np.where(dark[..., None], bands.mean(axis=(0, 1)), bands)
    before = np.maximum((bands @ weights.T).sum(axis=-1), SMALLEST)
    bands = bands * (electrons.sum(axis=-1) / before)[..., None]
    if len(weights) == 1:
        return np.asarray(bands)
    shape = weights / np.maximum(weights.max(axis=1, keepdims=True), np.finfo(float).tiny)
    slope = np.einsum("fb,gb,hwb->hwfg", weights, shape, bands)
    least = LEAST_SLOPE * np.trace(slope, axis1=-2, axis2=-1) + np.finfo(float).tiny
    slope += least[..., None, None] * np.eye(len(weights))
    factors = np.linalg.solve(slope, (electrons - bands @ weights.T)[..., None])[..., 0]
    return np.asarray(bands * np.maximum(1 + factors @ shape, 0.0))


def band_errors(even: Float64Array, odd: Float64Array, mean: Float64Array, relative: Float64Array) -> Float64Array:
    """Standard errors of bands, (H, W, B), from two halves of equal weight with an error of their own, and the
    relative standard error (H, W) of the electrons, which they have in common at least."""
    spread = 0.25 * (even - odd) ** 2
    own = np.stack([box(spread[..., k], BAR_RADII_PX[0]) for k in range(spread.shape[-1])], axis=-1)
    return np.asarray(np.sqrt(np.maximum(own, (relative[..., None] * mean) ** 2)))
