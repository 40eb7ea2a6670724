"""A study in the terminal: verdict, findings and tables; pictures are on the page."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ..pages.html_page import FIGURE_SPACE, POINT_SPACE, shown
from ..pages.page import Study, Table
from .tables import ResultTable

STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
ROWS_MAX = 40  # of a table; a longer one shows the rows that failed or are recommended


def study_sheet(found: Study, path: str) -> RenderableType:
    """The verdict of a study, its findings and its tables.  path : of the page."""
    style = "bold red"
    if found.passed:
        style = "bold yellow" if found.missing else "bold green"
    title = Text.assemble((found.title, "bold"), " – ", (found.headline, style))
    title.append(f" → {path}")
    tables = [_table(part) for part in found.parts if isinstance(part, Table) and part.rows]
    return Group(title, *(Text(f"• {one}") for one in found.findings), *tables)


def _table(table: Table) -> ResultTable:
    headings, _, rows = shown(table)
    few = rows if len(rows) <= ROWS_MAX else [row for row in rows if row[0] in ("bad", "best")]
    more = f"{len(rows) - len(few)} more rows in the page" if len(few) < len(rows) else ""
    drawn = ResultTable(headings, title=table.title, caption=more)
    for mark, cells in few:
        plain = (cell.rstrip(FIGURE_SPACE + POINT_SPACE) for cell in cells)
        drawn.add_row(*plain, style=STYLES[mark])
    return drawn
