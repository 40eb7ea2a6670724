"""What ``cameras new`` asks for: the rows of an EMVA 1288 sheet, and a name and description of one's own."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path

import typer

import mitsuba_sensor as ms

from ..camera.camera import SET_BY_USER
from ..camera.emva_sheet import ROWS, Row, Value, camera_of_sheet, comparisons, is_asked
from ..camera.emva_sheet_file import read_sheet
from ..camera.gain_ladder import SAME, SET
from ..camera.shipped import DEFAULT_CAMERA as DEFAULT
from ..core import InputError
from .app import err
from .inputs import changes_of
from .values import Flag

OF_SHEET = "by its EMVA 1288 sheet"


def new_camera_of(flags: Mapping[str, Flag], file: Path) -> tuple[ms.Camera, list[str]]:
    """The camera to write, and what is to be said of it. Raises InputError."""
    given = [name for name in ("emva", "emva_file", "like") if flags[name]]
    if len(given) > 1:
        raise InputError(
            "--emva asks for all numbers, --emva-file reads them, and --like takes those of a camera; give "
            "one of these."
        )
    if flags["emva"] or flags["emva_file"]:
        values = read_sheet(flags["emva_file"]) if flags["emva_file"] else asked_rows()
        name, description, notes = asked_names(flags, file, OF_SHEET)
        camera = camera_of_sheet(values, name, description).replace(**changes_of(flags))
        notes += comparisons(values, camera)
    else:
        like = ms.load_camera(flags["like"] or DEFAULT)
        name, description, notes = asked_names(flags, file, f"a camera like {like.name}")
        camera, kept = camera_like(like, name, description, changes_of(flags))
        notes += kept
    return camera.without(*flags["without"] or ()), notes


def camera_like(
    like: ms.Camera, name: str, description: str, changes: Mapping[str, object]
) -> tuple[ms.Camera, list[str]]:
    """A camera with the numbers of another one but for some, and what is kept. Raises InputError.

    Sources and gain settings are kept where they are true of it: another K has no source, and gain settings whose
    numbers are changed are left out.
    """
    camera = like.replace(name=name, description=description, **changes)
    old_k, k = like.system_gain_dn_per_e, camera.system_gain_dn_per_e
    same_k = math.isclose(old_k, k, rel_tol=SAME)
    kept = f"all numbers and their sources are those of {like.name}, but {', '.join(changes)}"
    if not same_k:
        kept += f"; K is {k:.4g} DN/e- (that of {like.name}: {old_k:.4g})"
    stale_ladder = "gains" not in changes and bool(like.gains)
    if stale_ladder and not (same_k and set(changes).isdisjoint(SET.values())):
        camera = camera.replace(gains=None, gain=None)
        kept += "; its gain settings are left out, because they have other numbers"
    sources = dict(camera.sources)
    for field, text in sources.items():
        if name != like.name and text != SET_BY_USER:
            sources[field] = f"assumed: as {like.name}: {text}"
    if not same_k and "adc.full_scale_v" not in changes:
        sources.pop("adc.full_scale_v", None)
    return camera.replace(sources=sources), [kept] if changes else []


def asked_names(
    flags: Mapping[str, Flag], file: Path, description: str
) -> tuple[str, str, list[str]]:
    """Name and description as given, else as typed at a terminal, else derived from the file, which a note says.

    description : that is proposed.
    """
    name, notes, at_terminal = flags["name"], [], is_terminal()
    if name is None:
        name = file.stem
        if at_terminal:
            name = typer.prompt("name of the camera", default=name, err=True)
        else:
            notes.append(
                f"the camera is called {name!r}, as its file; --name gives another name"
            )
    given = flags["description"]
    if given is None and at_terminal:
        given = typer.prompt("description, one line", default=description, err=True)
    return str(name), str(given if given is not None else description), notes


def is_terminal() -> bool:
    """Whether somebody can type answers."""
    return sys.stdin.isatty()


def asked_rows() -> dict[str, Value]:
    """The values of a sheet, each asked until it can be used; of answers that nobody types the first that cannot ends
    it, because all others would belong to another row. Raises InputError, also where the answers end before."""
    if is_terminal():
        err.print(
            "The rows of the EMVA 1288 summary sheet, from top to bottom; an optional one may stay empty.",
            highlight=False,
        )
    values: dict[str, Value] = {}
    for row in ROWS:
        if is_asked(row, values):
            values[row.key] = _asked(row)
    return values


def _asked(row: Row) -> Value:
    if row.optional:
        question = f"{row.question} (optional)"
    else:
        question = row.question
    while True:
        text = _typed(question)
        if text is None:
            raise InputError(
                f"the answers end before the row {row.question!r} of the sheet; give one line for each row, or a file "
                "of them (--emva-file)."
            )
        try:
            return row.value(text)
        except InputError as error:
            if not is_terminal():
                raise
            err.print(str(error), markup=False, highlight=False, soft_wrap=True)


def _typed(question: str) -> str | None:
    """The next answer; of a pipe a line, without asking. None where the answers end."""
    if is_terminal():
        try:
            return str(typer.prompt(question, default="", show_default=False, err=True))
        except typer.Abort:
            return None
    line = sys.stdin.readline()
    if line:
        return line.strip()
    return None
