"""The findings of a study and its tables, as the terminal shows them."""

from __future__ import annotations

import io
from collections.abc import Mapping

from rich.console import Console, Group, RenderableType
from rich.text import Text

from ..pages import page
from ..pages.html_page import text
from .tables import FittedTable

STYLES = {
    "good": "green",
    "bad": "bold red",
    "best": "bold green",
    "dim": "dim",
    "": "",
}  # of a mark
MOST_LINES = 40
"""Of a study in the terminal; what does not fit stands in the page."""
LAST_LINES = 2  # of the sentence about what does not fit, in a narrow terminal
LONGEST = 16  # rows of a table that a terminal still shows
NOTHING = 1e-30  # what is smaller is printed as 0


def study_sheet(found: page.Study, path: str, width: int) -> RenderableType:
    """A study in the terminal of so many characters: findings, then the tables that fit, first those with faults."""
    style = "bold red"
    if found.passed:
        style = "bold yellow" if found.missing else "bold green"
    verdict = (found.verdict, style)
    lines: list[RenderableType] = [
        Text.assemble((found.title, "bold"), " – ", verdict, " → ", (path, "bold"))
    ]
    parts = [
        part for part in found.parts if isinstance(part, page.Grid | page.Table) and part.rows
    ]
    parts.sort(key=lambda part: not _has_faults(part))
    pieces: dict[str, list[RenderableType]] = {
        "findings": [Text(f"• {finding}") for finding in found.findings],
        "tables": [
            _grid(part) if isinstance(part, page.Grid) else _table(part, width)
            for part in parts
        ],
    }
    left, hidden = MOST_LINES - LAST_LINES - height(lines[0], width), dict.fromkeys(pieces, 0)
    for kind, some in pieces.items():
        for piece in some:
            if fits := height(piece, width) <= left:
                lines.append(piece)
                left -= height(piece, width)
            hidden[kind] += not fits
    if any(hidden.values()):
        lines.append(in_the_page(hidden))
    return Group(*lines)


def in_the_page(hidden: Mapping[str, int]) -> Text:
    """What only the page has.  hidden : things, in the plural, and how many of them."""
    more = [
        f"{number} more {name if number > 1 else name.removesuffix('s')}"
        for name, number in hidden.items()
        if number
    ]
    return Text(f"{' and '.join(more)} in the page", style="dim")


def height(what: RenderableType, width: int) -> int:
    """Lines that it takes in so many characters."""
    console = Console(width=width, file=io.StringIO())
    return len(console.render_lines(what, pad=False))


def _has_faults(part: page.Grid | page.Table) -> bool:
    if isinstance(part, page.Grid):
        rows = part.marks
    else:
        rows = (part.marks,)
    return any("bad" in marks for marks in rows)


def _grid(part: page.Grid) -> RenderableType:
    drawn = FittedTable(("", *part.columns), title=part.title)
    for name, marks, texts in zip(part.rows, part.marks, part.texts, strict=True):
        drawn.add_row(
            name, *(Text(cell, STYLES[mark]) for cell, mark in zip(texts, marks, strict=True))
        )
    return drawn


def _table(table: page.Table, width: int) -> RenderableType:
    """As many of its columns, from the left, as fit, and what of it stands only in the page.

    Of a long one the rows that are not as they must be, or that are to be taken.
    """
    if set(table.marks) == {"good"}:
        return Text(f"{table.title}: all {len(table.rows)} rows passed")
    rows = list(zip(table.marks or ("",) * len(table.rows), table.rows, strict=True))
    if len(rows) <= LONGEST:
        shown = rows
    else:
        shown = [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
    drawn = FittedTable(table.columns)
    for mark, row in shown:
        drawn.add_row(*map(_cell, row), style=STYLES[mark])
    columns = range(len(table.columns))
    count = max(sum(drawn.least(columns[: one + 1]) <= width for one in columns), 1)
    hidden = {"rows": len(rows) - len(shown), "columns": len(columns) - count}
    if any(hidden.values()):
        said = [in_the_page(hidden)]
    else:
        said = []
    if not shown:
        return Text(f"{table.title}: {len(rows)} rows, in the page", style="dim")
    return Group(
        Text(f"\n{table.title}", style="bold"), drawn.block(columns[:count], width), *said
    )


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return text(value)
    if abs(value) < NOTHING:
        return "0"
    return f"{value:.3g}"
