"""The commands below cameras: the cameras and lens prescriptions that ship with the package."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.text import Text

import mitsuba_sensor as ms

from ..camera.fingerprint import flat_fields
from ..camera.shipped import DEFAULT_CAMERA
from . import arguments, options
from .app import app, show
from .help import Command, Group
from .tables import ResultTable, short
from .values import Flag

if TYPE_CHECKING:
    from ..camera.camera_check import CameraFinding
    from ..camera.figures import EmvaFigures

MOST_LABELS = 3
"""Gain settings that `cameras list` names one by one."""

cameras = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="The cameras that ship with the package, their lenses, and camera files of your own.",
)
app.add_typer(cameras, name="cameras")


@cameras.command("list", cls=Command)
def list_command(search: arguments.SearchText = None, as_json: arguments.Json = False) -> None:
    """The cameras that ship with the package, or those with a text in name or description: a sensor, a maker."""
    from ..camera.camera_file import cameras_with
    from ..core import InputError

    names = cameras_with(" ".join(search)) if search else ms.list_cameras()
    if not names:
        raise InputError(
            f"no camera has {' '.join(search or ())!r} in name or description; `cameras list` has all of them."
        )
    known = [ms.load_camera(name) for name in names]
    table = ResultTable(("camera", "type", "pixels", "gains or read-outs", "what it is"))
    for one in known:
        size = f"{one.sensor.columns} × {one.sensor.rows}"
        gains = _gain_range(one)
        table.add_row(one.name, one.sensor.technology, size, gains, one.description)
    found = list[dict[str, object]]()
    for one in known:
        facts: dict[str, object] = {"name": one.name, "description": one.description}
        facts |= one.sensor.model_dump(include={"technology", "columns", "rows"})
        facts["gains"] = [setting.label for setting in one.gains]
        facts["readouts"] = [readout.name for readout in one.readouts]
        found.append(facts)
    show(found if as_json else table, as_json)


@cameras.command(
    "new",
    cls=Command,
    epilog="Example: mitsuba-sensor cameras new my.toml --like bayer_2mp --set adc.bits=14",
)
@options.flags(options.NewCameraFlags)
def new_camera(new_file: arguments.NewFile, **flags: Flag) -> None:
    """Write a camera file to change: every key with unit, range, meaning, and where its value comes from.

    It loads as the camera that it is like, or, with --emva, as the camera of an EMVA 1288 sheet. `cameras check FILE`
    says what is wrong after a change.
    """
    from ..files.texts import write_page
    from .new_camera import new_camera_of

    file = _camera_file(new_file, flags["force"])
    camera, notes = new_camera_of(flags, file)
    write_page(file, camera.to_toml())
    if flags["emva"]:
        of = "of an EMVA 1288 sheet"
    else:
        of = f"like {flags['like'] or DEFAULT_CAMERA}"
    show(
        f"{file} is a camera {of}; change it, then: mitsuba-sensor cameras check {file}", False
    )
    for note in notes:
        show(f"note: {note}", False)


@cameras.command(
    "import",
    cls=Command,
    epilog="Example: mitsuba-sensor cameras import imx477.json -o my.toml --set adc.bits=12",
)
@options.flags(options.ImportFlags)
def import_command(
    sources: arguments.ImportedFiles,
    out: arguments.CameraFile,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Make a camera file of what another program measured: noise models, calibrations, reports, presets.

    [sources] of the file says where each number comes from; what the source does not say is marked "assumed:". --set
    fields of the camera that it is like hold for the conversion, adc.bits for example.
    """
    from ..files.texts import write_page
    from ..output.importers.import_camera import import_camera
    from .inputs import changes_of

    file = _camera_file(out, flags["force"])
    like = ms.load_camera(flags["like"])
    camera = import_camera(sources, like.replace(**changes_of(flags)), flags["name"])
    write_page(file, camera.to_toml())
    assumed = sorted(
        field for field, text in camera.sources.items() if text.startswith("assumed")
    )
    said = {
        "file": str(file),
        "name": camera.name,
        "sources": dict(camera.sources),
        "assumed": assumed,
    }
    text = f"{file} is {camera.description}; {len(assumed)} of {len(camera.sources)} numbers are assumed"
    show(
        said if as_json else f"{text} (see [sources]); mitsuba-sensor cameras check {file}",
        as_json,
    )


@cameras.command("check", cls=Command, epilog="Example: mitsuba-sensor cameras check my.toml")
@options.flags(options.ChangedCameraFlags)
def check_camera(
    name: arguments.CameraName, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """All that is wrong in a camera file, with line numbers, and values that are allowed but unusual.

    Exit code: 0 if there are at most warnings, 2 if the file cannot be used.
    """
    from ..optics import image_record
    from .inputs import changes_of

    found, changes = ms.check_camera(name), changes_of(flags)
    if changes:
        found = _findings_with(changes, name, found)
    lines, airy, pixel_mtf = [*map(str, found)], None, None
    is_wrong = any(one.level == "error" for one in found)
    if not is_wrong:
        camera = ms.load_camera(name).replace(**changes)
        airy = image_record.airy_record(camera)
        pixel_mtf = image_record.pixel_mtf_record(camera)
        lines += [f"{name}: {line}" for line in image_record.optics_sentences(camera)]
    lines.append(_verdict(name, found))
    findings = [one.to_dict() for one in found]
    checked = {"findings": findings, "airy_disk": airy, "pixel_mtf": pixel_mtf}
    show(checked if as_json else "\n".join(lines), as_json)
    if is_wrong:
        raise typer.Exit(2)


def _findings_with(
    changes: dict[str, object], name: str, of_file: tuple[CameraFinding, ...]
) -> tuple[CameraFinding, ...]:
    """What is wrong or unusual with --set, in no line of the file; of a file that does not load, its own errors."""
    try:
        camera = ms.load_camera(name)
    except ms.InputError:
        return of_file
    found = ms.check_camera(tomllib.loads(camera.replace(**changes).to_toml()))
    return tuple(replace(one, file=f"{name} with --set") for one in found)


@cameras.command(
    "show", cls=Command, epilog="Example: mitsuba-sensor cameras show konnik_table1"
)
def show_camera(
    name: arguments.CameraName, as_toml: arguments.Toml = False, as_json: arguments.Json = False
) -> None:
    """Every number of one camera, with its unit (the end of the field's name) and where it comes from."""
    from ..camera.figures import figures_if_any
    from .readouts import hdr_facts, readout_table

    camera = ms.load_camera(name)
    if as_toml:
        return show(camera.to_toml().rstrip("\n"), False)
    fields = camera.model_dump(mode="json")
    figures = figures_if_any(camera)
    found = {
        "sources": dict(camera.sources),
        "notes": list(camera.notes),
        "emva1288": figures and figures.to_dict(),
        "hdr": hdr_facts(camera),
    }
    show({**fields, **found} if as_json else _field_table(camera), as_json)
    if camera.gains and not as_json:
        show(_settings(camera), False)
    if camera.readouts and not as_json:
        show(readout_table(camera), False)
    if figures and not as_json:
        both = ", of both photodiodes together" if camera.sensor.dual_pixel else ""
        show(_figure_table(figures, both), False)
    for note in () if as_json else camera.notes:
        show(f"note: {note}", False)


def _gain_range(camera: ms.Camera) -> str:
    """Its gain settings in short, for --gain, or how often it reads every pixel."""
    if camera.readouts:
        return f"{len(camera.readouts)} read-outs"
    labels = [one.label for one in camera.gains]
    if len(labels) > MOST_LABELS:
        return f"{labels[0]} … {labels[-1]} ({len(labels)})"
    return ", ".join(labels) or "–"


def _field_table(camera: ms.Camera) -> ResultTable:
    """A row for every number of the camera."""
    table = ResultTable(("field", "value", "source"))
    own = camera.model_dump(mode="json", exclude={"sources", "gains", "readouts"})
    for name, value in flat_fields(own):
        source = short(camera.sources.get(name, ""))
        table.add_row(name, Text(short(value)), Text(source, style="dim"))
    return table


def _figure_table(figures: EmvaFigures, of_what: str) -> ResultTable:
    """of_what : end of the title, for dual pixels."""
    table = ResultTable(
        ("symbol", "value", "unit", "what it is"),
        title=f"EMVA 1288, from the datasheet, short exposure{of_what}",
    )
    for one in figures.table():
        table.add_row(one.symbol, f"{one.value:.5g}", one.unit, one.name)
    return table


@cameras.command(cls=Command)
def fields() -> None:
    """Every key of a camera file with unit, range, default and meaning, as the Markdown tables of docs."""
    from ..camera.camera import Camera
    from ..camera.field_catalogue import markdown

    show(markdown(Camera), False)


@cameras.command(cls=Command)
def schema() -> None:
    """The JSON Schema of a camera file: every field, its unit and its allowed range."""
    from ..camera.camera import Camera

    show(Camera.model_json_schema(), True)


@cameras.command(cls=Command)
def stages() -> None:
    """The stages of the sensor in their order, as the Markdown table of docs."""
    from ..stages.chain import stage_table

    show(stage_table(), False)


@cameras.command(cls=Command)
def lenses(as_json: arguments.Json = False) -> None:
    """The lens prescriptions that ship with the package, for `render --set lens.prescription=NAME`."""
    from ..camera.lens_file import list_lenses
    from ..optics.traced_lens import cardinal_points

    default = ms.load_camera(DEFAULT_CAMERA).replace(
        **{"lens.f_number": 64.0}
    )  # every lens can close so far
    known = [default.replace(**{"lens.prescription": name}).lens for name in list_lenses()]
    lengths = [
        (one.prescription, cardinal_points(one).focal_length)
        for one in known
        if one.prescription is not None
    ]
    found = [
        {"name": x.name, "focal_length_mm": f, "surfaces": len(x.surfaces), "source": x.source}
        for x, f in lengths
    ]
    table = ResultTable(("lens", "focal length", "surfaces", "source"))
    for x, f in lengths:
        table.add_row(x.name, f"{f:.4g} mm", str(len(x.surfaces)), x.source)
    show(found if as_json else table, as_json)


def _settings(camera: ms.Camera) -> ResultTable:
    """One row per gain setting, with what it has in place of the camera's own numbers."""
    from ..camera.gain_ladder import SET

    names = [
        name for name in ("gain_dn_per_e", *SET) if getattr(camera.gains[0], name) is not None
    ]
    table = ResultTable(("gain setting", *names), caption=camera.sources.get("gains", ""))
    for one in camera.gains:
        chosen = ""
        if one.label == camera.gain:
            chosen = " (set)"
        table.add_row(f"{one.label}{chosen}", *(f"{getattr(one, name):g}" for name in names))
    return table


def _camera_file(name: str, force: bool) -> Path:
    """The path of a camera file to write. Raises InputError."""
    from ..core import InputError

    file = Path(name)
    if file.suffix != ".toml":
        raise InputError(
            f"{name or 'an empty text'} is no name of a camera file; let it end in .toml."
        )
    if file.exists() and not (force and file.is_file()):
        remedy = "give another name"
        if file.is_file():
            remedy = "--force writes over it, or give another name"
        raise InputError(f"{file} exists already; {remedy}.")
    return file


def _verdict(name: str, found: Sequence[CameraFinding]) -> str:
    """The last line of a check."""
    counts = [
        (sum(one.level == level for one in found), level) for level in ("error", "warning")
    ]
    said = ", ".join(f"{n} {level}{'s' if n > 1 else ''}" for n, level in counts if n)
    return f"{name}: {said or 'nothing is wrong'}"
