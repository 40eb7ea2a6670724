"""Refractive index of a glass against wavelength: Sellmeier or Cauchy coefficients."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.arrays import sqrt
from ..core.types import Array
from ..sensor.lens_datasheet import SurfaceSection

D_NM, F_NM, C_NM = 587.5618, 486.1327, 656.2725  # Fraunhofer lines (ISO 7944): He d, H F, H C


@dataclass(frozen=True)
class Glass:
    """n(λ): Sellmeier's three terms if the manufacturer gives them, else Cauchy's two from index and Abbe number.

    coefficients : B1, B2, B3, C1, C2, C3 with C in µm² (n² − 1 = Σ B·λ²/(λ² − C)); or A, B of n = A + B/λ².
    """

    coefficients: tuple[float, ...]

    def index(self, wavelength_nm: Array = D_NM) -> Array:
        """n at a wavelength [nm], of the same type."""
        square = wavelength_nm * wavelength_nm * 1e-6
        if len(self.coefficients) == 2:
            constant, slope = self.coefficients
            return constant + slope / square if slope else constant
        terms = zip(self.coefficients[:3], self.coefficients[3:], strict=True)
        return sqrt(1.0 + sum(b * square / (square - c) for b, c in terms))


AIR = Glass((1.0, 0.0))


def glass_behind(surface: SurfaceSection) -> Glass:
    """The glass behind a surface of a prescription; without an Abbe number it has no dispersion.

    Cauchy's B follows from V = (n_d − 1)/(n_F − n_C), A from n_d. The error for Schott's N-BK7 is at most
    0.0003 from 400 to 700 nm and 0.002 at 1000 nm.
    """
    if surface.sellmeier is not None:
        return Glass(surface.sellmeier)
    if surface.abbe is None:
        return Glass((surface.index, 0.0))
    spread = (surface.index - 1) / surface.abbe
    slope = spread / ((F_NM * 1e-3) ** -2 - (C_NM * 1e-3) ** -2)
    return Glass((surface.index - slope / (D_NM * 1e-3) ** 2, slope))
