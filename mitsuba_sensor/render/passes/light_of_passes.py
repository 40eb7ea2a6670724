"""Bands of a render and their standard errors, from its passes; denoised, they agree with what each filter detects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ..denoise.denoise import Denoised
from ..light.bands import Bands, in_band_factor
from ..light.statistics import pooled
from .passes import Passes

BANDS_AT_ONCE = 4
VALUES_AT_ONCE = 2**18  # pixels × bands: 2 MiB for each array in between
SLOPE_MIN = 1e-6  # of the largest: filters that are nearly equal cannot be told apart

Float32Bands = NDArray[np.float32]


def raw_bands(
    passes: Passes, bands: Bands, solid_angle_sr: Float64Array, keep: bool
) -> tuple[Float32Bands, Float32Bands]:
    """Return the irradiance of each band as the passes have it, and its standard errors, (H, W, B) each.

    keep : whether the sums of the passes are needed afterwards; otherwise they are written over, to save memory.
    """
    sums = passes.bands if bands.first_filter else passes.filters
    data, error = (sums.mean.copy(), sums.squares.copy()) if keep else (sums.mean, sums.squares)
    of_mean = max(passes.count * (passes.count - 1), 1)
    for first in range(0, len(bands), BANDS_AT_ONCE):
        part = slice(first, min(first + BANDS_AT_ONCE, len(bands)))
        scale = (solid_angle_sr[..., None] * (passes.unit * bands.scale[part])).astype(
            np.float32
        )
        mean, squares = np.maximum(data[..., part], 0), error[..., part]
        variance = pooled(mean, squares / np.float32(of_mean), passes.count)
        data[..., part], error[..., part] = mean * scale, np.sqrt(variance) * scale
    return data, error


def agree_with_filters(
    data: Float32Bands,
    error: Float32Bands,
    weights: Float64Array,
    raw: NDArray[np.floating],
    denoised: Denoised,
    relative: tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]],
) -> None:
    """Scale bands and their standard errors, (H, W, B), until each filter detects the denoised photoelectrons.

    weights : (F, B) photoelectrons of 1 W m⁻² nm⁻¹ in each band.  raw : (H, W, F) photoelectrons of the passes.
    relative : (H, W) denoised photoelectrons over the raw ones, and the relative standard errors of both. A band's own
    error is what it has beyond that of the photoelectrons.
    """
    spectrum = data.mean(axis=(0, 1), dtype=np.float64)
    step = max(VALUES_AT_ONCE // max(data[0].size, 1), 1)
    for first in range(0, len(data), step):
        rows = slice(first, first + step)
        before = data[rows].astype(np.float64)
        flat = in_band_factor(before @ weights.T, raw[rows])
        after = bands_of_filters(before, weights, denoised.mean[rows] * flat, spectrum)
        gain, of_raw, of_denoised = (
            np.nan_to_num(x[rows, :, None], posinf=0.0) for x in relative
        )
        own = np.maximum(error[rows].astype(np.float64) ** 2 - (of_raw * before) ** 2, 0.0)
        data[rows], error[rows] = after, np.sqrt(gain**2 * own + (of_denoised * after) ** 2)


def bands_of_filters(
    bands: Float64Array,
    weights: Float64Array,
    electrons: NDArray[np.floating],
    spectrum: Float64Array,
) -> Float64Array:
    """Return the bands (H, W, B), scaled smoothly over wavelength until every filter detects ``electrons`` (H, W, F).

    All bands are scaled by the ratio of all electrons; what is then missing behind single filters changes each band by
    the factor 1 + Σ λ_g s_g, s_g the filter's own response with a peak of 1; never negative.
    spectrum : (B,), which a pixel without light has.
    """
    before = (bands @ weights.T).sum(axis=-1)
    dark = ~(before > 0)
    if dark.any():
        bands = np.where(dark[..., None], spectrum, bands)
        before = (bands @ weights.T).sum(axis=-1)
    bands = (
        bands * (electrons.sum(axis=-1) / np.maximum(before, np.finfo(float).tiny))[..., None]
    )
    if len(weights) == 1:
        return np.asarray(bands)
    shape = weights / np.maximum(weights.max(axis=1, keepdims=True), np.finfo(float).tiny)
    slope = np.einsum("fb,gb,hwb->hwfg", weights, shape, bands)
    least = SLOPE_MIN * np.trace(slope, axis1=-2, axis2=-1) + np.finfo(float).tiny
    slope += least[..., None, None] * np.eye(len(weights))
    factors = np.linalg.solve(slope, (electrons - bands @ weights.T)[..., None])[..., 0]
    return np.asarray(bands * np.maximum(1 + factors @ shape, 0.0))


def in_band_of(
    passes: Passes, electrons: Float64Array, data: Float32Bands, weights: Float64Array
) -> NDArray[np.float32]:
    """Return photoelectrons (H, W) over those of spectra that are flat within each band."""
    factor = np.empty(electrons.shape, np.float32)
    step = max(VALUES_AT_ONCE // max(data[0].size, 1), 1)
    for first in range(0, len(data), step):
        rows = slice(first, first + step)
        flat = passes.own(data[rows] @ weights.T, first)
        factor[rows] = in_band_factor(electrons[rows], flat)
    return factor
