"""The traced lens of a camera, a prescription or a ray transfer: its paraxial optics and its chief rays.

Focal length, focal points, pupils, stop radius and sensor distance follow from the surfaces, or from the linear terms
of a ray transfer and the centre of its pupil. For a ray transfer, the pass plane, where its rays start, replaces the
last vertex.

Exit-pupil bounds: vignetting and pupil tilt leave only a few per cent of the rear of a lens open for the image corner.
A grid of rays is traced from many image heights along one radius, for half of the plane. An ellipse in the reference
plane encloses all unvignetted rays; the renderer samples it.

Light travels from the scene to the sensor; a ray is (height y, angle u). A surface of radius R between n and n′ gives
n′u′ = nu − y(n′ − n)/R, a gap t gives y′ = y + tu. Distances are in mm, positive towards the sensor.
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
"""Rays start at z < 0; z is 0 at the reference plane: the last vertex of surfaces, or the pass plane of a transfer."""
AXIAL_RAYS, REFINEMENTS = 256, 3  # in searches for the widest light cone and the exit pupil
WIDE_OPEN_RATIO = 1.01  # up to this multiple of its lowest f-number, a ray transfer has no stop
PUPIL_FIT_HEIGHT = 0.1  # largest image height over back focus in the fit of an exit pupil
PUPIL_HEIGHTS, PUPIL_RAYS, UNVIGNETTED = 25, 4001, 0.98
# Of the linear terms of a fit; a lens in air has the determinant 1.
DETERMINANT_TOLERANCE = 0.05
SECANT_STEPS = 12  # to the centre of the stop; six suffice
INTERVALS = 32
"""Intervals of the table; the ellipses also enclose rays halfway between its entries."""
GRID = 64  # rays across the window, in each refinement
HALF_AXIS_MIN = 1e-150  # of an empty ellipse; its square is still positive
CHIEF_RAYS = 17  # of the table of chief rays, without the axis


@dataclass(frozen=True)
class CardinalPoints:
    """Focal points and pupils of a lens [mm]."""

    focal_length: float
    front_focus: float  # after the first vertex
    back_focus: float  # after the last vertex
    entrance_pupil: float  # after the first vertex
    entrance_radius: float
    exit_pupil: float  # after the last vertex
    stop_radius: float  # of the aperture stop; its paraxial image is the entrance pupil
    length: float  # from the first to the last vertex
    scale: float  # factor on all lengths of the prescription

    def image_distance(self, focus_m: float) -> float:
        """Return the distance from the last vertex to the sensor [mm], focused ``focus_m`` before the entrance pupil.

        Newton: x·x′ = −f², with x from the front focal point to the object, x′ from the back focal point to the image.
        """
        return self.back_focus + self.focal_length**2 / self._object_distance(focus_m)

    def principal_distance(self, focus_m: float) -> float:
        """Return image height over tangent of field angle [mm]: |m|·focus distance, |m| = f/|x|; f at infinity."""
        if math.isinf(focus_m):
            return self.focal_length
        return self.focal_length * focus_m * 1e3 / self._object_distance(focus_m)

    def _object_distance(self, focus_m: float) -> float:
        """Return the distance from the front focal point to the object [mm]."""
        distance = focus_m * 1e3 - self.entrance_pupil + self.front_focus
        if distance <= 0:
            nearest_m = (self.entrance_pupil - self.front_focus) * 1e-3
            raise InputError(
                f"the focus distance is {focus_m:g} m; it must be above {nearest_m:.3g} m for a real image: increase "
                "lens.focus_m or the scene's focus_distance."
            )
        return distance


@lru_cache(maxsize=32)
def cardinal_points(lens: LensSection) -> CardinalPoints:
    """Return the paraxial data of a camera's prescription at 587.56 nm, scaled and stopped down to its f-number.

    The f-number sets the stop: the paraxial entrance pupil has the diameter f/N, as in lens-design programs, and the
    stop is the size of its image. Irradiance follows from the rays through the stop. On the axis, pupil aberrations
    change it from π·L/(4N²), for the double Gauss by +0.95 % at f/2.8 and +0.17 % at f/5.6.
    Raises InputError if the focal length is not positive, or the f-number is too low for the lens.
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
            f"the lens {prescription.name!r} has its pupil or image at infinity; move its stop."
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
    """Rays at the film and on the scene side; NaN if a ray does not exist."""

    start: Ray
    end: Ray


def trace_chief_rays(lens: LensSection, focus_m: float, heights_mm: Float64Array) -> ChiefRays:
    """Trace the chief rays of image heights through the centre of the stop, focused at a distance."""
    points, traced = cardinal_points(lens), traced_lens(lens).unobscured()
    distance = points.image_distance(focus_m)

    def ray_through(radial: Float64Array) -> Ray:
        return ray_to(distance, heights_mm, radial, 0 * heights_mm)

    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        # Start at the paraxial exit pupil.
        before = heights_mm * points.exit_pupil / (points.exit_pupil - distance)
        radial, miss_before = before + 1e-3, np.asarray(traced.miss_stop(ray_through(before)))
        for _ in range(SECANT_STEPS):
            miss = np.asarray(traced.miss_stop(ray_through(radial)))
            secant = miss * (radial - before) / (miss - miss_before)
            step = np.where(miss == miss_before, 0.0, secant)
            before, miss_before, radial = radial, miss, radial - step
        start = ray_through(radial)
        return ChiefRays(start, traced.trace(start))


def chief_ray_heights(
    lens: LensSection, focus_m: float, highest_mm: float
) -> tuple[Float64Array, Float64Array]:
    """Return (ideal, real) image heights of points in the focus plane, up to ``highest_mm`` [mm].

    Ideal heights are the principal distance times the tangent of the field angle at the centre of the paraxial entrance
    pupil. Heights with a vignetted chief ray are omitted.
    """
    points = cardinal_points(lens)
    heights = highest_mm * np.arange(1, CHIEF_RAYS + 1) / CHIEF_RAYS
    end = trace_chief_rays(lens, focus_m, heights).end
    with np.errstate(all="ignore"):
        tangent = slope = end.dx / end.dz
        if not math.isinf(focus_m):
            depth = end.z - (points.length - points.entrance_pupil)
            tangent = (end.x + (focus_m * 1e3 - depth) * slope) / (focus_m * 1e3)
    unvignetted = np.asarray(end.unvignetted)
    return -points.principal_distance(focus_m) * tangent[unvignetted], heights[unvignetted]


def _require_open(lens: LensSection, closing: float) -> None:
    """Raise InputError for an f-number below the lowest f-number of the lens, ``closing`` times as large."""
    assert lens.prescription is not None
    name = lens.prescription.name
    if not closing < math.inf:  # also for NaN
        raise InputError(
            f"the lens {name!r} passes no light on the axis; check semi-diameters, radii and glasses of its surfaces."
        )
    if closing > 1:
        fastest = math.ceil(lens.f_number * closing * 100) / 100
        raise InputError(
            f"lens.f_number is {lens.f_number:g}; it must be at least {fastest:g}, the lowest f-number of the lens "
            f"{name!r}."
        )


def _transfer_points(lens: LensSection) -> CardinalPoints:
    """Return the cardinal points of a ray transfer. Raises InputError for invalid ones and for a low f-number."""
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
    if not exit_pupil < back_focus or c * exit_pupil + d == 0:  # also for NaN
        raise InputError(
            f"the lens {name!r} has no exit pupil before the sensor; check its ray transfer."
        )
    stop_radius = NO_STOP_MM
    if closing * WIDE_OPEN_RATIO < 1:
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
    """Raise InputError for an impossible ray-transfer matrix.  power : its C."""
    if power >= 0:
        raise InputError(
            f"the lens {name!r} has a negative or infinite focal length; give a lens with a positive focal length."
        )
    if abs(determinant - 1) > DETERMINANT_TOLERANCE:
        raise InputError(
            f"the linear terms of the ray transfer {name!r} have the determinant {determinant:.3g}; it must be within "
            f"{DETERMINANT_TOLERANCE:g} of 1, as for a lens in air: use a fit of another degree."
        )


def _transfer_matrix(transfer: RayTransfer) -> tuple[float, float, float, float]:
    """Return A, B, C, D of height and slope from the pass plane to the first vertex, towards the scene."""
    y, slope = transfer.outputs["y"], transfer.outputs["dy"]
    a, b, c, d = y.slope(1, 0), y.slope(0, 1), slope.slope(1, 0), slope.slope(0, 1)
    a, b = a - transfer.output_plane * c, b - transfer.output_plane * d
    return a, b - transfer.depth * a, c, d - transfer.depth * c


def _fitted_exit_pupil(transfer: RayTransfer, back_focus: float, sine: float) -> float:
    """Return the distance of the exit pupil after the pass plane [mm], where light cones near the axis intersect.

    Least squares over the image heights up to the first vignetted cone.
    """
    edge = 1.5 * back_focus * sine / math.sqrt(1 - sine**2)
    heights = np.linspace(0, PUPIL_FIT_HEIGHT * back_focus, PUPIL_HEIGHTS)
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
    """Return rays from a point on the axis."""
    zero, cosine = 0 * sine, np.sqrt(1 - sine**2)
    return Ray(zero, zero, -distance, sine, zero, cosine, sine > 0)


def _widest_sine(lens: TracedLens, back_focus: float) -> float:
    """Return the sine of half the widest unvignetted light cone on the axis; 0 if no light passes."""
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
    """Return the ray-transfer matrix A, B, C, D from the first surface to the end of the last gap, and the index there.

    steps : surfaces, each with the gap after it [mm].  index : refractive index before the first surface.
    """
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for surface, gap in steps:
        after = float(glass_behind(surface).index(D_NM))
        power = 0.0
        if surface.radius_mm is not None:
            power = (after - index) / (after * surface.radius_mm)
        c, d = index / after * c - power * a, index / after * d - power * b
        a, b, index = a + gap * c, b + gap * d, after
    return a, b, c, d, index


@dataclass(frozen=True, eq=False)
class ExitPupilBounds:
    """Ellipses in the reference plane of the lens for image heights, shape (INTERVALS + 1,) [mm].

    highest : image height of the last entry; the first entry is the axis.
    centre : on the line through axis and image point, positive on the side of the point.
    radial, tangential : half axes along this line and across; 0 if no light passes.
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
    """Return the bounds for a sensor ``distance`` after the reference plane, up to the image height ``highest`` [mm].

    wavelengths_nm : the ellipses enclose rays that pass at any of these.
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
            "no ray on the axis passes this lens; reduce lens.f_number, e.g. to 8."
        )
    # Ellipses as wide as the windows, enlarged to enclose the corners of all passing cells.
    half, edge = cell[:, None] / 2, tangential + row[:, None] / 2

    def enlargement(first: int, centre: Float64Array, *half_axes: Float64Array) -> Float64Array:
        """Return the factors at which ellipses enclose the passing cells of every second height."""
        offset = np.abs(radial[first::2] - centre[:, None]) + half[first::2]
        x, y = (
            reach / np.maximum(half_axis, HALF_AXIS_MIN)[:, None]
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
    # Rays halfway between two entries of the table must be inside the mean of their ellipses.
    between = enlargement(1, *((v[1:] + v[:-1]) / 2 for v in (centre, *half_axes)))
    scale = np.maximum(np.maximum(np.append(between, 1.0), np.insert(between, 0, 1.0)), 1.0)
    return ExitPupilBounds(highest, centre, *(half_axis * scale for half_axis in half_axes))


def _cells_to_last(passes: NDArray[np.bool_]) -> Float64Array:
    """Return the cells up to the last passing cell, plus one: (heights, cells) → (heights,); 0 if none passes."""
    cells = passes.shape[1] - np.argmax(passes[:, ::-1], axis=1) + 1.0
    return np.where(passes.any(axis=1), cells, 0.0)
