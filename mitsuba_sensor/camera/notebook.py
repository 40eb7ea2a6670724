"""What a camera shows in a notebook: the numbers by which it is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.html import facts, fragment
from ..stages.stage import converter_of
from .figures import figures_if_any

if TYPE_CHECKING:
    from .camera import Camera


def camera_html(camera: Camera) -> str:
    """The numbers by which a camera is known."""
    sensor, pixel, converter = camera.sensor, camera.pixel, converter_of(camera.stages)
    low, high = camera.band_nm
    efficiency = max(max(curve) for curve in camera.quantum_efficiency.curves.values())
    found = {
        "sensor": f"{sensor.columns} × {sensor.rows} pixels of {pixel.pitch_x_um:g} × {pixel.pitch_y_um:g} µm",
        "colour filters": ", ".join(camera.filter_names)
        if len(camera.filter_names) > 1
        else "none",
        "quantum efficiency": f"at most {efficiency:.3g}, {low:g} to {high:g} nm",
        "full well": f"{pixel.full_well_e:g} e-",
        "converter": f"{camera.code_bits} bits, black level {converter.black_level_dn:g} DN",
        "lens": f"f/{camera.lens.f_number:g}",
        "stages": ", ".join(stage.label for stage in camera.stages),
    }
    if camera.gain is not None:
        found["gain setting"] = camera.gain
    if camera.notes:
        found["notes"] = " ".join(camera.notes)
    figures = figures_if_any(camera)
    found |= (
        {f"{one.name} {one.symbol}": f"{one.value:.4g} {one.unit}" for one in figures.table()}
        if figures
        else {}
    )
    if camera.description:
        about = f"{camera.name}: {camera.description}"
    else:
        about = camera.name
    return fragment(about, facts(found))
