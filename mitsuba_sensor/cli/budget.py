"""The command budget: what each noise source of a camera contributes, for so much light or that of a render."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

import mitsuba_sensor as ms

from ..render.scene.scene_settings import SceneSettings
from . import arguments, options
from .app import app, show, show_remarks
from .budget_sheet import combined_rows, combined_sheet, rows_of, sheet_of
from .completion import shell_files
from .help import Command
from .tables import ResultTable
from .values import Flag, number

FIRST = ("electrons", "sweep", "camera", "readout", "exposure_s", "gain", "settings", "as_json")
SIDE = 128
"""Rows and columns of pixels in uniform light, at most."""
USUAL_TIME_S = 0.01

OptionalLight = Annotated[
    str | None,
    typer.Argument(
        metavar="[IRRADIANCE.exr]",
        help="The light of a render, as `render` wrote it; or give --electrons.",
        show_default=False,
        autocompletion=shell_files,
    ),
]
MeanElectrons = Annotated[
    str | None,
    typer.Option(
        "--electrons",
        metavar="NUMBER",
        help="Mean photoelectrons of every pixel, in uniform light.",
        rich_help_panel="Light",
    ),
]
OneReadout = Annotated[
    str | None,
    typer.Option(
        "--readout",
        metavar="NAME",
        help="One read-out of a camera that has several. Default: all, and their combination.",
        rich_help_panel="Camera and exposure",
    ),
]

Sweep = Annotated[
    bool,
    typer.Option(
        "--sweep",
        help="The SNR curve instead: signal and noise at levels of uniform light, from 1 e- to saturation.",
        rich_help_panel="Light",
    ),
]


@app.command(
    cls=Command,
    epilog="Example: mitsuba-sensor budget --camera sony_imx174 --electrons 1000 --exposure-s 0.01",
)
@options.flags(
    options.CameraFlags, without=("meter", "readout"), first=FIRST, source="that of the render"
)
def budget(
    irradiance: OptionalLight = None,
    electrons: MeanElectrons = None,
    readout: OneReadout = None,
    sweep: Sweep = False,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Say how much noise each source adds, in DN and percent, for a number of photoelectrons or the light of a render.

    Of a camera with several read-outs: of each of them, and what their combination has. Writes nothing. In Python:
    frames.noise_budget().explain().
    """
    from ..core import InputError

    if sweep:
        if irradiance is not None or electrons is not None or readout is not None:
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
    if irradiance is None:
        frames, remarks = _in_uniform_light(electrons, flags)
    else:
        frames, remarks = _in_light_of(irradiance, flags)
    if readout is not None:
        share = _light_share(frames.camera, readout)
        frames = frames.readouts[readout]
        if electrons is not None and share != 1:
            own_e = share * float(number(electrons))
            remarks.append(
                f"{electrons} e- on the first read-out are {own_e:.4g} e- on {readout}"
            )
    if frames.camera.readouts:
        show(combined_rows(frames) if as_json else combined_sheet(frames), as_json)
    else:
        show(rows_of(frames) if as_json else sheet_of(frames), as_json)
    show_remarks(as_json, remarks)


def _show_sweep(as_json: bool, flags: options.Flags) -> None:
    """Show the SNR curve of the camera."""
    from ..core import InputError
    from .inputs import camera_and_exposure
    from .remarks import taken_by_default

    settings = SceneSettings(exposure_s=USUAL_TIME_S)
    camera, exposure = camera_and_exposure(flags, settings)
    if not isinstance(exposure, ms.Exposure):
        raise InputError(
            "--exposure-s is auto, and --sweep has no image to meter; give seconds, e.g. 0.01."
        )
    curve = ms.snr_curve(camera, exposure)
    columns = {
        "electrons": curve.electrons,
        "signal_dn": curve.signal_dn,
        "temporal_dn": curve.temporal_dn,
        "spatial_dn": curve.spatial_dn,
        "snr": curve.snr,
        "total_snr": curve.total_snr,
    }
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    table = ResultTable(
        (
            "electrons [e-]",
            "signal [DN]",
            "temporal σ [DN]",
            "spatial σ [DN]",
            "SNR",
            "total SNR",
        ),
        f"SNR of {curve.camera} at {curve.exposure.time_s:g} s",
        "SNR: signal over temporal noise (EMVA 1288); total SNR: over temporal and spatial noise",
    )
    for row in rows:
        table.add_row(*(f"{value:.4g}" for value in row.values()))
    show(rows if as_json else table, as_json)
    show_remarks(as_json, taken_by_default(flags, settings, camera))


def _light_share(camera: ms.Camera, readout: str) -> float:
    """Photoelectrons of a read-out over those of the first one. Raises InputError for one that there is not."""
    camera.at_readout(readout)
    [chain] = [one for one in camera.combined_readouts.readouts if one.name == readout]
    return chain.light_ratio


def _in_uniform_light(
    electrons: str | None, flags: options.Flags
) -> tuple[ms.Frames, list[str]]:
    """A frame of equal pixels, and what was taken by default."""
    from ..core import InputError, require
    from .inputs import camera_and_exposure
    from .remarks import taken_by_default

    mean_e = require("electrons", number(str(electrons)), 0, 1e9, "per pixel, e.g. 1000")
    if flags["exposure_s"] == "auto":
        raise InputError(
            "--exposure-s is auto, and --electrons are those of one exposure; give its seconds."
        )
    settings = SceneSettings(exposure_s=USUAL_TIME_S)
    camera, exposure = camera_and_exposure(flags, settings)
    rows, columns = (min(n, SIDE) for n in (camera.sensor.rows, camera.sensor.columns))
    light = ms.Photons(np.full((rows, columns), mean_e), detected=True)
    remarks = taken_by_default(flags, settings, camera)
    if flags["exposure_s"] is None:
        remarks.append(f"taken by default: an exposure of {USUAL_TIME_S:g} s (--exposure-s)")
    return ms.expose(light, camera, exposure), remarks


def _in_light_of(irradiance: str, flags: options.Flags) -> tuple[ms.Frames, list[str]]:
    """A frame in the light of a render, and what was taken by default."""
    from ..output.exr import rendered_for
    from .inputs import camera_and_exposure, settings_of
    from .remarks import taken_by_default

    settings = settings_of(rendered_for(irradiance), flags)
    camera, exposure = camera_and_exposure(flags, settings)
    frames = ms.expose(ms.read_irradiance(irradiance), camera, exposure, progress=False)
    return frames, taken_by_default(flags, settings, camera)
