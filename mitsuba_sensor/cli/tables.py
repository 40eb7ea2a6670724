"""Tables that never cut a number: in a narrow terminal further columns follow below, in blocks of their own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from ..core.printable import printable

NUMBER = re.compile(r"[<(+−-]?\d[\d.,]*(e[+-]?\d+)?%?[),;:]?", re.IGNORECASE)
NO_TEXT = ("", "–")  # in a column of numbers
LONGEST_PIECE = 20  # longer ones, paths for example, are broken where the terminal is narrow
GAP = 2  # between columns
FINEST = 1e-4  # of a unit: half of this and less is printed as 0


@dataclass
class FittedTable:
    """Rows under headings, as every table of the command line looks.

    keys : so many leading columns name the rows; they stand in front of every block.
    Text breaks at blanks. Numbers stay whole, and columns of nothing else are flush right.
    """

    headings: Sequence[str]
    keys: int = 1
    caption: str = ""
    title: str = ""
    rows: list[tuple[Text, ...]] = field(default_factory=list)
    styles: list[str] = field(default_factory=list)

    def add_row(self, *cells: str | Text, style: str = "") -> None:
        """One cell for each heading."""
        texts = (Text(cell) if isinstance(cell, str) else cell for cell in cells)
        self.rows.append(tuple(_printable_cell(cell) for cell in texts))
        self.styles.append(style)

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        """The table, or as many blocks as the width of the terminal asks for."""
        if self.title:
            yield Text(f"\n{self.title}", style="bold")
        for columns in self.blocks(options.max_width):
            yield from (Text(), self.block(columns, options.max_width))
        yield Text(f"{self.caption}\n" if self.caption else "", style="dim")

    def blocks(self, width: int) -> list[list[int]]:
        """Numbers of the columns of every block."""
        keys, blocks = list(range(self.keys)), [list[int]()]
        for column in range(self.keys, len(self.headings)):
            if blocks[-1] and self.least([*keys, *blocks[-1], column]) > width:
                blocks.append([])
            blocks[-1].append(column)
        return [[*keys, *block] for block in blocks]

    def least(self, columns: Sequence[int]) -> int:
        """The smallest width [characters] of these columns in which nothing is cut."""
        return sum(self._range(column)[0] for column in columns) + GAP * (len(columns) - 1)

    def block(self, columns: Sequence[int], width: int) -> Table:
        """These columns in so many characters. Where that is not enough, names of rows are broken."""
        drawn = Table(
            box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, GAP - 1, 0, 0)
        )
        for column, characters in zip(columns, self._widths(columns, width), strict=True):
            side: Literal["right", "left"] = "right" if self._is_of_numbers(column) else "left"
            heading = self.headings[column]
            drawn.add_column(heading, overflow="fold", width=characters, justify=side)
        for row, style in zip(self.rows, self.styles, strict=True):
            drawn.add_row(*(row[column] for column in columns), style=style)
        return drawn

    def _widths(self, columns: Sequence[int], width: int) -> list[int]:
        """What is left over goes to the columns that can use it, in equal shares."""
        found = {column: self._range(column)[0] for column in columns}
        left = width - self.least(columns)
        for column in columns[: self.keys]:
            if left < 0:
                given = min(-left, found[column] - 1)
                found[column], left = found[column] - given, left + given
        wanted = {column: self._range(column)[1] - found[column] for column in columns}
        for number, column in enumerate(sorted(columns, key=lambda one: wanted[one])):
            more = max(min(wanted[column], left // (len(columns) - number)), 0)
            found[column], left = found[column] + more, left - more
        return [found[column] for column in columns]

    def _range(self, column: int) -> tuple[int, int]:
        """Smallest width in which no number and no usual text breaks, and the one that takes a line for each row."""
        texts = [self.headings[column], *(row[column].plain for row in self.rows)]
        pieces = [
            (cell_len(one), NUMBER.fullmatch(one)) for text in texts for one in text.split()
        ]
        least = max(
            (size if number else min(size, LONGEST_PIECE) for size, number in pieces), default=1
        )
        of_rows = max(
            (cell_len(line) for text in texts[1:] for line in text.split("\n")), default=1
        )
        if self._is_of_numbers(column):
            heading = least
        else:
            heading = cell_len(texts[0])
        return least, max(least, of_rows, heading)

    def _is_of_numbers(self, column: int) -> bool:
        texts = [row[column].plain for row in self.rows]
        return any(text not in NO_TEXT for text in texts) and all(
            text in NO_TEXT or NUMBER.fullmatch(text) for text in texts
        )


def _printable_cell(cell: Text) -> Text:
    """The cell as the terminal shows it, so that its width is right."""
    shown = printable(cell.plain, keep="\n")
    if shown == cell.plain:
        return cell
    return Text(shown, style=cell.style)


def number(value: float | None) -> str:
    """Four significant digits and no more than four decimals, without an exponent where it can be avoided."""
    if value is None:
        return "–"
    if abs(value) < FINEST / 2:
        return "0"
    if 1e3 <= abs(value) < 1e7:
        return f"{value:.0f}"
    if abs(value) >= 0.1:
        return f"{value:.4g}"
    return f"{value:.4f}".rstrip("0")


def rough(value: float) -> str:
    """Two significant digits, no more than six characters for most numbers."""
    if 0 < value < 1e-3:
        return "<0.001"
    return f"{value:.0f}" if 10 <= value < 1e6 else f"{value:.2g}"


def short(value: object) -> str:
    """A value on one line; a long list by its ends."""
    if isinstance(value, list | tuple) and len(value) > 6:
        return printable(f"{value[0]} … {value[-1]} ({len(value)} numbers)")
    return printable(str(value))
