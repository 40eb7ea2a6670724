"""The commands render, expose, plan, fpn-maps, doctor and lint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from .app import Command, app, err, show, show_remarks
from .flag_names import with_flags
from .options import Flag, number

FIRST_OF_CAMERA = ("camera", "exposure_s", "gain", "settings")
FIRST_OF_EXPOSE = ("out_dir", "dng", "clean", "page", "as_json", *FIRST_OF_CAMERA, "frames")
FIRST_OF_RENDER = (*FIRST_OF_EXPOSE, "width", "spp", "luminance")
FIRST_OF_PLAN = ("as_json", *FIRST_OF_CAMERA, "width", "spp", "tolerance_dn")
"""Options in short ``--help``."""


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

    Writes frame.tiff, frame.png, irradiance.exr and frame.json into DIR, and the files that --dng, --aovs, --clean and
    --page add. --sensor all writes them into DIR/NAME for each sensor of the scene.
    """
    from ..files.appearing import output_folder
    from ..files.sensor_names import ALL_SENSORS
    from ..output.frame_files import CAPTURE_FILES
    from .inputs import defaults_line, render_input
    from .progress import render_progress

    if flags["sensor"] == ALL_SENSORS:
        return _render_sensors(scene, Path(out_dir), as_json, flags)
    given, others = render_input(scene, flags)
    with (
        output_folder(out_dir, CAPTURE_FILES) as folder,
        render_progress(err, others) as progress,
    ):
        capture = ms.capture(
            given.scene, given.camera, given.exposure, progress=progress, **others
        )
        capture.save(folder)
    defaults = defaults_line(flags, given.scene.settings, given.camera)
    _print_frames(capture.metadata, out_dir, CAPTURE_FILES, as_json, defaults)


def _print_frames(
    report: Mapping[str, object],
    folder: str,
    names: Sequence[str],
    as_json: bool,
    remarks: Sequence[str],
) -> None:
    """Print frame.json, or its summary and the written files.  names : of the files that the command writes."""
    from .inputs import written
    from .summaries import summary

    show(report, as_json, summary(report, folder))
    show_remarks(as_json, [*remarks, written(folder, names)])


def _render_sensors(scene: str, out_dir: Path, as_json: bool, flags: options.Flags) -> None:
    """Render for ``--sensor all`` into one folder for each sensor of the scene."""
    from ..capture import capture_sensors
    from ..files.appearing import output_folders
    from ..output.frame_files import CAPTURE_FILES
    from .inputs import defaults_line, render_inputs
    from .progress import render_progress

    views, others = render_inputs(scene, flags)
    completed = complete(CaptureOptions, others)
    check_asked_files(completed)
    with (
        output_folders(out_dir, views, CAPTURE_FILES) as folders,
        render_progress(err, others) as progress,
    ):
        sensors = capture_sensors(views, completed, progress).sensors
        for name, capture in sensors.items():
            capture.write(folders[name])
    if as_json:
        return show({name: capture.metadata for name, capture in sensors.items()}, True)
    for name, capture in sensors.items():
        view = views[name]
        assert view.camera is not None
        defaults = defaults_line(flags, view.scene.settings, view.camera)
        _print_frames(capture.metadata, str(out_dir / name), CAPTURE_FILES, False, defaults)


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
)
def expose(
    irradiance: arguments.IrradianceFile,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Expose a camera to the light of an earlier render, with another exposure, camera or seed.

    Camera, exposure and serial number default to those of the render. Writes frame.tiff, frame.png and frame.json into
    DIR, and the files that --dng, --clean and --page add.
    """
    from ..files.appearing import output_folder, refuse_empty
    from ..output.frame_files import FRAME_FILES
    from .inputs import camera_and_exposure, defaults_line, other_flags, settings_of
    from .progress import render_progress

    refuse_empty(irradiance, "irradiance", "give the path of an irradiance.exr")
    foreign = {name: flags.pop(name) for name in UnitOptions.__annotations__}
    _refuse_lens(flags, foreign["unit"])
    settings = settings_of(irradiance, flags)
    camera, exposure = camera_and_exposure(flags, settings)
    light: ms.Irradiance | str = irradiance
    if any(value is not None for value in foreign.values()):
        light = ms.read_irradiance(irradiance, camera=camera, **foreign)
    bar = render_progress(err, {}, "reading the light")
    with output_folder(out_dir, FRAME_FILES) as folder, bar as progress:
        capture = ms.capture(light, camera, exposure, progress=progress, **other_flags(flags))
        capture.save(folder)
    defaults = defaults_line(flags, settings, camera)
    _print_frames(capture.metadata, out_dir, FRAME_FILES, as_json, defaults)


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor plan out/irradiance.exr --exposure-s 0.001 --tolerance-dn 0.02",
)
@options.flags(
    options.CameraFlags, UnitOptions, LevelOptions, RenderOptions, first=FIRST_OF_PLAN
)
def plan(
    source: arguments.SceneOrIrradiance,
    tolerance_dn: arguments.ToleranceDn = "0",
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Show which sensor stages this light and exposure need, and how far each one changes pixel values.

    Writes no files.
    """
    from ..core import InputError, require
    from ..render.light.photons import metered
    from ..sensor.metering import Metering
    from .inputs import camera_and_exposure, defaults_line, render_input, settings_of
    from .progress import render_progress

    tolerance = require(
        "tolerance_dn", number(tolerance_dn), 0.0, 1e9, "digital numbers, e.g. 0.02"
    )
    foreign = {name: flags.pop(name) for name in ("unit", "fov_deg", "layer")}
    lights = complete(LevelOptions, {"lights": flags.pop("lights")})["lights"]
    if source.lower().endswith(".exr"):
        _refuse_lens(flags, foreign["unit"])
        foreign["wavelength_nm"], flags["wavelength_nm"] = flags["wavelength_nm"], None
        refuse_render_options(flags)
        settings = settings_of(source, flags)
        camera, exposure = camera_and_exposure(flags, settings)
        light = ms.read_irradiance(source, camera=camera, **foreign)
        light = light.before_denoising() if flags["raw_light"] else light
    else:
        if any(value is not None for value in foreign.values()):
            raise InputError(
                f"{source!r} is a scene to render; omit --unit, --fov-deg and --layer, which describe an EXR file."
            )
        given, others = render_input(source, flags)
        settings, camera, exposure = given.scene.settings, given.camera, given.exposure
        with render_progress(err, others) as progress:
            light = ms.render(given.scene, camera, exposure, progress=progress, **others)
    if lights is not None:
        light = light.with_lights(lights)
    if isinstance(exposure, Metering):
        exposure = metered(light, camera, exposure)
    photons = ms.collect(light, camera, exposure)
    plan = ms.plan(camera, exposure, photons, tolerance_dn=tolerance)
    show(plan.to_dict(), as_json, plan.explain())
    show_remarks(as_json, defaults_line(flags, settings, camera))


def _refuse_lens(flags: options.Flags, unit: str | None) -> None:
    """Raise InputError for changes of the lens, whose effect is already in the irradiance.

    unit : of another program's light, which may be radiance in front of the lens.
    """
    from ..core import InputError

    for field in flags["settings"] or ():
        if field.startswith("lens.") and not (unit or "").startswith("radiance"):
            raise InputError(
                f"--set {field} has no effect on this irradiance, which already passed the lens; set it in `render`."
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
)
def fpn_maps(
    out_file: arguments.MapFile, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Write the fixed-pattern noise (FPN) maps of one sensor unit into a NumPy .npz file.

    `render … --fpn-maps FILE.npz` reads such a file, with maps that you changed or measured.
    """
    from ..core import first_given, require
    from ..files.npz import write_fpn_maps
    from .inputs import NO_SCENE, camera_of, defaults_line, new_file, other_flags

    asked = complete(options.MapFlags, other_flags(flags))
    path = new_file(out_file, "camera1.npz")
    camera = camera_of(flags)
    sizes = {"rows": camera.sensor.rows, "width": camera.sensor.columns}
    rows, columns = (
        int(
            require(
                name,
                first_given(flags[name], pixels),
                1,
                pixels,
                f"at most the {pixels} pixels of {camera.name}",
            )
        )
        for name, pixels in sizes.items()
    )
    maps = ms.fpn_maps(camera, (rows, columns), serial=asked["serial"])
    write_fpn_maps(path, maps)
    spread = {
        name: {"mean": float(x.mean()), "sigma": float(x.std()), "shape": x.shape}
        for name, x in maps.items()
    }
    show(spread, as_json)
    wrote = f"wrote {out_file}: FPN maps of {camera.name}, serial number {asked['serial']}"
    show_remarks(as_json, [*defaults_line(flags, NO_SCENE, camera), wrote])


@app.command(cls=Command)
def doctor(as_json: arguments.Json = False) -> None:
    """Find out what works on this machine, and print the command that repairs what does not.

    Renders a small image with every Mitsuba variant and writes no files. Exit code 0 if a render works.
    """
    from ..render.doctor import examine
    from .progress import steps_bar

    with steps_bar(err, "rendering a small scene with every variant") as tell:
        findings = examine(tell)
    python = "works" if findings["python"]["works"] else "fails"
    shown = {"python": f"mi.render {python}: {findings['python']['reason']}"}
    shown["remedies"] = findings["remedies"] or "none needed"
    show(findings, as_json, findings | shown)
    if not findings["works"]:
        raise typer.Exit(1)


@app.command(cls=Command, epilog="Example: mitsuba-sensor lint cornell_box --camera rgbir_2mp")
@options.flags(
    options.CameraFlags,
    SceneOptions,
    without=(
        *("exposure_s", "meter", "temperature_k", "gain"),
        *("without", "width", "motion", "look_at"),
    ),
    first=("camera", "settings", "parameters", "scene_unit", "as_json"),
)
def lint(scene: arguments.Scene, as_json: arguments.Json = False, **flags: Flag) -> None:
    """List parts of SCENE that will be black or wrong for this camera, and further facts; renders nothing.

    Exit code: 0 if nothing is black or wrong, 1 if something is, 2 if the scene cannot be loaded.
    """
    from ..optics.image_record import airy_diameter_px
    from ..render.load.scene import inspect_scene
    from .inputs import defaults_line, render_input

    given, _ = render_input(scene, flags)
    camera, (low, high) = given.camera, given.camera.band_nm
    findings = inspect_scene(
        given.scene, camera, flags["parameters"] or {}, flags["scene_unit"]
    )
    facts = [finding.to_dict() for finding in findings]
    airy = f"Airy disk {airy_diameter_px(camera):.2g} px"
    head = {"camera": f"{camera.name}, {low:g} to {high:g} nm, {airy}"}
    rows = [
        {name: with_flags(x) if isinstance(x, str) else x for name, x in fact.items()}
        for fact in facts
    ]
    show(facts, as_json, {**head, "findings": rows or "none for this camera"})
    show_remarks(as_json, defaults_line(flags, given.scene.settings, camera))
    if any(finding.is_serious for finding in findings):
        raise typer.Exit(1)
