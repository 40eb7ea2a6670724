"""A study in the terminal: its verdict, its findings and the tables that fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import accumulate

from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from ..study.html import text
from ..study.page import Grid, Study, Table
from .terminal import columns_table

STYLES: dict[str, str] = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
LONGEST = 48  # rows of a table that a terminal still shows; of a longer one only those that are not as they must be
WIDEST, GAP = 30, 2  # characters of a column that holds text, and between two columns


@contextmanager
def seconds_bar(console: Console) -> Iterator[Callable[[float, float, str], None]]:
    """A bar over the seconds that a study expects to take, and what it does now. Yields what a kit reports to."""
    columns = (
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def tell(done_s: float, expected_s: float, now: str) -> None:
            left_s = max(expected_s - done_s, 0.0)
            left = f"about {left_s / 60:.0f} min" if left_s > 90 else f"about {left_s:.0f} s"
            if progress.tasks[task].total is None:
                console.print(f"this takes {left}", highlight=False)
            progress.update(task, completed=done_s, total=expected_s, description=f"{left} left [dim]{now}")

        yield tell


def sheet(study: Study, page: str, width: int) -> RenderableType:
    """The whole study, as far as it fits into so many columns of characters."""
    verdict = ("everything that must hold does", "bold green") if study.passed else ("not all holds", "bold red")
    head = Text.assemble((study.title, "bold"), " – ", verdict, " → ", (page, "bold"))
    return Group(head, *(Text(f"• {finding}") for finding in study.findings), *_parts(study, width))


def _parts(study: Study, width: int) -> Iterator[RenderableType]:
    for part in study.parts:
        if isinstance(part, Grid):
            yield _grid(part)
        elif isinstance(part, Table) and part.rows and set(part.marks) == {"good"}:
            yield Text(f"{part.title}: all {len(part.rows)} rows as they must be")
        elif isinstance(part, Table) and part.rows:
            yield from _table(part, width)


def _table(table: Table, width: int) -> Iterator[RenderableType]:
    """As many of its columns, from the left, as fit, and what of it stands only in the page."""
    rows = list(zip(table.marks or ("",) * len(table.rows), table.rows, strict=True))
    shown = rows if len(rows) <= LONGEST else [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
    cells = [[f"{v:.3g}" if isinstance(v, float) else text(v) for v in row] for _, row in shown]
    longest = (  # headings break at spaces, long texts anywhere
        max(len(one) for one in (*heading.split(), "", *(row[index] for row in cells)))
        for index, heading in enumerate(table.columns)
    )
    count = max(sum(used <= width for used in accumulate(min(one, WIDEST) + GAP for one in longest)), 1)
    drawn = columns_table(*table.columns[:count])
    for index, column in enumerate(drawn.columns):
        if shown and all(isinstance(row[index], int | float | None) for _, row in shown):
            column.justify = "right"
    for (mark, _), texts in zip(shown, cells, strict=True):
        drawn.add_row(*map(Text, texts[:count]), style=STYLES[mark])
    yield Text(f"\n{table.title}", style="bold")
    yield drawn
    hidden = {"rows": len(rows) - len(shown), "columns": len(table.columns) - count}
    if more := " and ".join(f"{number} more {name}" for name, number in hidden.items() if number):
        yield Text(f"{more} stand in the page", style="dim")


def _grid(grid: Grid) -> RenderableType:
    drawn = columns_table("", *grid.columns)
    drawn.title, drawn.title_justify, drawn.title_style = grid.title, "left", "bold"
    for name, marks, texts in zip(grid.rows, grid.marks, grid.texts, strict=True):
        drawn.add_row(name, *(Text(cell, style=STYLES[mark]) for cell, mark in zip(texts, marks, strict=True)))
    return drawn
