"""render: a scene into raw frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms

from ..core.checks import first_given
from ..core.errors import InputError, nearest
from ..io import exr, files
from ..io.metadata import Clock, Shot
from . import options, terminal
from .app import app, err, scene_camera, scene_exposure, scene_setup
from .frames import FRAME, develop, tell, write_frames

SPECTRUM, TRUTH = "irradiance.exr", "aovs.exr"
RENDER_NOISE_MODES = ("shared", "per-frame", "compensated")


@app.command(epilog="Example: mitsuba-sensor render scenes/cornell_box.xml -o out/ --exposure-s 0.01 --set adc.bits=14")
def render(
    scene: options.Scene,
    out_dir: options.Out,
    camera: options.CameraOrScene = None,
    exposure_s: options.ExposureOrScene = None,
    temperature_k: options.TemperatureOrScene = None,
    wavelength_nm: options.WavelengthNm = None,
    bandwidth_nm: options.BandwidthNm = None,
    spectral: options.Spectral = None,
    seed: options.SeedOrScene = None,
    serial: options.SerialOrScene = None,
    frames: options.Frames = 1,
    given_patterns: options.PatternsIn = None,
    chain: options.Chain = "physical",
    engine: options.Engine = "auto",
    precision: options.Precision = "auto",
    preview_gain: options.PreviewGain = 1.0,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    spp: options.Samples = None,
    noise_ratio: options.NoiseRatio = None,
    max_seconds: options.MaxSeconds = None,
    max_spp: options.MaxSpp = None,
    render_noise: options.RenderNoiseMode = "shared",
    scene_unit: options.SceneUnit = None,
    columns: options.Columns = None,
    motion: options.MotionFile = None,
    subframes: options.Subframes = None,
    denoise: options.Denoise = False,
    render_aovs: options.Aovs = False,
    variant: options.Variant = None,
    as_json: options.Json = False,
) -> None:
    """Render SCENE and expose a camera to it.

    Writes frame.tiff, frame.png, irradiance.exr and frame.json into DIR (and aovs.exr if asked for): all, or none.
    """
    if render_noise not in RENDER_NOISE_MODES:
        raise InputError(
            f"--render-noise is {render_noise!r}; it must be one of {', '.join(RENDER_NOISE_MODES)}."
            f"{nearest(render_noise, RENDER_NOISE_MODES)}"
        )
    given = options.pairs("-D", parameters)
    setup = scene_setup(scene, given, variant)
    shot = Shot(
        scene_camera(camera, setup, settings),
        scene_exposure(exposure_s, temperature_k, setup),
        seed=first_given(seed, setup.seed, 1),
        serial=first_given(serial, setup.serial, 1),
        frames=frames,
        maps=files.read_fpn_maps(given_patterns) if given_patterns else None,
        chain=chain,
        engine=engine,
        precision=precision,
        preview_gain=preview_gain,
    )
    wish = {
        "wavelength_nm": wavelength_nm, "bandwidth_nm": bandwidth_nm, "spectral": spectral, "spp": spp,
        "noise_ratio": noise_ratio, "max_seconds": max_seconds, "max_spp": max_spp, "motion": motion,
        "subframes": subframes, "scene_unit": scene_unit, "columns": columns, "denoise": denoise,
        "parameters": given, "variant": variant,
    }  # fmt: skip
    _rehearse(shot, first_given(wavelength_nm, setup.wavelength_nm) is not None)
    clock, origin = Clock(), {"scene": scene, "parameters": given, "motion": motion, "render_noise": render_noise}
    with files.output_folder(out_dir, (SPECTRUM, *FRAME, TRUTH)) as folder:
        report = (_reused if render_noise == "shared" else _taken)(folder, scene, shot, wish, origin, clock)
        if render_aovs:
            with clock.step("ground truth"):
                _write_truth(folder, scene, shot, wish)
        files.write_json(folder / "frame.json", report)
    tell(report, out_dir, as_json)


def _rehearse(shot: Shot, one_band: bool) -> None:
    """Refuse before a long render what ``expose`` would refuse after it: seeds, chain, the names of maps."""
    if shot.chain == "konnik2014" and not one_band:
        raise InputError("--chain konnik2014 knows one wavelength; add --wavelength-nm 550, say.")
    corner = {name: values[:1, :1] for name, values in (shot.maps or {}).items() if values.ndim == 2}
    words = {**shot.exposing, "maps": corner}
    ms.expose([[0.0]], shot.camera, shot.exposure, seed=shot.seed, serial=shot.serial, wavelengths_nm=550.0, **words)


def _reused(
    folder: Path, scene: Path, shot: Shot, wish: dict[str, Any], origin: dict[str, Any], clock: Clock
) -> dict[str, Any]:
    """One render, and all frames of it."""
    with clock.step("render"), terminal.passes(err) as progress:
        light = ms.render(scene, shot.camera, shot.exposure, seed=shot.seed, progress=progress, **wish)
    with clock.step("write irradiance"):
        exr.write_irradiance_exr(folder / SPECTRUM, light)
    return develop(folder, shot, light, origin, clock)


def _taken(
    folder: Path, scene: Path, shot: Shot, wish: dict[str, Any], origin: dict[str, Any], clock: Clock
) -> dict[str, Any]:
    """A render for every frame; the irradiance and the report are those of the first."""
    if shot.chain != "physical":
        raise InputError(f"--render-noise {origin['render_noise']} is for the physical chain; leave --chain out.")
    with clock.step("render and expose"), terminal.frames(err, shot.frames) as progress:
        takes = ms.render_frames(
            scene, shot.camera, shot.exposure, frames=shot.frames, seed=shot.seed, serial=shot.serial,
            render_noise=origin["render_noise"], exposing=shot.exposing, progress=progress, **wish,
        )  # fmt: skip
        first = next(takes)
        digital, uncompensated = [first.frames.digital[0]], [first.uncompensated]
        for take in takes:
            digital.append(take.frames.digital[0])
            uncompensated.append(take.uncompensated)
    with clock.step("write irradiance"):
        exr.write_irradiance_exr(folder / SPECTRUM, first.light)
    origin = {**origin, "uncompensated": float(np.mean(uncompensated))}
    return write_frames(folder, shot, first.light, first.photons, first.frames, np.stack(digital), origin, clock)


def _write_truth(folder: Path, scene: Path, shot: Shot, wish: dict[str, Any]) -> None:
    """Depth, position, normals, albedo, shapes and flow of the same pixels, in a pass of its own."""
    from ..render.aovs import render_aovs

    words = {name: wish[name] for name in ("motion", "parameters", "scene_unit", "variant")}
    found = render_aovs(scene, shot.camera, exposure=shot.exposure, width=wish["columns"], **words)
    exr.write_aovs_exr(folder / TRUTH, found)
