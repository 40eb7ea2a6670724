"""The camera that ``cameras new`` writes: like another one, or of an EMVA 1288 sheet, with a name of its own."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path

import typer

import mitsuba_sensor as ms

from ..camera.camera import SET_BY_USER
from ..camera.emva_sheet import camera_of_sheet, comparisons, read_sheet
from ..camera.gain_ladder import SAME, SET
from ..camera.shipped import DEFAULT_CAMERA as DEFAULT
from ..core import InputError
from .inputs import changes_of
from .values import Flag

OF_SHEET = "by its EMVA 1288 sheet"


def new_camera_of(flags: Mapping[str, Flag], file: Path) -> tuple[ms.Camera, list[str]]:
    """The camera to write, and what is to be said of it. Raises InputError."""
    if flags["emva"] and flags["like"]:
        raise InputError(
            "--emva takes the numbers of a sheet, and --like those of a camera; give one of both."
        )
    if flags["emva"]:
        sheet = read_sheet(flags["emva"])
        name, description, notes = asked_names(flags, file, OF_SHEET)
        camera = camera_of_sheet(sheet, name, description).replace(**changes_of(flags))
        notes += comparisons(sheet, camera)
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
