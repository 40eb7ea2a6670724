"""The commands render, expose, plan, fpn-maps, doctor and lint: from a scene, or from its irradiance, to raw frames."""

from __future__ import annotations

from pathlib import Path

import typer

import mitsuba_sensor as ms

from ..capture_options import (
    CaptureOptions,
    LevelOptions,
    LightOptions,
    check_asked_files,
    refuse_render_options,
)
from ..core.options import complete
from ..render.options import RawLightOptions, RenderOptions, SceneOptions, UnitOptions
from . import arguments, options
from .app import app, err, show, show_remarks
from .help import Command
from .values import Flag, number

LEVELS = {
    "black": "bold red",
    "wrong": "bold yellow",
    "note": "",
    "fact": "dim",
}  # of a finding of lint → its style
FIRST_OF_CAMERA = ("camera", "exposure_s", "gain", "settings")
FIRST_OF_EXPOSE = ("out_dir", "dng", "clean", "as_json", *FIRST_OF_CAMERA, "frames")
FIRST_OF_RENDER = (*FIRST_OF_EXPOSE, "width", "spp")
FIRST_OF_PLAN = ("as_json", *FIRST_OF_CAMERA, "width", "spp", "tolerance_dn")
"""Options that people use first, as ``--help`` shows them."""


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor render cornell_box -o out/ --exposure-s 0.01 --set adc.bits=14",
)
@options.flags(options.CameraFlags, CaptureOptions, first=FIRST_OF_RENDER)
def render(
    scene: arguments.Scene,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Render SCENE and expose a camera to it.

    Writes frame.tiff, frame.png, irradiance.exr and frame.json into DIR (and the files of --dng, --aovs and --clean if
    asked for): all, or none. With --sensor all these are in DIR/NAME for each sensor of the scene.
    """
    from ..files.appearing import output_folder
    from ..files.sensor_names import ALL_SENSORS
    from ..output.frame_files import CAPTURE_FILES
    from .inputs import render_input
    from .progress import render_progress
    from .remarks import taken_by_default, written
    from .terminal import summary

    if flags["sensor"] == ALL_SENSORS:
        return _render_sensors(scene, Path(out_dir), as_json, flags)
    given, asked = render_input(scene, flags)
    with (
        output_folder(out_dir, CAPTURE_FILES) as folder,
        render_progress(err, asked) as progress,
    ):
        found = ms.capture(
            given.scene, given.camera, given.exposure, progress=progress, **asked
        )
        found.save(folder)
    report = found.metadata
    show(report if as_json else summary(report, str(out_dir)), as_json)
    defaults = taken_by_default(flags, given.scene.settings, given.camera)
    show_remarks(as_json, [*defaults, written(out_dir, CAPTURE_FILES)])


def _render_sensors(scene: str, out_dir: Path, as_json: bool, flags: options.Flags) -> None:
    """``render --sensor all``: a folder below ``out_dir`` for each sensor of the scene."""
    from rich.console import Group

    from ..capture import capture_sensors
    from ..files.appearing import output_folders
    from ..output.frame_files import CAPTURE_FILES
    from .inputs import render_inputs
    from .progress import render_progress
    from .remarks import taken_by_default, written
    from .terminal import summary

    views, flags_left = render_inputs(scene, flags)
    asked = complete(CaptureOptions, flags_left)
    check_asked_files(asked)
    with (
        output_folders(out_dir, views, CAPTURE_FILES) as folders,
        render_progress(err, flags_left) as progress,
    ):
        found = capture_sensors(views, asked, progress)
        for name, one in found.sensors.items():
            one.write(folders[name])
    reports = {name: one.metadata for name, one in found.sensors.items()}
    pages = [summary(one, str(out_dir / name)) for name, one in reports.items()]
    show(reports if as_json else Group(*pages), as_json)
    remarks = dict[str, None]()
    for view in views.values():
        assert view.camera is not None
        remarks |= dict.fromkeys(taken_by_default(flags, view.scene.settings, view.camera))
    wrote = [written(out_dir / name, CAPTURE_FILES) for name in views]
    show_remarks(as_json, [*remarks, *wrote])


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor expose out/irradiance.exr -o dark/ --exposure-s 0.001 --frames 8",
)
@options.flags(
    options.CameraFlags,
    UnitOptions,
    LightOptions,
    RawLightOptions,
    first=FIRST_OF_EXPOSE,
    source="that of the render",
    helps={"seed": "Seed of all temporal noise. Default: 1."},
)
def expose(
    irradiance: arguments.IrradianceFile,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Expose a camera to irradiance that is already rendered: another time, camera or seed at no cost.

    Camera, exposure and serial number are those that it was rendered for, unless you give others.
    Writes frame.tiff, frame.png and frame.json into DIR (and those of --dng and --clean if asked for): all, or none.
    """
    from ..files.appearing import output_folder, refuse_empty
    from ..output.exr import rendered_for
    from ..output.frame_files import FRAME_FILES
    from .inputs import camera_and_exposure, other_flags, settings_of
    from .progress import render_progress
    from .remarks import taken_by_default, written
    from .terminal import summary

    refuse_empty(irradiance, "irradiance", "give the path of an irradiance.exr")
    foreign = {name: flags.pop(name) for name in UnitOptions.__annotations__}
    _refuse_lens(flags, foreign["unit"])
    settings = settings_of(rendered_for(irradiance), flags)
    camera, exposure = camera_and_exposure(flags, settings)
    light: ms.Irradiance | str = irradiance
    if any(value is not None for value in foreign.values()):
        light = ms.read_irradiance(irradiance, camera=camera, **foreign)
    bar = render_progress(err, {}, "reading the light")
    with output_folder(out_dir, FRAME_FILES) as folder, bar as progress:
        found = ms.capture(light, camera, exposure, progress=progress, **other_flags(flags))
        found.save(folder)
    report = found.metadata
    show(report if as_json else summary(report, str(out_dir)), as_json)
    defaults = taken_by_default(flags, settings, camera)
    show_remarks(as_json, [*defaults, written(out_dir, FRAME_FILES)])


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor plan out/irradiance.exr --exposure-s 0.001 --tolerance-dn 0.02",
)
@options.flags(
    options.CameraFlags,
    UnitOptions,
    LevelOptions,
    RenderOptions,
    first=FIRST_OF_PLAN,
    source="that of the scene file or render",
)
def plan(
    source: arguments.SceneOrIrradiance,
    tolerance_dn: arguments.ToleranceDn = "0",
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Say which stages this light and exposure need, how far each moves the numbers, and the time that is saved.

    Writes nothing. Times are medians of five interleaved runs on this machine.
    """
    from ..core import InputError, require
    from ..output.exr import rendered_for
    from ..render.light.photons import metered
    from ..sensor.metering import Metering
    from .inputs import camera_and_exposure, render_input, settings_of
    from .progress import render_progress
    from .remarks import taken_by_default
    from .terminal import plan_sheet

    tolerance = require(
        "tolerance_dn", number(tolerance_dn), 0.0, 1e9, "digital numbers, e.g. 0.02"
    )
    foreign = {name: flags.pop(name) for name in ("unit", "fov_deg", "layer")}
    lights = complete(LevelOptions, {"lights": flags.pop("lights")})["lights"]
    if source.lower().endswith(".exr"):
        _refuse_lens(flags, foreign["unit"])
        wavelength_nm, flags["wavelength_nm"] = flags["wavelength_nm"], None
        refuse_render_options(flags)
        settings = settings_of(rendered_for(source), flags)
        camera, exposure = camera_and_exposure(flags, settings)
        light = ms.read_irradiance(
            source, wavelength_nm=wavelength_nm, camera=camera, **foreign
        )
        light = light.before_denoising() if flags["raw_light"] else light
    else:
        if any(value is not None for value in foreign.values()):
            raise InputError(
                f"{source} is a scene, which is rendered; leave --unit, --fov-deg and --layer out."
            )
        given, asked = render_input(source, flags)
        settings, camera, exposure = given.scene.settings, given.camera, given.exposure
        with render_progress(err, asked) as progress:
            light = ms.render(given.scene, camera, exposure, progress=progress, **asked)
    if lights is not None:
        light = light.with_lights(lights)
    if isinstance(exposure, Metering):
        exposure = metered(light, camera, exposure)
    found = ms.plan(
        camera, exposure, ms.collect(light, camera, exposure), tolerance_dn=tolerance
    )
    if as_json:
        show(found.to_dict(), True)
    else:
        show(plan_sheet(found), False)
        show_remarks(False, taken_by_default(flags, settings, camera))


def _refuse_lens(flags: options.Flags, unit: str | None) -> None:
    """The irradiance is behind the lens already: another lens needs another render. unit : of another program's light,
    which may be in front of it."""
    from ..core import InputError

    for field in flags["settings"] or ():
        if field.startswith("lens.") and not (unit or "").startswith("radiance"):
            raise InputError(
                f"--set {field} comes too late: the irradiance is behind the lens already; set it in `render`."
            )


@app.command(
    "fpn-maps",
    cls=Command,
    epilog="Example: mitsuba-sensor fpn-maps -o camera7.npz --serial 7; then render … --fpn-maps",
)
@options.flags(
    options.CameraFlags,
    options.MapFlags,
    without=("exposure_s", "meter", "temperature_k"),
    first=("out_file", "camera", "gain", "serial", "rows", "width", "as_json"),
    source="",
)
def fpn_maps(
    out_file: arguments.MapFile, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Write the fixed-pattern noise (FPN) maps of one camera into a NumPy .npz.

    To look at, to change, or to replace by measured ones: `render … --fpn-maps FILE.npz` takes such a file.
    """
    from ..core import InputError, first_given, require
    from ..files.appearing import refuse_empty
    from ..files.npz import write_fpn_maps
    from .inputs import NO_SCENE, camera_and_exposure, other_flags
    from .remarks import taken_by_default
    from .terminal import map_list

    asked = complete(options.MapFlags, other_flags(flags))
    refuse_empty(out_file, "-o", "give the name of a file, e.g. -o camera1.npz")
    path = Path(out_file)
    if path.suffix != ".npz":
        raise InputError(f"{out_file} is no name of a file of FPN maps; let it end in .npz.")
    camera, _ = camera_and_exposure(flags)
    for name, given, pixels in (
        ("rows", asked["rows"], camera.sensor.rows),
        ("width", asked["width"], camera.sensor.columns),
    ):
        require(
            name,
            first_given(given, pixels),
            1,
            pixels,
            f"pixels, at most those of {camera.name}",
        )
    shape = (
        first_given(asked["rows"], camera.sensor.rows),
        first_given(asked["width"], camera.sensor.columns),
    )
    found = ms.fpn_maps(camera, shape, serial=asked["serial"])
    write_fpn_maps(path, found)
    spread = {
        name: {"mean": float(x.mean()), "sigma": float(x.std()), "shape": x.shape}
        for name, x in found.items()
    }
    maps = f"{out_file}: FPN maps of {camera.name}, serial number {asked['serial']}"
    show(spread if as_json else map_list(spread, maps), as_json)
    show_remarks(as_json, taken_by_default(flags, NO_SCENE, camera))


@app.command(cls=Command)
def doctor(as_json: arguments.Json = False) -> None:
    """Find out what works on this machine, and the command that repairs what does not. Writes nothing.

    It renders a small picture with every variant of Mitsuba. Exit code 0 if a render works.
    """
    from ..render.doctor import examine
    from .progress import steps_bar
    from .terminal import diagnosis

    with steps_bar(err, "rendering a small scene with every variant") as tell:
        findings = examine(tell)
    show(findings if as_json else diagnosis(findings), as_json)
    if not findings["works"]:
        raise typer.Exit(1)


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor lint cornell_box --camera rgbir_2mp",
)
@options.flags(
    options.CameraFlags,
    SceneOptions,
    without=(
        "exposure_s",
        "meter",
        "temperature_k",
        "gain",
        "without",
        "width",
        "motion",
        "look_at",
    ),
    first=("camera", "settings", "parameters", "scene_unit", "as_json"),
)
def lint(scene: arguments.Scene, as_json: arguments.Json = False, **flags: Flag) -> None:
    """Say what in SCENE is black, wrong or worth knowing for this camera. Nothing is rendered.

    Exit code: 0 if nothing is black or wrong, 1 if something is, 2 if the scene cannot be loaded.
    """
    from rich.console import Group
    from rich.text import Text

    from ..optics.image_record import airy_diameter_px
    from ..render.load.scene import inspect_scene
    from .inputs import render_input
    from .remarks import taken_by_default
    from .tables import ResultTable

    given, _ = render_input(scene, flags)
    camera, (low, high) = given.camera, given.camera.band_nm
    findings = inspect_scene(
        given.scene, camera, flags["parameters"] or {}, flags["scene_unit"]
    )
    if as_json:
        show([finding.to_dict() for finding in findings], True)
    else:
        table = ResultTable(("", "where", "what", "remedy"))
        for one in findings:
            table.add_row(
                Text(one.level, style=LEVELS[one.level]),
                *map(Text, (one.where, one.what, one.remedy)),
            )
        disk = f"Airy disk {airy_diameter_px(camera):.2g} px"
        head = Text.assemble(
            (Path(scene).name, "bold"), f" for {camera.name}, {low:g} to {high:g} nm, {disk}"
        )
        shown = [head, table] if findings else [head]
        if all(one.level == "fact" for one in findings):
            shown.append(Text("nothing to say for this camera", style="green"))
        show(Group(*shown), False)
        show_remarks(False, taken_by_default(flags, given.scene.settings, camera))
    if any(finding.is_serious for finding in findings):
        raise typer.Exit(1)
