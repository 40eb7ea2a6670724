"""The commands plan, fpn-maps and doctor: what an exposure needs, a camera's FPN maps, what works on this machine."""

from __future__ import annotations

from dataclasses import asdict

import typer

import mitsuba_sensor as ms

from ..core import InputError, first_given
from ..core.options import complete, declared
from ..io import exr, files
from ..render.options import RenderOptions
from ..sensor.gains import gain_dn_per_e
from . import options, terminal
from .app import app, err, given_camera, given_exposure, refuse_lens, render_input, show


@app.command(epilog="Example: mitsuba-sensor plan out/irradiance.exr --exposure-s 0.001 --tolerance-dn 0.02")
@options.flags(options.CameraFlags, RenderOptions)
def plan(
    source: options.SceneOrIrradiance,
    tolerance_dn: options.ToleranceDn = 0.0,
    as_json: options.Json = False,
    **flags: options.Flag,
) -> None:
    """Say which stages this light and exposure need, how far each moves the numbers, and the time that is saved.

    Writes nothing. Times are medians of five interleaved runs on this machine.
    """
    from ..render.requirements import render_requirements

    if source.suffix.lower() == ".exr":
        refuse_lens(flags["settings"])
        _refuse_render_options(flags)
        camera, exposure = given_camera(flags), given_exposure(flags)
        light = exr.read_irradiance_exr(source)
    else:
        given, asked = render_input(source, flags)
        camera, exposure = given.camera, given.exposure
        with terminal.render_progress(err, asked) as progress:
            light = ms.render(given.scene, camera, exposure, progress=progress, **asked)
    photons = ms.collect(light, camera, exposure)
    found = ms.plan(camera, exposure, photons, tolerance_dn=tolerance_dn)
    needs = render_requirements(light, camera, exposure, gain_dn_per_e(camera), tolerance_dn)
    whole_s, planned_s = found.seconds
    if as_json:
        seconds = {"whole_chain": whole_s, "plan": planned_s}
        show({**found.to_dict(), "render": [asdict(need) for need in needs], "seconds_per_frame": seconds}, True)
        return
    show(terminal.plan_sheet(found, needs, whole_s, planned_s), False)


@app.command("fpn-maps", epilog="Example: mitsuba-sensor fpn-maps -o camera7.npz --serial 7; then render … --fpn-maps")
@options.flags(options.CameraFlags, options.MapFlags, without=("exposure_s", "temperature_k"))
def fpn_maps(out_file: options.MapFile, as_json: options.Json = False, **flags: options.Flag) -> None:
    """Write the fixed-pattern noise (FPN) maps of one camera into a NumPy .npz.

    To look at, to change, or to replace by measured ones: `render … --fpn-maps FILE.npz` takes such a file.
    """
    asked = complete(options.MapFlags, {name: flags[name] for name in options.MapFlags.__annotations__})
    camera = given_camera(flags)
    shape = first_given(asked["rows"], camera.sensor.rows), first_given(asked["width"], camera.sensor.columns)
    found = ms.fpn_maps(camera, shape, serial=asked["serial"])
    files.write_fpn_maps(out_file, found)
    spread = {name: {"mean": float(x.mean()), "sigma": float(x.std()), "shape": x.shape} for name, x in found.items()}
    show(spread if as_json else terminal.map_list(spread, str(out_file)), as_json)


@app.command()
def doctor(as_json: options.Json = False) -> None:
    """Find out what works on this machine, and the command that mends what does not. Exit code 0 if a render works."""
    from ..render.doctor import examine

    with err.status("rendering a small scene with every variant"):
        findings = examine()
    show(findings if as_json else terminal.diagnosis(findings), as_json)
    if not findings["works"]:
        raise typer.Exit(1)


def _refuse_render_options(flags: options.Flags) -> None:
    """Raise InputError for options of a render where the light is rendered already."""
    for one in declared(RenderOptions):
        if flags[one.name] not in (None, one.option.default):
            raise InputError(
                f"{one.name} is for the render of a scene, and this light is rendered already; leave it out."
            )
