"""Charts averaged exactly over pixels, in closed form, for the instruments of image quality."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def slanted_edge(
    shape: tuple[int, int], angle_deg: float, offset_px: float = 0.0, dark: float = 0.1
) -> Array:
    """Return an edge averaged over full pixels, from ``dark`` to 1.  angle_deg : angle of its normal from the rows."""
    rows, columns = shape
    angle = math.radians(angle_deg)
    x, y = np.arange(columns) + 0.5 - columns / 2, np.arange(rows) + 0.5 - rows / 2
    distance = x * math.cos(angle) + y[:, None] * math.sin(angle) + offset_px
    longer, shorter = sorted((abs(math.cos(angle)), abs(math.sin(angle))), reverse=True)
    if shorter < 1e-9:
        share = np.clip(distance + 0.5, 0.0, 1.0)
    else:
        share = _integrated(distance, longer, shorter)
    return np.asarray(dark + (1 - dark) * share)


def _integrated(distance: Array, longer: float, shorter: float) -> Array:
    """Return the integral up to a distance of a trapezoid of area 1."""

    def half_square(end: float) -> Array:
        return np.asarray(np.square(np.maximum(distance + end, 0.0)) / 2)

    outer, inner = (longer + shorter) / 2, (longer - shorter) / 2
    whole = half_square(outer) - half_square(inner) - half_square(-inner) + half_square(-outer)
    return np.asarray(whole / (longer * shorter))


def pixel_modulation(frequency: Array, angle_deg: float) -> Array:
    """Return the MTF of a full pixel along a direction."""
    angle = math.radians(angle_deg)
    across = np.sinc(frequency * math.cos(angle)) * np.sinc(frequency * math.sin(angle))
    return np.asarray(np.abs(across))


def siemens_star(
    side: int,
    cycles: int,
    contrast: float,
    offset_px: tuple[float, float] = (0.0, 0.0),
    samples: int = 8,
) -> Array:
    """A sinusoidal star of mean 0.5 that pixels average, each over samples² points.  offset_px : (x, y) of its centre
    from the middle."""
    place = (np.arange(side * samples) + 0.5) / samples - side / 2
    angle = np.arctan2(place[:, None] - offset_px[1], place - offset_px[0])
    bright = 0.5 + 0.5 * contrast * np.cos(cycles * angle)
    return np.asarray(bright.reshape(side, samples, side, samples).mean(axis=(1, 3)))


def star_modulation(frequency: Array, samples: int = 8) -> Array:
    """Return the root mean square over all directions of the MTF of a pixel of samples² points."""
    angle = 2 * np.pi * (np.arange(720) + 0.5) / 720
    waves = frequency[:, None] * np.array([np.cos(angle), np.sin(angle)])[:, None]
    points = (np.arange(samples) + 0.5) / samples - 0.5
    along, across = np.cos(2 * np.pi * waves[..., None] * points).mean(axis=-1)
    return np.asarray(np.sqrt(np.square(along * across).mean(axis=1)))


def blurred_star(side: int, cycles: int, contrast: float, blur_px: float) -> Array:
    """Return a star of mean 0.5 after a normal point spread of this σ, whose MTF is exp(−2π²σ²f²).

    Its centre is not that of a pixel: else pixels of all sectors would have the same phases.
    """
    x = np.arange(side) + 0.2 - side / 2
    y = x[:, None] + 0.43
    radius = np.maximum(np.hypot(x, y), 1.0)
    frequency = cycles / (2 * np.pi * radius)
    modulation = contrast * np.exp(-2 * np.square(np.pi * blur_px * frequency))
    waves = np.cos(cycles * np.arctan2(y, x))
    return np.asarray(0.5 + 0.5 * modulation * waves)


@cache
def dead_leaves(side: int, dense: int = 1, seed: int = 1, leaves: int = 4000) -> Array:
    """Return overlapping discs of radii r with density r⁻³, with values from 0.25 to 0.75, at (dense·side)² points."""
    rng = np.random.default_rng(seed)
    points = side * dense
    smallest, largest = 1.0 * dense, points / 6
    shares = rng.random(leaves) * (smallest**-2 - largest**-2)
    radii = (smallest**-2 - shares) ** -0.5
    chart = np.full((points, points), 0.5)
    for radius in radii:
        x, y = rng.uniform(0, points, 2)
        rows = np.arange(max(int(y - radius), 0), min(int(y + radius) + 1, points))
        columns = np.arange(max(int(x - radius), 0), min(int(x + radius) + 1, points))
        inside = np.hypot(columns + 0.5 - x, rows[:, None] + 0.5 - y) < radius
        part = chart[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        part[inside] = rng.uniform(0.25, 0.75)
    return chart


def averaged(picture: Array, factor: int) -> Array:
    """Return means over squares of factor × factor points."""
    rows, columns = picture.shape[0] // factor, picture.shape[1] // factor
    return np.asarray(picture.reshape(rows, factor, columns, factor).mean(axis=(1, 3)))


def blurred(picture: Array, blur_px: float) -> Array:
    """Return a picture after a normal point spread of this σ, continued periodically."""
    squares = [np.square(np.fft.fftfreq(count)) for count in picture.shape]
    modulation = np.exp(-2 * (np.pi * blur_px) ** 2 * np.add.outer(*squares))
    return np.asarray(np.fft.ifft2(np.fft.fft2(picture) * modulation).real)
