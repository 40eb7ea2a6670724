"""The f-number law: irradiance at the focal plane from scene radiance, E = L · T · Ω.

Ω = π/(4·N_w²)·cos⁴θ with the working f-number N_w = N·(1 + |m|/P): an aplanatic lens of f-number N, transmission T(λ)
and pupil magnification P at magnification m (``convention = "working"``); or the planar Ω = π/(1 + 4N²(1 + |m|)²)·cos⁴θ
of EMVA 1288 and ISET (``"planar"``). They differ by 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8.

Where the lens distorts, Ω is also divided by the area of the image of a small patch over its area without distortion:
the flux that enters the pupil from the patch, L·A·cos θ dω = L·A·cos⁴θ dA/f², is spread over that area. The entrance
pupil is assumed to be the same over the whole field. A measured relative illumination contains all of this and replaces
both factors. The rays of a sequential lens (``lens.prescription``) carry Ω themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import Float64Array, InputError
from .distortion import distortion_of
from .intrinsics import View, image_distance_m, magnification

if TYPE_CHECKING:
    from ..camera.camera import Camera

RADII = 33  # points of the table of relative illumination
GAUSS_2 = (
    0.5 - 0.5 / math.sqrt(3),
    0.5 + 0.5 / math.sqrt(3),
)  # nodes of the 2-point Gauss rule on a pixel


def solid_angle_sr(view: View, camera: Camera) -> Float64Array:
    """Ω = E/(L·T) [sr], projected, for each pixel of the crop, (rows, columns); 1 where the rays carry it already.

    Raises InputError where a measured table does not reach the corner of the image.
    """
    if view.sequential:
        return np.ones(view.crop_size[::-1])
    lens, m = camera.lens, magnification(view, camera)
    if lens.convention == "planar":
        on_axis = math.pi / (1 + 4 * lens.f_number**2 * (1 + m) ** 2)
    else:
        working = lens.f_number * (1 + m / lens.pupil_magnification)
        on_axis = math.pi / (4 * working**2)
    return on_axis * _relative_illumination(view, camera)


def _relative_illumination(view: View, camera: Camera) -> Float64Array:
    """Ω over its value on the axis, averaged over each pixel, (rows, columns)."""
    return _pixel_means(view, _illumination_at(view, camera))


def shading(view: View, camera: Camera) -> dict[str, list[float]] | None:
    """Relative illumination along a radius of the part that is rendered, for the correction of raw frames: distances
    ``radius_px`` from the optical axis to the farthest corner, and ``relative_illumination`` there.

    None where it is not known: the rays of a prescription carry it, a telecentric sensor has none. Of a lens with
    tangential distortion it is that to the right.
    """
    if view.sequential or not view.half_width:
        return None
    sides = zip(view.axis, view.crop_offset, view.crop_size, strict=True)
    corner = math.hypot(*(max(a - first, first + n - a) for a, first, n in sides))
    radius = np.linspace(0.0, corner, RADII)
    values = _illumination_at(view, camera)(radius[None], np.zeros((1, 1)))[0]
    return {"radius_px": radius.tolist(), "relative_illumination": values.tolist()}


def _illumination_at(
    view: View, camera: Camera
) -> Callable[[Float64Array, Float64Array], Float64Array]:
    """Ω over its value on the axis, at x and y from the optical axis [pixels]."""
    lens, scale, pitch_mm = camera.lens, view.tangent_per_pixel, camera.pixel.pitch_x_um * 1e-3
    if lens.relative_illumination is not None:
        return lambda x, y: _measured_illumination(camera, pitch_mm * np.hypot(x, y))
    distortion = distortion_of(lens, image_distance_m(view, camera) * 1e3)
    if distortion is None:
        return _cos4_at(scale)

    def distorted(x: Float64Array, y: Float64Array) -> Float64Array:
        u, v, area = distortion.ideal(*np.broadcast_arrays(scale * x, scale * y))
        return np.asarray(1 / (1 + u**2 + v**2) ** 2 / area)

    return distorted


def cos4(view: View) -> Float64Array:
    """cos⁴ of the angle to the optical axis, averaged over each pixel of the crop, (rows, columns)."""
    return _pixel_means(view, _cos4_at(view.tangent_per_pixel))


def _cos4_at(scale: float) -> Callable[[Float64Array, Float64Array], Float64Array]:
    return lambda x, y: np.asarray(1 / (1 + (scale * x) ** 2 + (scale * y) ** 2) ** 2)


def _measured_illumination(camera: Camera, heights_mm: Float64Array) -> Float64Array:
    """Measured relative illumination at image heights, linear between the points of the table."""
    known, values = (
        camera.lens.relative_illumination_heights_mm,
        camera.lens.relative_illumination,
    )
    assert known is not None and values is not None
    if (highest := float(heights_mm.max())) > known[-1]:
        raise InputError(
            f"lens.relative_illumination_heights_mm ends at {known[-1]:g} mm, and the sensor reaches {highest:.4g} mm "
            "from the axis; extend the table."
        )
    return np.interp(heights_mm, known, values)


def _pixel_means(
    view: View, function: Callable[[Float64Array, Float64Array], Float64Array]
) -> Float64Array:
    """Gauss's means over each pixel of a function of x (1, columns) and y (rows, 1) from the optical axis [pixels]."""
    (columns, rows), (column, row), (axis_x, axis_y) = (
        view.crop_size,
        view.crop_offset,
        view.axis,
    )
    xs = [
        np.arange(columns, dtype=float)[None, :] + (column + node - axis_x) for node in GAUSS_2
    ]
    ys = [np.arange(rows, dtype=float)[:, None] + (row + node - axis_y) for node in GAUSS_2]
    return sum((0.25 * function(x, y) for x in xs for y in ys), np.zeros((rows, columns)))


def transmittance(camera: Camera, wavelengths_nm: ArrayLike) -> Float64Array:
    """T of the lens at each wavelength, (B,): ``transmission`` times the curve, linear between its points.

    Raises InputError outside the range of the curve, where T is not known.
    """
    lens, at_nm = camera.lens, np.asarray(wavelengths_nm, dtype=float)
    known = lens.transmission_wavelengths_nm
    if lens.transmission_curve is None or known is None:
        return np.full(at_nm.shape, lens.transmission)
    outside = at_nm[(at_nm < known[0]) | (at_nm > known[-1])]
    if outside.size:
        wrong = outside.min() if outside.min() < known[0] else outside.max()
        raise InputError(
            f"lens.transmission_curve is given from {known[0]:g} to {known[-1]:g} nm and needed at {wrong:g} nm; "
            "extend it, with 0 where the lens is opaque."
        )
    return lens.transmission * np.asarray(np.interp(at_nm, known, lens.transmission_curve))
