"""Spectra from colour-science: illuminant D65, the luminous efficiency V(λ), and the reflectances of a ColorChecker.

The only module that imports colour-science, and only inside functions, because the import is slow.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core import Float64Array

LUMENS_PER_WATT = 683.002  # K_m, CIE: 683 lm/W at 540 THz, that is 555.017 nm in air
VISIBLE_NM = (360.0, 830.0)  # the range of Mitsuba's own spectra (CIE observers)
COLOR_CHECKER = "ISO 17321-1"  # 380 to 780 nm every 5 nm, 24 patches


def d65(wavelengths_nm: ArrayLike) -> Float64Array:
    """CIE standard illuminant D65, relative (100 at 560 nm), 0 outside its table of 300 to 780 nm."""
    from colour import SDS_ILLUMINANTS

    table, at_nm = SDS_ILLUMINANTS["D65"], np.asarray(wavelengths_nm, float)
    return np.asarray(np.interp(at_nm, table.wavelengths, table.values, left=0.0, right=0.0))


def photopic(wavelengths_nm: ArrayLike) -> Float64Array:
    """Luminous efficiency V(λ): CIE 1931 ȳ, 1 at 555 nm, 0 outside 360 to 830 nm."""
    from colour import MSDS_CMFS

    table, at_nm = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"], np.asarray(wavelengths_nm, float)
    return np.asarray(np.interp(at_nm, table.wavelengths, table.values[:, 1], left=0.0, right=0.0))


def luminous(wavelengths_nm: Float64Array, radiometric: Float64Array) -> float:
    """Photometric value of a spectrum: W m⁻² nm⁻¹ → lux, W m⁻² sr⁻¹ nm⁻¹ → cd/m²."""
    return float(LUMENS_PER_WATT * scipy.integrate.trapezoid(radiometric * photopic(wavelengths_nm), wavelengths_nm))


def d65_radiance(luminance_cd_per_m2: float, wavelengths_nm: ArrayLike) -> Float64Array:
    """Spectral radiance [W m⁻² sr⁻¹ nm⁻¹] of D65 light of this luminance."""
    fine = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + 1)
    return luminance_cd_per_m2 / luminous(fine, d65(fine)) * d65(wavelengths_nm)


def color_checker() -> dict[str, tuple[Float64Array, Float64Array]]:
    """Name → (wavelengths_nm, reflectance) of the 24 patches, row by row, from dark skin to black (ISO 17321-1)."""
    from colour import SDS_COLOURCHECKERS

    return {name: (sd.wavelengths, sd.values) for name, sd in SDS_COLOURCHECKERS[COLOR_CHECKER].items()}
