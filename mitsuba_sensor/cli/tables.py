"""Tables and numbers on the terminal."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from ..core.printable import printable

NUMBER = re.compile(
    r"([<>] )?[<(+−-]?\d[\d.,]*(e[+-]?\d+)?(±[\d.e+-]+)?%?[),;:]?", re.IGNORECASE
)
EMPTY_CELLS = ("", "–")  # in a column of numbers
SMALLEST_SHOWN = 1e-4  # of a unit: half of this and less is printed as 0
LIST_MAX = 6  # numbers or names in a cell


class ResultTable(Table):
    """Rows under headings. Numbers are right-aligned and never cut: a table may be wider than its terminal."""

    def __init__(self, headings: Sequence[str], title: str = "", caption: str = "") -> None:
        super().__init__(
            box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0)
        )
        self.above, self.below = title, caption  # rich would wrap them at the table's width
        for heading in headings:
            self.add_column(Text(heading), overflow="fold")  # not markup: [s] is a unit
        self.has_only_numbers = [True] * len(headings)

    def add_row(self, *cells: str | Text, style: str = "") -> None:  # type: ignore[override]
        """Add a row with one cell per heading; texts are not markup."""
        texts = [Text(cell) if isinstance(cell, str) else cell for cell in cells]
        for i, text in enumerate(texts):
            text.plain = printable(text.plain, keep="\n")
            is_number = text.plain in EMPTY_CELLS or NUMBER.fullmatch(text.plain)
            self.has_only_numbers[i] &= bool(is_number)
        super().add_row(*texts, style=style)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table in at least its smallest width."""
        smallest = 0
        for i, column in enumerate(self.columns):
            texts = [str(cell) for cell in column.cells]
            if self.has_only_numbers[i] and texts:
                column.justify = "right"
            elif i:
                texts = [word for text in texts for word in text.split()]
            column.min_width = max(map(cell_len, [*texts, *str(column.header).split(), ""]))
            smallest += column.min_width + 2
        width = max(smallest, options.max_width)
        yield Text(f"\n{self.above}" if self.above else "", style="bold")
        yield from super().__rich_console__(console, options.update(max_width=width))
        if self.below:
            yield Text(f"{self.below}\n", style="dim")


def view(facts: object, name: str = "") -> RenderableType:
    """Return the JSON of a command as lines and tables: a list of objects becomes one table, and so does an object of
    objects.  name : of the facts."""
    rows = facts
    if isinstance(facts, dict) and facts and all(isinstance(x, dict) for x in facts.values()):
        rows = [{"name": key, **row} for key, row in facts.items()]
    if isinstance(rows, list | tuple) and rows and all(isinstance(row, dict) for row in rows):
        headings = dict.fromkeys(
            key for row in rows for key in row if row[key] not in (None, "")
        )
        table = ResultTable([*headings], name)
        for row in rows:
            table.add_row(*(cell(row.get(key)) for key in headings))
        return table
    if isinstance(facts, dict):
        return Group(*(view(value, key) for key, value in facts.items()))
    return fact(name, cell(facts))


def fact(name: str, text: str) -> Text:
    """Return a line ``name: text`` that is not wrapped, so paths can be copied."""
    line = Text.assemble((f"{name}: ", "bold"), text)
    line.no_wrap, line.overflow = True, "ignore"
    return line


def cell(value: object) -> str:
    """Return a value on one line; a long list by its ends."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {cell(inner)}" for name, inner in value.items())
    if isinstance(value, list | tuple):
        if len(value) > LIST_MAX:
            return f"{cell(value[0])} … {cell(value[-1])} ({len(value)})"
        return ", ".join(map(cell, value)) or "–"
    return "–" if value is None else str(value)


def number(value: float | None) -> str:
    """Return four significant digits, at most four decimals, and an exponent only above 1e7."""
    if value is None:
        return "–"
    if abs(value) < SMALLEST_SHOWN / 2:
        return "0"
    if 1e3 <= abs(value) < 1e7:
        return f"{value:.0f}"
    if abs(value) >= 0.1:
        return f"{value:.4g}"
    return f"{value:.4f}".rstrip("0")


def counted(count: int, noun: str) -> str:
    """Return ``1 sample`` or ``3 samples``."""
    return f"{count} {noun}{'s' * (count != 1)}"


def rough(value: float) -> str:
    """Return two significant digits."""
    if 0 < value < 1e-3:
        return "<0.001"
    return f"{value:.0f}" if 10 <= value < 1e6 else f"{value:.2g}"
