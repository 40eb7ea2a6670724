"""Spectra and colours: CIE illuminants A and D65, the CIE 1931 observer, surface reflectances, CIELAB and sRGB.

Importing colour-science takes 2 s and 170 MB, so renders, frames and previews use the tables and formulas here
(5a4fbc1b:benchmarks/spectra_tables.py wrote the tables). colour-science computes the rest.
"""

from __future__ import annotations

from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike

from ..core import Float32Array, Float64Array, require

LUMENS_PER_WATT = 683.002  # K_m, CIE: 683 lm/W at 540 THz, 555.017 nm in air
VISIBLE_NM = (360.0, 830.0)  # the range of Mitsuba's own spectra (CIE observers)
DAYLIGHT = "D65"
ILLUMINANTS = ("A", DAYLIGHT)  # the columns of their table
TABLES = resources.files(__package__) / "tables"
BRADFORD: Float64Array = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
"""XYZ to sharpened cones: ICC.1, annex E."""
CAT02: Float64Array = np.array(
    [[0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834]]
)
"""XYZ to the sharpened cones of CIECAM02: CIE 159:2004."""
XYZ_TO_SRGB: Float64Array = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
"""IEC 61966-2-1, with its rounding."""
DETERMINANT_MIN = 1e-3  # of the chromaticities of primaries; sRGB has 0.22


def _white_xyz(chromaticity: ArrayLike) -> Float64Array:
    x, y = np.asarray(chromaticity)
    return np.array([x / y, 1.0, (1 - x - y) / y])


D65_XYZ, D50_XYZ = _white_xyz((0.3127, 0.3290)), _white_xyz((0.3457, 0.3585))
"""White points of sRGB, and of ICC profiles and DNG (CIE 1931, Y = 1)."""
SILICON_NM = tuple(float(nm) for nm in range(400, 1001, 50))
ABSORPTION_PER_UM = (
    *(9.52, 2.55, 1.11, 0.639, 0.414, 0.281, 0.190),
    *(0.130, 0.0850, 0.0535, 0.0306, 0.0157, 0.00640),
)
"""Silicon at 300 K: Green & Keevers 1995, Progress in Photovoltaics 3, 189."""
OTHER_SENSOR = (
    "nm, e.g. 525; for other sensors, give quantum_efficiency.curves in a camera file"
)
DEAD_UM, DEPTH_UM = 0.05, 5.0
"""Depths of the dead layer and of collection in a typical front-illuminated sensor."""


def silicon_qe(value: float, at_nm: float) -> tuple[list[float], list[float]]:
    """Return wavelengths [nm] and quantum efficiencies (at most 1) of a typical silicon sensor with ``value`` at one.

    Raises InputError for a wavelength outside the table.
    """
    low_nm, high_nm = SILICON_NM[0], SILICON_NM[-1]
    at_nm = require("wavelength_nm", at_nm, low_nm, high_nm, OTHER_SENSOR)
    absorption = np.array(ABSORPTION_PER_UM)
    shape = np.exp(-absorption * DEAD_UM) * -np.expm1(-absorption * DEPTH_UM)
    wavelengths_nm = sorted({*SILICON_NM, at_nm})
    curve = value * np.interp(wavelengths_nm, SILICON_NM, shape)
    curve = np.minimum(curve / np.interp(at_nm, SILICON_NM, shape), 1.0).round(4)
    curve[wavelengths_nm.index(at_nm)] = value
    return wavelengths_nm, curve.tolist()


def d65(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return CIE standard illuminant D65 (100 at 560 nm); 0 outside 300 to 830 nm."""
    return standard_illuminant(DAYLIGHT, wavelengths_nm)


def daylight_nm() -> Float64Array:
    """Return the wavelengths between which D65 is linear."""
    return _table("illuminants")[0]


def standard_illuminant(name: str, wavelengths_nm: ArrayLike) -> Float64Array:
    """Return a CIE illuminant by name ("D65", "A"), 100 at 560 nm; 0 outside its table."""
    table_nm, power = _table("illuminants")
    asked_nm, values = np.asarray(wavelengths_nm, float), power[:, ILLUMINANTS.index(name)]
    return np.asarray(np.interp(asked_nm, table_nm, values, left=0.0, right=0.0))


def observer(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return x̄, ȳ, z̄ of the CIE 1931 observer, shape (3, B); 0 outside 360 to 830 nm."""
    table_nm, functions = _table("observer")
    at_nm = np.asarray(wavelengths_nm, float)
    return np.stack(
        [np.interp(at_nm, table_nm, values, left=0.0, right=0.0) for values in functions.T]
    )


def photopic(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return the luminous efficiency V(λ), CIE 1931 ȳ: 1 at 555 nm, 0 outside 360 to 830 nm."""
    _, y, _ = observer(np.atleast_1d(wavelengths_nm))
    return np.asarray(y.reshape(np.shape(wavelengths_nm)))


def luminous(wavelengths_nm: Float64Array, radiometric: Float64Array) -> float:
    """Return the photometric value of a spectrum: lux for W m⁻² nm⁻¹, cd/m² for W m⁻² sr⁻¹ nm⁻¹."""
    seen = radiometric * photopic(wavelengths_nm)
    return float(LUMENS_PER_WATT * np.trapezoid(seen, wavelengths_nm))


def surfaces(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return the reflectances of AMPAS' RAW to ACES training set, shape (190, B); constant outside 380 to 780 nm."""
    table_nm, reflectances = _table("surfaces")
    at_nm = np.asarray(wavelengths_nm, float)
    return np.array([np.interp(at_nm, table_nm, values) for values in reflectances.T])


def color_checker(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return the reflectances of a ColorChecker (ISO 17321-1), shape (24, B); constant outside 380 to 780 nm."""
    import colour

    at_nm, patches = np.asarray(wavelengths_nm, float), colour.SDS_COLOURCHECKERS["ISO 17321-1"]
    return np.array([np.interp(at_nm, sd.wavelengths, sd.values) for sd in patches.values()])


def color_checker_xyz() -> Float64Array:
    """Return XYZ of a ColorChecker under D65, shape (24, 3); a perfect white has Y = 1."""
    fine = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + 1)
    seen = (observer(fine) * d65(fine)).T
    white = seen.sum(axis=0) / seen[:, 1].sum()
    return adapted_to_daylight(color_checker(fine) @ seen / seen[:, 1].sum(), white)


def bradford(white: Float64Array, other: Float64Array) -> Float64Array:
    """Return the matrix (3, 3) from colours under one white (XYZ) to another, by linear Bradford as in DNG and ICC."""
    return _adaptation(BRADFORD, white, other)


def adapted_to_daylight(xyz: Float64Array, white: Float64Array) -> Float64Array:
    """Return colours (N, 3) adapted from this white to daylight (CAT02)."""
    return np.asarray(xyz @ _adaptation(CAT02, white, D65_XYZ).T)


def lab(xyz: Float64Array) -> Float64Array:
    """Return CIELAB of colours (N, 3) in daylight (CIE 15:2004, 8.2.1)."""
    relative = np.maximum(xyz, 0.0) / D65_XYZ
    straight = 841 / 108 * relative + 16 / 116
    x, y, z = np.where(relative > (24 / 116) ** 3, np.cbrt(relative), straight).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def delta_e_2000(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return ΔE00 of CIELAB colours (..., 3), CIE 142:2001, with k_L = k_C = k_H = 1."""
    import colour

    return np.asarray(colour.difference.delta_E_CIE2000(first, second))


def rgb_to_srgb(chromaticities: tuple[float, ...]) -> Float64Array:
    """Return the matrix (3, 3) from linear RGB of other primaries to linear sRGB, adapted by Bradford.

    chromaticities : x and y of red, green, blue and white. Raises ValueError for degenerate primaries.
    """
    import colour

    *primaries, white = np.reshape(np.array(chromaticities, float), (4, 2))
    corners = np.array([[x, y, 1 - x - y] for x, y in primaries]).T
    spans = np.isfinite(chromaticities).all() and abs(np.linalg.det(corners)) > DETERMINANT_MIN
    if not (spans and white[1] > 0 and (np.linalg.solve(corners, _white_xyz(white)) > 0).all()):
        raise ValueError(f"chromaticities are {chromaticities}")
    srgb = colour.RGB_COLOURSPACES["sRGB"]
    source = colour.RGB_Colourspace("linear", primaries, white)
    target = colour.RGB_Colourspace("linear", srgb.primaries, srgb.whitepoint)
    return np.asarray(colour.matrix_RGB_to_RGB(source, target, "Bradford"), float)


@cache
def _table(name: str) -> tuple[Float64Array, Float64Array]:
    """Return wavelengths (B,) [nm] and columns (B, N) of an included table."""
    lines = (TABLES / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    rows = np.loadtxt(lines, delimiter=",")
    return rows[:, 0], rows[:, 1:]


def _adaptation(cones: Float64Array, white: Float64Array, other: Float64Array) -> Float64Array:
    """Return the matrix (3, 3) that scales each cone from one white to another (von Kries)."""
    scale = (cones @ other) / (cones @ white)
    return np.asarray(np.linalg.inv(cones) @ (scale[:, None] * cones))


def srgb_curve(linear: Float64Array) -> Float64Array:
    """Return linear values encoded by the IEC 61966-2-1 transfer curve, [0, 1] → [0, 1]."""
    power = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, power)


def inverse_srgb_curve(encoded: Float32Array) -> Float32Array:
    """Return linear values of the IEC 61966-2-1 transfer curve, [0, 1] → [0, 1]."""
    base = (np.maximum(encoded, 0.04045) + np.float32(0.055)) / np.float32(1.055)
    power = base ** np.float32(2.4)
    linear = encoded / np.float32(12.92)
    return np.asarray(np.where(encoded <= 0.04045, linear, power), np.float32)
