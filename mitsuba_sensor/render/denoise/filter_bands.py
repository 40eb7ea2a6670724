"""Spectral bands that agree with denoised photoelectrons: their sum over each colour filter is the filter's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ..light.own_filter import in_band_factor
from ..passes.pooled import pooled
from ..passes.row_strip import RowStrip
from .combine import SMALLEST, Image, box
from .denoise import Denoised

VALUES_AT_ONCE = 2**18  # pixels × bands: 2 MiB for each array in between
LEAST_SLOPE = 1e-6  # of the largest: filters that are nearly equal cannot be told apart
OWN_RADIUS_PX = 2  # of the neighbourhood of a band's own error


def bands_of_filters(
    bands: Float64Array, weights: Float64Array, electrons: Image, spectrum: Float64Array
) -> Float64Array:
    """The irradiance of each band, scaled smoothly over wavelength until every filter detects what it should.

    bands : (H, W, B).  weights : (F, B) photoelectrons of 1 W m⁻² nm⁻¹.  electrons : (H, W, F) to be detected.
    spectrum : (B,), which a pixel without light has.
    All bands are scaled by the ratio of all electrons; what is then missing behind single filters changes each band by
    the factor 1 + Σ λ_g s_g, s_g the filter's own response with a peak of 1; never negative.
    """
    before = (bands @ weights.T).sum(axis=-1)
    dark = ~(before > 0)
    if dark.any():
        bands = np.where(dark[..., None], spectrum, bands)
        before = (bands @ weights.T).sum(axis=-1)
    bands = bands * (electrons.sum(axis=-1) / np.maximum(before, SMALLEST))[..., None]
    if len(weights) == 1:
        return np.asarray(bands)
    shape = weights / np.maximum(weights.max(axis=1, keepdims=True), np.finfo(float).tiny)
    slope = np.einsum("fb,gb,hwb->hwfg", weights, shape, bands)
    least = LEAST_SLOPE * np.trace(slope, axis1=-2, axis2=-1) + np.finfo(float).tiny
    slope += least[..., None, None] * np.eye(len(weights))
    factors = np.linalg.solve(slope, (electrons - bands @ weights.T)[..., None])[..., 0]
    return np.asarray(bands * np.maximum(1 + factors @ shape, 0.0))


def band_errors(
    apart: NDArray[np.float32], mean: NDArray[np.float32], relative: Float64Array
) -> NDArray[np.float32]:
    """Standard errors of bands, (H, W, B), from the difference of two halves of equal weight with an error of their
    own, and the relative standard error (H, W) of the electrons, which they have in common at least."""
    errors = np.empty(mean.shape, np.float32)
    for k in range(mean.shape[-1]):
        own = box(0.25 * apart[..., k].astype(np.float64) ** 2, OWN_RADIUS_PX)
        errors[..., k] = np.sqrt(np.maximum(own, (relative * mean[..., k]) ** 2))
    return errors


def bands_of(
    strip: RowStrip,
    denoised: Denoised | None,
    weights: Float64Array,
    relative: NDArray[np.float32],
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Bands of a strip and their standard errors, denoised where that was done.  relative : (H, W), of the picture."""
    if denoised is None or strip.even is None:
        return raw_bands(strip)
    halves = denoised.mean, denoised.even, denoised.odd
    here = [image[strip.rows] for image in halves]
    return denoised_bands(strip, weights, here, relative[strip.rows])


def denoised_bands(
    strip: RowStrip,
    weights: Float64Array,
    electrons: list[Image],
    relative: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bands of a strip and their standard errors, which agree with the denoised electrons behind each filter.

    electrons : mean, even and odd half, (H, W, F) each.  relative : (H, W) standard error.
    """
    bands = np.empty(strip.bands.mean.shape, np.float32)
    apart = np.empty(strip.bands.mean.shape, np.float32)
    spectra, step = strip.spectra(), max(VALUES_AT_ONCE // max(bands[0].size, 1), 1)
    for first in range(0, len(bands), step):
        rows = slice(first, first + step)
        mean = strip.bands.mean[rows].astype(np.float64)
        flat = in_band_factor(mean @ weights.T, strip.electrons.mean[rows])
        images = mean, strip.half(False, rows), strip.half(True, rows)
        whole, even, odd = (
            bands_of_filters(image, weights, wanted[rows] * flat, spectrum)
            for image, wanted, spectrum in zip(images, electrons, spectra, strict=True)
        )
        bands[rows], apart[rows] = whole, even - odd
    relative_errors = np.nan_to_num(relative.astype(np.float64), posinf=0.0)
    return bands, band_errors(apart, bands, relative_errors)


def raw_bands(strip: RowStrip) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
    """Bands of a strip as the passes have them, and their standard errors."""
    bands, variances = strip.bands.mean, strip.variance_of_bands()
    sigma = np.empty(bands.shape, np.float32)
    for k in range(bands.shape[2]):
        mean, variance = bands[..., k], variances[..., k]
        pooled_variance = pooled(
            mean.astype(np.float64), variance.astype(np.float64), strip.bands.count
        )
        sigma[..., k] = np.sqrt(pooled_variance)
    return bands, sigma
