"""mitsuba-sensor: the words of the library on the command line. The only module that prints."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

import mitsuba_sensor as ms

from . import options, terminal
from .data import files
from .data.report import Clock, Shot, frame_report
from .engine.errors import InputError
from .sensor.chain import gain_dn_per_e

SPECTRUM = "irradiance.exr"
FRAME = ("frame.tiff", "frame.png", "frame.json")

out = Console()
err = Console(stderr=True)


class Door(TyperGroup):
    """Where every command ends: what a user did wrong is one sentence on stderr and exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except (InputError, OSError, MemoryError) as error:
            err.print(f"[bold red]error:[/] {escape(_sentence(error))}", highlight=False, soft_wrap=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            err.print("stopped; nothing was written", highlight=False)
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=Door,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="From a 3D scene to the raw numbers of a camera, with every noise that physics puts in.\n\n"
    "Start here: [bold]mitsuba-sensor render scenes/cornell_box.xml -o out/[/]",
)
cameras = typer.Typer(no_args_is_help=True, help="The camera files that come along, and what may stand in one.")
app.add_typer(cameras, name="cameras")


@app.command(epilog="Example: mitsuba-sensor render scenes/cornell_box.xml -o out/ --exposure-s 0.01 --set adc.bits=14")
def render(
    scene: options.Scene,
    out_dir: options.Out,
    camera: options.Camera = options.DEFAULT_CAMERA,
    exposure_s: options.ExposureS = options.DEFAULT_EXPOSURE_S,
    temperature_k: options.TemperatureK = options.DEFAULT_TEMPERATURE_K,
    wavelength_nm: options.WavelengthNm = None,
    bandwidth_nm: options.BandwidthNm = options.DEFAULT_BANDWIDTH_NM,
    seed: options.Seed = 1,
    serial: options.Serial = 1,
    frames: options.Frames = 1,
    given_patterns: options.PatternsIn = None,
    chain: options.Chain = "physical",
    engine: options.Engine = "auto",
    precision: options.Precision = "auto",
    preview_gain: options.PreviewGain = 1.0,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    spp: options.Samples = None,
    variant: options.Variant = None,
    as_json: options.Json = False,
) -> None:
    """Render SCENE and expose a camera to it.

    Writes frame.tiff, frame.png, irradiance.exr and frame.json into DIR: all four, or none.
    """
    shot = _shot(
        camera,
        settings,
        ms.Exposure(exposure_s, temperature_k),
        seed=seed,
        serial=serial,
        frames=frames,
        maps=files.read_patterns(given_patterns) if given_patterns else None,
        chain=chain,
        engine=engine,
        precision=precision,
        preview_gain=preview_gain,
    )
    given = options.pairs("-D", parameters)
    _rehearse(shot, wavelength_nm is not None)
    clock = Clock()
    with files.output_folder(out_dir, (SPECTRUM, *FRAME)) as folder:
        with clock.step("render"), terminal.passes(err) as progress:
            light = ms.render(
                scene,
                shot.camera,
                shot.exposure,
                seed=seed,
                spp=spp,
                wavelength_nm=wavelength_nm,
                bandwidth_nm=bandwidth_nm,
                parameters=given,
                variant=variant,
                progress=progress,
            )
        with clock.step("write irradiance"):
            files.write_irradiance_exr(folder / SPECTRUM, light)
        report = _develop(folder, shot, light, {"scene": scene, "parameters": given}, clock)
    _tell(report, out_dir, as_json)


@app.command(epilog="Example: mitsuba-sensor expose out/irradiance.exr -o dark/ --exposure-s 0.001 --frames 8")
def expose(
    irradiance: options.Light,
    out_dir: options.Out,
    camera: options.Camera = options.DEFAULT_CAMERA,
    exposure_s: options.ExposureS = options.DEFAULT_EXPOSURE_S,
    temperature_k: options.TemperatureK = options.DEFAULT_TEMPERATURE_K,
    seed: options.Seed = 1,
    serial: options.Serial = 1,
    frames: options.Frames = 1,
    given_patterns: options.PatternsIn = None,
    chain: options.Chain = "physical",
    engine: options.Engine = "auto",
    precision: options.Precision = "auto",
    preview_gain: options.PreviewGain = 1.0,
    settings: options.Settings = None,
    as_json: options.Json = False,
) -> None:
    """Expose a camera to light that is already rendered: another time, camera or seed at no cost.

    Writes frame.tiff, frame.png and frame.json into DIR: all three, or none.
    """
    shot = _shot(
        camera,
        settings,
        ms.Exposure(exposure_s, temperature_k),
        seed=seed,
        serial=serial,
        frames=frames,
        maps=files.read_patterns(given_patterns) if given_patterns else None,
        chain=chain,
        engine=engine,
        precision=precision,
        preview_gain=preview_gain,
    )
    clock = Clock()
    with files.output_folder(out_dir, FRAME) as folder:
        with clock.step("read irradiance"):
            light = files.read_irradiance_exr(irradiance)
        report = _develop(folder, shot, light, {"irradiance": irradiance}, clock)
    _tell(report, out_dir, as_json)


@app.command(epilog="Example: mitsuba-sensor plan out/irradiance.exr --exposure-s 0.001 --tolerance-dn 0.02")
def plan(
    source: options.SceneOrLight,
    camera: options.Camera = options.DEFAULT_CAMERA,
    exposure_s: options.ExposureS = options.DEFAULT_EXPOSURE_S,
    temperature_k: options.TemperatureK = options.DEFAULT_TEMPERATURE_K,
    tolerance_dn: options.ToleranceDn = 0.0,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    spp: options.Samples = None,
    variant: options.Variant = None,
    as_json: options.Json = False,
) -> None:
    """Say which stages this light and exposure need, how far each moves the numbers, and the time that is saved.

    Writes nothing. Times are medians of five interleaved runs on this machine.
    """
    from .light.needs import render_needs

    shot = _shot(camera, settings, ms.Exposure(exposure_s, temperature_k))
    if source.suffix.lower() == ".exr":
        light = files.read_irradiance_exr(source)
    else:
        with terminal.passes(err) as progress:
            given = options.pairs("-D", parameters)
            light = ms.render(
                source, shot.camera, shot.exposure, spp=spp, parameters=given, variant=variant, progress=progress
            )
    photons = ms.collect(light, shot.camera, shot.exposure)
    found = ms.plan(shot.camera, shot.exposure, photons, tolerance_dn=tolerance_dn)
    needs = render_needs(light, shot.camera, shot.exposure, gain_dn_per_e(shot.camera), tolerance_dn)
    whole_s, planned_s = found.seconds
    if as_json:
        seconds = {"whole_chain": whole_s, "plan": planned_s}
        _print({**found.to_dict(), "render": [asdict(need) for need in needs], "seconds_per_frame": seconds}, True)
        return
    _print(terminal.plan_sheet(found, needs, whole_s, planned_s), False)


@app.command(epilog="Example: mitsuba-sensor patterns -o chip7.npz --serial 7; then render … --patterns chip7.npz")
def patterns(
    out_file: options.PatternsOut,
    camera: options.Camera = options.DEFAULT_CAMERA,
    serial: options.Serial = 1,
    rows: options.Rows = None,
    columns: options.Columns = None,
    settings: options.Settings = None,
    as_json: options.Json = False,
) -> None:
    """Write the fixed patterns of one chip into a NumPy .npz, to look at, to change, or to replace by measured ones."""
    shot = _shot(camera, settings, ms.Exposure(0.0), serial=serial)
    shape = rows or shot.camera.sensor.rows, columns or shot.camera.sensor.columns
    found = ms.patterns(shot.camera, shape, serial=serial)
    files.write_patterns(out_file, found)
    spread = {name: {"mean": float(x.mean()), "sigma": float(x.std()), "shape": x.shape} for name, x in found.items()}
    _print(spread if as_json else terminal.pattern_list(spread, str(out_file)), as_json)


@cameras.command("list")
def list_command(as_json: options.Json = False) -> None:
    """The cameras that come along."""
    known = [ms.load_camera(name) for name in ms.list_cameras()]
    if as_json:
        _print([{"name": one.name, "description": one.description} for one in known], True)
        return
    rows = [
        (one.name, one.sensor.technology, f"{one.sensor.columns} × {one.sensor.rows}", one.description) for one in known
    ]
    _print(terminal.camera_list(rows), False)


@cameras.command(epilog="Example: mitsuba-sensor cameras show konnik_table1")
def show(name: options.CameraName, as_json: options.Json = False) -> None:
    """Every number of one camera, with its unit (the end of the field's name) and where it comes from."""
    camera = ms.load_camera(name)
    fields = camera.model_dump(mode="json")
    if as_json:
        _print({**fields, "sources": dict(camera.sources)}, True)
        return
    fields.pop("sources", None)
    _print(terminal.camera_sheet(_flat(fields), camera.sources), False)


@cameras.command()
def schema() -> None:
    """The JSON Schema of a camera file: every field, its unit and its allowed range."""
    from .sensor.camera import camera_schema

    _print(camera_schema(), True)


@app.command()
def doctor(as_json: options.Json = False) -> None:
    """Find out what works on this machine, and the command that mends what does not. Exit code 0 if a render works."""
    from .doctor import examine

    with err.status("rendering a small scene with every variant"):
        findings = examine()
    _print(findings if as_json else terminal.diagnosis(findings), as_json)
    if not findings["works"]:
        raise typer.Exit(1)


def _shot(camera: str, settings: list[str] | None, exposure: ms.Exposure, **asked: Any) -> Shot:
    """The camera with its --set fields, and what is asked of it; all checked. asked : other fields of Shot."""
    changes = {key: options.toml_value(text) for key, text in options.pairs("--set", settings).items()}
    chosen = ms.load_camera(camera)
    return Shot(chosen.replace(**changes) if changes else chosen, exposure, **asked)


def _rehearse(shot: Shot, one_band: bool) -> None:
    """Refuse before a long render what ``expose`` would refuse after it: seeds, chain, the names of maps."""
    if shot.chain == "konnik2014" and not one_band:
        raise InputError("--chain konnik2014 knows one wavelength; add --wavelength-nm 550, say.")
    corner = {name: values[:1, :1] for name, values in (shot.maps or {}).items() if values.ndim == 2}
    ms.expose(
        [[0.0]], shot.camera, shot.exposure, seed=shot.seed, serial=shot.serial,
        wavelengths_nm=550.0, maps=corner, chain=shot.chain, engine=shot.engine, precision=shot.precision,
    )  # fmt: skip


def _develop(folder: Path, shot: Shot, light: ms.Irradiance, origin: dict[str, Any], clock: Clock) -> dict[str, Any]:
    """Irradiance → photons → frames, written into ``folder``; the report."""
    from .data.preview import preview

    with clock.step("expose"):
        photons = ms.collect(light, shot.camera, shot.exposure)
        frames = ms.expose(
            photons,
            shot.camera,
            shot.exposure,
            seed=shot.seed,
            serial=shot.serial,
            frames=shot.frames,
            maps=shot.maps,
            chain=shot.chain,
            engine=shot.engine,
            precision=shot.precision,
        )
    with clock.step("write frame"):
        files.write_tiff(folder / "frame.tiff", frames.digital)
        files.write_png(folder / "frame.png", preview(frames.digital[0], shot.camera, shot.preview_gain))
    with clock.step("report"):
        plan_of = ms.plan(shot.camera, shot.exposure, photons) if shot.chain == "physical" else None
        found = plan_of.to_dict() if plan_of else {"stages": [], "float32": None}
        judged = {"effects": found["stages"], "float32": found["float32"], "times_s": clock.seconds}
        report = {**frame_report(shot, light, frames, origin), **judged}
    files.write_json(folder / "frame.json", report)
    return report


def _tell(report: dict[str, Any], folder: Path, as_json: bool) -> None:
    _print(report if as_json else terminal.summary(report, str(folder)), as_json)


def _print(what: Any, as_json: bool) -> None:
    """JSON plain and whole, everything else as rich shows it."""
    if as_json:
        typer.echo(files.to_json(what))
    else:
        out.print(what, highlight=False)


def _flat(fields: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested fields under dotted names."""
    flat: dict[str, Any] = {}
    for key, value in fields.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat


def _sentence(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); render a smaller picture, fewer bands or fewer frames."
    if isinstance(error, OSError):
        return f"{error.filename or 'the system'}: {error.strerror or error}."
    return str(error)
