"""render and expose: light into raw frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba_sensor as ms

from ..data import files
from ..data.report import Clock, Shot, frame_report
from ..engine.errors import InputError
from . import options, terminal
from .app import app, chosen_shot, err, show

SPECTRUM = "irradiance.exr"
FRAME = ("frame.tiff", "frame.png", "frame.json")


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
    shot = chosen_shot(
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
    shot = chosen_shot(
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
    from ..data.preview import preview

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
    show(report if as_json else terminal.summary(report, str(folder)), as_json)
