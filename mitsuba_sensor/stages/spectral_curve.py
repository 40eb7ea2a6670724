"""Curves against wavelength, as a data sheet prints them: quantum efficiency, quantum yield, diffusion length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core import Array, Photons, arrays
from ..core.band_average import photon_averages


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
