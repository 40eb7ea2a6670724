"""Rays through a sequential lens: from each point of the sensor through all surfaces of a prescription into the scene.

A pixel's irradiance is E = ∫ L·cos θ dω over the rear of the lens, with dω = cos³θ dA/Z² for the plane of the last
vertex at the distance Z. A ray through a point sampled uniformly from the ellipse of area A that light can pass has the
weight A·cos⁴θ/Z², or 0 if it is vignetted. So the rays carry E/L, and the f-number law must not be applied again.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..core import Array
from ..core.llvm import drjit
from ..optics.exit_pupil import exit_pupil_bounds
from ..optics.intrinsics import View
from ..optics.paraxial import cardinal_points, surfaces_at_f_number
from ..optics.ray_trace import D_NM, Ray, stopped_down, trace
from ..sensor.camera import Camera
from .variants import MitsubaObject, mitsuba

NO_HEIGHT = 1e-9  # below it an image point is on the axis [mm]


class SequentialLens:
    """Rays through the camera's prescription; the centre of its entrance pupil is where the scene's sensor is.

    view : what the sensor images through it.
    highest_mm, lit_mm : image height of the farthest corner of the film, and the largest one that receives light.
    """

    def __init__(self, camera: Camera, view: View, unit_m: float) -> None:
        lens, mi, dr = camera.lens, mitsuba(), drjit()
        points, focus_m = cardinal_points(lens), lens.focus_m or view.focus_m
        surfaces, distance = surfaces_at_f_number(lens), points.image_distance(focus_m)
        self._pitch_mm = (camera.pixel.pitch_x_um * 1e-3, camera.pixel.pitch_y_um * 1e-3)
        self.view = replace(
            view,
            half_width=0.5 * view.size[0] * self._pitch_mm[0] / points.principal_distance(focus_m),
            focus_m=focus_m,
            aperture_radius_m=points.entrance_radius * 1e-3,
            sequential=True,
        )
        wavelengths_nm = (*camera.band_nm, D_NM) if lens.dispersion else (D_NM,)
        reach = [max(a, n - a) * p for a, n, p in zip(view.axis, view.size, self._pitch_mm, strict=True)]
        bounds = exit_pupil_bounds(surfaces, distance, math.hypot(*reach), wavelengths_nm)
        last, lit = len(bounds.radial) - 1, np.flatnonzero(bounds.radial)
        self.highest_mm, self.lit_mm = bounds.highest, min(int(lit[-1]) + 1, last) / last * bounds.highest
        self._dispersion = lens.dispersion
        self._entrance_pupil_mm = points.length - points.entrance_pupil  # from the last vertex
        self._units_per_mm = 1e-3 / unit_m
        # Focus and f-number are data of the compiled kernel, so that it serves all of them; the glass is part of it.
        self._surfaces = stopped_down(surfaces, dr.opaque(mi.Float, points.stop_radius))
        self._distance = dr.opaque(mi.Float, distance)
        table = np.stack([bounds.centre, bounds.radial, bounds.tangential], axis=-1).astype(np.float32)
        self._bounds = mi.Texture1f(mi.TensorXf(table), use_accel=False)
        self._per_mm = dr.opaque(mi.Float, 1 / bounds.highest)

    def sample(
        self, sensor: MitsubaObject, samples: tuple[Array, Array, Array, Array], active: Array
    ) -> tuple[MitsubaObject, Array]:
        """A ray and its weight E/L, per wavelength.

        samples : time, wavelength sample, position on the film [pixels], and aperture sample.
        """
        mi, dr = mitsuba(), drjit()
        time, wavelength, position, aperture = samples
        lengths, weight = sensor.inner.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wavelength, active)
        start, solid_angle = self._start(position, aperture)
        if self._dispersion:  # only the first wavelength is traced, and represents the others
            weight = weight * mi.Spectrum(len(lengths), *[0.0] * (len(lengths) - 1))
        end = trace(self._surfaces, start, lengths[0] if self._dispersion else D_NM)
        to_world, unvignetted = sensor.world_transform(), mi.Mask(end.unvignetted & active)
        mm = self._units_per_mm
        exit_point = mi.Point3f(end.x * mm, end.y * mm, (end.z - self._entrance_pupil_mm) * mm)
        origin = dr.select(unvignetted, exit_point, mi.Point3f(0.0))
        direction = dr.select(unvignetted, mi.Vector3f(end.dx, end.dy, end.dz), mi.Vector3f(0.0, 0.0, 1.0))
        ray = mi.Ray3f(to_world @ origin, dr.normalize(to_world @ direction), time, lengths)
        ray.maxt = dr.select(unvignetted, ray.maxt, 0.0)  # a vignetted ray intersects nothing
        return ray, weight * dr.select(unvignetted, solid_angle, 0.0)

    def _start(self, position: Array, aperture: Array) -> tuple[Ray, Array]:
        """A ray from the film to the plane of the last vertex, and the projected solid angle it represents [sr]."""
        dr, (axis_x, axis_y), (pitch_x, pitch_y) = drjit(), self.view.axis, self._pitch_mm
        x, y, z = (position.x - axis_x) * pitch_x, (position.y - axis_y) * pitch_y, self._distance
        height = dr.sqrt(x * x + y * y)
        on_axis, inverse = height < NO_HEIGHT, 1.0 / dr.maximum(height, NO_HEIGHT)
        ux, uy = dr.select(on_axis, 1.0, x * inverse), y * inverse
        cells = self._bounds.shape[0] - 1  # of the exit-pupil bounds, linear in between
        at = height * self._per_mm * (cells / (cells + 1)) + 0.5 / (cells + 1)
        centre, radial, tangential = self._bounds.eval(at)
        disk = mitsuba().warp.square_to_uniform_disk_concentric(aperture)
        along, across = centre + radial * disk.x, tangential * disk.y
        dx, dy = along * ux - across * uy - x, along * uy + across * ux - y
        inverse = dr.rsqrt(dx * dx + dy * dy + z * z)
        cosine = z * inverse
        solid_angle = (math.pi * radial * tangential) * (cosine * cosine / z) ** 2
        return Ray(x, y, -z, dx * inverse, dy * inverse, cosine, True), solid_angle
