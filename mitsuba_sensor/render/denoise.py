"""The one door to Open Image Denoise: irradiance smoothed by a neural network, with its bias measured.

Two half-sets of the passes, A and B, are denoised apart. What A's picture differs from the raw B is the denoiser's own
error plus B's known noise; averaged over blocks, it is the bias. Off unless asked for: no network conserves energy.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .aovs import guides_of
from .scene import Scene

if TYPE_CHECKING:
    from .irradiance import Irradiance, Job

BLOCK = 8  # pixels along a block's side: noise of 64 pixels averages to 1/8, edges stay
DARKEST = 0.01  # of the median: relative errors of darker pixels are taken to be errors of this level
LAYERS = 3  # the network knows colour pictures, so bands go through it three at a time


def library() -> Any:
    """The module pyoidn. Raises InputError if it is not installed."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        raise InputError("denoise needs Open Image Denoise; pip install 'mitsuba-sensor[denoise]'.") from None


def denoised(light: Irradiance, job: Job, halves: tuple[NDArray[Any], NDArray[Any]]) -> Irradiance:
    """The irradiance without most of its noise, guided by albedo and normals, with the measured bias certified.

    halves : (H, W, B) each, two independent renders of half the samples.
    Its error bars stay those before denoising: they bound the noise, not the bias.
    """
    scene = job.scene if isinstance(job.scene, Scene) else job.scene.scene  # a moving one as it rests
    guides = guides_of(scene)
    raw = np.stack([half.astype(np.float64) for half in halves])
    smooth = np.stack([smoothed(half, guides) for half in halves])
    finite = np.isfinite(light.data)
    data = np.where(finite, smoothed(np.where(finite, light.data, 0), guides), light.data).astype(np.float32)
    report = {"by": f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})", **judged(raw, smooth)}
    note = "denoised: error bars are those before; the bias is in the certificate"
    statistics = replace(light.statistics, denoised=report, notes=(*light.statistics.notes, note))
    return replace(light, data=data, statistics=statistics)


def smoothed(picture: NDArray[Any], guides: tuple[NDArray[Any], NDArray[Any]]) -> NDArray[np.float32]:
    """(H, W, B) through the network, three bands at a time; never negative.  guides : albedo and normals, (H, W, 3)."""
    bands = picture.shape[2]
    padded = np.concatenate([picture, *[picture[..., -1:]] * (-bands % LAYERS)], axis=-1)
    scale = float(padded.mean()) or 1.0
    albedo, normal = (np.ascontiguousarray(np.nan_to_num(g), np.float32) for g in guides)
    grey = np.repeat(albedo.mean(axis=-1, keepdims=True), LAYERS, axis=-1)  # bands have no colour of their own
    parts = [
        library().denoise(
            np.ascontiguousarray(padded[..., k : k + LAYERS] / scale, np.float32), albedo=grey, normal=normal, hdr=True
        )
        for k in range(0, padded.shape[2], LAYERS)
    ]
    return np.asarray(np.maximum(np.concatenate(parts, axis=-1)[..., :bands], 0.0) * scale, np.float32)


def judged(raw: NDArray[np.float64], smooth: NDArray[Any]) -> dict[str, float]:
    """What two half-sets (2, H, W, B), raw and denoised, say of the denoiser; each error relative to its own pixel.

    error_before, error_after : rms error of a half-set, raw and denoised; the noise of the other half, with which it is
        compared, is taken off.
    bias_mean : of the whole picture, relative to its mean.  bias_blocks : rms over blocks of 8 × 8 pixels, noise off.
    """
    level = smooth.mean(axis=0, dtype=np.float64)
    level = np.maximum(level, DARKEST * np.median(level[level > 0])) if (level > 0).any() else np.ones_like(level)
    noise = 0.5 * float(np.mean(((raw[0] - raw[1]) / level) ** 2))  # variance of one raw half
    across = smooth - raw[::-1]  # each against the other half
    error = max(float(np.mean((across / level) ** 2)) - noise, 0.0)
    blocks, noise_blocks = _blocks(across.mean(axis=0) / level), 0.25 * _blocks((raw[0] - raw[1]) / level) ** 2
    bias = max(float(np.mean(blocks**2) - np.mean(noise_blocks)), 0.0)
    return {
        "error_before": noise**0.5,
        "error_after": error**0.5,
        "bias_mean": float(across.mean() / (raw.mean() or 1.0)),
        "bias_blocks": bias**0.5,
    }


def _blocks(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over blocks of the picture (H, W, B); smaller ones at its ends."""
    for axis in (0, 1):
        starts = np.arange(0, picture.shape[axis], BLOCK)
        counts = np.diff(np.append(starts, picture.shape[axis]))
        shape = [-1 if a == axis else 1 for a in range(3)]
        picture = np.add.reduceat(picture, starts, axis=axis) / counts.reshape(shape)
    return picture
