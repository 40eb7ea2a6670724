"""The f-number law: irradiance at the focal plane from scene radiance, E = L · T · Ω.

Ω = π/(4·N_w²)·cos⁴θ with the working f-number N_w = N·(1 + |m|/P): an aplanatic lens of f-number N, transmission T(λ)
and pupil magnification P at magnification m (``convention = "working"``); or the planar Ω = π/(1 + 4N²(1 + |m|)²)·cos⁴θ
of EMVA 1288 and ISET (``"planar"``). They differ by 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8.

Where the lens distorts, Ω is also divided by the area of the image of a small patch over its area without distortion:
the flux that enters the pupil from the patch, L·A·cos θ dω = L·A·cos⁴θ dA/f², is spread over that area. The entrance
pupil is assumed to be the same over the whole field. A measured relative illumination contains all of this and replaces
both factors. The rays of a sequential lens (``lens.prescription``) carry Ω themselves.

The chief ray of a thin lens comes from the middle of its exit pupil, at the distance f·(P + |m|) before the sensor. The
chief ray of a prescription is traced from the middle of its stop. The microlenses are made for the angle
``pixel.microlens_cra_deg`` at each image height; the response of a pixel follows from the difference of both angles.
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

RADII = 33  # points of the table of relative illumination
TRACED = 129  # chief rays from the axis to the corner
GAUSS_2 = 0.5 - 0.5 / math.sqrt(3), 0.5 + 0.5 / math.sqrt(3)
"""Nodes of the 2-point Gauss rule on a pixel."""
Illumination: TypeAlias = Callable[[Float64Array, Float64Array], Float64Array]
"""Ω over its value on the axis, at x and y from the optical axis [pixels]."""


def solid_angle_sr(view: View, camera: Camera) -> Float64Array:
    """Ω = E/(L·T) [sr], projected, for each pixel of the crop, (rows, columns); 1 where the rays carry it already; all
    times the response of the pixels to slanted light.

    Raises InputError where a measured table does not reach the corner of the image.
    """
    pixels = pixel_response(view, camera)
    if view.sequential:
        return pixels * np.ones(view.crop_size[::-1])
    on_axis = math.pi * numerical_aperture(view, camera) ** 2
    return pixels * on_axis * _pixel_means(view, _illumination(view, camera))


def pixel_response(view: View, camera: Camera) -> Float64Array | float:
    """Response of each pixel of the crop to light from the direction of its chief ray, (rows, columns); 1 without a
    measured angular response. Raises InputError where its table ends."""
    if camera.pixel.angular_response is None:
        return 1.0
    pitch_mm = camera.pixel.pitch_x_um * 1e-3
    return _pixel_means(
        view, lambda x, y: slant_response(view, camera, pitch_mm * np.hypot(x, y))
    )


def numerical_aperture(view: View, camera: Camera) -> float:
    """Sine of half the cone of light on the axis behind the lens: 1/(2·N_w), or of the planar law."""
    lens = camera.lens
    if view.sequential:
        principal_mm = cardinal_points(lens).principal_distance(view.focus_m)
        return cardinal_points(lens).entrance_radius / principal_mm
    m = magnification(view, camera)
    if lens.convention == "planar":
        return 1 / math.sqrt(1 + 4 * lens.f_number**2 * (1 + m) ** 2)
    return 1 / (2 * lens.f_number * (1 + m / lens.pupil_magnification))


def shading(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Relative illumination along a radius of the part that is rendered, for the correction of raw frames: distances
    ``radius_px`` from the optical axis to the farthest corner, and ``relative_illumination`` there.

    None where it is not known: the rays of a prescription carry it, a telecentric sensor has none. Of a lens with
    tangential distortion it is that to the right.
    """
    if view.sequential or not view.half_width:
        return None
    sides = zip(view.axis, view.crop_offset, view.crop_size, strict=True)
    reach = [max(axis - first, first + count - axis) for axis, first, count in sides]
    radius = np.linspace(0.0, math.hypot(*reach), RADII)
    values = _illumination(view, camera)(radius[None], np.zeros((1, 1)))[0]
    values = values * slant_response(view, camera, camera.pixel.pitch_x_um * 1e-3 * radius)
    return {"radius_px": radius.tolist(), "relative_illumination": values.tolist()}


def _illumination(view: View, camera: Camera) -> Illumination:
    """Return the relative illumination of a camera's lens behind this view as a function of the place."""
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
    """Return the angle of the chief ray to the axis at image heights [°]; negative for an exit pupil behind it.

    Angles of a traced lens are linear between traced rays; where no ray gets through, the paraxial exit pupil gives
    them.
    """
    if not view.sequential:
        m, pupils = magnification(view, camera), camera.lens.pupil_magnification
        exit_pupil_mm = image_distance_m(view, camera) * 1e3 * (pupils + m) / (1 + m)
        return np.degrees(np.arctan(heights_mm / exit_pupil_mm))
    table_mm = np.linspace(0.0, float(np.max(heights_mm, initial=0.0)), TRACED)
    start = trace_chief_rays(camera.lens, view.focus_m, table_mm).start
    points = cardinal_points(camera.lens)
    paraxial = table_mm / (points.image_distance(view.focus_m) - points.exit_pupil)
    with np.errstate(invalid="ignore"):
        slopes = np.where(np.isfinite(start.dx), -start.dx / start.dz, paraxial)
    return np.interp(heights_mm, table_mm, np.degrees(np.arctan(slopes)))


def microlens_deg(camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Return the angle that the microlenses are made for at image heights [°]. Raises InputError beyond its table."""
    pixel = camera.pixel
    if pixel.microlens_cra_deg is None:
        return np.zeros_like(heights_mm)
    places_mm, name = pixel.microlens_cra_heights_mm, "pixel.microlens_cra_heights_mm [mm]"
    return _in_table(heights_mm, places_mm, pixel.microlens_cra_deg, name)


def slant_response(view: View, camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Return the response of pixels at image heights to light along their chief ray, over that to light that their
    microlens is made for; 1 without a measured one. Raises InputError where a table ends."""
    pixel = camera.pixel
    if pixel.angular_response is None:
        return np.ones_like(heights_mm)
    off_deg = np.abs(
        chief_ray_deg(view, camera, heights_mm) - microlens_deg(camera, heights_mm)
    )
    places_deg, name = pixel.angular_response_deg, "pixel.angular_response_deg [°]"
    return _in_table(off_deg, places_deg, pixel.angular_response, name)


def _in_table(
    asked: Float64Array,
    places: tuple[float, ...] | None,
    values: tuple[float, ...],
    name: str,
) -> Float64Array:
    """Return values of a measured table, linear between its places. Raises InputError where it ends."""
    assert places is not None
    highest = float(np.max(asked, initial=0.0))
    if highest > places[-1]:
        raise InputError(
            f"{name} ends at {places[-1]:g}, and the picture reaches {highest:.4g}; extend the table to "
            f"{1.001 * highest:.4g} or more."
        )
    return np.interp(asked, places, values)


def _pixel_means(view: View, function: Illumination) -> Float64Array:
    """Gauss's means over each pixel of a function of x (1, columns) and y (rows, 1) from the optical axis [pixels]."""
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
    """T of the lens at each wavelength, (B,): ``transmission`` times the curve, linear between its points.

    Raises InputError outside the range of the curve, where T is not known.
    """
    lens, asked_nm = camera.lens, np.asarray(wavelengths_nm, dtype=float)
    table_nm = lens.transmission_wavelengths_nm
    if lens.transmission_curve is None or table_nm is None:
        return np.full(asked_nm.shape, lens.transmission)
    outside = asked_nm[(asked_nm < table_nm[0]) | (asked_nm > table_nm[-1])]
    if outside.size:
        wrong = outside.min() if outside.min() < table_nm[0] else outside.max()
        raise InputError(
            f"lens.transmission_curve is given from {table_nm[0]:g} to {table_nm[-1]:g} nm and needed at {wrong:g} nm; "
            "extend it, with 0 where the lens is opaque."
        )
    return lens.transmission * np.asarray(
        np.interp(asked_nm, table_nm, lens.transmission_curve)
    )
