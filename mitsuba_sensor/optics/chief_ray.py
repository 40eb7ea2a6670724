"""Chief rays on the sensor: their angle by image height, and what a pixel makes of light from there.

The chief ray of a thin lens comes from the middle of its exit pupil, at the distance f·(P + |m|) before the sensor, P
the pupil magnification and m the magnification; that of a prescription is traced from the middle of its stop. The
microlenses are made for the angle ``pixel.microlens_cra_deg`` at each image height; the response follows from the
difference of both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core import Float64Array, InputError
from .intrinsics import View, image_distance_m, magnification
from .paraxial import cardinal_points
from .traced_chief_ray import trace_chief_rays

if TYPE_CHECKING:
    from ..camera.camera import Camera

TRACED = 129  # chief rays from the axis to the corner


def chief_ray_deg(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Angle of the chief ray to the axis at image heights [°]; negative from an exit pupil behind the sensor."""
    if view.sequential:
        return _traced_deg(view, camera, heights_mm)
    m, pupils = magnification(view, camera), camera.lens.pupil_magnification
    exit_pupil_mm = image_distance_m(view, camera) * 1e3 * (pupils + m) / (1 + m)
    return np.degrees(np.arctan(heights_mm / exit_pupil_mm))


def _traced_deg(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """That of chief rays through the middle of the stop, linear between traced ones; where none gets through, that of
    the paraxial exit pupil."""
    table_mm = np.linspace(0.0, float(np.max(heights_mm, initial=0.0)), TRACED)
    start = trace_chief_rays(camera.lens, view.focus_m, table_mm).start
    points = cardinal_points(camera.lens)
    paraxial = table_mm / (points.image_distance(view.focus_m) - points.exit_pupil)
    with np.errstate(invalid="ignore"):
        slopes = np.where(np.isfinite(start.dx), -start.dx / start.dz, paraxial)
    return np.interp(heights_mm, table_mm, np.degrees(np.arctan(slopes)))


def microlens_deg(camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Angle that the microlenses are made for at image heights [°]. Raises InputError beyond the end of its table."""
    pixel = camera.pixel
    if pixel.microlens_cra_deg is None:
        return np.zeros_like(heights_mm)
    places_mm, name = pixel.microlens_cra_heights_mm, "microlens_cra_heights_mm"
    return _in_table(heights_mm, places_mm, pixel.microlens_cra_deg, f"{name} [mm]")


def slant_response(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Response of pixels at image heights to light along their chief ray, over that to light that their microlens is
    made for; 1 without a measured one. Raises InputError beyond the end of a table."""
    pixel = camera.pixel
    if pixel.angular_response is None:
        return np.ones_like(heights_mm)
    off_deg = np.abs(
        chief_ray_deg(view, camera, heights_mm) - microlens_deg(camera, heights_mm)
    )
    places_deg, name = pixel.angular_response_deg, "angular_response_deg"
    return _in_table(off_deg, places_deg, pixel.angular_response, f"{name} [°]")


def _in_table(
    asked: Float64Array,
    places: tuple[float, ...] | None,
    values: tuple[float, ...],
    name: str,
) -> Float64Array:
    """Values of a table of the pixel, linear between its places. Raises InputError beyond its end."""
    assert places is not None
    highest = float(np.max(asked, initial=0.0))
    if highest > places[-1]:
        raise InputError(
            f"pixel.{name} ends at {places[-1]:g}, and the picture reaches {highest:.4g}; extend the table to "
            f"{1.001 * highest:.4g} or more."
        )
    return np.interp(asked, places, values)
