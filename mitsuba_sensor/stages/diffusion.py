"""Charge diffusion: photoelectrons go sideways before a pixel collects them, further where light goes deeper.

Electrons that are freed at one place arrive in a Gaussian about it. Averaged over the pixel that frees them and over
the one that collects them, that is a share for each neighbour. Janesick, Scientific CCDs (2001), has widths.
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
    """A quantity against wavelength: linear between the points, 0 outside them.

    wavelengths_nm : increasing [nm].  values : at each of them; electrons per photon for a QE.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, wavelengths_nm: Array) -> Array:
        """Values at these wavelengths, (B,)."""
        return arrays.interpolate(wavelengths_nm, self.wavelengths_nm, self.values)

    def of(
        self,
        photons: Photons,
        wavelengths_nm: Array,
        factor: SpectralCurve | None = None,
        power: int = 1,
    ) -> Array:
        """Means over the bands of the photons, or values at their wavelengths, (B,); times factor**power."""

        def values(nm: Array) -> Array:
            if factor is None:
                return self.at(nm)
            return self.at(nm) * factor.at(nm) ** power

        if photons.bandwidths_nm is None:
            return values(wavelengths_nm)
        return photon_averages(
            values, np.array(self.wavelengths_nm), wavelengths_nm, photons.bandwidths_nm
        )


WIDEST_PX = 2.0
"""Largest standard deviation of the Gaussian [pixels]."""

REACH_SIGMA = 4.5
"""Beyond so many standard deviations and one pixel there are no electrons: shares are exact to 1e-6."""


@dataclass(frozen=True)
class Diffusion:
    """Shares of the photoelectrons of a pixel that the pixels about it collect, by wavelength.

    sigma_um : standard deviation of the Gaussian against wavelength [µm].
    pitch_um : height and width of a pixel [µm].
    """

    sigma_um: SpectralCurve
    pitch_um: tuple[float, float]

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Diffusion | None:
        """That of the camera; None where every electron stays in its pixel."""
        section, pixel = camera.quantum_efficiency, camera.pixel
        if section.diffusion_um is None or not any(section.diffusion_um):
            return None
        sigma_um = SpectralCurve(section.wavelengths_nm, section.diffusion_um)
        return cls(sigma_um, (pixel.pitch_y_um, pixel.pitch_x_um))

    @property
    def reach_px(self) -> int:
        """How far away a pixel is that gets electrons."""
        widest_px = max(self.sigma_um.values) / min(self.pitch_um)
        return math.ceil(REACH_SIGMA * widest_px) + 1

    def collected(
        self, freed_with: Callable[[Array], Array], wavelengths_nm: Array
    ) -> Float64Array:
        """Mean photoelectrons that the pixels of a window collect, (H, W).

        freed_with : returns those of a window that is wider by ``reach_px`` on each side, with these weights of bands.
        wavelengths_nm : of the bands, (B,).
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
        """Share of a row (axis 0) or column (1) so many pixels away, (reach_px + 1, B)."""
        sigma_px = self.sigma_um.at(wavelengths_nm) / self.pitch_um[axis]
        distance_px = np.arange(-1, self.reach_px + 2)[:, None]
        integral = _integral_twice(distance_px, np.maximum(sigma_px, 1e-9))
        return np.asarray(integral[2:] - 2 * integral[1:-1] + integral[:-2])


def _integral_twice(x: Array, sigma: Array) -> Float64Array:
    """Second integral of a Gaussian of mean 0: x·Φ(x/σ) + σ·φ(x/σ)."""
    z = x / sigma
    density = np.exp(-0.5 * z**2) / math.sqrt(2 * math.pi)
    return np.asarray(x * scipy.special.ndtr(z) + sigma * density)


def _places(rows: int, columns: int) -> Iterator[tuple[int, int]]:
    """The pixels that are so many rows and columns away, on either side."""
    return product(sorted({rows, -rows}), sorted({columns, -columns}))
