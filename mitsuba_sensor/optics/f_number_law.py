"""The f-number law: irradiance at the focal plane from scene radiance, E = L · T · Ω.

``convention = "working"``: Ω = π/(4·N_w²)·cos⁴θ with the working f-number N_w = N·(1 + |m|/P), for an aplanatic lens
of f-number N, transmission T(λ) and pupil magnification P at magnification m. ``"planar"``: Ω = π/(1 + 4N²(1 +
|m|)²)·cos⁴θ of EMVA 1288 and ISET. They differ by 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8.

With distortion, Ω is also divided by the real over the ideal image area of a small patch: the flux from the patch
through the pupil, L·A·cos θ dω = L·A·cos⁴θ dA/f², spreads over the real area. The entrance pupil is assumed constant
over the field. A measured relative illumination replaces cos⁴θ and this factor. The rays of a sequential lens
(``lens.prescription``) carry Ω themselves.

The chief ray of a thin lens comes from the centre of its exit pupil, f·(P + |m|) before the sensor. The chief ray of a
prescription is traced from the centre of its stop. The response of a pixel follows from the difference between the
chief-ray angle and the design angle of its microlens, ``pixel.microlens_cra_deg``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import Float64Array, InputError
from .distortion import distortion_of
from .intrinsics import View, image_distance_m, magnification
from .traced_lens import cardinal_points, trace_chief_rays

if TYPE_CHECKING:
    from ..camera.camera import Camera

SHADING_POINTS = 33  # of the table of relative illumination
TRACED_RAYS = 129  # chief rays from the axis to the corner
GAUSS_2 = 0.5 - 0.5 / math.sqrt(3), 0.5 + 0.5 / math.sqrt(3)
"""Nodes of the 2-point Gauss rule on a pixel."""
Illumination: TypeAlias = Callable[[Float64Array, Float64Array], Float64Array]
"""Ω over its on-axis value at x and y from the optical axis [pixels]."""


def solid_angle_sr(view: View, camera: Camera) -> Float64Array:
    """Return Ω = E/(L·T) [sr] times the response to slanted light for each pixel of the crop, shape (rows, columns).

    Ω is 1 for a sequential lens, whose rays carry it. Raises InputError if a measured table is too short.
    """
    pixels = pixel_response(view, camera)
    if view.sequential:
        return pixels * np.ones(view.crop_size[::-1])
    on_axis = math.pi * numerical_aperture(view, camera) ** 2
    return pixels * on_axis * _pixel_means(view, _illumination(view, camera))


def pixel_response(view: View, camera: Camera) -> Float64Array | float:
    """Return the response of each pixel of the crop to light along its chief ray, shape (rows, columns).

    It is 1 without a measured angular response. Raises InputError if its table is too short.
    """
    if camera.pixel.angular_response is None:
        return 1.0
    pitch_mm = camera.pixel.pitch_x_um * 1e-3
    return _pixel_means(
        view, lambda x, y: slant_response(view, camera, pitch_mm * np.hypot(x, y))
    )


def numerical_aperture(view: View, camera: Camera) -> float:
    """Return the sine of half the on-axis light cone at the sensor: 1/(2·N_w), or by the planar law."""
    lens = camera.lens
    if view.sequential:
        principal_mm = cardinal_points(lens).principal_distance(view.focus_m)
        return cardinal_points(lens).entrance_radius / principal_mm
    m = magnification(view, camera)
    if lens.convention == "planar":
        return 1 / math.sqrt(1 + 4 * lens.f_number**2 * (1 + m) ** 2)
    return 1 / (2 * lens.f_number * (1 + m / lens.pupil_magnification))


def shading(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Return the relative illumination along a radius of the rendered crop, for correcting raw frames.

    ``radius_px`` holds distances from the optical axis up to the farthest corner, ``relative_illumination`` the values.
    Tangential distortion is evaluated to the right. None for prescriptions and telecentric sensors.
    """
    if view.sequential or not view.half_width:
        return None
    sides = zip(view.axis, view.crop_offset, view.crop_size, strict=True)
    reach = [max(axis - first, first + count - axis) for axis, first, count in sides]
    radius = np.linspace(0.0, math.hypot(*reach), SHADING_POINTS)
    values = _illumination(view, camera)(radius[None], np.zeros((1, 1)))[0]
    values = values * slant_response(view, camera, camera.pixel.pitch_x_um * 1e-3 * radius)
    return {"radius_px": radius.tolist(), "relative_illumination": values.tolist()}


def _illumination(view: View, camera: Camera) -> Illumination:
    """Return the relative illumination of a camera's lens as a function of the image position."""
    lens, scale, pitch_mm = camera.lens, view.tangent_per_pixel, camera.pixel.pitch_x_um * 1e-3
    if lens.relative_illumination is not None:
        places_mm, values = lens.relative_illumination_heights_mm, lens.relative_illumination
        name = "lens.relative_illumination_heights_mm [mm]"
        return lambda x, y: _in_table(pitch_mm * np.hypot(x, y), places_mm, values, name)
    distortion = distortion_of(lens, image_distance_m(view, camera) * 1e3)
    if distortion is None:
        return lambda x, y: np.asarray(1 / (1 + (scale * x) ** 2 + (scale * y) ** 2) ** 2)

    def distorted(x: Float64Array, y: Float64Array) -> Float64Array:
        u, v, area = distortion.ideal(*np.broadcast_arrays(scale * x, scale * y))
        return np.asarray(1 / (1 + u**2 + v**2) ** 2 / area)

    return distorted


def chief_ray_deg(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Return the chief-ray angle to the axis at image heights [°]; negative if the exit pupil is behind the sensor.

    Angles of a traced lens are interpolated between traced rays; if no ray passes, they follow from the paraxial exit
    pupil.
    """
    if not view.sequential:
        m, pupils = magnification(view, camera), camera.lens.pupil_magnification
        exit_pupil_mm = image_distance_m(view, camera) * 1e3 * (pupils + m) / (1 + m)
        return np.degrees(np.arctan(heights_mm / exit_pupil_mm))
    table_mm = np.linspace(0.0, float(np.max(heights_mm, initial=0.0)), TRACED_RAYS)
    start = trace_chief_rays(camera.lens, view.focus_m, table_mm).start
    points = cardinal_points(camera.lens)
    paraxial = table_mm / (points.image_distance(view.focus_m) - points.exit_pupil)
    with np.errstate(invalid="ignore"):
        slopes = np.where(np.isfinite(start.dx), -start.dx / start.dz, paraxial)
    return np.interp(heights_mm, table_mm, np.degrees(np.arctan(slopes)))


def microlens_deg(camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Return the design angle of the microlenses at image heights [°]. Raises InputError if its table is too short."""
    pixel = camera.pixel
    if pixel.microlens_cra_deg is None:
        return np.zeros_like(heights_mm)
    places_mm, name = pixel.microlens_cra_heights_mm, "pixel.microlens_cra_heights_mm [mm]"
    return _in_table(heights_mm, places_mm, pixel.microlens_cra_deg, name)


def slant_response(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Return the response of pixels at image heights to light along their chief ray, relative to the design angle.

    It is 1 without a measured angular response. Raises InputError if a table is too short.
    """
    pixel = camera.pixel
    if pixel.angular_response is None:
        return np.ones_like(heights_mm)
    chief_deg, design_deg = (
        chief_ray_deg(view, camera, heights_mm),
        microlens_deg(camera, heights_mm),
    )
    off_deg = np.abs(chief_deg - design_deg)
    places_deg, name = pixel.angular_response_deg, "pixel.angular_response_deg [°]"
    return _in_table(off_deg, places_deg, pixel.angular_response, name)


def _in_table(
    asked: Float64Array,
    places: tuple[float, ...] | None,
    values: tuple[float, ...],
    name: str,
) -> Float64Array:
    """Return interpolated values of a measured table. Raises InputError if it is too short."""
    assert places is not None
    highest = float(np.max(asked, initial=0.0))
    if highest > places[-1]:
        raise InputError(
            f"{name} ends at {places[-1]:g}, but the image needs {highest:.4g}; extend the table to at least "
            f"{1.001 * highest:.4g}."
        )
    return np.interp(asked, places, values)


def _pixel_means(view: View, function: Illumination) -> Float64Array:
    """Return Gauss means over each pixel of a function of x (1, columns) and y (rows, 1) from the axis [pixels]."""
    columns, rows = view.crop_size
    x = np.arange(columns, dtype=float)[None, :]
    y = np.arange(rows, dtype=float)[:, None]
    (column, row), (axis_x, axis_y) = view.crop_offset, view.axis
    total = np.zeros((rows, columns))
    for node_x, node_y in product(GAUSS_2, GAUSS_2):
        value = function(x + (column + node_x - axis_x), y + (row + node_y - axis_y))
        total = total + 0.25 * value
    return total


def transmittance(camera: Camera, wavelengths_nm: ArrayLike) -> Float64Array:
    """Return T of the lens at each wavelength, shape (B,): ``transmission`` times the interpolated curve.

    Raises InputError outside the range of the curve.
    """
    lens, asked_nm = camera.lens, np.asarray(wavelengths_nm, dtype=float)
    table_nm = lens.transmission_wavelengths_nm
    if lens.transmission_curve is None or table_nm is None:
        return np.full(asked_nm.shape, lens.transmission)
    outside = asked_nm[(asked_nm < table_nm[0]) | (asked_nm > table_nm[-1])]
    if outside.size:
        nm = outside.min() if outside.min() < table_nm[0] else outside.max()
        raise InputError(
            f"lens.transmission_curve spans {table_nm[0]:g} to {table_nm[-1]:g} nm but is needed at {nm:g} nm; extend "
            "it, with 0 where the lens is opaque."
        )
    return lens.transmission * np.asarray(
        np.interp(asked_nm, table_nm, lens.transmission_curve)
    )
