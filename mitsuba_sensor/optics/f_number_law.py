"""The lens: from scene radiance to irradiance at the focal plane.

E = L · T · Ω with Ω = π/(4·N_w²)·cos⁴θ, N_w = N·(1 + |m|/P): an aplanatic lens of f-number N, transmission T(λ) and
pupil magnification P at magnification m (``convention = "working"``); or the planar Ω = π/(1 + 4N²(1 + |m|)²)·cos⁴θ of
EMVA 1288 and ISET (``"planar"``). They differ by 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8.

Where the lens distorts, Ω is also divided by the area that its picture of a small patch has over that of a lens without
distortion: the light that enters the pupil from the patch, L·A·cos θ dω = L·A·cos⁴θ dA/f², is spread over that area. It
is taken that the entrance pupil does not change over the field. A measured relative illumination has all of this in it
and replaces both factors.

The camera's lens decides the light; the scene's sensor decides the field of view, and with its aperture the blur. A
lens that is traced surface by surface (``lens.prescription``) decides all three, and its rays carry Ω.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .chief_ray import chief_heights
from .distortion import distortion_of
from .paraxial import cardinal

if TYPE_CHECKING:
    from ..sensor.camera import Camera

GAUSS_2 = (0.5 - 0.5 / math.sqrt(3), 0.5 + 0.5 / math.sqrt(3))  # nodes of the 2-point Gauss rule on a pixel
CONVENTION = "OpenCV: x right, y down, z forward; the middle of the upper left pixel is (0, 0)"
Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """What a scene's sensor sees.

    size : (columns, rows) of the full film; crop_size, crop_offset : the part that is rendered, (columns, rows).
    half_width : tan of half the horizontal field of view, 0 for an orthographic (telecentric) sensor.
    principal_point : offset of the optical axis as a fraction of the film (Mitsuba's convention).
    focus_m, aperture_radius_m : of a thin lens; infinity and 0 for a pinhole. The scene unit is the metre.
    traced : whether the sensor's rays carry E/L, as those through a prescription do.
    """

    size: tuple[int, int]
    crop_size: tuple[int, int]
    crop_offset: tuple[int, int] = (0, 0)
    half_width: float = 0.0
    principal_point: tuple[float, float] = (0.0, 0.0)
    focus_m: float = math.inf
    aperture_radius_m: float = 0.0
    traced: bool = False

    @property
    def axis(self) -> tuple[float, float]:
        """Where the optical axis meets the full film, (column, row) from its upper left corner [pixels]."""
        (width, height), (x, y) = self.size, self.principal_point
        return width / 2 - x * width, height / 2 - y * height

    @property
    def step(self) -> float:
        """Tangent of the field angle per pixel; pixels are square in Mitsuba."""
        return 2 * self.half_width / self.size[0]


def cos4(view: View) -> Array:
    """cos⁴ of the angle to the optical axis, averaged over each pixel of the crop, (rows, columns)."""
    return sum(0.25 / (1 + (view.step * x) ** 2 + (view.step * y) ** 2) ** 2 for x, y in _places(view))  # type: ignore


def solid_angle_sr(view: View, camera: Camera) -> Array:
    """Ω = E/(L·T) [sr], projected, for each pixel of the crop, (rows, columns); 1 where the rays carry it already.

    Raises InputError where a measured table does not reach the corner of the picture.
    """
    if view.traced:
        return np.ones(view.crop_size[::-1])
    lens, m = camera.lens, magnification(view, camera)
    if lens.convention == "planar":
        on_axis = math.pi / (1 + 4 * lens.f_number**2 * (1 + m) ** 2)
    else:
        working = lens.f_number * (1 + m / lens.pupil_magnification)
        on_axis = math.pi / (4 * working**2)
    return on_axis * _fall_off(view, camera)


def _fall_off(view: View, camera: Camera) -> Array:
    """Ω over its value on the axis, averaged over each pixel."""
    lens = camera.lens
    if lens.relative_illumination is not None:
        pitch_mm = camera.pixel.pitch_x_um * 1e-3
        return sum(0.25 * _measured(camera, pitch_mm * np.hypot(x, y)) for x, y in _places(view))  # type: ignore
    distortion = distortion_of(lens, image_distance_m(view, camera) * 1e3)
    if distortion is None:
        return cos4(view)
    mean = np.zeros(view.crop_size[::-1])
    for x, y in _places(view):
        u, v, area = distortion.ideal(*np.broadcast_arrays(view.step * x, view.step * y))
        mean += 0.25 / (1 + u**2 + v**2) ** 2 / area
    return mean


def _measured(camera: Camera, heights_mm: Array) -> Array:
    """Measured relative illumination at image heights, linear between the points of the table."""
    known = camera.lens.relative_illumination_heights_mm
    assert known is not None
    if (highest := float(heights_mm.max())) > known[-1]:
        raise InputError(
            f"lens.relative_illumination_heights_mm ends at {known[-1]:g} mm, and the sensor reaches {highest:.4g} mm "
            "from the axis; extend the table."
        )
    return np.interp(heights_mm, known, camera.lens.relative_illumination)


def _places(view: View) -> Iterator[tuple[Array, Array]]:
    """The four Gauss points of every pixel of the crop from the optical axis, (1, columns) and (rows, 1) [pixels]."""
    (columns, rows), (column, row), (axis_x, axis_y) = view.crop_size, view.crop_offset, view.axis
    for dx in GAUSS_2:
        for dy in GAUSS_2:
            x, y = np.arange(columns) + (column + dx - axis_x), np.arange(rows) + (row + dy - axis_y)
            yield x[None, :], y[:, None]


def transmittance(camera: Camera, wavelengths_nm: ArrayLike) -> Array:
    """T of the lens at each wavelength, (B,): the one number times the curve, linear between its points.

    Raises InputError outside the curve: what a lens does there is not known.
    """
    lens, at = camera.lens, np.asarray(wavelengths_nm, dtype=float)
    if lens.transmission_curve is None:
        return np.full(at.shape, lens.transmission)
    known = lens.transmission_wavelengths_nm
    assert known is not None
    if at.size and (at.min() < known[0] or at.max() > known[-1]):
        wrong = at.min() if at.min() < known[0] else at.max()
        raise InputError(
            f"lens.transmission_curve is given from {known[0]:g} to {known[-1]:g} nm and needed at {wrong:g} nm; "
            "extend it, with 0 where the lens is opaque."
        )
    return lens.transmission * np.interp(at, known, lens.transmission_curve)


def magnification(view: View, camera: Camera) -> float:
    """|m| = image distance / focus distance; 0 for a pinhole or telecentric sensor, which focus everywhere."""
    return 0.0 if math.isinf(view.focus_m) else image_distance_m(view, camera) / view.focus_m


def image_distance_m(view: View, camera: Camera) -> float:
    """Distance from lens to sensor that gives this field of view on this camera's pixels; infinite if telecentric."""
    half_sensor_m = 0.5 * view.size[0] * camera.pixel.pitch_x_um * 1e-6
    return half_sensor_m / view.half_width if view.half_width else math.inf


def aperture_f_number(view: View, camera: Camera) -> float | None:
    """The f-number that the scene's own thin-lens aperture means on this sensor, or None where it has none.

    A traced lens is closed to the camera's f-number.
    """
    if view.traced:
        return camera.lens.f_number
    if view.aperture_radius_m <= 0 or view.half_width == 0:
        return None
    return focal_length_m(view, camera) / (2 * view.aperture_radius_m)


def focal_length_m(view: View, camera: Camera) -> float:
    """Of the thin lens that has this field of view, focused at this distance, on this camera's pixels."""
    return 1 / (1 / image_distance_m(view, camera) + 1 / view.focus_m)


def intrinsics(view: View, camera: Camera) -> dict[str, Any]:
    """How the picture is a projection of the world, ready for JSON.

    matrix : K (3 × 3) for the part of the film that is rendered [pixels], in OpenCV's convention: x to the right, y
        down, z forward; the middle of the upper left pixel is (0, 0). None for an orthographic sensor.
    distortion : k1, k2, p1, p2, k3 of OpenCV; None where only heights are known.
    heights_mm : {"ideal", "real"} image heights where a table or a traced lens says how they differ, else None.
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
    fx = 1 / view.step
    fy = fx * pitch_mm[0] / pitch_mm[1] if view.traced else fx  # Mitsuba's own sensors have square pixels
    sides = ((x, view.crop_size[0], fx), (y, view.crop_size[1], fy))
    lens, heights = camera.lens, _heights_mm(view, camera)
    return {
        "model": "traced lens" if view.traced else "thin lens" if view.aperture_radius_m else "pinhole",
        "matrix": [[fx, 0.0, x - 0.5], [0.0, fy, y - 0.5], [0.0, 0.0, 1.0]],
        "distortion": None if heights else list(lens.distortion or (0.0,) * 5),
        "heights_mm": heights,
        "focal_length_mm": cardinal(lens).focal_length if view.traced else focal_length_m(view, camera) * 1e3,
        "field_of_view_deg": [math.degrees(math.atan(a / f) + math.atan((n - a) / f)) for a, n, f in sides],
        **shared,
    }


def _heights_mm(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Ideal and real image heights, where the lens has a table of them or is traced."""
    lens = camera.lens
    if view.traced:
        reach = [max(a, n - a) for a, n in zip(view.axis, view.size, strict=True)]
        corner_mm = math.hypot(reach[0] * camera.pixel.pitch_x_um, reach[1] * camera.pixel.pitch_y_um) * 1e-3
        ideal, real = chief_heights(lens, view.focus_m, corner_mm)
        return {"ideal": [0.0, *ideal.tolist()], "real": [0.0, *real.tolist()]}
    if lens.distortion_percent is None or lens.distortion_heights_mm is None:
        return None
    pairs = zip(lens.distortion_heights_mm, lens.distortion_percent, strict=True)
    return {"ideal": list(lens.distortion_heights_mm), "real": [h * (1 + p / 100) for h, p in pairs]}
