"""Paraxial optics of a prescription: focal length, focal points, pupils, stop radius, and distance of the sensor.

A ray transfer has it from the linear terms of its polynomials and the middle of its pupil. There the first vertex is
that of the lens, and the last one stands for its pass plane, from which its rays are traced.

Light runs from the scene to the sensor; a ray is (height y, angle u). A surface of radius R between n and n′ gives
n′u′ = nu − y(n′ − n)/R, a gap t gives y′ = y + tu. Every distance is in mm, positive towards the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..core import Array, Float64Array, InputError
from .ray_trace import (
    D_NM,
    Ray,
    Surface,
    glass_behind,
    lens_surfaces,
    stopped_down,
    surfaces_to_stop,
    trace,
    unobscured,
)
from .ray_transfer import NO_STOP_MM, RayTransfer, ray_transfer

if TYPE_CHECKING:
    from ..camera.lens_datasheet import LensSection, SurfaceSection

AXIAL_RAYS, REFINEMENTS = 256, 3  # by which the widest cone of light on the axis is found
WIDE_OPEN = 1.01  # up to this f-number over the lowest one a ray transfer is not stopped down
NEAR_AXIS = (
    0.1  # heights over the back focus at which the exit pupil of a ray transfer is sought
)
PUPIL_HEIGHTS, PUPIL_RAYS, UNVIGNETTED = 25, 4001, 0.98
SAME_ETENDUE = (
    0.05  # by how much the determinant of the linear terms of a ray transfer may differ from 1
)


@dataclass(frozen=True)
class CardinalPoints:
    """Focal points and pupils of a lens [mm]."""

    focal_length: float
    front_focus: float  # behind the first vertex
    back_focus: float  # behind the last vertex
    entrance_pupil: float  # behind the first vertex
    entrance_radius: float
    exit_pupil: float  # behind the last vertex
    stop_radius: float  # of the aperture stop, whose paraxial image the entrance pupil is
    length: float  # from the first to the last vertex
    scale: float  # factor on all lengths of the prescription

    def image_distance(self, focus_m: float) -> float:
        """From the last vertex to the sensor [mm] for an object in focus at ``focus_m`` before the entrance pupil.

        Newton: x·x′ = −f², with x from the front focal point to the object, x′ from the back one to its image.
        """
        return self.back_focus + self.focal_length**2 / self._object_distance(focus_m)

    def principal_distance(self, focus_m: float) -> float:
        """Image height over the tangent of the field angle [mm]: |m|·focus distance, |m| = f/|x|; f at infinity."""
        if math.isinf(focus_m):
            return self.focal_length
        return self.focal_length * focus_m * 1e3 / self._object_distance(focus_m)

    def _object_distance(self, focus_m: float) -> float:
        """From the front focal point to the object [mm]."""
        distance = focus_m * 1e3 - self.entrance_pupil + self.front_focus
        if distance <= 0:
            nearest_m = (self.entrance_pupil - self.front_focus) * 1e-3
            raise InputError(
                f"the focus distance is {focus_m:g} m, and the lens has no real image of objects nearer than "
                f"{nearest_m:.3g} m; set lens.focus_m or the scene's focus_distance to a larger value."
            )
        return distance


@lru_cache(maxsize=32)
def cardinal_points(lens: LensSection) -> CardinalPoints:
    """Paraxial data of a camera's prescription at 587.56 nm, scaled and stopped down to its f-number.

    The f-number sets the diaphragm: the paraxial entrance pupil has the diameter f/N, as in programs for lens design,
    and the stop is as large as its image. Irradiance follows from the rays that pass the stop; on the axis it differs
    from π·L/(4N²) by the aberrations of the pupil, for the double Gauss by +0.95 % at f/2.8 and +0.17 % at f/5.6.
    Raises InputError if the lens has no positive focal length, or cannot be opened so far.
    """
    prescription = lens.prescription
    assert prescription is not None
    if prescription.ray_transfer is not None:
        return _transfer_points(lens)
    *others, last_surface = prescription.surfaces
    steps = [*((surface, surface.thickness_mm) for surface in others), (last_surface, 0.0)]
    a, _, c, d, _ = _matrix(steps)
    if c >= 0:
        raise InputError(
            f"the lens {prescription.name!r} has a negative or infinite focal length; it must be positive."
        )
    stop = next(number for number, (surface, _) in enumerate(steps) if surface.stop)
    fa, fb, _, _, index = _matrix(steps[:stop])
    _, rb, _, rd, _ = _matrix(steps[stop:], index)
    if fa == 0 or rd == 0 or a <= 0:
        raise InputError(
            f"the lens {prescription.name!r} has a pupil or an image at infinity; move its stop."
        )
    scale = 1.0
    if lens.focal_length_mm is not None:
        scale = lens.focal_length_mm * -c
    back_focus = -scale * a / c
    entrance_radius = -scale / c / (2 * lens.f_number)
    stop_radius = entrance_radius * abs(fa)
    surfaces = unobscured(lens_surfaces(prescription, scale))
    sine = _widest_sine(lambda ray: trace(surfaces, ray).unvignetted, back_focus)
    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        edge = trace(surfaces_to_stop(surfaces), _axial_rays(np.array([sine]), back_focus))
    closing = math.inf
    if sine:
        closing = stop_radius / float(abs(edge.x[0]))
    _require_open(lens, closing)
    return CardinalPoints(
        focal_length=-scale / c,
        front_focus=scale * d / c,
        back_focus=back_focus,
        entrance_pupil=scale * fb / fa,
        entrance_radius=entrance_radius,
        exit_pupil=-scale * rb / rd,
        stop_radius=stop_radius,
        length=scale * sum(gap for _, gap in steps),
        scale=scale,
    )


def surfaces_at_f_number(lens: LensSection) -> tuple[Surface, ...]:
    """The surfaces of a camera's prescription from the sensor to the scene, scaled and stopped down to its f-number."""
    assert lens.prescription is not None
    points = cardinal_points(lens)
    return stopped_down(lens_surfaces(lens.prescription, points.scale), points.stop_radius)


def _require_open(lens: LensSection, closing: float) -> None:
    """Raise InputError for an f-number below the lowest one of the lens, which is ``closing`` times as large."""
    assert lens.prescription is not None
    name = lens.prescription.name
    if not closing < math.inf:  # NaN, too
        raise InputError(
            f"no light on the axis passes the lens {name!r}; check the semi-diameters, radii and glasses "
            "of its surfaces."
        )
    if closing > 1:
        fastest = math.ceil(lens.f_number * closing * 100) / 100
        raise InputError(
            f"lens.f_number is {lens.f_number:g}, and the lens {name!r} opens to f/{fastest:g} at most; "
            f"set lens.f_number to {fastest:g} or more."
        )


def _transfer_points(lens: LensSection) -> CardinalPoints:
    """Of a ray transfer.  Raises InputError if it is no lens near the axis, or cannot be opened so far."""
    prescription = lens.prescription
    assert prescription is not None and prescription.ray_transfer is not None
    name, transfer = prescription.name, ray_transfer(prescription.ray_transfer, 1.0)
    a, b, c, d = _transfer_matrix(transfer)
    _require_lens(name, c, a * d - b * c)
    back_focus, focal_length = -d / c, -1 / c
    sine = 0.0
    if back_focus > 0:
        sine = _widest_sine(transfer.unvignetted, back_focus)
    closing = math.inf
    if sine:
        closing = 1 / (2 * lens.f_number * sine)
    _require_open(lens, closing)
    exit_pupil = _fitted_exit_pupil(transfer, back_focus, sine)
    if not exit_pupil < back_focus or c * exit_pupil + d == 0:  # of NaN, too
        raise InputError(f"the lens {name!r} has no exit pupil before the sensor.")
    stop_radius = NO_STOP_MM
    if closing * WIDE_OPEN < 1:
        slope = math.tan(math.asin(1 / (2 * lens.f_number)))
        stop_radius = slope * (back_focus - exit_pupil)
    scale = 1.0
    if lens.focal_length_mm is not None:
        scale = lens.focal_length_mm / focal_length
    return CardinalPoints(
        focal_length=scale * focal_length,
        front_focus=-scale * a * focal_length,
        back_focus=scale * back_focus,
        entrance_pupil=scale * (a * exit_pupil + b) / (c * exit_pupil + d),
        entrance_radius=scale * focal_length / (2 * lens.f_number),
        exit_pupil=scale * exit_pupil,
        stop_radius=scale * stop_radius,
        length=scale * transfer.length,
        scale=scale,
    )


def _require_lens(name: str, power: float, determinant: float) -> None:
    """Raise InputError for linear terms that no lens has.  power : C of the ray-transfer matrix."""
    if power >= 0:
        raise InputError(
            f"the lens {name!r} has a negative or infinite focal length; it must be positive."
        )
    if abs(determinant - 1) > SAME_ETENDUE:
        raise InputError(
            f"the linear terms of the ray transfer {name!r} have the determinant {determinant:.3g}, and those of a "
            f"lens in air have 1, within {SAME_ETENDUE:g} of a fit; take a fit of another degree."
        )


def _transfer_matrix(transfer: RayTransfer) -> tuple[float, float, float, float]:
    """A, B, C, D of height and slope from the pass plane to the first vertex, towards the scene."""
    y, slope = transfer.outputs["y"], transfer.outputs["dy"]
    a, b, c, d = y.slope(1, 0), y.slope(0, 1), slope.slope(1, 0), slope.slope(0, 1)
    a, b = a - transfer.output_plane * c, b - transfer.output_plane * d
    return a, b - transfer.depth * a, c, d - transfer.depth * c


def _fitted_exit_pupil(transfer: RayTransfer, back_focus: float, sine: float) -> float:
    """Behind the pass plane [mm]: where the middles of the cones of light of image points near the axis cross it.

    Least squares over the image heights up to the first whose cone is cut off.
    """
    edge = 1.5 * back_focus * sine / math.sqrt(1 - sine**2)
    heights = np.linspace(0, NEAR_AXIS * back_focus, PUPIL_HEIGHTS)
    points = np.linspace(-edge, edge, PUPIL_RAYS)
    size = np.sqrt((points - heights[:, None]) ** 2 + back_focus**2)
    x, z = heights[:, None] + 0 * points, -back_focus + 0 * size
    dx = (points - heights[:, None]) / size
    rays = Ray(x, 0 * size, z, dx, 0 * size, back_focus / size, size > 0)
    passes = transfer.unvignetted(rays)
    low = np.where(passes, points, np.inf).min(axis=1)
    high = np.where(passes, points, -np.inf).max(axis=1)
    cut = np.append(np.flatnonzero(high - low < UNVIGNETTED * (high[0] - low[0])), heights.size)
    near = slice(0, max(int(cut[0]), 3))
    heights, middles = heights[near], 0.5 * (low[near] + high[near])
    slope = heights @ middles / (heights @ heights)
    return float(slope * back_focus / (slope - 1))


def _axial_rays(sine: Float64Array, distance: float) -> Ray:
    """Rays from a point on the axis."""
    zero, cosine = 0 * sine, np.sqrt(1 - sine**2)
    return Ray(zero, zero, -distance, sine, zero, cosine, sine > 0)


def _widest_sine(unvignetted: Callable[[Ray], Array], back_focus: float) -> float:
    """Sine of half the widest cone of light on the axis that no aperture cuts off; 0 where no light passes."""
    low, high = 0.0, 1.0
    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        for _ in range(REFINEMENTS):
            sines = np.linspace(low, high, AXIAL_RAYS + 1)[1:]
            blocked = np.flatnonzero(~unvignetted(_axial_rays(sines, back_focus)))
            if blocked.size:
                first = int(blocked[0])
            else:
                first = AXIAL_RAYS - 1
            low, high = np.append(low, sines)[[first, first + 1]]
    return float(low)


def _matrix(
    steps: Sequence[tuple[SurfaceSection, float]], index: float = 1.0
) -> tuple[float, ...]:
    """Ray-transfer matrix A, B, C, D from before the first surface to the end of the last gap, and the index there.

    steps : surfaces, each with the gap behind it [mm].  index : refractive index before the first one.
    """
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for surface, gap in steps:
        behind = float(glass_behind(surface).index(D_NM))
        power = 0.0
        if surface.radius_mm is not None:
            power = (behind - index) / (behind * surface.radius_mm)
        c, d = index / behind * c - power * a, index / behind * d - power * b
        a, b, index = a + gap * c, b + gap * d, behind
    return a, b, c, d, index
