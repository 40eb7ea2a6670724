"""The aperture of a pixel: its relative sensitivity to light by position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from pydantic import ValidationInfo

from ..core.csv_rows import SEPARATED
from .csv_file import read_rows

Cells: TypeAlias = tuple[tuple[float, ...], ...]
CELLS_MAX = 64
"""Most rows and columns of a map of the sensitivity within the pixel."""
SENSITIVITY_MAX = 1e6
EXAMPLE = "[[0.5, 1, 0.5], [1, 1, 1], [0.5, 1, 0.5]]"


@dataclass(frozen=True)
class PixelAperture:
    """A rectangle in the middle of a pixel, divided into equal cells with a sensitivity each.

    sides : width and height of the rectangle, as fractions of the pitch.
    cells : sensitivity of each cell relative to the best, rows from the top as one looks at the picture.
    """

    sides: tuple[float, float] = (1.0, 1.0)
    cells: Cells = ((1.0,),)

    @classmethod
    def of_map(cls, rows: Cells) -> PixelAperture:
        """Return the whole pixel with measured sensitivities."""
        values = np.array(rows)
        return cls(cells=tuple(map(tuple, (values / values.max()).tolist())))

    @property
    def is_even(self) -> bool:
        """Whether the sensitivity is the same all over the rectangle."""
        return len(set().union(*self.cells)) == 1

    @property
    def is_full(self) -> bool:
        """Whether the sensitivity is the same all over the pixel."""
        return self.sides == (1.0, 1.0) and self.is_even

    @property
    def area(self) -> float:
        """Mean sensitivity over the pixel, relative to the best cell."""
        return math.prod(self.sides) * float(np.mean(self.cells))

    def profile(self, along_rows: bool) -> tuple[float, ...]:
        """Return the sensitivity along rows or columns, summed over the other direction."""
        return tuple(np.sum(self.cells, axis=0 if along_rows else 1).tolist())


def aperture_value(value: object, info: ValidationInfo) -> object:
    """Return the value of ``pixel.aperture``, with the map read if it names a file. Raises ValueError."""
    if isinstance(value, str) and value.endswith(".csv"):
        value = _read_map(value, (info.context or {}).get("folder", "."))
    if isinstance(value, str) and value in ("full", "square"):
        return value
    if isinstance(value, list | tuple) and value:
        if all(isinstance(row, list | tuple) for row in value):
            return _checked_map(value)
        if len(value) == 2 and all(_is_from(side, 0, 1) and side > 0 for side in value):
            return tuple(map(float, value))
    raise ValueError(
        f"{value!r} is neither 'full' nor 'square' nor a width and a height; give these as fractions of the pitch, "
        "above 0 and at most 1, e.g. [0.8, 0.6], or rows of the sensitivity within the pixel, or a .csv file of these"
    )


def _is_from(value: object, low: float, high: float) -> bool:
    return type(value) in (int, float) and low <= value <= high  # type: ignore[operator]


def _checked_map(rows: list[list[object]] | tuple[tuple[object, ...], ...]) -> Cells:
    """Return the rows as numbers. Raises ValueError for rows of unequal length or wrong values."""
    widths = {len(row) for row in rows}
    if len(widths) > 1 or not 1 <= max(widths) <= CELLS_MAX or len(rows) > CELLS_MAX:
        raise ValueError(
            f"the sensitivity within the pixel has {len(rows)} row(s) of {', '.join(map(str, sorted(widths)))} "
            f"values; give rows of equal length, at most {CELLS_MAX} × {CELLS_MAX}, e.g. {EXAMPLE}"
        )
    values = [value for row in rows for value in row]
    for value in values:
        if not _is_from(value, 0, SENSITIVITY_MAX):
            raise ValueError(
                f"the sensitivity within the pixel has the value {value!r}; give numbers from 0 to "
                f"{SENSITIVITY_MAX:g}, only their ratios matter"
            )
    if not any(values):
        raise ValueError(
            f"the sensitivity within the pixel is 0 everywhere; give numbers above 0, e.g. {EXAMPLE}"
        )
    return tuple(tuple(map(float, row)) for row in rows)  # type: ignore[arg-type]


def _read_map(name: str, folder: str) -> list[list[float]]:
    """Return the rows of a file in ``folder``, the camera file's; lines with # are comments. Raises ValueError."""
    rows = read_rows(name, folder, "the file of the sensitivity within the pixel")
    try:
        return [[float(cell) for cell in row] for row in rows]
    except ValueError as error:
        raise ValueError(
            f"file {name!r}: {error}; it must be rows of numbers, {SEPARATED}, without a header"
        ) from None
