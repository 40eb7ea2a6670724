"""The lens: from scene radiance to irradiance at the focal plane.

E = L · T · Ω with Ω = π/(4·N_w²)·cos⁴θ, N_w = N·(1 + |m|/P): an aplanatic lens of f-number N, transmission T(λ) and
pupil magnification P at magnification m (``convention = "working"``); or the planar Ω = π/(1 + 4N²(1 + |m|)²)·cos⁴θ of
EMVA 1288 and ISET (``"planar"``). They differ by 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8.

The camera's lens decides the light; the scene's sensor decides the field of view, and with its aperture the blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from ..sensor.camera import Camera

GAUSS_2 = (0.5 - 0.5 / math.sqrt(3), 0.5 + 0.5 / math.sqrt(3))  # nodes of the 2-point Gauss rule on a pixel


@dataclass(frozen=True)
class View:
    """What a scene's sensor sees.

    size : (columns, rows) of the full film; crop_size, crop_offset : the part that is rendered, (columns, rows).
    half_width : tan of half the horizontal field of view, 0 for an orthographic (telecentric) sensor.
    principal_point : offset of the optical axis as a fraction of the film (Mitsuba's convention).
    focus_m, aperture_radius_m : of a thin lens; infinity and 0 for a pinhole. The scene unit is the metre.
    """

    size: tuple[int, int]
    crop_size: tuple[int, int]
    crop_offset: tuple[int, int] = (0, 0)
    half_width: float = 0.0
    principal_point: tuple[float, float] = (0.0, 0.0)
    focus_m: float = math.inf
    aperture_radius_m: float = 0.0


def cos4(view: View) -> NDArray[np.float64]:
    """cos⁴ of the angle to the optical axis, averaged over each pixel of the crop, (rows, columns)."""
    (width, height), (columns, rows) = view.size, view.crop_size
    if view.half_width == 0:
        return np.ones((rows, columns))
    step = 2 * view.half_width / width  # of the tangent, per pixel; pixels are square in Mitsuba
    shift_x, shift_y = (p * n for p, n in zip(view.principal_point, view.size, strict=True))
    mean = np.zeros((rows, columns))
    for dx in GAUSS_2:
        for dy in GAUSS_2:
            x = step * (np.arange(columns) + view.crop_offset[0] + dx + shift_x - width / 2)
            y = step * (np.arange(rows) + view.crop_offset[1] + dy + shift_y - height / 2)
            mean += 0.25 / (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 2
    return mean


def solid_angle_sr(view: View, camera: Camera) -> NDArray[np.float64]:
    """Ω = E/(L·T) [sr], projected, for each pixel of the crop, (rows, columns)."""
    lens, m = camera.lens, magnification(view, camera)
    if lens.convention == "planar":
        on_axis = math.pi / (1 + 4 * lens.f_number**2 * (1 + m) ** 2)
    else:
        working = lens.f_number * (1 + m / lens.pupil_magnification)
        on_axis = math.pi / (4 * working**2)
    return on_axis * cos4(view)


def transmittance(camera: Camera, wavelengths_nm: ArrayLike) -> NDArray[np.float64]:
    """T of the lens at each wavelength, (B,)."""
    return np.full(np.shape(wavelengths_nm), camera.lens.transmission)


def magnification(view: View, camera: Camera) -> float:
    """|m| = image distance / focus distance; 0 for a pinhole or telecentric sensor, which focus everywhere."""
    return 0.0 if math.isinf(view.focus_m) else image_distance_m(view, camera) / view.focus_m


def image_distance_m(view: View, camera: Camera) -> float:
    """Distance from lens to sensor that gives this field of view on this camera's pixels; infinite if telecentric."""
    half_sensor_m = 0.5 * view.size[0] * camera.pixel.pitch_x_um * 1e-6
    return half_sensor_m / view.half_width if view.half_width else math.inf


def aperture_f_number(view: View, camera: Camera) -> float | None:
    """The f-number that the scene's own thin-lens aperture means on this sensor, or None where it has none."""
    if view.aperture_radius_m <= 0 or view.half_width == 0:
        return None
    image = image_distance_m(view, camera)
    focal_length_m = 1 / (1 / image + 1 / view.focus_m)
    return focal_length_m / (2 * view.aperture_radius_m)
