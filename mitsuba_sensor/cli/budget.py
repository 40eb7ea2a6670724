"""The command budget: what each noise source of a camera contributes, for so much light or that of a render."""

from __future__ import annotations

import math

import numpy as np

import mitsuba_sensor as ms

from ..render.scene.scene_settings import SceneSettings
from . import arguments, options
from .app import app, show, show_remarks
from .help import Command
from .values import Flag, number

FIRST = ("electrons", "sweep", "camera", "readout", "exposure_s", "gain", "settings", "as_json")
SIDE = 128
"""Rows and columns of pixels in uniform light, at most."""
USUAL_TIME_S = 0.01


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor budget --camera sony_imx174 --electrons 1000 --exposure-s 0.01",
)
@options.flags(options.CameraFlags, without=("meter",), first=FIRST)
def budget(
    irradiance: arguments.OptionalLight = None,
    electrons: arguments.MeanElectrons = None,
    sweep: arguments.Sweep = False,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Say how much noise each source adds, in DN and percent, for a number of photoelectrons or the light of a render.

    Of a camera with several read-outs: of each of them, and what their combination has. Writes nothing. In Python:
    frames.noise_budget().explain().
    """
    from ..core import InputError
    from .inputs import camera_and_exposure, settings_of, taken_by_default

    if sweep:
        if irradiance is not None or electrons is not None or flags["readout"] is not None:
            raise InputError(
                "--sweep chooses the levels of light itself; leave out the light and --readout."
            )
        _show_sweep(as_json, flags)
        return
    if (irradiance is None) == (electrons is None):
        raise InputError(
            "give the light, and give it once: --electrons 1000 (mean photoelectrons of every pixel), or the "
            "irradiance.exr of a render."
        )
    readout = flags.pop("readout")
    if irradiance is None:
        settings = SceneSettings(exposure_s=USUAL_TIME_S)
    else:
        settings = settings_of(irradiance, flags)
    camera, exposure = camera_and_exposure(flags, settings)
    remarks = taken_by_default(flags, settings, camera)
    if irradiance is None:
        light: ms.Photons | ms.Irradiance = _uniform_light(electrons, camera, exposure)
        if flags["exposure_s"] is None:
            remarks.append(
                f"taken by default: an exposure of {USUAL_TIME_S:g} s (--exposure-s)"
            )
    else:
        light = ms.read_irradiance(irradiance)
    frames = ms.expose(light, camera, exposure, progress=False)
    if readout is not None:
        camera.at_readout(readout)
        frames = frames.readouts[readout]
    show(_facts(frames), as_json, None if as_json else _text(frames))
    show_remarks(as_json, remarks)


def _show_sweep(as_json: bool, flags: options.Flags) -> None:
    """Show the SNR curve of the camera."""
    from ..core import InputError
    from .inputs import camera_and_exposure, taken_by_default

    settings = SceneSettings(exposure_s=USUAL_TIME_S)
    camera, exposure = camera_and_exposure(flags, settings)
    if not isinstance(exposure, ms.Exposure):
        raise InputError(
            "--exposure-s is auto, and --sweep has no image to meter; give seconds, e.g. 0.01."
        )
    curve = ms.snr_curve(camera, exposure)
    names = "electrons", "signal_dn", "temporal_dn", "spatial_dn", "snr", "total_snr"
    rows = zip(*(getattr(curve, name) for name in names), strict=True)
    show([dict(zip(names, map(float, row), strict=True)) for row in rows], as_json)
    about = (
        f"{curve.camera} at {curve.exposure.time_s:g} s; snr: signal over temporal noise (EMVA 1288); total_snr: over "
        "temporal and spatial noise"
    )
    show_remarks(as_json, [about, *taken_by_default(flags, settings, camera)])


def _uniform_light(electrons: str | None, camera: ms.Camera, exposure: object) -> ms.Photons:
    """So many photoelectrons in every pixel."""
    from ..core import InputError, require

    mean_e = require("electrons", number(str(electrons)), 0, 1e9, "per pixel, e.g. 1000")
    if not isinstance(exposure, ms.Exposure):
        raise InputError(
            "--exposure-s is auto, and --electrons are those of one exposure; give its seconds."
        )
    rows, columns = (min(n, SIDE) for n in (camera.sensor.rows, camera.sensor.columns))
    return ms.Photons(np.full((rows, columns), mean_e), detected=True)


def _facts(frames: ms.Frames) -> object:
    """The rows of the noise budget; of several read-outs those of each, and the combination."""
    if not frames.camera.readouts:
        return [row._asdict() for row in frames.noise_budget().rows]
    rows = {name: _facts(one) for name, one in frames.readouts.items()}
    return {"readouts": rows, "combination": _combination(frames)}


def _combination(frames: ms.Frames) -> dict[str, object]:
    """What theory says of the linear code, and by how many pixels each read-out alone counts.

    snr_db : of a pixel, mean over black against temporal noise; None in darkness.
    """
    from ..output.frame_files import readout_facts
    from ..stages.stage import converter_of

    found = frames.theory.averages(frames.stages[-1])
    signal_dn, snr_db = found.mean - converter_of(frames.stages).black_level_dn, None
    if signal_dn > 0 and found.temporal > 0:
        snr_db = 20 * math.log10(signal_dn / math.sqrt(found.temporal))
    return {
        "mean_dn": found.mean,
        "temporal_dn2": found.temporal,
        "spatial_dn2": found.spatial,
        "snr_db": snr_db,
        "share_of_pixels": {
            str(one["name"]): one["share_of_pixels"] for one in readout_facts(frames) or []
        },
    }


def _text(frames: ms.Frames, name: str = "") -> str:
    """The camera and its noise budget; of several read-outs that of each, and the combination."""
    from .tables import cell

    if frames.camera.readouts:
        each = [_text(one, name) for name, one in frames.readouts.items()]
        combined = (f"{key}: {cell(value)}" for key, value in _combination(frames).items())
        return "\n\n".join([*each, "\n".join(["combined", *combined])])
    camera, exposure = frames.camera, frames.first.exposure
    readout = f", read-out {name}" if name else ""
    setting = f" at gain {camera.gain}" if camera.gain is not None else ""
    return (
        f"{camera.name}{readout}{setting}, K = {camera.system_gain_dn_per_e:.4g} DN/e-, {exposure.time_s:g} s at "
        f"{exposure.temperature_k:g} K\n{frames.noise_budget().explain()}"
    )
