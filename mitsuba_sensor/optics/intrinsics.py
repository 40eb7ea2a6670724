"""The camera's intrinsics: K matrix, distortion coefficients, focal length and field of view of a rendered image."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .chief_ray import chief_ray_heights
from .paraxial import cardinal_points
from .view import View, focal_length_m

if TYPE_CHECKING:
    from ..sensor.camera import Camera

CONVENTION = "OpenCV: x right, y down, z forward; the middle of the upper left pixel is (0, 0)"


def intrinsics(view: View, camera: Camera) -> dict[str, object]:
    """How the image is a projection of the world, ready for JSON.

    matrix : K (3 × 3) for the part of the film that is rendered [pixels], in OpenCV's convention: x to the right, y
        down, z forward; the middle of the upper left pixel is (0, 0). None for an orthographic sensor.
    distortion : k1, k2, p1, p2, k3 of OpenCV; None where only heights are known.
    heights_mm : {"ideal", "real"} image heights of a distortion table or a sequential lens, else None.
    focal_length_mm : of the lens; None for an orthographic sensor.  principal_point_mm : from the middle of the full
        film, to the right and down.  field_of_view_deg : across and down the part that is rendered, along the lines
        through the principal point, without distortion.
    """
    pitch_mm = (camera.pixel.pitch_x_um * 1e-3, camera.pixel.pitch_y_um * 1e-3)
    principal = [(a - n / 2) * p for a, n, p in zip(view.axis, view.size, pitch_mm, strict=True)]
    shared = {"image_size": list(view.crop_size), "principal_point_mm": principal, "convention": CONVENTION}
    if view.half_width == 0:
        nothing = dict.fromkeys(("matrix", "distortion", "heights_mm", "focal_length_mm", "field_of_view_deg"))
        return {"model": "orthographic", **nothing, **shared}
    x, y = (a - corner for a, corner in zip(view.axis, view.crop_offset, strict=True))
    fx = 1 / view.tangent_per_pixel
    fy = fx * pitch_mm[0] / pitch_mm[1] if view.sequential else fx  # Mitsuba's own sensors have square pixels
    sides = ((x, view.crop_size[0], fx), (y, view.crop_size[1], fy))
    lens, heights = camera.lens, _image_heights_mm(view, camera)
    focal_mm = cardinal_points(lens).focal_length if view.sequential else focal_length_m(view, camera) * 1e3
    return {
        "model": "sequential lens" if view.sequential else "thin lens" if view.aperture_radius_m else "pinhole",
        "matrix": [[fx, 0.0, x - 0.5], [0.0, fy, y - 0.5], [0.0, 0.0, 1.0]],
        "distortion": None if heights else list(lens.distortion or (0.0,) * 5),
        "heights_mm": heights,
        "focal_length_mm": focal_mm,
        "field_of_view_deg": [math.degrees(math.atan(a / f) + math.atan((n - a) / f)) for a, n, f in sides],
        **shared,
    }


def _image_heights_mm(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Ideal and real image heights of a distortion table or a sequential lens."""
    lens = camera.lens
    if view.sequential:
        reach = [max(a, n - a) for a, n in zip(view.axis, view.size, strict=True)]
        corner_mm = math.hypot(reach[0] * camera.pixel.pitch_x_um, reach[1] * camera.pixel.pitch_y_um) * 1e-3
        ideal, real = chief_ray_heights(lens, view.focus_m, corner_mm)
        return {"ideal": [0.0, *ideal.tolist()], "real": [0.0, *real.tolist()]}
    if lens.distortion_percent is None or lens.distortion_heights_mm is None:
        return None
    pairs = zip(lens.distortion_heights_mm, lens.distortion_percent, strict=True)
    return {"ideal": list(lens.distortion_heights_mm), "real": [h * (1 + p / 100) for h, p in pairs]}
