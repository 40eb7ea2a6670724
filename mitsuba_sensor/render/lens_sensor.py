"""A Mitsuba sensor that images through the camera's lens: it wraps the scene's own sensor.

The scene's sensor keeps film, sampler, pose and parameters; a change through ``mi.traverse`` of either of the two
sensors changes both. A measured distortion displaces the rays of the scene's own pinhole or thin lens (distorted
projection); a prescription traces its own (:mod:`.sequential_lens`).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Float64Array, InputError
from ..core.llvm import drjit
from ..optics.distortion import Distortion, distortion_of
from ..optics.intrinsics import View, image_distance_m
from ..sensor.camera import Camera
from .sequential_lens import SequentialLens
from .variants import MitsubaObject, mitsuba

TOLERANCE_PX = 0.005  # of the interpolated displacement of a distorted projection
COARSEST, FINEST = 32, 1024  # cells of its table along a side


def with_lens(
    sensor: MitsubaObject, view: View, camera: Camera | None, unit_m: float
) -> tuple[MitsubaObject, View, tuple[str, ...]]:
    """The scene's sensor behind the camera's lens, its view, and notes about the differences.

    Sensor and view are unchanged if the lens has neither distortion nor prescription.
    sensor : built by Mitsuba, perspective or thinlens.  unit_m : metres per scene unit.
    Raises InputError where the lens and the scene's sensor cannot be combined.
    """
    if camera is None:
        return sensor, view, ()
    lens: SequentialLens | DistortedProjection
    if camera.lens.prescription is not None:
        if view.half_width == 0:
            raise InputError(
                "lens.prescription is given and the scene's sensor is orthographic; take a perspective or thinlens "
                "sensor."
            )
        lens = SequentialLens(camera, view, unit_m)
        view, notes = lens.view, _prescription_notes(camera.lens.prescription.name, view, lens)
    else:
        distortion = distortion_of(camera.lens, image_distance_m(view, camera) * 1e3)
        if distortion is None:
            return sensor, view, ()
        lens, notes = DistortedProjection(distortion, view), []
    if mitsuba().variant().startswith("scalar"):
        notes.append("the lens is computed in Python here, 0.1 ms per ray; an llvm variant is as fast as without it")
    return _lens_sensor_class(mitsuba().variant())(sensor, lens), view, tuple(notes)


def _prescription_notes(name: str, view: View, lens: SequentialLens) -> list[str]:
    """What the prescription determines instead of the scene.  view : the scene's own."""
    wide, was = (2 * math.degrees(math.atan(v.half_width)) for v in (lens.view, view))
    focus = "infinity" if math.isinf(lens.view.focus_m) else f"{lens.view.focus_m:g} m"
    notes = [
        f"the lens {name!r} determines the field of view, {wide:.3g} degrees across instead of the scene's "
        f"{was:.3g}, and the blur; it is focused at {focus}"
    ]
    if lens.lit_mm < lens.highest_mm:
        notes.append(
            f"no light comes through the lens to image heights above {lens.lit_mm:.3g} mm; "
            f"the sensor's corner is at {lens.highest_mm:.3g} mm"
        )
    return notes


@cache
def _lens_sensor_class(variant: str) -> MitsubaObject:
    """The sensor's class; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Sensor

    class LensSensor(base):  # type: ignore[misc]
        """inner : the scene's own sensor.  lens : samples rays at positions on the full film [pixels]."""

        def __init__(self, inner: MitsubaObject, lens: SequentialLens | DistortedProjection) -> None:
            props = mi.Properties(inner.class_name())
            props["film"], props["sampler"] = inner.film(), inner.sampler()
            super().__init__(props)
            self.inner, self.lens = inner, lens
            self.m_needs_sample_2 = self.m_needs_sample_3 = True

        def to_crop(self, position: Array) -> Array:
            """Pixels of the full film → fractions of the crop."""
            size, corner = self._crop()
            return mi.Point2f((position.x - corner.x) / size.x, (position.y - corner.y) / size.y)

        def _crop(self) -> tuple[Array, Array]:
            """Size and corner of the crop, as data: strips of rows share one compiled kernel."""
            film = self.film()
            size, corner = (
                mi.Vector2f(*(dr.opaque(mi.Float, float(n)) for n in pair))
                for pair in (film.crop_size(), film.crop_offset())
            )
            return size, corner

        def sample_ray(
            self, time: Array, wavelength: Array, position: Array, aperture: Array, active: Array = True
        ) -> tuple[MitsubaObject, Array]:
            size, corner = self._crop()
            on_film = mi.Point2f(position.x * size.x + corner.x, position.y * size.y + corner.y)
            return self.lens.sample(self, (time, wavelength, on_film, aperture), active)

        def sample_ray_differential(self, *samples: Array) -> tuple[MitsubaObject, Array]:
            ray, weight = self.sample_ray(*samples)
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
    """For each real position on the film, the ray of its ideal position, from a table over the whole film."""

    def __init__(self, distortion: Distortion, view: View) -> None:
        mi = mitsuba()
        self._size = view.size
        self._cells, table = _displacement_table(distortion, view)
        self._displacement = mi.Texture2f(mi.TensorXf(table), use_accel=False)

    def sample(
        self, sensor: MitsubaObject, samples: tuple[Array, Array, Array, Array], active: Array
    ) -> tuple[MitsubaObject, Array]:
        """The scene's own ray, and its weight, for the position without distortion.

        samples : time, wavelength sample, position on the film [pixels], and aperture sample.
        """
        time, wavelength, position, aperture = samples
        scale = self._cells / (self._cells + 1)
        at = [p / n * scale + (0.5 / (self._cells + 1)) for p, n in zip(position, self._size, strict=True)]
        dx, dy = self._displacement.eval(type(position)(*at), active)
        ideal = type(position)(position.x + dx, position.y + dy)
        ray, weight = sensor.inner.sample_ray(time, wavelength, sensor.to_crop(ideal), aperture, active)
        return ray, weight


def _displacement_table(distortion: Distortion, view: View) -> tuple[int, NDArray[np.float32]]:
    """Cells along a side, and ideal minus real position, (cells + 1, cells + 1, 2) [pixels].

    The table is as fine as needed for bilinear interpolation to be within TOLERANCE_PX at the centre of every cell.
    """
    cells = COARSEST
    table = _displacement(distortion, view, 2 * cells)
    while cells < FINEST:
        corners = table[::2, ::2]
        middle = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
        if np.abs(middle - table[1::2, 1::2]).max() <= TOLERANCE_PX:
            break
        cells *= 2
        table = _displacement(distortion, view, 2 * cells)
    return cells, table[::2, ::2].astype(np.float32)


def _displacement(distortion: Distortion, view: View, cells: int) -> Float64Array:
    """Ideal minus real position on a grid over the whole film, (cells + 1, cells + 1, 2) [pixels]."""
    (width, height), (axis_x, axis_y), scale = view.size, view.axis, view.tangent_per_pixel
    at = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(width * at - axis_x, height * at - axis_y)
    u, v, _ = distortion.ideal(scale * x, scale * y)
    return np.stack([u / scale - x, v / scale - y], axis=-1)
