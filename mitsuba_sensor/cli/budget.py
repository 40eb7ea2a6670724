"""The command budget: the noise from each source of a camera, or its SNR curve."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

import mitsuba_sensor as ms

from ..render.scene.scene_settings import SceneSettings
from . import arguments, options
from .app import Command, app, show, show_remarks
from .options import Flag, number

if TYPE_CHECKING:
    from ..theory.snr_curve import SnrCurve

FIRST = ("electrons", "sweep", "camera", "readout", "exposure_s", "gain", "settings", "as_json")
SIDE_MAX_PX = 128
"""Largest side of the uniformly lit window."""
DEFAULT_TIME_S = 0.01


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor budget --camera sony_imx174 --electrons 1000 --exposure-s 0.01",
)
@options.flags(options.CameraFlags, options.BudgetFlags, without=("meter",), first=FIRST)
def budget(
    irradiance: arguments.OptionalLight = None,
    electrons: arguments.MeanElectrons = None,
    sweep: arguments.Sweep = False,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Show the noise from each source, in DN and percent, for a number of photoelectrons or the light of a render.

    A camera with several readouts gets a budget for each readout and the noise of the combination. Writes no files. In
    Python: frames.noise_budget().explain().
    """
    from ..core import InputError
    from .inputs import camera_and_exposure, defaults_line, settings_of

    readout = flags["readout"]
    light = {"the irradiance": irradiance, "--electrons": electrons}
    given = [name for name, value in light.items() if value is not None]
    if sweep and (given or readout is not None):
        names = " and ".join([*given, *(["--readout"] if readout is not None else [])])
        raise InputError(f"--sweep sets the light and measures all readouts; omit {names}.")
    if not sweep and len(given) != 1:
        problem = " and ".join(given) + " both give the light" if given else "no light is given"
        raise InputError(
            f"{problem}; give either --electrons 1000 (mean photoelectrons per pixel), or the irradiance.exr of a "
            "render."
        )
    is_uniform = irradiance is None
    settings = SceneSettings(exposure_s=DEFAULT_TIME_S)
    if irradiance is not None:
        settings = settings_of(irradiance, flags)
    camera, exposure = camera_and_exposure({**flags, "readout": None}, settings)
    remarks = defaults_line(flags, settings, camera)
    if is_uniform and flags["exposure_s"] is None:
        remarks.append(f"default: exposure time {DEFAULT_TIME_S:g} s (--exposure-s)")
    if is_uniform and not isinstance(exposure, ms.Exposure):
        raise InputError(
            "--exposure-s is auto, and uniform light has nothing to meter; give seconds, e.g. 0.01."
        )
    if sweep:
        assert isinstance(exposure, ms.Exposure)
        return _show_sweep(ms.snr_curve(camera, exposure), as_json, remarks)
    source: ms.Photons | ms.Irradiance
    if irradiance is None:
        source = _uniform_light(str(electrons), camera, readout)
    else:
        source = ms.read_irradiance(irradiance)
    if readout is not None:
        camera.at_readout(readout)  # rejects unknown names
    frames = ms.expose(source, camera, exposure, progress=False)
    frames = frames if readout is None else frames.readouts[readout]
    show(_facts(frames) if as_json else _text(frames), as_json)
    show_remarks(as_json, remarks)


def _show_sweep(curve: SnrCurve, as_json: bool, remarks: list[str]) -> None:
    show(curve.rows if as_json else curve.explain(), as_json)
    about = "temporal SNR: signal over temporal noise (EMVA 1288); total SNR: over all noise"
    show_remarks(as_json, [about, *remarks])


def _uniform_light(electrons: str, camera: ms.Camera, readout: str | None) -> ms.Photons:
    """Return this many photoelectrons in every pixel of a window. Raises InputError if they saturate all readouts."""
    from ..core import InputError, require

    mean_e = require("electrons", number(electrons), 0, 1e9, "per pixel, e.g. 1000")
    read = camera if readout is None else camera.at_readout(readout)
    saturation_e = max(x.saturation_e for x in (read.readout_cameras or {"": read}).values())
    if mean_e > saturation_e:
        name = camera.name if readout is None else f"readout {readout} of {camera.name}"
        raise InputError(
            f"{electrons} e- is above the saturation of {name} ({saturation_e:.5g} e-); give fewer electrons."
        )
    shape = [min(n, SIDE_MAX_PX) for n in (camera.sensor.rows, camera.sensor.columns)]
    return ms.Photons(np.full(shape, mean_e), detected=True)


def _facts(frames: ms.Frames) -> object:
    """Return the rows of the noise budget; with several readouts those of each readout, and the combination."""
    if not frames.camera.readouts:
        return [row._asdict() for row in frames.noise_budget().rows]
    rows = {name: _facts(readout) for name, readout in frames.readouts.items()}
    return {"readouts": rows, "combination": _combination(frames)}


def _combination(frames: ms.Frames) -> dict[str, object]:
    """Return theory of the linear code, and the fraction of pixels that uses only one readout.

    snr_db : of a pixel, mean above the black level over temporal noise; None in the dark.
    """
    from ..output.frame_files import readout_facts
    from ..stages.stage import converter_of

    law = frames.theory.averages(frames.stages[-1])
    signal_dn, snr_db = law.mean - converter_of(frames.stages).black_level_dn, None
    if signal_dn > 0 and law.temporal > 0:
        snr_db = 20 * math.log10(signal_dn / math.sqrt(law.temporal))
    return {
        "mean_dn": law.mean,
        "temporal_dn2": law.temporal,
        "spatial_dn2": law.spatial,
        "snr_db": snr_db,
        "share_of_pixels": {
            str(readout["name"]): readout["share_of_pixels"]
            for readout in readout_facts(frames) or []
        },
    }


def _text(frames: ms.Frames, name: str = "") -> str:
    """Return the camera and its noise budget; with several readouts each budget, and the combination."""
    from .tables import cell

    if frames.camera.readouts:
        each = [_text(readout, name) for name, readout in frames.readouts.items()]
        combined = (f"{key}: {cell(value)}" for key, value in _combination(frames).items())
        return "\n\n".join([*each, "\n".join(["combined", *combined])])
    camera, exposure = frames.camera, frames.first.exposure
    readout = f", readout {name}" if name else ""
    setting = f" at gain {camera.gain}" if camera.gain is not None else ""
    return (
        f"{camera.name}{readout}{setting}, K = {camera.system_gain_dn_per_e:.4g} DN/e-, {exposure.time_s:g} s at "
        f"{exposure.temperature_k:g} K\n{frames.noise_budget().explain()}"
    )
