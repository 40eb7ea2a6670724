"""Write the tables of spectra in mitsuba_sensor/optics/tables from colour-science, to the last bit of each number.

python benchmarks/spectra_tables.py
"""

from __future__ import annotations

from pathlib import Path

import colour
import numpy as np
from colour.characterisation import read_training_data_rawtoaces_v1

TABLES = Path(__file__).resolve().parent.parent / "mitsuba_sensor" / "optics" / "tables"
OBSERVER = "CIE 1931 2 Degree Standard Observer"
BEYOND_NM = np.arange(785.0, 831.0, 5.0)
PLANCK_NM = 1.435e7 / 2848  # c2/T of illuminant A [nm]
HEADS = {
    "illuminants": "CIE standard illuminants A and D65, relative spectral power, 100 at 560 nm\n"
    "CIE 15:2004, tables T.1\nnm, A, D65",
    "observer": "Colour matching functions of the CIE 1931 standard observer, 2 degrees\nCIE 15:2004, table T.4\n"
    "nm, x, y, z",
    "surfaces": "Reflectances of 190 surfaces: training set of RAW to ACES, Academy of Motion Picture Arts and "
    "Sciences,\nas distributed with colour-science (BSD-3-Clause)\nnm, surfaces 1 to 190",
}


def write_table(name: str, wavelengths_nm: np.ndarray, columns: np.ndarray) -> None:
    """One row for each wavelength; numbers in the fewest digits that give the same float64."""
    lines = [f"# {line}" for line in HEADS[name].splitlines()]
    for nm, row in zip(wavelengths_nm, columns, strict=True):
        lines.append(",".join(np.format_float_positional(x, trim="-") for x in (nm, *row)))
    (TABLES / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def beyond() -> np.ndarray:
    """A and D65 where the tables of colour-science have ended, in the digits of the standard: Planck's law with its
    c2 = 0.01435 m K at 2848 K, and the D series, which gives the values of D65 below 780 nm within 0.001."""
    xy = colour.temperature.CCT_to_xy_CIE_D(6500 * 1.4388 / 1.4380)
    daylight = colour.colorimetry.sd_CIE_illuminant_D_series(xy)
    d65 = np.interp(BEYOND_NM, daylight.wavelengths, daylight.values)
    planck = (
        (560 / BEYOND_NM) ** 5 * np.expm1(PLANCK_NM / 560) / np.expm1(PLANCK_NM / BEYOND_NM)
    )
    d65 = np.round(d65 - 1e-9, 4)  # the standard rounds the means of two neighbours down
    return np.stack([np.round(100 * planck, 3), d65], axis=1)


def main() -> None:
    """Write illuminants.csv, observer.csv and surfaces.csv."""
    a, d65 = colour.SDS_ILLUMINANTS["A"], colour.SDS_ILLUMINANTS["D65"]
    nm, powers = a.wavelengths, np.stack([a.values, d65.values], axis=1)
    write_table("illuminants", np.append(nm, BEYOND_NM), np.concatenate([powers, beyond()]))
    observer = colour.MSDS_CMFS[OBSERVER]
    write_table("observer", observer.wavelengths, observer.values)
    surfaces = read_training_data_rawtoaces_v1()
    write_table(
        "surfaces", surfaces.wavelengths, np.maximum(surfaces.values, 0.0)
    )  # some are -1e-16


if __name__ == "__main__":
    main()
