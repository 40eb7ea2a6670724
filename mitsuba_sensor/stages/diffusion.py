"""Charge diffusion: photoelectrons move sideways before a pixel collects them, further for deeper absorption.

Electrons freed at one point arrive with a Gaussian distribution around it. Averaged over the freeing and the collecting
pixel, each neighbour gets a fraction. Janesick, Scientific CCDs (2001), lists widths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..core import Array, Photons, arrays
from ..core.band_average import photon_averages
from ..core.types import Float64Array

if TYPE_CHECKING:
    from .stage import Datasheet


@dataclass(frozen=True)
class SpectralCurve:
    """A quantity versus wavelength: linear between the points, 0 outside.

    wavelengths_nm : increasing wavelengths [nm].  values : value at each wavelength.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, wavelengths_nm: Array) -> Array:
        """Return the values at these wavelengths, shape (B,)."""
        return arrays.interpolate(wavelengths_nm, self.wavelengths_nm, self.values)

    def of(
        self,
        photons: Photons,
        wavelengths_nm: Array,
        factor: SpectralCurve | None = None,
        power: int = 1,
    ) -> Array:
        """Return means over the photons' bands, or values at their wavelengths, times factor**power, shape (B,)."""

        def values(nm: Array) -> Array:
            if factor is None:
                return self.at(nm)
            return self.at(nm) * factor.at(nm) ** power

        if photons.bandwidths_nm is None:
            return values(wavelengths_nm)
        return photon_averages(
            values, np.array(self.wavelengths_nm), wavelengths_nm, photons.bandwidths_nm
        )


SIGMA_MAX_PX = 2.0
"""Largest standard deviation of the Gaussian [pixels]."""

REACH_SIGMA = 4.5
"""Electrons farther than this [σ] and one pixel are ignored: fractions are exact within 1e-6."""


@dataclass(frozen=True)
class Diffusion:
    """Fractions of a pixel's photoelectrons that the surrounding pixels collect, by wavelength.

    sigma_um : standard deviation of the Gaussian versus wavelength [µm].
    pitch_um : height and width of a pixel [µm].
    """

    sigma_um: SpectralCurve
    pitch_um: tuple[float, float]

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Diffusion | None:
        """Return the diffusion of the camera; None if every electron stays in its pixel."""
        section, pixel = camera.quantum_efficiency, camera.pixel
        if section.diffusion_um is None or not any(section.diffusion_um):
            return None
        sigma_um = SpectralCurve(section.wavelengths_nm, section.diffusion_um)
        return cls(sigma_um, (pixel.pitch_y_um, pixel.pitch_x_um))

    @property
    def reach_px(self) -> int:
        """Distance of the farthest pixel that gets electrons [pixels]."""
        widest_px = max(self.sigma_um.values) / min(self.pitch_um)
        return math.ceil(REACH_SIGMA * widest_px) + 1

    def collected(
        self, freed_with: Callable[[Array], Array], wavelengths_nm: Array
    ) -> Float64Array:
        """Return the mean photoelectrons that the pixels of a window collect, shape (H, W).

        freed_with : function of weights of the bands; returns the photoelectrons freed in a window that is wider by
            ``reach_px`` on each side.
        wavelengths_nm : wavelengths of the bands, shape (B,).
        """
        reach_px = self.reach_px
        down, right = self.shares(0, wavelengths_nm), self.shares(1, wavelengths_nm)
        total: Array = 0.0
        for rows, columns in product(range(reach_px + 1), repeat=2):
            weights = down[rows] * right[columns]
            if not weights.any():
                continue
            freed = np.asarray(freed_with(weights))
            height, width = (side - 2 * reach_px for side in freed.shape)
            for top, left in _places(rows, columns):
                first = reach_px + top, reach_px + left
                total = total + freed[first[0] : first[0] + height, first[1] : first[1] + width]
        return np.asarray(total)

    def shares(self, axis: int, wavelengths_nm: Array) -> Float64Array:
        """Return the fraction for each distance in rows (axis 0) or columns (1), shape (reach_px + 1, B)."""
        sigma_px = self.sigma_um.at(wavelengths_nm) / self.pitch_um[axis]
        distance_px = np.arange(-1, self.reach_px + 2)[:, None]
        integral = _integral_twice(distance_px, np.maximum(sigma_px, 1e-9))
        return np.asarray(integral[2:] - 2 * integral[1:-1] + integral[:-2])


def _integral_twice(x: Array, sigma: Array) -> Float64Array:
    """Return the second integral of a Gaussian of mean 0: x·Φ(x/σ) + σ·φ(x/σ)."""
    z = x / sigma
    density = np.exp(-0.5 * z**2) / math.sqrt(2 * math.pi)
    return np.asarray(x * scipy.special.ndtr(z) + sigma * density)


def _places(rows: int, columns: int) -> Iterator[tuple[int, int]]:
    """Return the offsets of the pixels at this distance in rows and columns, on both sides."""
    return product(sorted({rows, -rows}), sorted({columns, -columns}))
