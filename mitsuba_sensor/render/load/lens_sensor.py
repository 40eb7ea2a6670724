"""A Mitsuba sensor that images through the camera's lens and wraps the scene's sensor.

The scene's sensor keeps film, sampler, pose and parameters; changing one of the two sensors by ``mi.traverse`` changes
both. A measured distortion displaces the rays of the scene's pinhole or thin lens (distorted projection). A
prescription traces rays from each point of the sensor through all surfaces, or by a ray transfer, into the scene.

A pixel's irradiance is E = ∫ L·cos θ dω over the rear of the lens, with dω = cos³θ dA/Z² for the reference plane of the
lens at distance Z (traced_lens.py). A ray through a point sampled uniformly from the ellipse of area A that passes
light has the weight A·cos⁴θ/Z², or 0 if it is vignetted. So the rays carry E/L, and the f-number law must not be
applied.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Protocol, TypeAlias

import numpy as np

from ...camera.camera import Camera
from ...core import Array, Float64Array, InputError
from ...core.llvm import drjit
from ...optics.distortion import Distortion, distortion_of
from ...optics.f_number_law import numerical_aperture
from ...optics.intrinsics import View, image_distance_m
from ...optics.ray_trace import D_NM, Ray
from ...optics.traced_lens import cardinal_points, exit_pupil_bounds, traced_lens
from ..variants import MitsubaObject, mitsuba

TOLERANCE_PX = 0.005  # of the interpolated displacement of a distorted projection
CELLS_MIN, CELLS_MAX = 32, 1024  # of its table along a side
IN_PYTHON = "the lens is computed in Python here, 0.1 ms per ray; an llvm variant is as fast as without it"
NO_HEIGHT = 1e-9  # image points below this height are on the axis [mm]
PUPIL_MIN = 1e-3  # of the pupil on the axis, where barely any light passes
Samples: TypeAlias = tuple[Array, Array, Array, Array]
"""Time, wavelength, position on the full film [pixels], aperture."""


class RaySource(Protocol):
    """Source of the rays of a sensor of :func:`sensor_class`."""

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return a ray of the scene for each point of the film, and its weight per wavelength."""


def with_lens(
    sensor: MitsubaObject, view: View, camera: Camera | None, unit_m: float
) -> tuple[MitsubaObject, View, tuple[str, ...]]:
    """Return the scene's sensor with the camera's lens, its view, and notes on the differences; sensor and view are
    unchanged without distortion and prescription. Raises InputError if lens and sensor cannot be combined."""
    if camera is None:
        return sensor, view, ()
    lens: RaySource
    variant, notes = mitsuba().variant(), list[str]()
    if camera.lens.prescription is not None:
        if view.half_width == 0:
            raise InputError(
                "lens.prescription is given and the scene's sensor is orthographic; take a perspective or thinlens "
                "sensor."
            )
        lens = SequentialLens(camera, view, unit_m)
        notes, view = lens.notes(camera, view), lens.view
    else:
        distortion = distortion_of(camera.lens, image_distance_m(view, camera) * 1e3)
        if distortion is None:
            return sensor, view, ()
        lens = DistortedProjection(distortion, view)
    if variant.startswith("scalar"):
        notes.append(IN_PYTHON)
    return sensor_class(variant)(sensor, lens), view, tuple(notes)


@cache
def sensor_class(variant: str) -> MitsubaObject:
    """Return the class of sensors with another ray source, or another film, than the scene's sensor; Mitsuba has
    another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Sensor

    class LensSensor(base):  # type: ignore[misc]
        """inner : the scene's sensor.  lens : samples rays at positions on the full film [pixels].  film : None for the
        film of ``inner``."""

        def __init__(
            self, inner: MitsubaObject, lens: RaySource, film: MitsubaObject | None = None
        ) -> None:
            props = mi.Properties(inner.class_name())
            props["film"], props["sampler"] = film or inner.film(), inner.sampler()
            super().__init__(props)
            if (medium := inner.get_medium()) is not None:
                self.set_medium(medium)
            self.inner, self.lens = inner, lens
            self.m_needs_sample_2 = self.m_needs_sample_3 = True

        def crop(self) -> tuple[Array, ...]:
            """Return size and corner of the crop as data, so strips of rows share one compiled kernel."""
            pairs = self.film().crop_size(), self.film().crop_offset()
            return tuple(
                mi.Vector2f(*(dr.opaque(mi.Float, float(n)) for n in pair)) for pair in pairs
            )

        def inner_ray(self, samples: Samples, active: Array) -> tuple[MitsubaObject, Array]:
            """Return the ray of ``inner`` through a position on the full film [pixels], and its weight."""
            time, wavelength, on_film, aperture = samples
            size, corner = self.crop()
            x, y = (on_film.x - corner.x) / size.x, (on_film.y - corner.y) / size.y
            in_crop = mi.Point2f(x, y)
            ray, weight = self.inner.sample_ray(time, wavelength, in_crop, aperture, active)
            return ray, weight

        def sample_ray(
            self,
            time: Array,
            sample1: Array,
            sample2: Array,
            sample3: Array,
            active: Array = True,
        ) -> tuple[MitsubaObject, Array]:
            """Return a ray and its weight. C++ calls by position, integrators in Python by Mitsuba's names."""
            size, corner = self.crop()
            on_film = mi.Point2f(sample2.x * size.x + corner.x, sample2.y * size.y + corner.y)
            return self.lens.sample(self, (time, sample1, on_film, sample3), active)

        def sample_ray_differential(
            self,
            time: Array,
            sample1: Array,
            sample2: Array,
            sample3: Array,
            active: Array = True,
        ) -> tuple[MitsubaObject, Array]:
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def world_transform(self) -> MitsubaObject:
            return self.inner.world_transform()

        def traverse(self, callback: MitsubaObject) -> None:
            self.inner.traverse(callback)

        def parameters_changed(self, keys: MitsubaObject = ()) -> None:
            self.inner.parameters_changed(list(keys))
            super().parameters_changed(list(keys))

    return LensSensor


class DistortedProjection:
    """Rays of the ideal position for each real position on the film, by a table over the whole film. Its cells are
    small enough for bilinear interpolation within TOLERANCE_PX at their centres."""

    def __init__(self, distortion: Distortion, view: View) -> None:
        mi, self._size, self._cells = mitsuba(), view.size, CELLS_MIN
        table = _displacement(distortion, view, 2 * CELLS_MIN)
        while self._cells < CELLS_MAX:
            corners = table[::2, ::2]
            below, above = (
                corners[1:, 1:] + corners[1:, :-1],
                corners[:-1, 1:] + corners[:-1, :-1],
            )
            if np.abs((below + above) / 4 - table[1::2, 1::2]).max() <= TOLERANCE_PX:
                break
            self._cells *= 2
            table = _displacement(distortion, view, 2 * self._cells)
        tensor = mi.TensorXf(table[::2, ::2].astype(np.float32))
        self._displacement = mi.Texture2f(tensor, use_accel=False)

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return the ray of the scene's sensor, and its weight, for the position without distortion."""
        time, wavelength, real, aperture = samples
        scale = self._cells / (self._cells + 1)
        at = [
            p / n * scale + (0.5 / (self._cells + 1))
            for p, n in zip(real, self._size, strict=True)
        ]
        dx, dy = self._displacement.eval(type(real)(*at), active)
        ideal = type(real)(real.x + dx, real.y + dy)
        ray, weight = sensor.inner_ray((time, wavelength, ideal, aperture), active)
        return ray, weight


def _displacement(distortion: Distortion, view: View, cells: int) -> Float64Array:
    """Return ideal minus real position on a grid over the whole film, shape (cells + 1, cells + 1, 2) [pixels]."""
    (width, height), (axis_x, axis_y), scale = view.size, view.axis, view.tangent_per_pixel
    at = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(width * at - axis_x, height * at - axis_y)
    u, v, _ = distortion.ideal(scale * x, scale * y)
    return np.stack([u / scale - x, v / scale - y], axis=-1)


class SequentialLens:
    """Rays through the camera's prescription, and its view. The centre of the entrance pupil is at the scene's
    sensor."""

    def __init__(self, camera: Camera, view: View, unit_m: float) -> None:
        lens, mi, dr = camera.lens, mitsuba(), drjit()
        points, focus_m = cardinal_points(lens), lens.focus_m or view.focus_m
        traced, distance = traced_lens(lens), points.image_distance(focus_m)
        self._pitch_mm = (camera.pixel.pitch_x_um * 1e-3, camera.pixel.pitch_y_um * 1e-3)
        self.view = replace(
            view,
            half_width=0.5
            * view.size[0]
            * self._pitch_mm[0]
            / points.principal_distance(focus_m),
            focus_m=focus_m,
            aperture_radius_m=points.entrance_radius * 1e-3,
            sequential=True,
        )
        wavelengths_nm = (*camera.band_nm, D_NM) if lens.dispersion else (D_NM,)
        reach = [
            max(a, n - a) * p
            for a, n, p in zip(view.axis, view.size, self._pitch_mm, strict=True)
        ]
        bounds = exit_pupil_bounds(traced, distance, math.hypot(*reach), wavelengths_nm)
        last, lit = len(bounds.radial) - 1, np.flatnonzero(bounds.radial)
        self._highest_mm = bounds.highest  # image height of the film's farthest corner
        # The largest image height with light.
        self._lit_mm = min(int(lit[-1]) + 1, last) / last * bounds.highest
        self._dispersion = lens.dispersion
        # From the reference plane of the lens.
        self._entrance_pupil_mm = points.length - points.entrance_pupil
        self._units_per_mm = 1e-3 / unit_m
        # Focus and f-number are data of the compiled kernel; the glass is part of the kernel.
        self._traced = traced.with_stop(dr.opaque(mi.Float, points.stop_radius))
        self._distance = dr.opaque(mi.Float, distance)
        table = np.stack([bounds.centre, bounds.radial, bounds.tangential], axis=-1)
        self._bounds = mi.Texture1f(mi.TensorXf(table.astype(np.float32)), use_accel=False)
        self._per_mm = dr.opaque(mi.Float, 1 / bounds.highest)
        self._half = lens.half_pupil
        self._to_exit_pupil = dr.opaque(mi.Float, distance - points.exit_pupil)
        self._numerical_aperture = dr.opaque(mi.Float, numerical_aperture(self.view, camera))

    def notes(self, camera: Camera, scene: View) -> list[str]:
        """Return notes on the properties that the lens determines instead of the scene, whose view is given."""
        wide, was = (2 * math.degrees(math.atan(x.half_width)) for x in (self.view, scene))
        columns = round(scene.size[0] * scene.half_width / self.view.half_width)
        columns = min(columns, camera.sensor.columns)
        remedy = (
            f"; width={columns} comes closest to the scene's view"
            if columns > scene.size[0]
            else ""
        )
        name = camera.lens.prescription and camera.lens.prescription.name
        focus = "infinity" if math.isinf(self.view.focus_m) else f"{self.view.focus_m:g} m"
        notes = [
            f"the lens {name!r} determines the field of view, {wide:.3g} degrees across instead of the scene's "
            f"{was:.3g}, and the blur; it is focused at {focus}{remedy}"
        ]
        if self._lit_mm < self._highest_mm:
            notes.append(
                f"no light comes through the lens to image heights above {self._lit_mm:.3g} mm; the sensor's corner is "
                f"at {self._highest_mm:.3g} mm"
            )
        return notes

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return a ray and its weight E/L per wavelength."""
        mi, dr = mitsuba(), drjit()
        time, wavelength, position, aperture = samples
        lengths, weight = sensor.inner.sample_wavelengths(
            dr.zeros(mi.SurfaceInteraction3f), wavelength, active
        )
        start, solid_angle = self._start(position, aperture)
        if self._dispersion:  # only the first wavelength is traced; it represents the others
            first = mi.UnpolarizedSpectrum(len(lengths), *[0.0] * (len(lengths) - 1))
            weight = mi.Spectrum(mi.unpolarized_spectrum(weight) * first)
        end = self._traced.trace(start, lengths[0] if self._dispersion else D_NM)
        to_world, unvignetted = sensor.world_transform(), mi.Mask(end.unvignetted & active)
        unvignetted &= self._in_half(start)
        mm = self._units_per_mm
        exit_point = mi.Point3f(end.x * mm, end.y * mm, (end.z - self._entrance_pupil_mm) * mm)
        origin = dr.select(unvignetted, exit_point, mi.Point3f(0.0))
        direction = dr.select(
            unvignetted, mi.Vector3f(end.dx, end.dy, end.dz), mi.Vector3f(0.0, 0.0, 1.0)
        )
        ray = mi.Ray3f(to_world @ origin, dr.normalize(to_world @ direction), time, lengths)
        ray.maxt = dr.select(unvignetted, ray.maxt, 0.0)  # a vignetted ray intersects nothing
        return ray, weight * dr.select(unvignetted, solid_angle, 0.0)

    def _in_half(self, start: Ray) -> Array:
        """Return True for a ray from the film that passes the visible half of the exit pupil; x points to the left of
        the camera, as in Mitsuba."""
        if self._half is None:
            return True
        x = start.x + start.dx / start.dz * self._to_exit_pupil
        return x > 0 if self._half == "left" else x < 0

    def numerical_apertures(self, place: Array) -> tuple[Array, Array]:
        """Return the numerical apertures of the ellipse that passes light to a position on the full film [pixels],
        along and across the radius.

        The value on the axis is paraxial; the exit-pupil bounds determine its change over the image.
        """
        dr, (axis_x, axis_y), (pitch_x, pitch_y) = drjit(), self.view.axis, self._pitch_mm
        x, y = (place.x - axis_x) * pitch_x, (place.y - axis_y) * pitch_y
        height = dr.sqrt(x * x + y * y)
        centre, radial, tangential = self._bounds_at(height)
        _, radius, _ = self._bounds_at(0.0 * height)
        cosine = self._distance * dr.rsqrt((centre - height) ** 2 + self._distance**2)
        across = self._numerical_aperture * cosine / radius
        along = across * cosine * cosine * dr.maximum(radial, PUPIL_MIN * radius)
        return along, across * dr.maximum(tangential, PUPIL_MIN * radius)

    def _bounds_at(self, height: Array) -> tuple[Array, Array, Array]:
        """Return centre and semi-axes of the exit pupil's ellipse, interpolated linearly."""
        cells = self._bounds.shape[0] - 1
        at = height * self._per_mm * (cells / (cells + 1)) + 0.5 / (cells + 1)
        centre, radial, tangential = self._bounds.eval(at)
        return centre, radial, tangential

    def _start(self, position: Array, aperture: Array) -> tuple[Ray, Array]:
        """Return a ray from the film to the reference plane of the lens, and its projected solid angle [sr]."""
        dr, (axis_x, axis_y), (pitch_x, pitch_y) = drjit(), self.view.axis, self._pitch_mm
        x, y = (position.x - axis_x) * pitch_x, (position.y - axis_y) * pitch_y
        z = self._distance
        height = dr.sqrt(x * x + y * y)
        on_axis, inverse = height < NO_HEIGHT, 1.0 / dr.maximum(height, NO_HEIGHT)
        ux, uy = dr.select(on_axis, 1.0, x * inverse), y * inverse
        centre, radial, tangential = self._bounds_at(height)
        disk = mitsuba().warp.square_to_uniform_disk_concentric(aperture)
        along, across = centre + radial * disk.x, tangential * disk.y
        dx, dy = along * ux - across * uy - x, along * uy + across * ux - y
        inverse = dr.rsqrt(dx * dx + dy * dy + z * z)
        cosine = z * inverse
        solid_angle = (math.pi * radial * tangential) * (cosine * cosine / z) ** 2
        return Ray(x, y, -z, dx * inverse, dy * inverse, cosine, True), solid_angle
