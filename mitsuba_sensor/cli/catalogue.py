"""The commands below cameras: the cameras and lens prescriptions that ship with the package."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from rich.text import Text

import mitsuba_sensor as ms

from ..core import InputError
from ..io import files
from ..sensor.camera_check import CameraFinding
from . import arguments, options
from .app import THINGS, app, changes_of, show
from .tables import FittedTable, short

cameras = typer.Typer(
    no_args_is_help=True, help="The cameras that ship with the package, their lenses, and camera files of your own."
)
app.add_typer(cameras, name="cameras", rich_help_panel=THINGS)


@cameras.command("list")
def list_command(as_json: arguments.Json = False) -> None:
    """The cameras that ship with the package."""
    known = [ms.load_camera(name) for name in ms.list_cameras()]
    table = FittedTable(("camera", "technology", "pixels", "what it is"))
    for one in known:
        size = f"{one.sensor.columns} × {one.sensor.rows}"
        table.add_row(one.name, one.sensor.technology, size, one.description)
    show([{"name": one.name, "description": one.description} for one in known] if as_json else table, as_json)


@cameras.command("new", epilog="Example: mitsuba-sensor cameras new my.toml --like bayer_2mp --set adc.bits=14")
@options.flags(options.NewCameraFlags)
def new_camera(name: arguments.NewFile, **flags: options.Flag) -> None:
    """Write a camera file to change: every key with unit, range, meaning, and where its value comes from.

    It loads as the camera that it is like; `cameras check FILE` says what is wrong after a change.
    """
    file = Path(name)
    if file.suffix != ".toml":
        raise InputError(f"{name or 'an empty text'} is no name of a camera file; let it end in .toml.")
    if file.exists() and not (flags["force"] and file.is_file()):
        remedy = "--force writes over it, or give another name" if file.is_file() else "give another name"
        raise InputError(f"{file} exists already; {remedy}.")
    files.write_page(file, ms.load_camera(flags["like"]).replace(**changes_of(flags)).to_toml())
    show(f"{file} is a camera like {flags['like']}; change it, then: mitsuba-sensor cameras check {file}", False)


@cameras.command("check", epilog="Example: mitsuba-sensor cameras check my.toml")
def check_camera(name: arguments.CameraName, as_json: arguments.Json = False) -> None:
    """All that is wrong in a camera file, with line numbers, and values that are allowed but unusual.

    Exit code: 0 if there are at most warnings, 2 if the file cannot be used.
    """
    found = ms.check_camera(name)
    errors = sum(one.level == "error" for one in found)
    show([one.to_dict() for one in found] if as_json else "\n".join(map(str, (*found, _verdict(name, found)))), as_json)
    if errors:
        raise typer.Exit(2)


@cameras.command("show", epilog="Example: mitsuba-sensor cameras show konnik_table1")
def show_camera(name: arguments.CameraName, as_toml: arguments.Toml = False, as_json: arguments.Json = False) -> None:
    """Every number of one camera, with its unit (the end of the field's name) and where it comes from."""
    camera = ms.load_camera(name)
    if as_toml:
        return show(camera.to_toml().rstrip("\n"), False)
    fields = camera.model_dump(mode="json")
    table = FittedTable(("field", "value", "source"))
    for field, value in _flat({key: value for key, value in fields.items() if key != "sources"}).items():
        table.add_row(field, Text(short(value)), Text(camera.sources.get(field, ""), style="dim"))
    show({**fields, "sources": dict(camera.sources), "notes": list(camera.notes)} if as_json else table, as_json)
    for note in () if as_json else camera.notes:
        show(f"note: {note}", False)


@cameras.command()
def fields() -> None:
    """Every key of a camera file with unit, range, default and meaning, as the Markdown tables of docs."""
    from ..sensor.camera import Camera
    from ..sensor.field_catalogue import markdown

    show(markdown(Camera), False)


@cameras.command()
def schema() -> None:
    """The JSON Schema of a camera file: every field, its unit and its allowed range."""
    from ..sensor.camera import camera_schema

    show(camera_schema(), True)


@cameras.command()
def stages() -> None:
    """The stages of the sensor in their order, as the Markdown table of docs."""
    from ..sensor.chain import stage_table

    show(stage_table(), False)


@cameras.command()
def lenses(as_json: arguments.Json = False) -> None:
    """The lens prescriptions that ship with the package, for --set lens.prescription=NAME."""
    from ..optics.paraxial import cardinal_points
    from ..sensor.lens_file import list_lenses

    default = ms.load_camera(options.DEFAULT_CAMERA).replace(**{"lens.f_number": 64.0})  # every lens can close so far
    known = [default.replace(**{"lens.prescription": name}).lens for name in list_lenses()]
    lengths = [(one.prescription, cardinal_points(one).focal_length) for one in known if one.prescription is not None]
    found = [
        {"name": x.name, "focal_length_mm": f, "surfaces": len(x.surfaces), "source": x.source} for x, f in lengths
    ]
    table = FittedTable(("lens", "focal length", "surfaces", "source"))
    for x, f in lengths:
        table.add_row(x.name, f"{f:.4g} mm", str(len(x.surfaces)), x.source)
    show(found if as_json else table, as_json)


def _verdict(name: str, found: Sequence[CameraFinding]) -> str:
    """The last line of a check."""
    counts = [(sum(one.level == level for one in found), level) for level in ("error", "warning")]
    said = ", ".join(f"{n} {level}{'s' if n > 1 else ''}" for n, level in counts if n)
    return f"{name}: {said or 'nothing is wrong'}"


def _flat(fields: dict[str, Any], prefix: str = "") -> dict[str, object]:
    """Nested fields under dotted names."""
    flat: dict[str, object] = {}
    for key, value in fields.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat
