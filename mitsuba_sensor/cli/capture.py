"""The commands render and expose: from a scene, or from irradiance that is rendered already, to raw frames."""

from __future__ import annotations

from pathlib import Path

import mitsuba_sensor as ms

from ..io import exr, files
from ..pipeline import FILES, CaptureOptions, LightOptions
from . import options, terminal
from .app import app, err, given_camera, given_exposure, refuse_lens, render_input, show


@app.command(epilog="Example: mitsuba-sensor render scenes/cornell_box.xml -o out/ --exposure-s 0.01 --set adc.bits=14")
@options.flags(options.CameraFlags, CaptureOptions)
def render(scene: options.Scene, out_dir: options.Out, as_json: options.Json = False, **flags: options.Flag) -> None:
    """Render SCENE and expose a camera to it.

    Writes frame.tiff, frame.png, irradiance.exr and frame.json into DIR (and aovs.exr if asked for): all, or none.
    """
    given, asked = render_input(scene, flags)
    with files.output_folder(out_dir, FILES) as folder:
        with terminal.render_progress(err, asked) as progress:
            found = ms.capture(given.scene, given.camera, given.exposure, progress=progress, **asked)
        found.save(folder)
    _show(found, out_dir, as_json)


@app.command(epilog="Example: mitsuba-sensor expose out/irradiance.exr -o dark/ --exposure-s 0.001 --frames 8")
@options.flags(options.CameraFlags, LightOptions)
def expose(
    irradiance: options.IrradianceFile, out_dir: options.Out, as_json: options.Json = False, **flags: options.Flag
) -> None:
    """Expose a camera to irradiance that is already rendered: another time, camera or seed at no cost.

    Writes frame.tiff, frame.png and frame.json into DIR: all three, or none.
    """
    refuse_lens(flags["settings"])
    exr.require_exr(irradiance)
    camera, exposure = given_camera(flags), given_exposure(flags)
    asked = {name: value for name, value in flags.items() if name not in options.CameraFlags.__annotations__}
    with files.output_folder(out_dir, FILES) as folder:
        found = ms.capture(irradiance, camera, exposure, **asked)
        found.save(folder)
    _show(found, out_dir, as_json)


def _show(found: ms.Capture, folder: Path, as_json: bool) -> None:
    show(found.metadata if as_json else terminal.summary(found.metadata, str(folder)), as_json)
