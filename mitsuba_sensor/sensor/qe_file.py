"""Quantum efficiency curves from a CSV file with the units in its header: wavelength_nm,R_percent,G_percent."""

import csv
from pathlib import Path
from typing import Any

from ..core.small_files import require_small

LENGTHS = {"nm": 1.0, "um": 1000.0, "µm": 1000.0}
SHARES = {"fraction": 1.0, "percent": 0.01}


def read_curves(name: str, folder: str) -> dict[str, Any]:
    """``wavelengths_nm`` and ``curves`` of a file in ``folder``, that of the camera file; else ValueError."""
    path = Path(folder) / name
    try:
        require_small(path, "the file of curves")
        rows = [row for row in csv.reader(path.read_text("utf-8-sig").splitlines()) if row and row[0][:1] != "#"]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"file {name!r} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(rows) < 3:
        raise ValueError(f"file {name!r} needs a header and at least two lines of numbers")
    scales = [_scale(name, i, column.strip()) for i, column in enumerate(rows[0])]
    if len(scales) < 2:
        raise ValueError(f"file {name!r} needs a wavelength column and at least one curve, separated by commas")
    try:
        numbers = [[float(cell) * s for cell, (_, s) in zip(row, scales, strict=True)] for row in rows[1:]]
    except ValueError:
        raise ValueError(f"file {name!r} has a line that is not {len(scales)} numbers separated by commas") from None
    columns = list(zip(*numbers, strict=True))
    curves = {label: list(column) for (label, _), column in zip(scales[1:], columns[1:], strict=True)}
    if len(curves) < len(scales) - 1:
        raise ValueError(f"file {name!r} names a curve twice; give each of {sorted(curves)} one column")
    return {"wavelengths_nm": list(columns[0]), "curves": curves}


def _scale(name: str, position: int, column: str) -> tuple[str, float]:
    """Label and factor of one column: ``wavelength_um`` → 1000, ``G_percent`` → 0.01."""
    label, _, unit = column.rpartition("_")
    known = SHARES if position else LENGTHS
    if unit not in known or (not position and label != "wavelength") or not label:
        wanted = "NAME_fraction or NAME_percent" if position else "wavelength_nm or wavelength_um"
        called = f"column {position + 1} is called {column[:60]!r}"
        raise ValueError(f"file {name!r}: {called}; call it {wanted}, so that the unit is sure")
    return label, known[unit]
