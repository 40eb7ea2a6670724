"""A Mitsuba sensor that looks through the camera's lens: it stands before the scene's own sensor.

The scene's sensor keeps film, sampler, pose and parameters; whoever changes them through ``mi.traverse``, of this
sensor or of that one, changes both.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.llvm import drjit
from ..optics.distortion import distortion_of
from ..optics.f_number_law import image_distance_m
from .distorted_projection import DistortedProjection
from .sequential_lens import SequentialLens
from .variants import mitsuba

if TYPE_CHECKING:
    from ..optics.f_number_law import View
    from ..sensor.camera import Camera


def put_lens(sensor: Any, view: View, camera: Camera | None, unit_m: float) -> tuple[Any, View, tuple[str, ...]]:
    """The scene's sensor behind the camera's lens, what it sees, and notes about what is different now.

    Sensor and view are as they were if the lens bends nothing. sensor : built by Mitsuba, perspective or thinlens.
    unit_m : metres per scene unit. Raises InputError where the lens and the scene's sensor do not go together.
    """
    mi, notes = mitsuba(), []
    if camera is None:
        return sensor, view, ()
    if camera.lens.prescription is not None:
        lens = traced = SequentialLens(mi, camera, _checked(view), unit_m)
        notes += _traced_notes(view, traced, camera)
        seen = traced.view
    else:
        distortion = distortion_of(camera.lens, image_distance_m(view, camera) * 1e3)
        if distortion is None:
            return sensor, view, ()
        lens, seen = DistortedProjection(mi, distortion, view), view
    if mi.variant().startswith("scalar"):
        notes.append("the lens works in Python here, 0.1 ms for every ray; an llvm variant is as fast as without it")
    return _through(mi.variant())(sensor, lens), seen, tuple(notes)


def _checked(view: View) -> View:
    if view.half_width == 0:
        raise InputError(
            "lens.prescription is given and the scene's sensor is orthographic; take a perspective or thinlens sensor."
        )
    return view


def _traced_notes(view: View, traced: SequentialLens, camera: Camera) -> list[str]:
    """What the lens decides instead of the scene."""
    prescription, seen = camera.lens.prescription, traced.view
    assert prescription is not None
    wide, was = (2 * math.degrees(math.atan(v.half_width)) for v in (seen, view))
    focus = "infinity" if math.isinf(seen.focus_m) else f"{seen.focus_m:g} m"
    notes = [
        f"the lens {prescription.name!r} decides the field of view, {wide:.3g} degrees across instead of the scene's "
        f"{was:.3g}, and the blur; it is focused on {focus}"
    ]
    if traced.lit_mm < traced.highest_mm:
        notes.append(
            f"no light comes through the lens to image heights above {traced.lit_mm:.3g} mm; "
            f"the sensor's corner is at {traced.highest_mm:.3g} mm"
        )
    return notes


@cache
def _through(variant: str) -> Any:
    """The sensor's class; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant

    class Through(mi.Sensor):  # type: ignore[misc]
        """inner : the scene's own sensor.  lens : makes rays of places on the full film [pixels]."""

        def __init__(self, inner: Any, lens: SequentialLens | DistortedProjection) -> None:
            props = mi.Properties(inner.class_name())
            props["film"], props["sampler"] = inner.film(), inner.sampler()
            super().__init__(props)
            self.inner, self.lens = inner, lens
            self.m_needs_sample_2 = self.m_needs_sample_3 = True

        def to_crop(self, place: Any) -> Any:
            """Pixels of the full film → fractions of the part that is rendered."""
            size, corner = self._crop()
            return mi.Point2f((place.x - corner.x) / size.x, (place.y - corner.y) / size.y)

        def _crop(self) -> tuple[Any, Any]:
            """Size and corner of what is rendered, as data: strips of rows share one compiled kernel."""
            film = self.film()
            return tuple(
                mi.Vector2f(*(dr.opaque(mi.Float, float(n)) for n in pair))
                for pair in (film.crop_size(), film.crop_offset())
            )

        def sample_ray(self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any = True) -> Any:
            size, corner = self._crop()
            place = mi.Point2f(position.x * size.x + corner.x, position.y * size.y + corner.y)
            return self.lens.sample(self, (time, wavelength, place, aperture), active)

        def sample_ray_differential(self, *samples: Any) -> Any:
            ray, weight = self.sample_ray(*samples)
            return mi.RayDifferential3f(ray), weight

        def world_transform(self) -> Any:
            return self.inner.world_transform()

        def traverse(self, callback: Any) -> None:
            self.inner.traverse(callback)

        def parameters_changed(self, keys: Any = ()) -> None:
            self.inner.parameters_changed(list(keys))
            super().parameters_changed(list(keys))

    return Through
