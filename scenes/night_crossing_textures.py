"""The textures of night_crossing.xml: puddles, the relief of asphalt, the sky late in the evening."""

from __future__ import annotations

import numpy as np

ZENITH, HORIZON = np.array([0.022, 0.045, 0.110]), np.array([0.80, 0.36, 0.13])
CLOUDS, GROUND = np.array([0.06, 0.045, 0.05]), 0.02


def noise(size: int, seed: int, longest: float, slope: float) -> np.ndarray:
    """Random hills that repeat at the edges, mean 0 and σ 1, (size, size).

    longest : wave, in widths of the picture.  slope : by which power of the frequency the amplitude falls.
    """
    chance = np.random.default_rng(seed)
    along = np.fft.fftfreq(size) * size
    frequency = np.hypot(along[:, None], along[None])
    amplitude = np.where(frequency >= 1 / longest, np.maximum(frequency, 1) ** -slope, 0)
    hills = np.fft.ifft2(np.fft.fft2(chance.normal(size=(size, size))) * amplitude).real
    return (hills - hills.mean()) / hills.std()


def puddles(size: int = 512) -> np.ndarray:
    """Where water stands on the road: 1 in puddles, 0 on what is only wet, (size, size)."""
    return np.clip((noise(size, 16, 0.25, 1.9) - 0.75) / 0.45, 0, 1)


def asphalt_relief(size: int = 256) -> np.ndarray:
    """Relative height of worn asphalt, 0 to 1, (size, size)."""
    return np.clip(0.5 + noise(size, 12, 0.5, 0.9) / 6, 0, 1)


def evening_sky(width: int = 192, height: int = 96) -> np.ndarray:
    """Luminance of the sky [cd/m²] as linear sRGB, (height, width, 3); the zenith is in the first row.

    The glow stands where the street ends, at the azimuth 0 of the picture; clouds take up the light of the town.
    """
    elevation = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    azimuth = 2 * np.pi * (np.arange(width) + 0.5) / width
    up = np.clip(np.sin(elevation), 0, 1)[:, None]
    towards = (0.5 + 0.5 * np.cos(azimuth))[None]
    glow = np.exp(-up / 0.16) * (0.35 + 0.65 * towards**2)
    dusk = np.broadcast_to(1 + 0.8 * np.exp(-up / 0.5), glow.shape)
    hills = np.clip(noise(256, 21, 0.4, 1.6)[:height, :width] - 0.1, 0, 2)
    cloud = hills * np.exp(-up / 0.35)
    sky = dusk[..., None] * ZENITH + glow[..., None] * HORIZON + cloud[..., None] * CLOUDS
    above = (elevation > -0.02)[:, None, None]
    return np.where(above, sky, GROUND * HORIZON)
