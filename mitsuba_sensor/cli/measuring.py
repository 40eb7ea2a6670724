"""Shared by the commands that measure: options of simulated frames, written files, and printed results."""

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
from .app import err, show, show_remarks
from .flag_names import with_flags
from .progress import steps_bar
from .tables import ResultTable, counted

if TYPE_CHECKING:
    from ..pages.page import Study, Table

PANEL = "Simulated frames"
NOTHING: Mapping[str, str] = {}
STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}
ROWS_MAX = 40
"""A longer table shows only the rows that failed or are recommended."""


class SimulatedFlags(TypedDict, total=False):
    """The simulated sensor unit and its frames."""

    serial: Annotated[
        int | None,
        Option(
            "Serial number of the simulated sensor unit. Default: 1.",
            check=require_seed,
            panel=PANEL,
        ),
    ]
    seed: Annotated[
        int | None,
        Option("Seed of the simulated frames. Default: 1.", check=require_seed, panel=PANEL),
    ]


def refuse_beside_frames(given: Mapping[str, object], names: Iterable[str]) -> None:
    """Raise InputError if an option of simulated frames is given together with ``--frames``."""
    for name in names:
        if given[name] is not None and given[name] is not False:
            raise InputError(
                f"--{name} is for simulated frames, and --frames reads frames from disk; omit one of them."
            )


def how_made() -> dict[str, object]:
    """Return command, machine and versions, for the footer of a page."""
    from ..core.versions import machine, versions

    command = shlex.join(["mitsuba-sensor", *sys.argv[1:]])
    return {"command": command, "machine": machine(), "versions": versions()}


def publish(
    study: "Study",
    folder: str,
    stem: str,
    as_json: object,
    remarks: Iterable[str] = (),
    more: Mapping[str, str] = NOTHING,
) -> None:
    """Write the page and the numbers of a study, print it, and exit with code 1 if a check failed.

    stem : of the file names.  more : contents of further files, by name.
    """
    from ..files import texts
    from ..files.appearing import output_folder
    from ..pages.html_page import html

    with steps_bar(err, "drawing the page"):
        numbers = texts.to_json(study.to_dict()) + "\n"
        contents = {f"{stem}.html": html(study), f"{stem}.json": numbers, **more}
    with output_folder(folder, [*contents]) as scratch:
        for name, content in contents.items():
            texts.write_page(scratch / name, content)
    finish(study, folder, [*contents], as_json, remarks)


def finish(
    study: "Study",
    folder: str | Path,
    names: Sequence[str],
    as_json: object,
    remarks: Iterable[str] = (),
) -> None:
    """Print a study and its files; exit with code 1 if a check failed.  names : of the files, the page first."""
    from .inputs import written

    show(study.to_dict(), bool(as_json), study_sheet(study, str(Path(folder) / names[0])))
    show_remarks(bool(as_json), [*remarks, written(folder, names)])
    if not study.passed:
        raise typer.Exit(1)


def study_sheet(study: "Study", path: str) -> RenderableType:
    """Return the verdict, the findings and the tables of a study.  path : of its page, which has all of it."""
    from ..pages.page import Table

    style = "bold red"
    if study.passed:
        style = "bold green" if study.complete else "bold yellow"
    title = Text.assemble((study.title, "bold"), " – ", (study.headline, style), f" → {path}")
    tables = (part for part in study.parts if isinstance(part, Table) and part.rows)
    shown = [_table(part) for part in tables if part.terminal != ()]
    return Group(
        title, *(Text(f"• {with_flags(finding)}") for finding in study.findings), *shown
    )


def _table(table: "Table") -> ResultTable:
    """Return the columns and rows of a table that a terminal shows."""
    from ..pages.html_page import FIGURE_SPACE, POINT_SPACE, shown

    headings, _, rows = shown(table)
    chosen = (*(table.terminal or headings), "verdict")
    columns = [number for number, name in enumerate(headings) if name in chosen]
    short = (
        rows if len(rows) <= ROWS_MAX else [row for row in rows if row[0] in ("bad", "best")]
    )
    left = len(rows) - len(short)
    more = f"{counted(left, 'more row')} on the page" if left else ""
    drawn = ResultTable([headings[number] for number in columns], table.title, more)
    for mark, cells in short:
        plain = (cells[number].rstrip(FIGURE_SPACE + POINT_SPACE) for number in columns)
        drawn.add_row(*plain, style=STYLES[mark])
    return drawn
