"""Modulation transfer at a sinusoidal Siemens star (s-SFR, ISO 12233), with its 95 % band.

In a ring of the star the frequency is known: cycles over the circumference. A cosine and a sine of the angle are fitted
to the pixels of each ring in each of eight sectors. Noise makes their amplitudes larger; the mean of their squares
follows a noncentral χ² law, whose noncentrality is the modulation, and which has an interval at any noise.
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
FEWEST_PIXELS = 36
"""Of a sector of a ring, in which five numbers are fitted; with fewer the pixels repeat each other's phases."""
STEPS = 4
"""Of the search for the centre."""
MOST_PHASE = 0.8
"""Root mean square of what the phases of the sectors may be off those of one centre [rad]. A star of one cycle more or
less has 1.1."""


@dataclass(frozen=True, eq=False)
class SiemensStar(OfModulation):
    """Modulation transfer of a star.

    modulation : over the frequency along the rings, all directions together.
    centre : (x, y) of the star from the corner of the picture [samples].
    """

    centre: tuple[float, float]


class _Polar(NamedTuple):
    """Values of all pixels and where they are around a centre, the nearest first; angle from −π to π."""

    radius: Float64Array
    angle: Float64Array
    x: Float64Array
    y: Float64Array
    values: Float64Array

    @classmethod
    def around(cls, pixels: Float64Array, centre: Float64Array) -> _Polar:
        """All pixels around (x, y)."""
        y, x = np.indices(pixels.shape) + 0.5
        x, y = (x - centre[0]).ravel(), (y - centre[1]).ravel()
        fields = np.array([np.hypot(x, y), np.arctan2(y, x), x, y, pixels.ravel()])
        return cls(*fields[:, np.argsort(fields[0])])


class _Ring(NamedTuple):
    """Of the sectors of a ring: complex amplitudes, means, and variances of each part of the amplitudes, (8,) each."""

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
    """Modulation transfer of a picture of a star whose brightness is a sine of the angle.

    ::

        y, x = np.mgrid[:160, :160] - 79.5
        star = 500 + 300 * np.cos(36 * np.arctan2(y, x))
        print(ms.lab.siemens_star(star, 36, contrast=0.6).modulation.at(0.1))

    picture : (H, W) linear values without the black level, the star's centre within a few pixels of its middle.
    cycles : of the star, for example 144.
    radius_px : of the star in the picture; by default the largest that fits.
    contrast : modulation of the chart itself, (bright − dark) / (bright + dark).
    flat : (H, W), the same pixels of an evenly lit surface, by which the picture is divided.
    sample_px : distance of neighbouring values, 2 for one plane of a Bayer mosaic.
    Raises InputError for pictures that show no such star.
    """
    pixels = flat_fielded(picture_of(picture), flat)
    count = require_count("cycles", cycles, 8, 1000, 144)
    contrast = require("contrast", contrast, 0.01, 1.0, "1 for a chart from black to white")
    sample_px = require(
        "sample_px", sample_px, 0.01, 100.0, "pixels, 2 for a plane of a mosaic"
    )
    largest = min(pixels.shape) / 2
    radius = largest if radius_px is None else radius_px
    radius = require("radius_px", radius, 8.0, largest, "pixels of this picture")
    # One cycle per sample, and enough pixels.
    smallest = max(count, SECTORS * FEWEST_PIXELS / RING_PX) / (2 * math.pi)
    if radius < smallest + 3 * RING_PX:
        raise InputError(
            f"a star of {count} cycles within {radius:.3g} pixels has no ring of enough pixels below one cycle per "
            f"sample; pass a picture of {2 * (smallest + 3 * RING_PX):.0f} pixels or more."
        )
    centre = _find_centre(pixels, count, radius)
    edges = np.arange(radius - 1, smallest, -RING_PX)
    polar = _Polar.around(pixels, centre)
    rings = [_fit_ring(polar, (edge - RING_PX, edge), count) for edge in edges[:-1]]
    modulation = _modulation(rings, edges[:-1] - RING_PX / 2, count, contrast, sample_px)
    return SiemensStar(modulation, (float(centre[0]), float(centre[1])))


def _find_centre(pixels: Float64Array, cycles: int, radius: float) -> Float64Array:
    """(x, y) for which the phase is the same in all sectors, beginning in the middle; first in the outer rings."""
    middle = np.array(pixels.shape[::-1]) / 2
    centre = middle.copy()
    for share in np.linspace(0.95, 0.6, STEPS):
        outer = max(share * radius, cycles / math.pi)
        ring = _fit_ring(_Polar.around(pixels, centre), (outer - 2 * RING_PX, outer), cycles)
        phases = np.unwrap(-np.angle(ring.amplitude))
        angles = (np.arange(SECTORS) + 0.5) * 2 * math.pi / SECTORS - math.pi
        design = np.column_stack([np.ones_like(angles), np.sin(angles), -np.cos(angles)])
        solution = np.linalg.lstsq(design, phases, rcond=None)[0]
        centre = centre + solution[1:] * (outer - RING_PX) / cycles
        off = float(np.sqrt(np.square(phases - design @ solution).mean()))
    if not (np.hypot(*(centre - middle)) < 0.1 * radius and off < MOST_PHASE):
        raise InputError(
            "the picture shows no star around its middle; cut out a square with the star's centre in the middle, and "
            f"check that it has {cycles} cycles."
        )
    return centre


def _fit_ring(polar: _Polar, ring: tuple[float, float], cycles: int) -> _Ring:
    """A cosine and a sine beside a plane in every sector of a ring from one radius to another, by least squares."""
    inside = slice(*np.searchsorted(polar.radius, ring))
    part = _Polar(*(field[inside] for field in polar))
    number = np.floor((part.angle + math.pi) * SECTORS / (2 * math.pi)).astype(int) % SECTORS
    waves = cycles * part.angle
    place = part.x / ring[1], part.y / ring[1]
    whole = np.column_stack([np.cos(waves), np.sin(waves), np.ones_like(waves), *place])
    fits = []
    for sector in range(SECTORS):
        own = number == sector
        if own.sum() < FEWEST_PIXELS / 2:
            raise InputError("the star is cut off; pass a picture that holds all of it.")
        design, values = whole[own], part.values[own]
        inverse = np.linalg.pinv(design.T @ design)
        solution = inverse @ (design.T @ values)
        residual = values - design @ solution
        variance = float(residual @ residual) / (values.size - design.shape[1])
        mean = float((design[:, 2:] @ solution[2:]).mean())
        fits.append((complex(*solution[:2]), mean, variance * np.diag(inverse)[:2].mean()))
    amplitude, mean, variance = (np.array(column) for column in zip(*fits, strict=True))
    return _Ring(amplitude, mean, variance)


def _modulation(
    rings: list[_Ring],
    radii: Float64Array,
    cycles: int,
    contrast: float,
    sample_px: float,
) -> Modulation:
    """The root of the mean square of the modulation of all sectors, ring by ring."""
    mean = np.array([ring.mean for ring in rings])
    if not (mean > 0).all():
        raise InputError("the star is not brighter than black; take off the black level only.")
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
    """Ends of the interval of the root of the mean square, from the noncentral χ² law of the sum of squares."""
    freedom = 2 * SECTORS
    ratio = total / np.maximum(noise, 1e-300)
    half = TWO_SIDED * np.sqrt(noise / SECTORS)
    size = np.sqrt(np.maximum(total - (freedom - 1) * noise, 0.0) / SECTORS)
    low, high = size - half, size + half
    near = ratio < 1e4  # farther away the law is normal
    ends = noncentrality_interval(ratio[near], freedom)
    low[near], high[near] = (np.sqrt(end * noise[near] / SECTORS) for end in ends)
    return low, high
