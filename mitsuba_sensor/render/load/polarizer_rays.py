"""Rays of a sensor with polarisers: their weight is the first row of the Mueller matrix of their pixel's polariser.

Polarised variants of Mitsuba multiply the weight of a ray, a Mueller matrix, by the Stokes vector of the light, and the
film takes the first component. With the first row (1, c·cos 2θ, c·sin 2θ, 0), rotated from the frame of the sensor to
the frame of the ray, this is S0 + c·(S1 cos 2θ + S2 sin 2θ), which is never negative; see :mod:`stages.polarizers`.

The frame of the sensor is the frame of Mitsuba's integrator ``stokes``: its first axis is perpendicular to the ray and
to the columns of the image.
"""

from __future__ import annotations

import numpy as np

from ...camera.camera import Camera
from ...camera.fingerprint import polarizer_fingerprint
from ...core import Array
from ...core.llvm import drjit
from ...stages.polarizers import contrast
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, is_polarized, mitsuba
from .lens_sensor import Samples, sensor_class

STEP_NM = 1.0  # of the table of the contrast


def with_polarizers(
    sensor: MitsubaObject, scene: ParsedScene, camera: Camera | None
) -> tuple[MitsubaObject, str | None]:
    """Return the sensor behind the polarisers of the camera, and their fingerprint; unchanged without polarisers, and
    if the variant does not follow polarisation."""
    if camera is None or camera.sensor.polarizers is None:
        return sensor, None
    if scene.ignore_polarization or not is_polarized():
        return sensor, None
    behind = sensor_class(mitsuba().variant())(sensor, PolarizerRays(camera))
    return behind, polarizer_fingerprint(camera)


class PolarizerRays:
    """Rays of another sensor behind the polariser of their pixel."""

    def __init__(self, camera: Camera) -> None:
        mi, dr = mitsuba(), drjit()
        double_angles = 2 * np.radians(np.array(camera.sensor.polarizers, dtype=float))
        axes = np.stack([np.cos(double_angles), np.sin(double_angles)], axis=-1)
        every_pixel = {
            "filter_mode": dr.FilterMode.Nearest,
            "wrap_mode": dr.WrapMode.Repeat,
            "use_accel": False,
        }
        self._axes = mi.Texture2f(mi.TensorXf(axes.astype(np.float32)), **every_pixel)
        self._per_row, self._per_column = (1.0 / period for period in double_angles.shape)
        self._contrast = ContrastTable(camera)

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return the ray of the inner sensor, and its weight times the first row of the polariser's Mueller matrix."""
        mi, dr = mitsuba(), drjit()
        ray, weight = sensor.inner_ray(samples, active)
        _, _, on_film, _ = samples
        column, row = dr.floor(on_film.x) + 0.5, dr.floor(on_film.y) + 0.5
        place = mi.Point2f(column * self._per_column, row * self._per_row)
        cosine, sine = self._axes.eval(place)
        to_s1, to_s2 = _turned(sensor, ray, cosine, sine)
        passed = mi.unpolarized_spectrum(weight)
        polarized = passed * self._contrast.at(ray.wavelengths)
        matrix = dr.zeros(mi.Spectrum)
        matrix[0, 0], matrix[0, 1], matrix[0, 2] = passed, polarized * to_s1, polarized * to_s2
        return ray, matrix


def _turned(
    sensor: MitsubaObject, ray: MitsubaObject, cosine: Array, sine: Array
) -> tuple[Array, Array]:
    """Return (cos 2θ, sin 2θ) of an axis, rotated from the frame of the sensor to the Stokes frame of the ray."""
    mi, dr = mitsuba(), drjit()
    to_world = sensor.world_transform()
    up, right = to_world @ mi.Vector3f(0, 1, 0), to_world @ mi.Vector3f(-1, 0, 0)
    towards = -ray.d
    of_ray, first = mi.mueller.stokes_basis(towards), dr.normalize(dr.cross(ray.d, up))
    is_mirrored = dr.dot(dr.cross(right, up), towards) < 0
    anticlockwise = dr.select(is_mirrored, -sine, sine)
    cos_angle, sin_angle = dr.dot(of_ray, first), dr.dot(towards, dr.cross(of_ray, first))
    cos_twice = cos_angle * cos_angle - sin_angle * sin_angle
    sin_twice = 2 * cos_angle * sin_angle
    return (
        cosine * cos_twice - anticlockwise * sin_twice,
        cosine * sin_twice + anticlockwise * cos_twice,
    )


class ContrastTable:
    """(τ_max − τ_min)/(τ_max + τ_min) of the polarisers by wavelength, interpolated linearly."""

    def __init__(self, camera: Camera) -> None:
        mi, dr = mitsuba(), drjit()
        points_nm, values = camera.quantum_efficiency.wavelengths_nm, contrast(camera)
        self._constant = dr.opaque(mi.Float, float(values[0])) if np.ptp(values) == 0 else None
        if self._constant is not None:
            return
        nodes_nm = np.arange(points_nm[0], points_nm[-1] + STEP_NM, STEP_NM)
        table = np.interp(nodes_nm, points_nm, values).astype(np.float32)[:, None]
        self._first_nm, self._count = points_nm[0], len(nodes_nm)
        self._table = mi.Texture1f(mi.TensorXf(table), use_accel=False)

    def at(self, wavelengths_nm: Array) -> Array:
        """Return the contrast at the wavelengths of a ray."""
        if self._constant is not None:
            return self._constant
        values = []
        for wavelength_nm in wavelengths_nm:
            node = (wavelength_nm - self._first_nm) / STEP_NM
            values.append(self._table.eval((node + 0.5) / self._count)[0])
        return mitsuba().UnpolarizedSpectrum(*values)
