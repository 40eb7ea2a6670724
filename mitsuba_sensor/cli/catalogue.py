"""The commands below cameras: the cameras and lens prescriptions that ship with the package."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import typer

import mitsuba_sensor as ms

from ..camera.fingerprint import flat_fields
from ..camera.shipped import DEFAULT_CAMERA
from . import arguments, options
from .app import app, show, show_remarks
from .help import Command, Group
from .values import Flag

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
    found = []
    for one in map(ms.load_camera, names):
        facts: dict[str, object] = {"name": one.name}
        facts |= one.sensor.model_dump(include={"technology", "columns", "rows"})
        facts["gains"] = [setting.label for setting in one.gains]
        facts["readouts"] = [readout.name for readout in one.readouts]
        found.append(facts | {"description": one.description})
    show(found, as_json)


@cameras.command(
    "new",
    cls=Command,
    epilog="Example: mitsuba-sensor cameras new my.toml --like bayer_2mp --set adc.bits=14",
)
@options.flags(options.NewCameraFlags)
def new_camera(
    new_file: arguments.NewFile, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Write a camera file to change: every key with unit, range, meaning, and where its value comes from.

    It loads as the camera that it is like, or, with --emva, as the camera of an EMVA 1288 sheet. `cameras check FILE`
    says what is wrong after a change.
    """
    from ..camera.emva_sheet import camera_of_sheet, comparisons, read_sheet
    from ..core import InputError
    from . import inputs

    file, changes = (
        inputs.new_file(new_file, "my.toml", flags["force"]),
        inputs.changes_of(flags),
    )
    name = flags["name"] or file.stem
    if flags["emva"] and flags["like"]:
        raise InputError(
            "--emva takes the numbers of a sheet, and --like those of a camera; give one of both."
        )
    if flags["emva"]:
        sheet, source = read_sheet(flags["emva"]), "its EMVA 1288 sheet"
        description = flags["description"] or "by its EMVA 1288 sheet"
        camera = camera_of_sheet(sheet, name, description).replace(**changes)
        notes = comparisons(sheet, camera)
    else:
        like = ms.load_camera(flags["like"] or DEFAULT_CAMERA)
        source, description = like.name, flags["description"] or f"a camera like {like.name}"
        camera, notes = _like(like, {**changes, "name": name, "description": description})
    _write(file, camera.without(*flags["without"] or ()), as_json, source, notes)


def _write(file: Path, camera: ms.Camera, as_json: bool, source: str, notes: list[str]) -> None:
    """Write a camera file, and say where its numbers come from."""
    from ..files.texts import write_page

    write_page(file, camera.to_toml())
    sources = dict(camera.sources)
    assumed = sorted(field for field, text in sources.items() if text.startswith("assumed"))
    found = {"file": str(file), "name": camera.name, "sources": sources, "assumed": assumed}
    said = f"{file} is {camera.name}, from {source}: {len(assumed)} of {len(sources)} numbers are assumed"
    show(found | {"notes": notes}, as_json, f"{said} (see [sources])")
    after = f"change it, then: mitsuba-sensor cameras check {file}"
    show_remarks(as_json, [*(f"note: {note}" for note in notes), after])


def _like(like: ms.Camera, changes: Mapping[str, object]) -> tuple[ms.Camera, list[str]]:
    """A camera with the numbers of another one but for some, and what is kept. Raises InputError.

    Sources and gain settings are kept where they are true of it: another K has no source, and gain settings whose
    numbers are changed are left out.
    """
    from ..camera.camera import SET_BY_USER
    from ..camera.gain_ladder import SAME, SET

    camera, notes = like.replace(**changes), list[str]()
    old_k, k = like.system_gain_dn_per_e, camera.system_gain_dn_per_e
    same_k = math.isclose(old_k, k, rel_tol=SAME)
    if not same_k:
        notes.append(f"K is {k:.4g} DN/e- (that of {like.name}: {old_k:.4g})")
    is_stale = not same_k or bool({*SET.values()} & changes.keys())
    if like.gains and "gains" not in changes and is_stale:
        camera = camera.replace(gains=None, gain=None)
        notes.append("its gain settings are left out, because they have other numbers")
    sources = dict(camera.sources)
    for field, text in sources.items():
        if camera.name != like.name and text != SET_BY_USER:
            sources[field] = f"assumed: as {like.name}: {text}"
    if not same_k and "adc.full_scale_v" not in changes:
        sources.pop("adc.full_scale_v", None)
    return camera.replace(sources=sources), notes


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
    from ..output.importers.import_camera import import_camera
    from .inputs import changes_of, new_file

    file = new_file(out, "my.toml", flags["force"])
    like = ms.load_camera(flags["like"]).replace(**changes_of(flags))
    camera = import_camera(sources, like, flags["name"])
    _write(file, camera, as_json, camera.description, [])


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
    if changes and not any(one.level == "error" for one in found):
        changed = ms.load_camera(name).replace(**changes).to_toml()
        of_changed = ms.check_camera(tomllib.loads(changed))
        found = tuple(replace(one, file=f"{name} with --set") for one in of_changed)
    is_wrong = any(one.level == "error" for one in found)
    checked: dict[str, object] = {"findings": [one.to_dict() for one in found]}
    checked |= {"airy_disk": None, "pixel_mtf": None}
    lines = [*map(str, found)]
    if not is_wrong:
        camera = ms.load_camera(name).replace(**changes)
        lines += [f"{name}: {line}" for line in image_record.optics_sentences(camera)]
        checked["airy_disk"] = image_record.airy_record(camera)
        checked["pixel_mtf"] = image_record.pixel_mtf_record(camera)
    levels = [one.level for one in found]
    counts = [f"{levels.count(x)} {x}(s)" for x in ("error", "warning") if x in levels]
    lines.append(f"{name}: {', '.join(counts) or 'nothing is wrong'}")
    show(checked, as_json, "\n".join(lines))
    if is_wrong:
        raise typer.Exit(2)


@cameras.command(
    "show", cls=Command, epilog="Example: mitsuba-sensor cameras show konnik_table1"
)
def show_camera(
    name: arguments.CameraName, as_toml: arguments.Toml = False, as_json: arguments.Json = False
) -> None:
    """Every number of one camera, with its unit (the end of the field's name) and where it comes from."""
    from ..camera.figures import emva_figures, figures_if_any
    from ..theory.dynamic_range import hdr_figures

    camera, dark = ms.load_camera(name), ms.Exposure(0.0)
    if as_toml:
        return show(camera.to_toml().rstrip("\n"), False)
    fields, figures = camera.model_dump(mode="json"), figures_if_any(camera)
    hdr = hdr_figures(camera, dark).to_dict() if camera.readouts else None
    notes = {"sources": dict(camera.sources), "notes": list(camera.notes)}
    found = {**fields, **notes, "emva1288": figures and figures.to_dict(), "hdr": hdr}
    tables: dict[str, object] = {"fields": _fields(camera)}
    if camera.gains:
        tables["gain settings"] = [
            {"gain setting": f"{one.label}{' (set)' if one.label == camera.gain else ''}"}
            | one.model_dump(exclude={"name", "iso"}, exclude_none=True)
            for one in camera.gains
        ]
    if camera.readouts:
        tables["read-outs"] = {
            name: {x.symbol: x.value for x in emva_figures(one, dark).table()}
            for name, one in camera.readout_cameras.items()
        }
        tables["combined"] = [hdr]
    if figures:
        both = ", of both photodiodes together" if camera.sensor.dual_pixel else ""
        title = f"EMVA 1288, from the datasheet, short exposure{both}"
        tables[title] = [one._asdict() for one in figures.table()]
    show(found, as_json, tables)
    show_remarks(as_json, [f"note: {note}" for note in camera.notes])


def _fields(camera: ms.Camera) -> list[dict[str, object]]:
    """A row for every number of the camera."""
    own = camera.model_dump(mode="json", exclude={"sources", "gains", "readouts"})
    return [
        {"field": name, "value": value, "source": camera.sources.get(name, "")}
        for name, value in flat_fields(own)
    ]


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

    found = []
    for name in list_lenses():  # every lens can close to f/64
        closed = {"lens.f_number": 64.0, "lens.prescription": name}
        lens = ms.load_camera(DEFAULT_CAMERA).replace(**closed).lens
        prescription = lens.prescription
        assert prescription is not None
        focal_mm = cardinal_points(lens).focal_length
        facts = {"name": prescription.name, "focal_length_mm": focal_mm}
        found.append(
            {**facts, "surfaces": len(prescription.surfaces), "source": prescription.source}
        )
    show(found, as_json)
