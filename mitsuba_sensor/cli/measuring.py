"""What the commands have in common that measure: simulated or real frames, the files they write, what they print."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from ..core import InputError, require_seed
from ..core.options import Option
from .app import show, show_remarks
from .tables import ResultTable

if TYPE_CHECKING:
    from ..pages.page import Study, Table

PANEL = "Simulated frames"
STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
ROWS_MAX = 40
"""Of a table; a longer one shows the rows that failed or are recommended."""


class SimulatedFlags(TypedDict, total=False):
    """Which camera of its kind is simulated, and which of its frames."""

    serial: Annotated[
        int | None,
        Option(
            "Serial number of the simulated camera. Default: 1.",
            check=require_seed,
            panel=PANEL,
        ),
    ]
    seed: Annotated[
        int | None,
        Option("Seed of the simulated frames. Default: 1.", check=require_seed, panel=PANEL),
    ]


def refuse_beside_frames(given: Mapping[str, object], names: Iterable[str]) -> None:
    """Raises InputError where one of these options of a simulated camera is given."""
    for name in names:
        if given[name] is not None and given[name] is not False:
            raise InputError(
                f"--{name} is for simulated frames, and --frames names real ones; omit one of them."
            )


def how_made() -> dict[str, object]:
    """Command, machine and versions, for the foot of a page."""
    from ..core.versions import machine, versions

    command = shlex.join(["mitsuba-sensor", *sys.argv[1:]])
    return {"command": command, "machine": machine(), "versions": versions()}


def write_texts(folder: str, contents: Mapping[str, str]) -> None:
    """Text files by name, which appear in a folder together."""
    from ..files import texts
    from ..files.appearing import output_folder

    with output_folder(folder, [*contents]) as scratch:
        for name, content in contents.items():
            texts.write_page(scratch / name, content)


def finish(
    found: "Study",
    folder: str | Path,
    names: Sequence[str],
    as_json: object,
    remarks: Iterable[str] = (),
) -> None:
    """Print what a study found and what it wrote, and end with exit code 1 where something failed.

    names : of the files in the folder, the page first.
    """
    from .inputs import written

    show(found.to_dict(), bool(as_json), study_sheet(found, str(Path(folder) / names[0])))
    show_remarks(bool(as_json), [*remarks, written(folder, names)])
    if not found.passed:
        raise typer.Exit(1)


def study_sheet(found: "Study", path: str) -> RenderableType:
    """The verdict of a study, its findings and its tables; pictures are on the page.  path : of the page."""
    from ..pages.page import Table

    style = "bold red"
    if found.passed:
        style = "bold yellow" if found.missing else "bold green"
    title = Text.assemble((found.title, "bold"), " – ", (found.headline, style), f" → {path}")
    tables = [_table(part) for part in found.parts if isinstance(part, Table) and part.rows]
    return Group(title, *(Text(f"• {one}") for one in found.findings), *tables)


def _table(table: "Table") -> ResultTable:
    from ..pages.html_page import FIGURE_SPACE, POINT_SPACE, shown

    headings, _, rows = shown(table)
    few = rows if len(rows) <= ROWS_MAX else [row for row in rows if row[0] in ("bad", "best")]
    more = f"{len(rows) - len(few)} more rows in the page" if len(few) < len(rows) else ""
    drawn = ResultTable(headings, table.title, more)
    for mark, cells in few:
        plain = (cell.rstrip(FIGURE_SPACE + POINT_SPACE) for cell in cells)
        drawn.add_row(*plain, style=STYLES[mark])
    return drawn
