"""MTF of a sinusoidal Siemens star (s-SFR, ISO 12233), with its 95 % band.

A ring of the star has a known frequency: cycles over circumference. A cosine and a sine of the angle are fitted to the
pixels of each ring in eight sectors. Noise enlarges the amplitudes; the sum of their squares has a noncentral χ²
distribution with the MTF as noncentrality, which gives an interval at any noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....core import InputError, require
from ....core.errors import require_count
from ....core.types import Float64Array
from ...quantity import TWO_SIDED
from ...statistics.estimators import noncentrality_interval
from .modulation import Modulation, OfModulation, flat_fielded, picture_of

SECTION = "ISO 12233 s-SFR"
SECTORS = 8
RING_PX = 2.0
"""Width of a ring."""
SECTOR_PIXELS_MIN = 36
"""Smallest number of pixels in a sector of a ring, to which five numbers are fitted; fewer pixels repeat phases."""
CENTRE_STEPS = 4
"""Number of steps of the search for the centre."""
PHASE_RMS_MAX = 0.8
"""Largest rms deviation of the sectors' phases from a common centre [rad]; one cycle more or less gives 1.1."""


@dataclass(frozen=True, eq=False)
class SiemensStar(OfModulation):
    """MTF of a star.

    modulation : versus frequency along the rings, averaged over all directions.
    centre : (x, y) of the star from the corner of the image [samples].
    """

    centre: tuple[float, float]


class _Polar(NamedTuple):
    """Values and polar positions of all pixels about a centre, by ascending radius; angle from −π to π."""

    radius: Float64Array
    angle: Float64Array
    x: Float64Array
    y: Float64Array
    values: Float64Array

    @classmethod
    def around(cls, pixels: Float64Array, centre: Float64Array) -> _Polar:
        """Return all pixels about (x, y)."""
        y, x = np.indices(pixels.shape) + 0.5
        x, y = (x - centre[0]).ravel(), (y - centre[1]).ravel()
        fields = np.array([np.hypot(x, y), np.arctan2(y, x), x, y, pixels.ravel()])
        return cls(*fields[:, np.argsort(fields[0])])


class _Ring(NamedTuple):
    """Complex amplitudes, means, and variances of the amplitudes' parts in the sectors of a ring, shape (8,) each."""

    amplitude: NDArray[np.complex128]
    mean: Float64Array
    variance: Float64Array


def siemens_star(
    picture: ArrayLike,
    cycles: int,
    *,
    radius_px: float | None = None,
    contrast: float = 1.0,
    flat: ArrayLike | None = None,
    sample_px: float = 1.0,
) -> SiemensStar:
    """Measure the MTF in an image of a star whose brightness is a sine of the angle.

    ::

        y, x = np.mgrid[:160, :160] - 79.5
        star = 500 + 300 * np.cos(36 * np.arctan2(y, x))
        print(ms.lab.siemens_star(star, 36, contrast=0.6).modulation.at(0.1))

    picture : linear values without the black level, shape (H, W); its middle is within a few pixels of the star's
        centre.
    cycles : number of cycles of the star, e.g. 144.
    radius_px : radius of the star in the image [samples]. Default: the largest that fits.
    contrast : modulation of the chart, (bright − dark) / (bright + dark).
    flat : image of a uniformly lit surface, shape (H, W), by which the image is divided.
    sample_px : distance of neighbouring values [px], 2 for one plane of a Bayer mosaic.
    Raises InputError for images without such a star.
    """
    pixels = flat_fielded(picture_of(picture), flat)
    count = require_count("cycles", cycles, 8, 1000, 144)
    contrast = require("contrast", contrast, 0.01, 1.0, "1 for a chart from black to white")
    sample_px = require(
        "sample_px", sample_px, 0.01, 100.0, "pixels, 2 for a plane of a mosaic"
    )
    largest = min(pixels.shape) / 2
    radius = largest if radius_px is None else radius_px
    radius = require("radius_px", radius, 8.0, largest, "pixels of this image")
    # One cycle per sample, and enough pixels in a sector.
    smallest = max(count, SECTORS * SECTOR_PIXELS_MIN / RING_PX) / (2 * math.pi)
    if radius < smallest + 3 * RING_PX:
        raise InputError(
            f"a star of {count} cycles with a radius of {radius:.3g} pixels has no ring below one cycle per sample; "
            f"pass an image of at least {2 * (smallest + 3 * RING_PX):.0f} pixels."
        )
    centre = _find_centre(pixels, count, radius)
    edges = np.arange(radius - 1, smallest, -RING_PX)
    polar = _Polar.around(pixels, centre)
    rings = [_fit_ring(polar, (edge - RING_PX, edge), count) for edge in edges[:-1]]
    modulation = _modulation(rings, edges[:-1] - RING_PX / 2, count, contrast, sample_px)
    return SiemensStar(modulation, (float(centre[0]), float(centre[1])))


def _find_centre(pixels: Float64Array, cycles: int, radius: float) -> Float64Array:
    """Return (x, y) for which all sectors have the same phase, searched from the middle, in the outer rings first."""
    middle = np.array(pixels.shape[::-1]) / 2
    centre = middle.copy()
    for share in np.linspace(0.95, 0.6, CENTRE_STEPS):
        outer = max(share * radius, cycles / math.pi)
        ring = _fit_ring(_Polar.around(pixels, centre), (outer - 2 * RING_PX, outer), cycles)
        phases = np.unwrap(-np.angle(ring.amplitude))
        angles = (np.arange(SECTORS) + 0.5) * 2 * math.pi / SECTORS - math.pi
        design = np.column_stack([np.ones_like(angles), np.sin(angles), -np.cos(angles)])
        solution = np.linalg.lstsq(design, phases, rcond=None)[0]
        centre = centre + solution[1:] * (outer - RING_PX) / cycles
        off = float(np.sqrt(np.square(phases - design @ solution).mean()))
    if not (np.hypot(*(centre - middle)) < 0.1 * radius and off < PHASE_RMS_MAX):
        raise InputError(
            f"picture has no star of {cycles} cycles about its middle; pass a square with the star's centre in the "
            "middle, and check cycles."
        )
    return centre


def _fit_ring(polar: _Polar, ring: tuple[float, float], cycles: int) -> _Ring:
    """Fit a cosine, a sine and a plane to each sector of a ring between two radii, by least squares."""
    inside = slice(*np.searchsorted(polar.radius, ring))
    part = _Polar(*(field[inside] for field in polar))
    number = np.floor((part.angle + math.pi) * SECTORS / (2 * math.pi)).astype(int) % SECTORS
    waves = cycles * part.angle
    place = part.x / ring[1], part.y / ring[1]
    whole = np.column_stack([np.cos(waves), np.sin(waves), np.ones_like(waves), *place])
    fits = []
    for sector in range(SECTORS):
        inside_sector = number == sector
        if inside_sector.sum() < SECTOR_PIXELS_MIN / 2:
            raise InputError("picture cuts off the star; pass an image of the whole star.")
        design, values = whole[inside_sector], part.values[inside_sector]
        inverse = np.linalg.pinv(design.T @ design)
        solution = inverse @ (design.T @ values)
        residual = values - design @ solution
        noise = float(residual @ residual) / (values.size - design.shape[1])
        level = float((design[:, 2:] @ solution[2:]).mean())
        fits.append((complex(*solution[:2]), level, noise * np.diag(inverse)[:2].mean()))
    amplitude, mean, variance = (np.array(column) for column in zip(*fits, strict=True))
    return _Ring(amplitude, mean, variance)


def _modulation(
    rings: list[_Ring],
    radii: Float64Array,
    cycles: int,
    contrast: float,
    sample_px: float,
) -> Modulation:
    """Return the root mean square of the modulation over all sectors, for each ring."""
    mean = np.array([ring.mean for ring in rings])
    if not (mean > 0).all():
        raise InputError("picture is not brighter than black; subtract only the black level.")
    square = np.abs([ring.amplitude for ring in rings]) ** 2 / mean**2
    variance = np.array([ring.variance for ring in rings]) / mean**2
    total, noise = square.sum(axis=1), variance.mean(axis=1)
    value = np.sqrt(np.maximum(total - (2 * SECTORS - 1) * noise, 0.0) / SECTORS)
    low, high = _interval(total, noise)
    frequency = cycles / (2 * math.pi * radii * sample_px)
    low, high = np.minimum(low, value), np.maximum(high, value)
    band = low / contrast, high / contrast
    return Modulation(frequency, value / contrast, *band, SECTION)


def _interval(total: Float64Array, noise: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the interval of the root mean square, from the noncentral χ² distribution of the sum of squares."""
    freedom = 2 * SECTORS
    ratio = total / np.maximum(noise, 1e-300)
    half = TWO_SIDED * np.sqrt(noise / SECTORS)
    size = np.sqrt(np.maximum(total - (freedom - 1) * noise, 0.0) / SECTORS)
    low, high = size - half, size + half
    near = ratio < 1e4  # larger ratios have a normal distribution
    ends = noncentrality_interval(ratio[near], freedom)
    low[near], high[near] = (np.sqrt(end * noise[near] / SECTORS) for end in ends)
    return low, high
