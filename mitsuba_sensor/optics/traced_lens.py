"""The traced lens of a camera, a prescription or a ray transfer: its paraxial optics and its chief rays.

Focal length, focal points, pupils, stop radius and the distance of the sensor follow from the surfaces, or from the
linear terms of the polynomials of a ray transfer and the middle of its pupil. For a ray transfer the first vertex is
that of the lens, and the pass plane, from which its rays are traced, stands for the last one.

Exit-pupil bounds: vignetting and the slant of the pupil leave only a few per cent of the rear of a lens unvignetted for
the corner of an image. A grid of rays is traced from each of many image heights along one radius, for one half of the
plane, and an ellipse in the reference plane is found that contains all unvignetted rays; the renderer samples it.

Light runs from the scene to the sensor; a ray is (height y, angle u). A surface of radius R between n and n′ gives
n′u′ = nu − y(n′ − n)/R, a gap t gives y′ = y + tu. Every distance is in mm, positive towards the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import Float64Array, InputError
from .ray_trace import D_NM, Ray, SequentialSurfaces, glass_behind, lens_surfaces, ray_to
from .ray_transfer import NO_STOP_MM, RayTransfer, ray_transfer

if TYPE_CHECKING:
    from ..camera.lens_datasheet import LensSection, SurfaceSection

TracedLens: TypeAlias = SequentialSurfaces | RayTransfer
"""Rays start at z < 0; z is 0 at the reference plane, the last vertex of surfaces or the pass plane of a transfer."""
AXIAL_RAYS, REFINEMENTS = (
    256,
    3,
)  # by which the widest cone of light on the axis, or the exit pupil, is found
WIDE_OPEN = 1.01  # up to this f-number over the lowest one a ray transfer is not stopped down
NEAR_AXIS = (
    0.1  # heights over the back focus at which the exit pupil of a ray transfer is sought
)
PUPIL_HEIGHTS, PUPIL_RAYS, UNVIGNETTED = 25, 4001, 0.98
SAME_ETENDUE = (
    0.05  # by how much the determinant of linear terms may differ from 1, that of a lens in air
)
SECANTS = 12  # steps to the middle of the stop; superlinear, six are enough
INTERVALS = 32
"""Intervals of the table; the ellipses also contain what passes half-way between its entries."""
GRID = 64  # rays across the window, in each refinement
TINY = 1e-150  # half axis of an empty ellipse; its square is still above 0
POINTS = 17  # of the table of chief rays, without the axis


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
    _require_lens(prescription.name, c)
    stop = next(number for number, (surface, _) in enumerate(steps) if surface.stop)
    fa, fb, _, _, index = _matrix(steps[:stop])
    _, rb, _, rd, _ = _matrix(steps[stop:], index)
    if fa == 0 or rd == 0 or a <= 0:
        raise InputError(
            f"the lens {prescription.name!r} has a pupil or an image at infinity; move its stop."
        )
    scale = lens.focal_length_mm * -c if lens.focal_length_mm is not None else 1.0
    back_focus = -scale * a / c
    entrance_radius = -scale / c / (2 * lens.f_number)
    stop_radius = entrance_radius * abs(fa)
    surfaces = lens_surfaces(prescription, scale).unobscured()
    sine = _widest_sine(surfaces, back_focus)
    closing = math.inf
    if sine:
        with np.errstate(all="ignore"):  # rays that miss a surface give NaN
            edge = surfaces.miss_stop(_axial_rays(np.array([sine]), back_focus))
        closing = stop_radius / float(abs(edge[0]))
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


def traced_lens(lens: LensSection) -> TracedLens:
    """Return the lens of a camera, scaled and stopped down to its f-number."""
    assert lens.prescription is not None
    points = cardinal_points(lens)
    if lens.prescription.ray_transfer is None:
        return lens_surfaces(lens.prescription, points.scale).with_stop(points.stop_radius)
    transfer = ray_transfer(lens.prescription.ray_transfer, points.scale)
    return replace(transfer, exit_pupil=points.exit_pupil, stop_radius=points.stop_radius)


class ChiefRays(NamedTuple):
    """Rays from the film, and what becomes of them on the side of the scene; NaN where there is none."""

    start: Ray
    end: Ray


def trace_chief_rays(lens: LensSection, focus_m: float, heights_mm: Float64Array) -> ChiefRays:
    """Trace the chief rays of image heights through the middle of the stop, for a sensor in focus at a distance."""
    points, traced = cardinal_points(lens), traced_lens(lens).unobscured()
    distance = points.image_distance(focus_m)

    def ray_through(radial: Float64Array) -> Ray:
        return ray_to(distance, heights_mm, radial, 0 * heights_mm)

    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        # Start at the paraxial exit pupil.
        before = heights_mm * points.exit_pupil / (points.exit_pupil - distance)
        radial, miss_before = before + 1e-3, np.asarray(traced.miss_stop(ray_through(before)))
        for _ in range(SECANTS):
            miss = np.asarray(traced.miss_stop(ray_through(radial)))
            secant = miss * (radial - before) / (miss - miss_before)
            step = np.where(miss == miss_before, 0.0, secant)
            before, miss_before, radial = radial, miss, radial - step
        start = ray_through(radial)
        return ChiefRays(start, traced.trace(start))


def chief_ray_heights(
    lens: LensSection, focus_m: float, highest_mm: float
) -> tuple[Float64Array, Float64Array]:
    """(ideal, real) image heights of points in the plane that is in focus, up to ``highest_mm`` [mm].

    Ideal is the principal distance times the tangent of the field angle at the middle of the paraxial entrance pupil.
    Heights whose chief ray is vignetted or misses a surface are left out.
    """
    points = cardinal_points(lens)
    heights = highest_mm * np.arange(1, POINTS + 1) / POINTS
    end = trace_chief_rays(lens, focus_m, heights).end
    with np.errstate(all="ignore"):
        tangent = slope = end.dx / end.dz
        if not math.isinf(focus_m):
            depth = end.z - (points.length - points.entrance_pupil)
            tangent = (end.x + (focus_m * 1e3 - depth) * slope) / (focus_m * 1e3)
    unvignetted = np.asarray(end.unvignetted)
    return -points.principal_distance(focus_m) * tangent[unvignetted], heights[unvignetted]


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
    """Return the cardinal points of a ray transfer. Raises InputError if it is no lens, or cannot be opened so far."""
    prescription = lens.prescription
    assert prescription is not None and prescription.ray_transfer is not None
    name, transfer = prescription.name, ray_transfer(prescription.ray_transfer, 1.0)
    a, b, c, d = _transfer_matrix(transfer)
    _require_lens(name, c, a * d - b * c)
    back_focus, focal_length = -d / c, -1 / c
    sine = _widest_sine(transfer, back_focus) if back_focus > 0 else 0.0
    closing = 1 / (2 * lens.f_number * sine) if sine else math.inf
    _require_open(lens, closing)
    exit_pupil = _fitted_exit_pupil(transfer, back_focus, sine)
    if not exit_pupil < back_focus or c * exit_pupil + d == 0:  # of NaN, too
        raise InputError(f"the lens {name!r} has no exit pupil before the sensor.")
    stop_radius = NO_STOP_MM
    if closing * WIDE_OPEN < 1:
        slope = math.tan(math.asin(1 / (2 * lens.f_number)))
        stop_radius = slope * (back_focus - exit_pupil)
    scale = lens.focal_length_mm / focal_length if lens.focal_length_mm is not None else 1.0
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


def _require_lens(name: str, power: float, determinant: float = 1.0) -> None:
    """Raise InputError for a ray-transfer matrix that no lens has.  power : its C."""
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


def _widest_sine(lens: TracedLens, back_focus: float) -> float:
    """Sine of half the widest cone of light on the axis that no aperture cuts off; 0 where no light passes."""
    low, high = 0.0, 1.0
    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        for _ in range(REFINEMENTS):
            sines = np.linspace(low, high, AXIAL_RAYS + 1)[1:]
            blocked = np.flatnonzero(~lens.unvignetted(_axial_rays(sines, back_focus)))
            first = int(blocked[0]) if blocked.size else AXIAL_RAYS - 1
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


@dataclass(frozen=True, eq=False)
class ExitPupilBounds:
    """An ellipse in the reference plane of the lens for each image height, (INTERVALS + 1,) [mm].

    highest : image height of the last entry; the first is the axis.
    centre : on the line through axis and image point, positive on the side of the point.
    radial, tangential : half axes along that line and across; 0 where no light passes.
    """

    highest: float
    centre: Float64Array
    radial: Float64Array
    tangential: Float64Array


def exit_pupil_bounds(
    lens: TracedLens,
    distance: float,
    highest: float,
    wavelengths_nm: tuple[float, ...] = (D_NM,),
) -> ExitPupilBounds:
    """The bounds for a sensor ``distance`` behind the reference plane, up to the image height ``highest`` [mm].

    wavelengths_nm : rays that pass at any of them are inside.
    """
    heights = np.linspace(0.0, highest, 2 * INTERVALS + 1)
    high = np.full(heights.shape, lens.reach(distance, highest))
    low, top = -high, high
    for _ in range(REFINEMENTS):
        cell, row = (high - low) / GRID, top / (GRID // 2)
        radial = low[:, None] + cell[:, None] * (np.arange(GRID) + 0.5)
        tangential = row[:, None] * (np.arange(GRID // 2) + 0.5)
        start = ray_to(
            distance, heights[:, None, None], radial[:, :, None], tangential[:, None, :]
        )
        with np.errstate(all="ignore"):  # rays that miss a surface give NaN
            passes = np.logical_or.reduce(
                [lens.unvignetted(start, nm) for nm in wavelengths_nm]
            )
        along, across = passes.any(axis=2), passes.any(axis=1)
        cells_below, cells_above = _cells_to_last(along[:, ::-1]), _cells_to_last(along)
        low, high = high - cell * cells_below, low + cell * cells_above
        top = row * _cells_to_last(across)
    if not passes[0].any():
        raise InputError(
            "no ray on the axis passes this lens; set lens.f_number to a smaller value, e.g. 8."
        )
    # Ellipses as wide as the windows, enlarged until the corners of all cells that pass are inside.
    half, edge = cell[:, None] / 2, tangential + row[:, None] / 2

    def enlargement(first: int, centre: Float64Array, *half_axes: Float64Array) -> Float64Array:
        """Factors at which ellipses contain the cells of every second height, from the first one on, that pass."""
        offset = np.abs(radial[first::2] - centre[:, None]) + half[first::2]
        x, y = (
            reach / np.maximum(half_axis, TINY)[:, None]
            for reach, half_axis in zip((offset, edge[first::2]), half_axes, strict=True)
        )
        squares = np.where(passes[first::2], x[:, :, None] ** 2 + y[:, None] ** 2, 0.0)
        return np.asarray(np.sqrt(squares.max(axis=(1, 2))))

    lit = np.asarray(passes.any(axis=(1, 2)))
    lit_rows = np.flatnonzero(lit)
    nearest = np.abs(lit_rows[None, :] - np.arange(len(lit))[:, None]).argmin(axis=1)
    centre = ((low + high) / 2)[lit_rows[nearest]][::2]
    half_axes = [np.where(lit, size, 0.0)[::2] for size in ((high - low) / 2, top)]
    scale = enlargement(0, centre, *half_axes)
    half_axes = [half_axis * scale for half_axis in half_axes]
    # What passes half-way between two entries of the table must be inside the mean of their ellipses.
    between = enlargement(1, *((v[1:] + v[:-1]) / 2 for v in (centre, *half_axes)))
    scale = np.maximum(np.append(between, 1.0), np.insert(between, 0, 1.0))
    scale = np.maximum(scale, 1.0)
    return ExitPupilBounds(highest, centre, *(half_axis * scale for half_axis in half_axes))


def _cells_to_last(passes: NDArray[np.bool_]) -> Float64Array:
    """Cells up to the last that passes, and one more: (heights, cells) → (heights,); 0 if none does."""
    cells = passes.shape[1] - np.argmax(passes[:, ::-1], axis=1) + 1.0
    return np.where(passes.any(axis=1), cells, 0.0)
