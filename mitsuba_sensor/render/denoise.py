"""Denoising of irradiance by Open Image Denoise, with its bias measured.

Two half-sets of the passes, A and B, are denoised separately. Denoised A minus raw B is the denoiser's own error plus
B's known noise; averaged over blocks, it is the bias. Off by default: no network conserves energy.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from importlib import metadata
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ..core import Float64Array, InputError
from .aovs import denoising_guides
from .irradiance import Irradiance
from .scene import Scene

Image = NDArray[np.float32]
BLOCK = 8  # pixels along a block's side: noise of 64 pixels averages to 1/8, edges stay
DARKEST = 0.01  # of the median: errors of darker pixels are taken relative to this level
LAYERS = 3  # the network takes colour images, so it denoises three bands at a time


def library() -> ModuleType:
    """The module pyoidn. Raises InputError if it is not installed."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        raise InputError("denoise needs Open Image Denoise; pip install 'mitsuba-sensor[denoise]'.") from None


def denoised(light: Irradiance, scene: Scene, halves: tuple[Float64Array, Float64Array]) -> Irradiance:
    """The denoised irradiance, guided by albedo and normals, with the measured bias in its statistics.

    scene : at rest.  halves : (H, W, B) each, two independent renders of half the samples.
    Its error bars are those before denoising: they bound the noise, not the bias.
    """
    guides = denoising_guides(scene)
    raw = np.stack([half.astype(np.float64) for half in halves])
    smooth = np.stack([smoothed(half, guides) for half in halves])
    finite = np.isfinite(light.data)
    data = np.where(finite, smoothed(np.where(finite, light.data, 0), guides), light.data).astype(np.float32)
    report = {"by": f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})", **denoising_errors(raw, smooth)}
    note = "denoised: error bars are those before; the bias is in the render statistics"
    statistics = replace(light.statistics, denoised=report, notes=(*light.statistics.notes, note))
    return replace(light, data=data, statistics=statistics)


def smoothed(image: Float64Array | Image, guides: tuple[Image, Image]) -> Image:
    """The denoised image (H, W, B), never negative.  guides : albedo and normals, (H, W, 3)."""
    bands = image.shape[2]
    padded = np.concatenate([image, *[image[..., -1:]] * (-bands % LAYERS)], axis=-1)
    scale = float(padded.mean()) or 1.0
    albedo, normal = (np.ascontiguousarray(np.nan_to_num(g), np.float32) for g in guides)
    grey = np.repeat(albedo.mean(axis=-1, keepdims=True), LAYERS, axis=-1)  # a band has no colour
    layers = (padded[..., k : k + LAYERS] / scale for k in range(0, padded.shape[2], LAYERS))
    images = (np.ascontiguousarray(layer, np.float32) for layer in layers)
    parts = [library().denoise(image, albedo=grey, normal=normal, hdr=True) for image in images]
    return np.asarray(np.maximum(np.concatenate(parts, axis=-1)[..., :bands], 0.0) * scale, np.float32)


def denoising_errors(raw: Float64Array, smooth: Float64Array | Image) -> dict[str, float]:
    """Errors of the denoiser from two half-sets (2, H, W, B), raw and denoised; each relative to its own pixel.

    error_before, error_after : rms error of a half-set, raw and denoised, without the noise of the other half.
    bias_mean : of the whole image, relative to its mean.  bias_blocks : rms over blocks of 8 × 8 pixels without noise.
    """
    level = smooth.mean(axis=0, dtype=np.float64)
    level = np.maximum(level, DARKEST * np.median(level[level > 0])) if (level > 0).any() else np.ones_like(level)
    noise = 0.5 * float(np.mean(((raw[0] - raw[1]) / level) ** 2))  # variance of one raw half
    difference = smooth - raw[::-1]  # of each from the other half
    error = max(float(np.mean((difference / level) ** 2)) - noise, 0.0)
    blocks, noise_blocks = (_block_means(x / level) for x in (difference.mean(axis=0), raw[0] - raw[1]))
    bias = max(float(np.mean(blocks**2) - np.mean(0.25 * noise_blocks**2)), 0.0)
    return {
        "error_before": noise**0.5,
        "error_after": error**0.5,
        "bias_mean": float(difference.mean() / (raw.mean() or 1.0)),
        "bias_blocks": bias**0.5,
    }


def _block_means(image: Float64Array) -> Float64Array:
    """Means over blocks of the image (H, W, B); the last blocks may be smaller."""
    for axis, shape in enumerate(((-1, 1, 1), (1, -1, 1))):
        starts = np.arange(0, image.shape[axis], BLOCK)
        counts = np.diff(np.append(starts, image.shape[axis]))
        image = np.add.reduceat(image, starts, axis=axis) / counts.reshape(shape)
    return image
