"""The findings of a study and its tables, as the terminal shows them."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from ..study import page
from .tables import FittedTable

STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}  # of a mark
LONGEST = 48  # rows of a table that a terminal still shows; of a longer one only those that are not as they must be
NOTHING = 1e-30  # what is smaller is printed as 0


def study_sheet(found: page.Study, path: str, width: int) -> RenderableType:
    """The whole study in the terminal, its findings and as much of its tables as fits into so many characters."""
    verdict = ("everything that must hold does", "bold green") if found.passed else ("not all holds", "bold red")
    lines: list[RenderableType] = [Text.assemble((found.title, "bold"), " – ", verdict, " → ", (path, "bold"))]
    lines += (Text(f"• {finding}") for finding in found.findings)
    for part in found.parts:
        if isinstance(part, page.Grid):
            drawn = FittedTable(("", *part.columns), title=part.title)
            for name, marks, texts in zip(part.rows, part.marks, part.texts, strict=True):
                drawn.add_row(name, *(Text(cell, STYLES[mark]) for cell, mark in zip(texts, marks, strict=True)))
            lines.append(drawn)
        elif isinstance(part, page.Table) and part.rows:
            held = Text(f"{part.title}: all {len(part.rows)} rows as they must be")
            lines += [held] if set(part.marks) == {"good"} else _table(part, width)
    return Group(*lines)


def _table(table: page.Table, width: int) -> Iterator[RenderableType]:
    """As many of its columns, from the left, as fit, and what of it stands only in the page."""
    rows = list(zip(table.marks or ("",) * len(table.rows), table.rows, strict=True))
    shown = rows if len(rows) <= LONGEST else [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
    drawn = FittedTable(table.columns)
    for mark, row in shown:
        drawn.add_row(*map(_cell, row), style=STYLES[mark])
    columns = range(len(table.columns))
    count = max(sum(drawn.least(columns[: one + 1]) <= width for one in columns), 1)
    yield from (Text(f"\n{table.title}", style="bold"), drawn.block(columns[:count], width))
    hidden = {"rows": len(rows) - len(shown), "columns": len(columns) - count}
    if more := " and ".join(f"{number} more {name}" for name, number in hidden.items() if number):
        yield Text(f"{more} stand in the page", style="dim")


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return page.text(value)
    return "0" if abs(value) < NOTHING else f"{value:.3g}"
