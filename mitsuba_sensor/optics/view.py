"""The view of a scene's sensor (film size, crop, field of view), and the thin lens that has it on a camera's pixels.

The scene's sensor determines the field of view, and with its aperture the blur; the camera's lens the irradiance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..sensor.camera import Camera


@dataclass(frozen=True)
class View:
    """What a scene's sensor images.

    size : (columns, rows) of the full film; crop_size, crop_offset : the part that is rendered, (columns, rows).
    half_width : tan of half the horizontal field of view, 0 for an orthographic (telecentric) sensor.
    principal_point : offset of the optical axis as a fraction of the film (Mitsuba's convention).
    focus_m, aperture_radius_m : of a thin lens [m]; infinity and 0 for a pinhole.
    sequential : whether rays are traced through a lens prescription; they then carry E/L.
    """

    size: tuple[int, int]
    crop_size: tuple[int, int]
    crop_offset: tuple[int, int] = (0, 0)
    half_width: float = 0.0
    principal_point: tuple[float, float] = (0.0, 0.0)
    focus_m: float = math.inf
    aperture_radius_m: float = 0.0
    sequential: bool = False

    @property
    def axis(self) -> tuple[float, float]:
        """Where the optical axis meets the full film, (column, row) from its upper left corner [pixels]."""
        (width, height), (x, y) = self.size, self.principal_point
        return width / 2 - x * width, height / 2 - y * height

    @property
    def tangent_per_pixel(self) -> float:
        """Tangent of the field angle per pixel; pixels are square in Mitsuba."""
        return 2 * self.half_width / self.size[0]


def magnification(view: View, camera: Camera) -> float:
    """|m| = image distance / focus distance; 0 for a pinhole or telecentric sensor, which focus everywhere."""
    return 0.0 if math.isinf(view.focus_m) else image_distance_m(view, camera) / view.focus_m


def image_distance_m(view: View, camera: Camera) -> float:
    """Distance from lens to sensor that gives this field of view on this camera's pixels [m]; inf if telecentric."""
    if view.half_width == 0:
        return math.inf
    return 0.5 * view.size[0] * camera.pixel.pitch_x_um * 1e-6 / view.half_width


def focal_length_m(view: View, camera: Camera) -> float:
    """Of the thin lens that has this field of view, at this focus distance, on this camera's pixels [m]."""
    return 1 / (1 / image_distance_m(view, camera) + 1 / view.focus_m)


def aperture_f_number(view: View, camera: Camera) -> float | None:
    """The f-number that the scene's own thin-lens aperture means on this sensor, or None where it has none.

    A sequential lens is stopped down to the camera's f-number.
    """
    if view.sequential:
        return camera.lens.f_number
    if view.aperture_radius_m <= 0 or view.half_width == 0:
        return None
    return focal_length_m(view, camera) / (2 * view.aperture_radius_m)
