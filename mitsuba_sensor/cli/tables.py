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

NUMBER = re.compile(r"[<(+−-]?\d[\d.,]*(e[+-]?\d+)?(±[\d.e+-]+)?%?[),;:]?", re.IGNORECASE)
NO_TEXT = ("", "–")  # in a column of numbers
PIECE = re.compile(r"[^\s/]*/+|[^\s/]+")  # paths and addresses may break behind a slash
PART = re.compile(
    r"[^._-]*[._-]+|[^._-]+"
)  # where that is not enough, names between their parts
GAP = 2  # between columns
FINEST = 1e-4  # of a unit: half of this and less is printed as 0


@dataclass
class FittedTable:
    """Rows under headings, as every table of the command line looks.

    keys : so many leading columns name the rows; they stand in front of every block.
    Text breaks at blanks and behind slashes. Numbers stay whole, and columns of nothing else are flush right.
    A block below the first one has only the rows that have something in it.
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
        """The smallest width [characters] of these columns in which nothing breaks within a name or number."""
        return sum(self._range(column)[0] for column in columns) + GAP * (len(columns) - 1)

    def block(self, columns: Sequence[int], width: int) -> Table:
        """These columns in so many characters. Where that is not enough, texts break, then names of rows."""
        drawn = Table(
            box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, GAP - 1, 0, 0)
        )
        widths = self._widths(columns, width)
        for column, characters in zip(columns, widths, strict=True):
            side: Literal["right", "left"] = "right" if self._is_of_numbers(column) else "left"
            heading = Text(self.headings[column])  # not markup: [s] is a unit
            drawn.add_column(heading, overflow="fold", width=characters, justify=side)
        for row, style in zip(self.rows, self.styles, strict=True):
            if self._has_text(row, columns):
                cells = map(_broken, (row[column] for column in columns), widths)
                drawn.add_row(*cells, style=style)
        return drawn

    def _has_text(self, row: Sequence[Text], columns: Sequence[int]) -> bool:
        """Whether a row stands in a block: in the first one all do."""
        own = columns[self.keys :]
        return self.keys in own or not own or any(row[column].plain for column in own)

    def _widths(self, columns: Sequence[int], width: int) -> list[int]:
        """What is left over goes to the columns that can use it, in equal shares."""
        found = {column: self._range(column)[0] for column in columns}
        left = width - self.least(columns)
        names, texts = columns[: self.keys], columns[self.keys :]
        least = {column: self._least_of_parts(column) for column in columns}
        for column, end in [
            *((one, least[one]) for one in (*texts, *names)),
            *((one, 1) for one in names),
        ]:
            given = max(min(-left, found[column] - end), 0)
            found[column], left = found[column] - given, left + given
        wanted = {column: self._range(column)[1] - found[column] for column in columns}
        for number, column in enumerate(sorted(columns, key=lambda one: wanted[one])):
            more = max(min(wanted[column], left // (len(columns) - number)), 0)
            found[column], left = found[column] + more, left - more
        return [found[column] for column in columns]

    def _range(self, column: int) -> tuple[int, int]:
        """Smallest width in which no number and no name breaks, and the one that takes a line for each row."""
        texts = self._texts(column)
        pieces = (cell_len(piece) for text in texts for piece in PIECE.findall(text))
        least = max(pieces, default=1)
        lines = [line for text in texts[1:] for line in text.split("\n")]
        of_rows = max(map(cell_len, lines), default=1)
        if self._is_of_numbers(column):
            heading = least
        else:
            heading = cell_len(texts[0])
        return least, max(least, of_rows, heading)

    def _least_of_parts(self, column: int) -> int:
        """Smallest width in which names break between their parts."""
        texts = self._texts(column)
        return max((cell_len(part) for text in texts for part in _parts(text)), default=1)

    def _texts(self, column: int) -> list[str]:
        return [self.headings[column], *(row[column].plain for row in self.rows)]

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


def _parts(text: str) -> Iterator[str]:
    """The parts of a text at which it may break where it must."""
    for piece in PIECE.findall(text):
        if NUMBER.fullmatch(piece):
            yield piece
        else:
            yield from PART.findall(piece)


def _broken(cell: Text, width: int) -> Text:
    """The cell with line breaks in what is longer than a line: behind slashes, else between the parts of names."""
    breaks = []
    for text in re.finditer(r"\S+", cell.plain):
        if cell_len(text[0]) > width:
            breaks += [text.start() + place for place in _breaks(text[0], width)]
    if not breaks:
        return cell
    return Text("\n").join(cell.divide(breaks))


def _breaks(text: str, width: int) -> Iterator[int]:
    """Places at which a text without blanks goes on in the next line."""
    used, place = 0, 0
    for piece in PIECE.findall(text):
        if cell_len(piece) <= width:
            parts = [piece]
        else:
            parts = [*_parts(piece)]
        for part in parts:
            if used and used + cell_len(part) > width:
                yield place
                used = 0
            used, place = used + cell_len(part), place + len(part)


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
