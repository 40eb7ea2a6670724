"""Spectra and colours from colour-science: D65, the CIE 1931 observer, reflectances of surfaces, CIELAB and sRGB.

The only module that imports colour-science, and only inside functions, because the import is slow.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core import Float64Array

LUMENS_PER_WATT = 683.002  # K_m, CIE: 683 lm/W at 540 THz, that is 555.017 nm in air
VISIBLE_NM = (360.0, 830.0)  # the range of Mitsuba's own spectra (CIE observers)
OBSERVER, DAYLIGHT, ADAPTATION = "CIE 1931 2 Degree Standard Observer", "D65", "CAT02"
COLOR_CHECKER = "ISO 17321-1"  # 380 to 780 nm every 5 nm, 24 patches


def d65(wavelengths_nm: ArrayLike) -> Float64Array:
    """CIE standard illuminant D65, relative (100 at 560 nm), 0 outside its table of 300 to 780 nm."""
    return standard_illuminant(DAYLIGHT, wavelengths_nm)


def standard_illuminant(name: str, wavelengths_nm: ArrayLike) -> Float64Array:
    """A CIE illuminant by its name ("D65", "A"), relative (100 at 560 nm), 0 outside its table."""
    from colour import SDS_ILLUMINANTS

    table, at_nm = SDS_ILLUMINANTS[name], np.asarray(wavelengths_nm, float)
    return np.asarray(np.interp(at_nm, table.wavelengths, table.values, left=0.0, right=0.0))


def observer(wavelengths_nm: ArrayLike) -> Float64Array:
    """x̄, ȳ, z̄ of the CIE 1931 observer, (3, B), 0 outside 360 to 830 nm."""
    from colour import MSDS_CMFS

    table, at_nm = MSDS_CMFS[OBSERVER], np.asarray(wavelengths_nm, float)
    return np.stack([np.interp(at_nm, table.wavelengths, one, left=0.0, right=0.0) for one in table.values.T])


def photopic(wavelengths_nm: ArrayLike) -> Float64Array:
    """Luminous efficiency V(λ): CIE 1931 ȳ, 1 at 555 nm, 0 outside 360 to 830 nm."""
    return np.asarray(observer(np.atleast_1d(wavelengths_nm))[1].reshape(np.shape(wavelengths_nm)))


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


def surfaces(wavelengths_nm: ArrayLike) -> Float64Array:
    """(190, B) reflectances of the training set of the AMPAS' RAW to ACES, held constant outside of 380 to 780 nm."""
    from colour.characterisation import read_training_data_rawtoaces_v1

    table, at_nm = read_training_data_rawtoaces_v1(), np.asarray(wavelengths_nm, float)
    return np.array([np.interp(at_nm, table.wavelengths, one) for one in np.asarray(table.values).T])


def daylight_xyz() -> Float64Array:
    """XYZ of D65, Y = 1: the white of sRGB."""
    return _white_xyz(DAYLIGHT)


def d50_xyz() -> Float64Array:
    """XYZ of D50, Y = 1: the white of colour profiles (ICC) and of DNG."""
    return _white_xyz("D50")


def _white_xyz(illuminant: str) -> Float64Array:
    from colour import CCS_ILLUMINANTS, xy_to_XYZ

    return np.asarray(xy_to_XYZ(CCS_ILLUMINANTS[OBSERVER][illuminant]))


def bradford(white: Float64Array, other: Float64Array) -> Float64Array:
    """(3, 3) from colours under one white (XYZ) to those under another: linear Bradford, as in DNG and ICC."""
    from colour.adaptation import matrix_chromatic_adaptation_VonKries

    return np.asarray(matrix_chromatic_adaptation_VonKries(white, other, transform="Bradford"))


def adapted_to_daylight(xyz: Float64Array, white: Float64Array) -> Float64Array:
    """Colours (N, 3) as they look in daylight to who was used to this white (CAT02)."""
    from colour.adaptation import matrix_chromatic_adaptation_VonKries

    return np.asarray(xyz @ matrix_chromatic_adaptation_VonKries(white, daylight_xyz(), transform=ADAPTATION).T)


def lab(xyz: Float64Array) -> Float64Array:
    """CIELAB of colours (N, 3) in daylight."""
    from colour import CCS_ILLUMINANTS, XYZ_to_Lab

    return np.asarray(XYZ_to_Lab(np.maximum(xyz, 0.0), CCS_ILLUMINANTS[OBSERVER][DAYLIGHT]))


def xyz_to_srgb() -> Float64Array:
    """(3, 3) from XYZ to linear sRGB (IEC 61966-2-1)."""
    from colour import RGB_COLOURSPACES

    return np.asarray(RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB)
