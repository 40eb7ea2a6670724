"""plan, patterns and doctor: what a frame needs, what a chip is, what this machine can do."""

from __future__ import annotations

from dataclasses import asdict

import typer

import mitsuba_sensor as ms

from ..core.checks import first_given
from ..io import exr, files
from ..sensor.gains import gain_dn_per_e
from . import options, terminal
from .app import app, changed, chosen_shot, err, refuse_lens, scene_camera, scene_exposure, scene_setup, show


@app.command(epilog="Example: mitsuba-sensor plan out/irradiance.exr --exposure-s 0.001 --tolerance-dn 0.02")
def plan(
    source: options.SceneOrLight,
    camera: options.CameraOrScene = None,
    exposure_s: options.ExposureOrScene = None,
    temperature_k: options.TemperatureOrScene = None,
    tolerance_dn: options.ToleranceDn = 0.0,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    spp: options.Samples = None,
    scene_unit: options.SceneUnit = None,
    columns: options.Columns = None,
    variant: options.Variant = None,
    as_json: options.Json = False,
) -> None:
    """Say which stages this light and exposure need, how far each moves the numbers, and the time that is saved.

    Writes nothing. Times are medians of five interleaved runs on this machine.
    """
    from ..render.requirements import render_requirements

    if source.suffix.lower() == ".exr":
        refuse_lens(settings)
        chosen = changed(ms.load_camera(camera or options.DEFAULT_CAMERA), settings)
        time_s, kelvin = options.DEFAULT_EXPOSURE_S, options.DEFAULT_TEMPERATURE_K
        exposure = ms.Exposure(first_given(exposure_s, time_s), first_given(temperature_k, kelvin))
        light = exr.read_irradiance_exr(source)
    else:
        given = options.pairs("-D", parameters)
        setup = scene_setup(source, given, variant)
        chosen, exposure = scene_camera(camera, setup, settings), scene_exposure(exposure_s, temperature_k, setup)
        words = {"spp": spp, "parameters": given, "variant": variant, "scene_unit": scene_unit, "columns": columns}
        with terminal.passes(err) as progress:
            light = ms.render(source, chosen, exposure, progress=progress, **words)
    photons = ms.collect(light, chosen, exposure)
    found = ms.plan(chosen, exposure, photons, tolerance_dn=tolerance_dn)
    needs = render_requirements(light, chosen, exposure, gain_dn_per_e(chosen), tolerance_dn)
    whole_s, planned_s = found.seconds
    if as_json:
        seconds = {"whole_chain": whole_s, "plan": planned_s}
        show({**found.to_dict(), "render": [asdict(need) for need in needs], "seconds_per_frame": seconds}, True)
        return
    show(terminal.plan_sheet(found, needs, whole_s, planned_s), False)


@app.command(epilog="Example: mitsuba-sensor patterns -o chip7.npz --serial 7; then render … --fpn-maps chip7.npz")
def patterns(
    out_file: options.PatternsOut,
    camera: options.Camera = options.DEFAULT_CAMERA,
    serial: options.Serial = 1,
    rows: options.MapRows = None,
    columns: options.MapColumns = None,
    settings: options.Settings = None,
    as_json: options.Json = False,
) -> None:
    """Write the fixed patterns of one chip into a NumPy .npz, to look at, to change, or to replace by measured ones."""
    shot = chosen_shot(camera, settings, ms.Exposure(0.0), serial=serial)
    shape = rows or shot.camera.sensor.rows, columns or shot.camera.sensor.columns
    found = ms.fpn_maps(shot.camera, shape, serial=serial)
    files.write_fpn_maps(out_file, found)
    spread = {name: {"mean": float(x.mean()), "sigma": float(x.std()), "shape": x.shape} for name, x in found.items()}
    show(spread if as_json else terminal.pattern_list(spread, str(out_file)), as_json)


@app.command()
def doctor(as_json: options.Json = False) -> None:
    """Find out what works on this machine, and the command that mends what does not. Exit code 0 if a render works."""
    from ..render.doctor import examine

    with err.status("rendering a small scene with every variant"):
        findings = examine()
    show(findings if as_json else terminal.diagnosis(findings), as_json)
    if not findings["works"]:
        raise typer.Exit(1)
