"""A lens of many surfaces: every ray is traced from the sensor through all of them into the scene.

A pixel's irradiance is E = ∫ L·cos θ dω over the back of the lens, with dω = cos³θ dA/Z² for the plane of the last
vertex at the distance Z. A ray through a point drawn evenly from the ellipse that light can pass has the weight
A·cos⁴θ/Z², or 0 if something stops it; so the rays carry E/L, and neither a closed form nor cos⁴ comes on top.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.llvm import drjit
from ..optics.glass import D_NM
from ..optics.paraxial import cardinal, opened
from ..optics.pupil import Pupil, find_pupil
from ..optics.ray_trace import Ray, stopped_down, trace

if TYPE_CHECKING:
    from ..optics.f_number_law import View
    from ..sensor.camera import Camera

NO_HEIGHT = 1e-9  # below it an image point lies on the axis [mm]


class SequentialLens:
    """Rays through the camera's prescription. The middle of its entrance pupil stands where the scene's camera does.

    view : what the sensor sees through it.  highest_mm, lit_mm : the image height of the farthest corner of the film,
    and that up to which there is light.
    """

    def __init__(self, mi: Any, camera: Camera, view: View, unit_m: float) -> None:
        lens, dr = camera.lens, drjit()
        points, focus_m = cardinal(lens), lens.focus_m or view.focus_m
        surfaces, distance = opened(lens), points.image_distance(focus_m)
        self._pitch_mm = (camera.pixel.pitch_x_um * 1e-3, camera.pixel.pitch_y_um * 1e-3)
        half_width = 0.5 * view.size[0] * self._pitch_mm[0] / points.principal_distance(focus_m)
        self.view = replace(
            view,
            half_width=half_width,
            focus_m=focus_m,
            aperture_radius_m=points.entrance_radius * 1e-3,
            traced=True,
        )
        band = (*camera.band_nm, D_NM) if lens.dispersion else (D_NM,)
        reach = [max(a, n - a) * p for a, n, p in zip(view.axis, view.size, self._pitch_mm, strict=True)]
        pupil = find_pupil(surfaces, distance, math.hypot(*reach), band)
        self.highest_mm, lit = pupil.highest, np.flatnonzero(pupil.radial)
        self.lit_mm = min(lit[-1] + 1, len(pupil.radial) - 1) / (len(pupil.radial) - 1) * pupil.highest
        self._mi, self._dr, self._dispersion = mi, dr, lens.dispersion
        self._behind_mm = points.length - points.entrance_pupil  # the entrance pupil, from the last vertex
        self._units_per_mm = 1e-3 / unit_m
        # What changes with focus and f-number is data to the compiled kernel; the glass is part of it.
        self._surfaces = stopped_down(surfaces, dr.opaque(mi.Float, points.stop_radius))
        self._distance = dr.opaque(mi.Float, distance)
        self._pupil, self._per_mm = _texture(mi, pupil), dr.opaque(mi.Float, 1 / pupil.highest)

    def sample(self, sensor: Any, samples: tuple[Any, Any, Any, Any], active: Any) -> tuple[Any, Any]:
        """The ray of a place on the film [pixels] and a place in the pupil, and its E/L."""
        mi, dr = self._mi, self._dr
        time, wavelength, place, aperture = samples
        lengths, weight = sensor.inner.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wavelength, active)
        start, share = self._start(place, aperture)
        if self._dispersion:  # the first wavelength is traced, and stands for the others
            weight = weight * mi.Spectrum(len(lengths), *[0.0] * (len(lengths) - 1))
        end = trace(self._surfaces, start, lengths[0] if self._dispersion else D_NM)
        to_world, unvignetted = sensor.world_transform(), mi.Mask(end.unvignetted & active)
        mm = self._units_per_mm
        middle = mi.Point3f(end.x * mm, end.y * mm, (end.z - self._behind_mm) * mm)
        origin = dr.select(unvignetted, middle, mi.Point3f(0.0))
        direction = dr.select(unvignetted, mi.Vector3f(end.dx, end.dy, end.dz), mi.Vector3f(0.0, 0.0, 1.0))
        ray = mi.Ray3f(to_world @ origin, dr.normalize(to_world @ direction), time, lengths)
        ray.maxt = dr.select(unvignetted, ray.maxt, 0.0)  # a ray that was stopped meets nothing
        return ray, weight * dr.select(unvignetted, share, 0.0)

    def _start(self, place: Any, aperture: Any) -> tuple[Ray, Any]:
        """From the film to the plane of the last vertex; and the projected solid angle that the ray stands for [sr]."""
        dr, (axis_x, axis_y), (pitch_x, pitch_y) = self._dr, self.view.axis, self._pitch_mm
        x, y, z = (place.x - axis_x) * pitch_x, (place.y - axis_y) * pitch_y, self._distance
        height = dr.sqrt(x * x + y * y)
        on_axis, inverse = height < NO_HEIGHT, 1.0 / dr.maximum(height, NO_HEIGHT)
        ux, uy = dr.select(on_axis, 1.0, x * inverse), y * inverse
        centre, radial, tangential = self._ellipse(height)
        disk = self._mi.warp.square_to_uniform_disk_concentric(aperture)
        along, across = centre + radial * disk.x, tangential * disk.y
        dx, dy = along * ux - across * uy - x, along * uy + across * ux - y
        inverse = dr.rsqrt(dx * dx + dy * dy + z * z)
        cosine = z * inverse
        share = (math.pi * radial * tangential) * (cosine * cosine / z) ** 2
        return Ray(x, y, -z, dx * inverse, dy * inverse, cosine, True), share

    def _ellipse(self, height: Any) -> Any:
        cells = self._pupil.shape[0] - 1
        at = height * self._per_mm * (cells / (cells + 1)) + 0.5 / (cells + 1)
        return self._pupil.eval(at)


def _texture(mi: Any, pupil: Pupil) -> Any:
    """The table, to be looked up with linear interpolation."""
    values = np.stack([pupil.centre, pupil.radial, pupil.tangential], axis=-1).astype(np.float32)
    return mi.Texture1f(mi.TensorXf(values), use_accel=False)
