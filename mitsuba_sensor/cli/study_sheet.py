"""A study in the terminal: verdict, findings and tables; plots stand in the page."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ..pages.html_page import text
from ..pages.page import Grid, Study, Table
from .tables import ResultTable

STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
ROWS_MAX = 40  # of a table; a longer one shows the rows that failed or are recommended


def study_sheet(found: Study, path: str) -> RenderableType:
    """The verdict of a study, its findings and its tables.  path : of the page."""
    style = "bold red"
    if found.passed:
        style = "bold yellow" if found.missing else "bold green"
    verdict = (found.verdict, style)
    title = Text.assemble((found.title, "bold"), " – ", verdict, " → ", (path, "bold"))
    tables = [_table(part) for part in found.parts if isinstance(part, Table) and part.rows]
    grids = [_grid(part) for part in found.parts if isinstance(part, Grid)]
    return Group(title, *(Text(f"• {one}") for one in found.findings), *grids, *tables)


def _grid(part: Grid) -> ResultTable:
    drawn = ResultTable(("", *part.columns), title=part.title)
    for name, marks, texts in zip(part.rows, part.marks, part.texts, strict=True):
        cells = zip(texts, marks, strict=True)
        drawn.add_row(name, *(Text(cell, STYLES[mark]) for cell, mark in cells))
    return drawn


def _table(table: Table) -> ResultTable:
    rows = [*zip(table.marks or ("",) * len(table.rows), table.rows, strict=True)]
    shown = (
        rows if len(rows) <= ROWS_MAX else [row for row in rows if row[0] in ("bad", "best")]
    )
    in_page = (
        f"{len(rows) - len(shown)} more rows in the page" if len(shown) < len(rows) else ""
    )
    drawn = ResultTable(table.columns, title=table.title, caption=in_page)
    for mark, row in shown:
        cells = (f"{x:.3g}" if isinstance(x, float) else text(x) for x in row)
        drawn.add_row(*cells, style=STYLES[mark])
    return drawn
