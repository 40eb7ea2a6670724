"""What camera, plan and noise budget show in a notebook: one table each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.html import Bar, bar, facts, fragment, table
from ..stages.stage import converter_of
from .figures import figures_if_any

if TYPE_CHECKING:
    from ..theory.noise_budget import NoiseBudget
    from ..theory.plan import Plan
    from .camera import Camera


def camera_html(camera: Camera) -> str:
    """The numbers by which a camera is known."""
    sensor, pixel, converter = camera.sensor, camera.pixel, converter_of(camera.stages)
    low, high = camera.band_nm
    efficiency = max(max(curve) for curve in camera.quantum_efficiency.curves.values())
    found = {
        "sensor": f"{sensor.columns} × {sensor.rows} pixels of {pixel.pitch_x_um:g} × {pixel.pitch_y_um:g} µm",
        "colour filters": ", ".join(camera.filter_names) if len(camera.filter_names) > 1 else "none",
        "quantum efficiency": f"at most {efficiency:.3g}, {low:g} to {high:g} nm",
        "full well": f"{pixel.full_well_e:g} e-",
        "converter": f"{camera.adc.bits} bits, black level {converter.black_level_dn:g} DN",
        "lens": f"f/{camera.lens.f_number:g}",
        "stages": ", ".join(stage.label for stage in camera.stages),
    }
    if camera.gain is not None:
        found["gain setting"] = camera.gain
    if camera.notes:
        found["notes"] = " ".join(camera.notes)
    figures = figures_if_any(camera)
    found |= {f"{one.name} {one.symbol}": f"{one.value:.4g} {one.unit}" for one in figures.table()} if figures else {}
    about = f"{camera.name}: {camera.description}" if camera.description else camera.name
    return fragment(about, facts(found))


def plan_html(plan: Plan) -> str:
    """The stages of a plan, what each moves, and why it is kept or left out."""
    held = plan.range
    head = {
        "camera": plan.camera,
        "tolerance": f"{plan.tolerance_dn:g} DN for all that is left out",
        "light": f"{held.darkest_e:.4g} … {held.brightest_e:.4g} mean photoelectrons per pixel",
        "exposure": f"{held.exposure.time_s:g} s at {held.exposure.temperature_k:g} K",
        "precision": plan.float32.explain(),
    }
    names = "stage", "", "mean [DN]", "temporal [DN]", "spatial [DN]", "lines [DN]", "pixels", "why"
    rows = [
        (
            one.stage,
            "kept" if one.kept else "left out",
            *(f"{x:.3g}" for x in (one.mean_dn, one.temporal_dn, one.spatial_dn, one.structure_dn, one.pixels_beyond)),
            one.reason,
        )
        for one in plan.effects
    ]
    return fragment("Plan of an exposure", facts(head), table(names, rows))


def budget_html(budget: NoiseBudget) -> str:
    """The contributions of all sources; bars show how much each adds to the two variances."""
    entries = budget.entries
    most = max((max(abs(one.temporal_dn2), abs(one.spatial_dn2)) for one in entries), default=0.0) or 1.0

    def variance(value: float) -> Bar:
        return bar(abs(value) / most, f"{value:.3g}")

    names = "source", "mean [DN]", "rms [DN]", "temporal [DN²]", "spatial [DN²]"
    rows = [
        (one.source, f"{one.mean_dn:.5g}", f"{one.rms_dn:.4g}", variance(one.temporal_dn2), variance(one.spatial_dn2))
        for one in entries
    ]
    return fragment("Noise budget of one frame", table(names, rows))
