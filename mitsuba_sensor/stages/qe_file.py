"""Quantum efficiency curves from a CSV file with the units in its header: wavelength_nm,R_percent,G_percent."""

from typing import Any, NamedTuple

from ..core.csv_rows import SEPARATED, named_column
from .csv_file import read_rows
from .datasheet import Nanometres

LENGTHS = {"nm": 1.0, "um": 1000.0}
FRACTIONS = {"fraction": 1.0, "percent": 0.01}
FIRST = ("wavelength",)


class Column(NamedTuple):
    """One column: its name and unit in the header, and its numbers in that unit."""

    name: str
    unit: str
    numbers: list[float]

    @property
    def title(self) -> str:
        """Its text in the header."""
        return f"{self.name}_{self.unit}"

    def scaled(self, unit: str | None = None) -> list[float]:
        """Return the numbers in nm or as fractions, read in this unit instead of the header's."""
        scale = (LENGTHS | FRACTIONS)[unit or self.unit]
        return [number * scale for number in self.numbers]


def read_curves(name: str, folder: str) -> dict[str, Any]:
    """Return ``wavelengths_nm`` and ``curves`` of a file in ``folder``, the camera file's. Raises ValueError."""
    rows = read_rows(name, folder, "the file of curves", FIRST)
    if len(rows) < 3:
        raise ValueError(f"file {name!r} needs a header and at least two lines of numbers")
    try:
        titles = [
            named_column(1, rows[0][0], LENGTHS, FIRST),
            *(
                named_column(n, title, FRACTIONS)
                for n, title in enumerate(rows[0][1:], start=2)
            ),
        ]
    except ValueError as error:
        raise ValueError(f"file {name!r}: {error}") from None
    if len(titles) < 2:
        raise ValueError(
            f"file {name!r} needs a wavelength column and at least one curve, {SEPARATED}"
        )
    try:
        numbers = [
            [float(cell) for cell, _ in zip(row, titles, strict=True)] for row in rows[1:]
        ]
    except ValueError:
        raise ValueError(
            f"file {name!r} has a line that is not {len(titles)} numbers {SEPARATED}"
        ) from None
    wavelengths, *curves = (
        Column(*title, list(column))
        for title, column in zip(titles, zip(*numbers, strict=True), strict=True)
    )
    found = {one.name: one.scaled() for one in curves}
    if len(found) < len(curves):
        raise ValueError(
            f"file {name!r} names a curve twice; give each of {sorted(found)} one column"
        )
    _check_lengths(name, wavelengths)
    _check_fractions(name, curves)
    return {"wavelengths_nm": wavelengths.scaled(), "curves": found}


def _check_lengths(name: str, column: Column) -> None:
    """Raise ValueError for unusual wavelengths that would be usual in another unit."""
    if all(map(Nanometres.includes, column.scaled())):
        return
    meant = next(
        (unit for unit in LENGTHS if all(map(Nanometres.includes, column.scaled(unit)))), None
    )
    if meant is not None:
        ends = f"{min(column.numbers):g} to {max(column.numbers):g} {column.unit}"
        raise ValueError(
            f"file {name!r}: {column.title} goes from {ends}; {Nanometres.text} nm is usual; if it is in {meant}, call "
            f"it {column.name}_{meant}"
        )


def _check_fractions(name: str, columns: list[Column]) -> None:
    """Raise ValueError for percents in a column of fractions, and for fractions in all columns of percents."""
    for one in columns:
        if one.unit == "fraction" and 1 < max(one.numbers) <= 100:
            raise ValueError(
                f"file {name!r}: {one.title} has {max(one.numbers):g}; a fraction is at most 1; if it is in "
                f"percent, call it {one.name}_percent"
            )
    percents = [one for one in columns if one.unit == "percent"]
    largest = max((max(one.numbers) for one in percents), default=0.0)
    if 0 < largest <= 1:
        raise ValueError(
            f"file {name!r}: the largest quantum efficiency is {largest:g} percent; if these are fractions, rename the "
            f"columns to {percents[0].name}_fraction; if the camera detects so little, convert them to fractions"
        )
