"""A study in the terminal: its verdict, its findings and the tables that fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from ..study import page
from ..study.html import text
from .terminal import columns_table

STYLES: dict[str, str] = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
LONGEST = 48  # rows of a table that a terminal still shows; of a longer one only those that are not as they must be
WIDEST, GAP = 30, 2  # characters of a column that holds text, and between two columns


@contextmanager
def seconds_bar(console: Console) -> Iterator[Any]:
    """A bar over the seconds that a study expects to take, and what it does now. Yields what a kit reports to."""
    columns = (BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn())
    texts = TextColumn("{task.fields[left]}"), TextColumn("{task.description}", style="dim")
    with Progress(*columns, *texts, console=console, transient=True, disable=not console.is_terminal) as progress:
        task, told = progress.add_task("", total=None, left=""), False

        def tell(done_s: float, expected_s: float, now: str) -> None:
            nonlocal told
            left_s = max(expected_s - done_s, 0.0)
            left = f"about {left_s / 60:.0f} min" if left_s > 90 else f"about {left_s:.0f} s"
            if not told:
                console.print(f"this takes {left}", highlight=False)
                told = True
            progress.update(task, completed=done_s, total=expected_s, description=now, left=f"{left} left")

        yield tell


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
        elif isinstance(part, page.Table) and part.rows:
            held = set(part.marks) == {"good"}
            yield Text(f"{part.title}: all {len(part.rows)} rows as they must be") if held else Fitted(part)


@dataclass(frozen=True)
class Fitted:
    """A table of as many of its columns, from the left, as the terminal is wide."""

    table: page.Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, and what of it stands only in the page."""
        unmarked: tuple[page.Mark, ...] = tuple("" for _ in self.table.rows)
        rows = list(zip(self.table.marks or unmarked, self.table.rows, strict=True))
        shown = rows if len(rows) <= LONGEST else [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
        cells = [[f"{v:.3g}" if isinstance(v, float) else text(v) for v in row] for _, row in shown]
        count = _fitting(self.table.columns, cells, options.max_width)
        yield Text(f"\n{self.table.title}", style="bold")
        drawn = columns_table(*self.table.columns[:count])
        for index, column in enumerate(drawn.columns):
            if shown and all(isinstance(row[index], int | float | None) for _, row in shown):
                column.justify = "right"
        for (mark, _), texts in zip(shown, cells, strict=True):
            drawn.add_row(*map(Text, texts[:count]), style=STYLES[mark])
        yield drawn
        hidden = {"rows": len(rows) - len(shown), "columns": len(self.table.columns) - count}
        if more := " and ".join(f"{number} more {name}" for name, number in hidden.items() if number):
            yield Text(f"{more} stand in the page", style="dim")


def _fitting(headings: Sequence[str], cells: Sequence[Sequence[str]], width: int) -> int:
    """How many columns fit; the first always does. Headings break at spaces, long texts anywhere."""
    used = 0
    for index, heading in enumerate(headings):
        longest = max([*map(len, heading.split()), *(len(row[index]) for row in cells)], default=0)
        used += min(longest, WIDEST) + GAP
        if used > width:
            return max(index, 1)
    return len(headings)


def _grid(grid: page.Grid) -> RenderableType:
    drawn = columns_table("", *grid.columns)
    drawn.title, drawn.title_justify, drawn.title_style = grid.title, "left", "bold"
    for name, marks, texts in zip(grid.rows, grid.marks, grid.texts, strict=True):
        drawn.add_row(name, *(Text(cell, style=STYLES[mark]) for cell, mark in zip(texts, marks, strict=True)))
    return drawn
