"""expose: light that is there already into raw frames; and what every frame is written as."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms

from ..io import exr, files
from ..io.metadata import Clock, Shot, frame_report
from . import options, terminal
from .app import app, chosen_shot, refuse_lens, show

FRAME = ("frame.tiff", "frame.png", "frame.json")


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
    refuse_lens(settings)
    shot = chosen_shot(
        camera,
        settings,
        ms.Exposure(exposure_s, temperature_k),
        seed=seed,
        serial=serial,
        frames=frames,
        maps=files.read_fpn_maps(given_patterns) if given_patterns else None,
        chain=chain,
        engine=engine,
        precision=precision,
        preview_gain=preview_gain,
    )
    clock = Clock()
    with files.output_folder(out_dir, FRAME) as folder:
        with clock.step("read irradiance"):
            light = exr.read_irradiance_exr(irradiance)
        report = develop(folder, shot, light, {"irradiance": irradiance}, clock)
        files.write_json(folder / "frame.json", report)
    tell(report, out_dir, as_json)


def develop(folder: Path, shot: Shot, light: ms.Irradiance, origin: dict[str, Any], clock: Clock) -> dict[str, Any]:
    """Irradiance → photons → frames, written into ``folder``; the report."""
    with clock.step("expose"):
        photons = ms.collect(light, shot.camera, shot.exposure)
        frames = ms.expose(
            photons, shot.camera, shot.exposure, seed=shot.seed, serial=shot.serial, frames=shot.frames, **shot.exposing
        )
    return write_frames(folder, shot, light, photons, frames, frames.digital, origin, clock)


def write_frames(
    folder: Path, shot: Shot, light: ms.Irradiance, photons: ms.Photons, frames: ms.Frames, digital: np.ndarray,
    origin: dict[str, Any], clock: Clock,
) -> dict[str, Any]:  # fmt: skip
    """Write the raw frames ``digital`` (N, H, W) and the report of the first of them, ``frames``; the report."""
    from ..io.preview import preview

    with clock.step("write frame"):
        files.write_tiff(folder / "frame.tiff", digital)
        files.write_png(folder / "frame.png", preview(digital[0], shot.camera, shot.preview_gain))
    with clock.step("report"):
        plan_of = ms.plan(shot.camera, shot.exposure, photons) if shot.chain == "physical" else None
        found = plan_of.to_dict() if plan_of else {"stages": [], "float32": None}
        judged = {"effects": found["stages"], "float32": found["float32"], "times_s": clock.seconds}
        report = {**frame_report(shot, light, frames, origin), **judged}
    return report


def tell(report: dict[str, Any], folder: Path, as_json: bool) -> None:
    show(report if as_json else terminal.summary(report, str(folder)), as_json)
