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
HEADS = {
    "illuminants": "CIE standard illuminants A and D65, relative spectral power, 100 at 560 nm\n"
    "CIE 15:2004, tables T.1\nnm, A, D65",
    "observer": "Colour matching functions of the CIE 1931 standard observer, 2 degrees\nCIE 15:2004, table T.4\n"
    "nm, x, y, z",
    "surfaces": "Reflectances of 190 surfaces: training set of RAW to ACES, Academy of Motion Picture Arts and "
    "Sciences,\nas distributed with colour-science (BSD-3-Clause)\nnm, surfaces 1 to 190",
    "color_checker": "Reflectances of the 24 patches of a ColorChecker Classic, row by row from dark skin to black\n"
    "ISO 17321-1, as distributed with colour-science (BSD-3-Clause)\nnm, patches 1 to 24",
}


def write_table(name: str, wavelengths_nm: np.ndarray, columns: np.ndarray) -> None:
    """One row for each wavelength; numbers in the fewest digits that give the same float64."""
    lines = [f"# {line}" for line in HEADS[name].splitlines()]
    for nm, row in zip(wavelengths_nm, columns, strict=True):
        lines.append(",".join(np.format_float_positional(x, trim="-") for x in (nm, *row)))
    (TABLES / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Write illuminants.csv, observer.csv, surfaces.csv and color_checker.csv."""
    a, d65 = colour.SDS_ILLUMINANTS["A"], colour.SDS_ILLUMINANTS["D65"]
    write_table("illuminants", a.wavelengths, np.stack([a.values, d65.values], axis=1))
    observer = colour.MSDS_CMFS[OBSERVER]
    write_table("observer", observer.wavelengths, observer.values)
    surfaces = read_training_data_rawtoaces_v1()
    write_table(
        "surfaces", surfaces.wavelengths, np.maximum(surfaces.values, 0.0)
    )  # some are -1e-16
    patches = colour.SDS_COLOURCHECKERS["ISO 17321-1"]
    first = next(iter(patches.values()))
    values = np.stack([patch.values for patch in patches.values()], axis=1)
    write_table("color_checker", first.wavelengths, values)


if __name__ == "__main__":
    main()
