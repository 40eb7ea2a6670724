"""HTML of a camera for notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.html import facts, fragment
from .figures import figures_if_any

if TYPE_CHECKING:
    from .camera import Camera


def camera_html(camera: Camera) -> str:
    """Return the main parameters of a camera as HTML."""
    sensor, pixel, figures = camera.sensor, camera.pixel, figures_if_any(camera)
    low, high = camera.band_nm
    efficiency = max(max(curve) for curve in camera.quantum_efficiency.curves.values())
    filters = ", ".join(camera.filter_names) if len(camera.filter_names) > 1 else "none"
    rows = {
        "sensor": f"{sensor.columns} × {sensor.rows} pixels of {pixel.pitch_x_um:g} × {pixel.pitch_y_um:g} µm",
        "colour filters": filters,
        "quantum efficiency": f"at most {efficiency:.3g}, {low:g} to {high:g} nm",
        "full well": f"{pixel.full_well_e:g} e-",
        "ADC": f"{camera.code_bits} bits, black level {camera.black_level_dn:g} DN",
        "lens": f"f/{camera.lens.f_number:g}",
        "stages": ", ".join(stage.label for stage in camera.stages),
    }
    if camera.gain is not None:
        rows["gain setting"] = camera.gain
    if camera.notes:
        rows["notes"] = " ".join(camera.notes)
    if figures:
        rows |= {f"{x.name} {x.symbol}": f"{x.value:.4g} {x.unit}" for x in figures.table()}
    title = f"{camera.name}: {camera.description}" if camera.description else camera.name
    return fragment(title, facts(rows))
