"""A study in the terminal: its verdict, its findings and the tables that fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ..study import page
from ..study.html import text
from .terminal import columns_table

STYLES: dict[page.Mark, str] = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
LONGEST = 48
"""Rows of a table that a terminal still shows; of a longer one only those that are not as they must be."""


@contextmanager
def seconds_bar(console: Console) -> Iterator[page.Progress]:
    """A bar over the seconds that a study expects to take, and what it does now. Yields what a study reports to."""
    columns = (
        BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
        TextColumn("{task.description}", style="dim"),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task, told = progress.add_task("", total=None, left=""), False

        def tell(done_s: float, expected_s: float, words: str) -> None:
            nonlocal told
            left = about(max(expected_s - done_s, 0.0))
            if not told:
                console.print(f"this takes {left}", highlight=False)
                told = True
            progress.update(task, completed=done_s, total=expected_s, description=words, left=f"{left} left")

        yield tell


def about(seconds: float) -> str:
    """How long, as people say it."""
    return f"about {seconds / 60:.0f} min" if seconds > 90 else f"about {seconds:.0f} s"


def sheet(study: page.Study, folder: str) -> RenderableType:
    """The whole study, as far as it fits."""
    verdict = ("everything that must hold does", "bold green") if study.passed else ("not all holds", "bold red")
    head = Text.assemble((study.title, "bold"), " – ", verdict, " → ", (folder, "bold"))
    findings = [Text.assemble("• ", finding) for finding in study.findings]
    return Group(head, *findings, *_parts(study))


def _parts(study: page.Study) -> Iterator[RenderableType]:
    for part in study.parts:
        if isinstance(part, page.Grid):
            yield _grid(part)
        elif isinstance(part, page.Table):
            yield _table(part)


def _table(table: page.Table) -> RenderableType:
    marks = table.marks or ("",) * len(table.rows)
    rows = list(zip(marks, table.rows, strict=True))
    left_out = 0
    if len(rows) > LONGEST:
        shown = [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
        rows, left_out = shown, len(rows) - len(shown)
    drawn = columns_table(*table.columns)
    drawn.title, drawn.title_justify, drawn.title_style = table.title, "left", "bold"
    for index, column in enumerate(drawn.columns):
        if all(isinstance(row[index], int | float | None) for _, row in rows):
            column.justify = "right"
    for mark, row in rows:
        drawn.add_row(*(Text(text(value)) for value in row), style=STYLES[mark])
    return Group(drawn, Text(f"{left_out} more rows stand in the page", style="dim")) if left_out else drawn


def _grid(grid: page.Grid) -> Table:
    drawn = columns_table("", *grid.columns)
    drawn.title, drawn.title_justify, drawn.title_style = grid.title, "left", "bold"
    words = grid.words or tuple(tuple(str(mark) for mark in row) for row in grid.marks)
    for name, marks, cells in zip(grid.rows, grid.marks, words, strict=True):
        drawn.add_row(name, *(Text(cell, style=STYLES[mark]) for cell, mark in zip(cells, marks, strict=True)))
    return drawn
