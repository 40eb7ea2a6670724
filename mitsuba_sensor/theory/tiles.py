"""Tiles: rectangles of neighbouring pixels of a window that are computed together."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np


class Tile(NamedTuple):
    """Pixels that are sampled together: their rows and columns in the window of the frame."""

    rows: slice
    columns: slice

    @property
    def pixels(self) -> int:
        """How many there are."""
        height, width = self.shape
        return height * width

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start

    def wider(self, by_px: tuple[int, int], shape: tuple[int, int]) -> Tile:
        """With so many more rows and columns on each side, as far as the window has them."""
        sides = []
        for side, more, length in zip(self, by_px, shape, strict=True):
            sides.append(slice(max(side.start - more, 0), min(side.stop + more, length)))
        return Tile(*sides)

    def within(self, other: Tile) -> Tile:
        """The same pixels counted from the first one of a tile about it."""
        sides = zip(self, other, strict=True)
        return Tile(
            *(slice(mine.start - its.start, mine.stop - its.start) for mine, its in sides)
        )

    def of_rows(self, rows: slice) -> Tile:
        """Those of its pixels that are in these rows; none has no rows."""
        start, stop = max(self.rows.start, rows.start), min(self.rows.stop, rows.stop)
        return Tile(slice(start, max(start, stop)), self.columns)


def tiles_of(shape: tuple[int, int], sides_px: tuple[int, int]) -> list[Tile]:
    """A window in tiles of about the same size, none of them with more rows and columns than these."""
    row_parts, column_parts = map(_parts, shape, sides_px)
    return [Tile(rows, columns) for rows in row_parts for columns in column_parts]


def _parts(length: int, longest: int) -> list[slice]:
    """A side of a window in parts of about the same length."""
    edges = np.linspace(0, length, -(-length // longest) + 1).astype(int).tolist()
    return [slice(*pair) for pair in itertools.pairwise(edges)]
