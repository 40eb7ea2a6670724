"""The commands below cameras: the cameras and lens prescriptions that ship with the package."""

from __future__ import annotations

from typing import Any

import typer
from rich.text import Text

import mitsuba_sensor as ms

from . import options
from .app import app, show
from .tables import FittedTable, short

cameras = typer.Typer(
    no_args_is_help=True, help="The cameras that ship with the package, their lenses, and the format of a camera file."
)
app.add_typer(cameras, name="cameras")


@cameras.command("list")
def list_command(as_json: options.Json = False) -> None:
    """The cameras that ship with the package."""
    known = [ms.load_camera(name) for name in ms.list_cameras()]
    table = FittedTable(("camera", "technology", "pixels", "what it is"))
    for one in known:
        size = f"{one.sensor.columns} × {one.sensor.rows}"
        table.add_row(one.name, one.sensor.technology, size, one.description)
    show([{"name": one.name, "description": one.description} for one in known] if as_json else table, as_json)


@cameras.command("show", epilog="Example: mitsuba-sensor cameras show konnik_table1")
def show_camera(name: options.CameraName, as_json: options.Json = False) -> None:
    """Every number of one camera, with its unit (the end of the field's name) and where it comes from."""
    camera = ms.load_camera(name)
    fields = camera.model_dump(mode="json")
    table = FittedTable(("field", "value", "source"))
    for field, value in _flat({key: value for key, value in fields.items() if key != "sources"}).items():
        table.add_row(field, Text(short(value)), Text(camera.sources.get(field, ""), style="dim"))
    show({**fields, "sources": dict(camera.sources), "notes": list(camera.notes)} if as_json else table, as_json)
    for note in () if as_json else camera.notes:
        show(f"note: {note}", False)


@cameras.command()
def schema() -> None:
    """The JSON Schema of a camera file: every field, its unit and its allowed range."""
    from ..sensor.camera import camera_schema

    show(camera_schema(), True)


@cameras.command()
def stages() -> None:
    """The stages of the sensor in their order, as the Markdown table of the README."""
    from ..sensor.chain import stage_table

    show(stage_table(), False)


@cameras.command()
def lenses(as_json: options.Json = False) -> None:
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


def _flat(fields: dict[str, Any], prefix: str = "") -> dict[str, object]:
    """Nested fields under dotted names."""
    flat: dict[str, object] = {}
    for key, value in fields.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat
