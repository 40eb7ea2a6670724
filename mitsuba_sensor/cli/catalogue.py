"""The commands below cameras and scenes: included cameras, lenses and scenes, and your own camera files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import typer

import mitsuba_sensor as ms

from ..camera.fingerprint import flat_fields
from ..camera.shipped import DEFAULT_CAMERA
from ..core.id_groups import as_options, groups_of_ids
from . import arguments, options
from .app import Command, Group, app, show, show_remarks
from .options import Flag

cameras = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="List and show the included cameras and lenses; write, import and check your own camera files.",
)
app.add_typer(cameras, name="cameras")
scenes = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="List, show and copy the included scenes, which every command accepts by name.",
)
app.add_typer(scenes, name="scenes")


@cameras.command("list", cls=Command, epilog="Example: mitsuba-sensor cameras list sony")
def list_command(search: arguments.SearchText = None, as_json: arguments.Json = False) -> None:
    """List the included cameras, or those with a text in name or description."""
    from ..camera.camera_file import cameras_with
    from ..core import InputError
    from .tables import view

    names = cameras_with(" ".join(search)) if search else ms.list_cameras()
    if not names:
        raise InputError(
            f"no camera has {' '.join(search or ())!r} in its name or description; `cameras list` shows all cameras."
        )
    facts, rows = [], []
    for camera in map(ms.load_camera, names):
        fact: dict[str, object] = {"name": camera.name}
        fact |= camera.sensor.model_dump(include={"technology", "columns", "rows"})
        fact["gains"] = [setting.label for setting in camera.gains]
        fact["readouts"] = [readout.name for readout in camera.readouts]
        facts.append(fact | {"description": camera.description})
        pixels = f"{camera.sensor.columns} × {camera.sensor.rows}"
        row = {"name": camera.name, "pixels": pixels, "gains": len(camera.gains) or "–"}
        row["readouts"] = len(camera.readouts) or "–"
        rows.append(row | {"description": camera.description})
    show(facts, as_json, view(rows))


@cameras.command(
    "new",
    cls=Command,
    epilog="Example: mitsuba-sensor cameras new my.toml --like bayer_2mp --set adc.bits=14",
)
@options.flags(options.NewCameraFlags)
def new_camera(
    new_file: arguments.NewFile, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Write a camera file to edit, with every key's unit, range, meaning and the source of its value.

    The file is a copy of --like, or converts an EMVA 1288 sheet (--emva). Check your changes with `cameras check FILE`.
    """
    from ..camera.emva_sheet import camera_of_sheet, comparisons, read_sheet
    from ..core import InputError
    from . import inputs

    file = inputs.new_file(new_file, "my.toml", flags["force"])
    changes, name = inputs.changes_of(flags), flags["name"] or file.stem
    if flags["emva"] and flags["like"]:
        raise InputError("--emva and --like both give the camera; omit one of them.")
    if flags["emva"]:
        sheet, source = read_sheet(flags["emva"]), "its EMVA 1288 sheet"
        description = flags["description"] or "by its EMVA 1288 sheet"
        camera = inputs.with_changes(camera_of_sheet(sheet, name, description), changes)
        notes = comparisons(sheet, camera)
    else:
        like = ms.load_camera(flags["like"] or DEFAULT_CAMERA)
        source, description = like.name, flags["description"] or f"a camera like {like.name}"
        camera, notes = _like(like, {**changes, "name": name, "description": description})
    _write(file, camera.without(*flags["without"] or ()), as_json, source, notes)


def _write(file: Path, camera: ms.Camera, as_json: bool, source: str, notes: list[str]) -> None:
    """Write a camera file and print the sources of its numbers."""
    from ..files.texts import write_page

    write_page(file, camera.to_toml())
    sources = dict(camera.sources)
    assumed = sorted(field for field, text in sources.items() if text.startswith("assumed"))
    facts = {"file": str(file), "name": camera.name, "sources": sources, "assumed": assumed}
    count = f"{len(assumed)} of {len(sources)} numbers are assumed (see [sources])"
    shown = f"wrote {file}: camera {camera.name}, from {source}; {count}"
    show(facts | {"notes": notes}, as_json, shown)
    after = f"edit it, then run: mitsuba-sensor cameras check {file}"
    show_remarks(as_json, [*(f"note: {note}" for note in notes), after])


def _like(like: ms.Camera, changes: Mapping[str, object]) -> tuple[ms.Camera, list[str]]:
    """Return a changed copy of a camera, and notes. Raises InputError.

    The copy drops sources and gain settings that its changes made wrong: a changed K has no source, and changed
    numbers have no gain settings.
    """
    from ..camera.camera import SET_BY_USER
    from ..camera.field_catalogue import copied_source
    from ..camera.gain_ladder import SAME, SET

    camera, notes = like.replace(**changes), list[str]()
    old_k, k = like.system_gain_dn_per_e, camera.system_gain_dn_per_e
    same_k = math.isclose(old_k, k, rel_tol=SAME)
    if not same_k:
        notes.append(f"K is {k:.4g} DN/e- ({like.name}: {old_k:.4g} DN/e-)")
    is_stale = not same_k or bool({*SET.values()} & changes.keys())
    if like.gains and "gains" not in changes and is_stale:
        camera = camera.replace(gains=None, gain=None)
        notes.append(
            "removed the gain settings, whose numbers differ; add [[gains]] to the file"
        )
    sources = dict(camera.sources)
    for field, text in sources.items():
        if camera.name != like.name and text != SET_BY_USER:
            sources[field] = copied_source(text, like.name)
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
    """Write a camera file from another program's noise model, calibration, report or preset.

    [sources] in the file states the origin of each number; values missing from the source are marked "assumed:". --set
    changes the --like camera before the conversion, e.g. adc.bits.
    """
    from ..output.importers.import_camera import import_camera
    from .inputs import changes_of, new_file, with_changes

    file = new_file(out, "my.toml", flags["force"])
    like = with_changes(ms.load_camera(flags["like"]), changes_of(flags))
    camera = import_camera(sources, like, flags["name"])
    _write(file, camera, as_json, camera.description, [])


@cameras.command("check", cls=Command, epilog="Example: mitsuba-sensor cameras check my.toml")
@options.flags(options.ChangedCameraFlags)
def check_camera(
    name: arguments.CameraName, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """List all errors in a camera file with their lines, and values that are allowed but unusual.

    Exit code: 0 without errors, 2 if the file cannot be used.
    """
    from ..optics import image_record
    from .inputs import changes_of, with_changes
    from .tables import counted

    findings, changes = ms.check_camera(name), changes_of(flags)
    if changes and not any(finding.level == "error" for finding in findings):
        of_changed = ms.check_camera(ms.load_camera(name).replace(**changes))
        findings = tuple(replace(finding, file=f"{name} with --set") for finding in of_changed)
    levels = [finding.level for finding in findings]
    facts: dict[str, object] = {"findings": [finding.to_dict() for finding in findings]}
    facts |= {"airy_disk": None, "pixel_mtf": None}
    lines = [*map(str, findings)]
    if "error" not in levels:
        camera = with_changes(ms.load_camera(name), changes)
        lines += [f"{name}: {line}" for line in image_record.optics_sentences(camera)]
        facts["airy_disk"] = image_record.airy_record(camera)
        facts["pixel_mtf"] = image_record.pixel_mtf_record(camera)
    counts = [counted(levels.count(x), x) for x in ("error", "warning") if x in levels]
    lines.append(f"{name}: {', '.join(counts) or 'no errors'}")
    show(facts, as_json, "\n".join(lines))
    if "error" in levels:
        raise typer.Exit(2)


@cameras.command(
    "show", cls=Command, epilog="Example: mitsuba-sensor cameras show konnik_table1"
)
def show_camera(
    name: arguments.CameraName, as_toml: arguments.Toml = False, as_json: arguments.Json = False
) -> None:
    """Show every number of one camera with its source; the unit ends the field's name."""
    from ..camera.figures import emva_figures, figures_if_any
    from ..theory.dynamic_range import hdr_figures

    camera, dark = ms.load_camera(name), ms.Exposure(0.0)
    if as_toml:
        return show(camera.to_toml().rstrip("\n"), False)
    figures = figures_if_any(camera)
    hdr = hdr_figures(camera, dark).to_dict() if camera.readouts else None
    facts = camera.model_dump(mode="json")
    facts |= {"sources": dict(camera.sources), "notes": list(camera.notes)}
    facts |= {"emva1288": figures and figures.to_dict(), "hdr": hdr}
    numbers = camera.model_dump(mode="json", exclude={"sources", "gains", "readouts"})
    fields = sorted(flat_fields(numbers), key=lambda item: item[1] in (None, []))  # unset last
    tables: dict[str, object] = {
        "fields": [
            {"field": field, "value": value, "source": camera.sources.get(field, "")}
            for field, value in fields
        ]
    }
    if camera.gains:
        tables["gain settings"] = [
            {"gain setting": f"{gain.label}{' (set)' if gain.label == camera.gain else ''}"}
            | gain.model_dump(exclude={"name", "iso"}, exclude_none=True)
            for gain in camera.gains
        ]
    if camera.readouts:
        tables["readouts"] = {
            name: {figure.symbol: figure.value for figure in emva_figures(one, dark).table()}
            for name, one in camera.readout_cameras.items()
        }
        tables["combined"] = [hdr]
    if figures:
        both = ", of both photodiodes together" if camera.sensor.dual_pixel else ""
        title = f"EMVA 1288, from the datasheet, short exposure{both}"
        tables[title] = [figure._asdict() for figure in figures.table()]
    show(facts, as_json, tables)
    show_remarks(as_json, [f"note: {note}" for note in camera.notes])


@cameras.command(cls=Command)
def fields() -> None:
    """Print every key of a camera file with unit, range, default and meaning, as Markdown tables."""
    from ..camera.camera import Camera
    from ..camera.field_catalogue import markdown

    show(markdown(Camera), False)


@cameras.command(cls=Command)
def schema() -> None:
    """Print the JSON Schema of a camera file."""
    from ..camera.camera import Camera

    show(Camera.model_json_schema(), True)


@cameras.command(cls=Command)
def stages(as_json: arguments.Json = False) -> None:
    """List the stages of the sensor in their order, and those that --without switches off."""
    from ..stages.chain import ORDER, what_it_does

    rows = [
        {
            "stage": stage.key(),
            "--without": "" if stage.no_noise else "yes",
            "what it computes": what_it_does(stage),
            "keys in": f"[{stage.table}]",
        }
        for stage in ORDER
    ]
    show(rows, as_json)


@cameras.command(cls=Command)
def lenses(as_json: arguments.Json = False) -> None:
    """List the included lens prescriptions, for `render --set lens.prescription=NAME`."""
    from ..camera.lens_file import list_lenses
    from ..optics.traced_lens import cardinal_points

    rows = []
    for name in list_lenses():
        closed = {
            "lens.f_number": 64.0,
            "lens.prescription": name,
        }  # every lens can close to f/64
        lens = ms.load_camera(DEFAULT_CAMERA).replace(**closed).lens
        prescription = lens.prescription
        assert prescription is not None
        rows.append(
            {
                "name": prescription.name,
                "focal_length_mm": cardinal_points(lens).focal_length,
                "surfaces": len(prescription.surfaces),
                "source": prescription.source,
            }
        )
    show(rows, as_json)


@scenes.command("list", cls=Command)
def list_scenes_command(as_json: arguments.Json = False) -> None:
    """List the included scenes."""
    from ..files.shipped_scenes import list_scenes, scene_description

    rows = [{"name": name, "description": scene_description(name)} for name in list_scenes()]
    show(rows, as_json)


@scenes.command("show", cls=Command, epilog="Example: mitsuba-sensor scenes show still_life")
def show_scene(name: arguments.SceneName, as_json: arguments.Json = False) -> None:
    """Show the parameters of one scene for `-D NAME=VALUE`, its sensors, its emitters and its file."""
    from ..files import shipped_scenes

    emitters = shipped_scenes.scene_emitters(name)
    facts = {
        "name": name,
        "description": shipped_scenes.scene_description(name),
        "file": str(shipped_scenes.scene_file(name)),
        "sensors": shipped_scenes.scene_sensors(name),
        "emitters": [emitter._asdict() for emitter in emitters],
        "parameters": [one._asdict() for one in shipped_scenes.scene_parameters(name)],
    }
    show(facts, as_json)
    ids = dict.fromkeys(emitter.id for emitter in emitters if emitter.id)
    if len(ids) > 1:
        groups = as_options(groups_of_ids(ids))
        show_remarks(as_json, [f"light groups that the ids suggest: {groups}"])


@scenes.command(
    "copy", cls=Command, epilog="Example: mitsuba-sensor scenes copy still_life my_scene/"
)
def copy_command(
    name: arguments.SceneName,
    folder: arguments.CopyFolder,
    force: arguments.Force = False,
    as_json: arguments.Json = False,
) -> None:
    """Copy one scene and all its files into a folder, to edit it there."""
    from ..files.scene_copies import copy_scene

    files = [str(file) for file in copy_scene(name, folder, force)]
    show({"files": files}, as_json, "\n".join(f"wrote {file}" for file in files))
    after = f"edit it, then run: mitsuba-sensor render {files[0]} -o out/"
    show_remarks(as_json, [after])
