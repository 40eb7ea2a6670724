"""View of a scene's sensor, the equivalent thin lens on a camera's pixels, and the intrinsics of the image.

The scene's sensor sets the field of view and, by its aperture, the blur; the camera's lens sets the irradiance.
Intrinsics: K matrix, distortion coefficients or image heights, focal length and field of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .traced_lens import cardinal_points, chief_ray_heights

if TYPE_CHECKING:
    from ..camera.camera import Camera

CONVENTION = "OpenCV: x right, y down, z forward; the middle of the upper left pixel is (0, 0)"


@dataclass(frozen=True)
class View:
    """View of a scene's sensor; pairs are (columns, rows).

    size, crop_size, crop_offset : of the full film and of the rendered crop [pixels].
    half_width : tangent of half the horizontal field of view; 0 for an orthographic (telecentric) sensor.
    principal_point : offset of the optical axis in film sizes (Mitsuba's convention).
    focus_m, aperture_radius_m : of a thin lens; a radius of 0 is a pinhole.
    sequential : rays are traced through a lens prescription and carry E/L.
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
        """Position of the optical axis on the full film, (column, row) from its upper left corner [pixels]."""
        (width, height), (x, y) = self.size, self.principal_point
        return width / 2 - x * width, height / 2 - y * height

    @property
    def tangent_per_pixel(self) -> float:
        """Tangent of the field angle per pixel; pixels are square in Mitsuba."""
        return 2 * self.half_width / self.size[0]


def magnification(view: View, camera: Camera) -> float:
    """Return |m| = image distance / focus distance; 0 for a pinhole or telecentric sensor."""
    if math.isinf(view.focus_m):
        return 0.0
    return image_distance_m(view, camera) / view.focus_m


def image_distance_m(view: View, camera: Camera) -> float:
    """Return the lens-to-sensor distance for this field of view on this camera's pixels [m]; inf if telecentric."""
    half_m = 0.5 * view.size[0] * camera.pixel.pitch_x_um * 1e-6
    return half_m / view.half_width if view.half_width else math.inf


def focal_length_m(view: View, camera: Camera) -> float:
    """Return the focal length of the thin lens with this field of view and focus distance [m]."""
    return 1 / (1 / image_distance_m(view, camera) + 1 / view.focus_m)


def aperture_f_number(view: View, camera: Camera) -> float | None:
    """Return the f-number of the scene's aperture, or of the camera for a prescription; None for a pinhole."""
    if view.sequential:
        return camera.lens.f_number
    if view.aperture_radius_m <= 0 or view.half_width == 0:
        return None
    return focal_length_m(view, camera) / (2 * view.aperture_radius_m)


def intrinsics(view: View, camera: Camera) -> dict[str, object]:
    """Return the projection of the world onto the image, for JSON; an orthographic sensor has several None.

    matrix : K, shape (3, 3), of the rendered crop [pixels], in OpenCV's convention (``CONVENTION``).
    distortion : OpenCV's k1, k2, p1, p2, k3; None if only heights are known.
    heights_mm : {"ideal", "real"} image heights of a distortion table or a sequential lens, else None.
    focal_length_mm : of the lens.  principal_point_mm : from the centre of the full film, right and down.
    field_of_view_deg : horizontal and vertical, of the crop through the principal point, without distortion.
    """
    lens, pixel = camera.lens, camera.pixel
    pitch_mm = (pixel.pitch_x_um * 1e-3, pixel.pitch_y_um * 1e-3)
    principal = zip(view.axis, view.size, pitch_mm, strict=True)
    shared = {
        "image_size": list(view.crop_size),
        "principal_point_mm": [(axis - n / 2) * pitch for axis, n, pitch in principal],
        "convention": CONVENTION,
    }
    if view.half_width == 0:
        names = "matrix", "distortion", "heights_mm", "focal_length_mm", "field_of_view_deg"
        return {"model": "orthographic", **dict.fromkeys(names), **shared}
    x, y = view.axis[0] - view.crop_offset[0], view.axis[1] - view.crop_offset[1]
    fx = fy = 1 / view.tangent_per_pixel  # Mitsuba's own sensors have square pixels
    if view.sequential:
        focal_mm, prescription = cardinal_points(lens).focal_length, lens.prescription
        is_transfer = prescription is not None and prescription.ray_transfer is not None
        model = "ray transfer" if is_transfer else "sequential lens"
        fy = fx * pitch_mm[0] / pitch_mm[1]
    else:
        model = "thin lens" if view.aperture_radius_m else "pinhole"
        focal_mm = focal_length_m(view, camera) * 1e3
    heights = _image_heights_mm(view, camera)
    distortion = list(lens.distortion or (0.0,) * 5) if heights is None else None
    columns, rows = view.crop_size
    return {
        "model": model,
        "matrix": [[fx, 0.0, x - 0.5], [0.0, fy, y - 0.5], [0.0, 0.0, 1.0]],
        "distortion": distortion,
        "heights_mm": heights,
        "focal_length_mm": focal_mm,
        "field_of_view_deg": [_angle_deg(x, columns, fx), _angle_deg(y, rows, fy)],
        **shared,
    }


def _angle_deg(axis: float, length: int, focal: float) -> float:
    """Return the angle of an image side with the optical axis at this position on it [pixels]."""
    return math.degrees(math.atan(axis / focal) + math.atan((length - axis) / focal))


def _image_heights_mm(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Return the ideal and real image heights of a distortion table or a sequential lens."""
    lens, pixel = camera.lens, camera.pixel
    if view.sequential:
        (axis_x, axis_y), (columns, rows) = view.axis, view.size
        reach_x, reach_y = max(axis_x, columns - axis_x), max(axis_y, rows - axis_y)
        corner_um = math.hypot(reach_x * pixel.pitch_x_um, reach_y * pixel.pitch_y_um)
        ideal, real = chief_ray_heights(lens, view.focus_m, corner_um * 1e-3)
        return {"ideal": [0.0, *ideal.tolist()], "real": [0.0, *real.tolist()]}
    if lens.distortion_percent is None or lens.distortion_heights_mm is None:
        return None
    pairs = zip(lens.distortion_heights_mm, lens.distortion_percent, strict=True)
    return {
        "ideal": list(lens.distortion_heights_mm),
        "real": [height * (1 + percent / 100) for height, percent in pairs],
    }
