"""The light of one half of the pupil: what one photodiode of a dual pixel sees.

A thin lens maps its two random numbers to the disk of its aperture such that the first one, below or above a half, says
on which side of the vertical diameter a ray passes. A ray of half the numbers has half the weight: the halves add up to
the whole. Of a prescription those rays are seen that cross the plane of the exit pupil on that side (lens_sensor.py).
"""

from __future__ import annotations

from ...camera.camera import Camera
from ...core import Array, InputError
from ...optics.intrinsics import View
from ..scene.parsed_scene import ParsedScene
from ..scene.scene_settings import SENSOR
from ..variants import MitsubaObject, mitsuba
from .lens_sensor import IN_PYTHON, Samples, sensor_class

FIRST_NUMBER = {"left": 0.5, "right": 0.0}
"""Where the half of the first number begins: Mitsuba's cameras have x to the left."""


class HalfPupil:
    """Rays of another sensor through one half of its aperture.  half : "left" or "right", as the camera looks."""

    def __init__(self, half: str) -> None:
        self._first = FIRST_NUMBER[half]

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """The other sensor's ray and half its weight."""
        mi = mitsuba()
        time, wavelength, on_film, aperture = samples
        through = mi.Point2f(self._first + 0.5 * aperture.x, aperture.y)
        ray, weight = sensor.inner_ray((time, wavelength, on_film, through), active)
        return ray, 0.5 * weight


def with_half_pupil(
    sensor: MitsubaObject, view: View, camera: Camera | None
) -> tuple[MitsubaObject, tuple[str, ...]]:
    """The sensor with the half of the pupil that the camera's lens has, and notes; unchanged for a whole one. Raises
    InputError for a pinhole."""
    if camera is None:
        return sensor, ()
    half = camera.lens.half_pupil
    if view.aperture_radius_m == 0:
        _refuse_halves_of_a_pinhole(camera)
    if half is None:  # each half of dual pixels is loaded by itself
        return sensor, ()
    notes = [half_note(half)]
    if view.sequential:  # whose rays are those of the half already
        return sensor, tuple(notes)
    if mitsuba().variant().startswith("scalar"):
        notes.append(IN_PYTHON)
    return sensor_class(mitsuba().variant())(sensor, HalfPupil(half)), tuple(notes)


def half_note(half: str) -> str:
    """The note of a render of one half."""
    return f"the light of the {half} half of the pupil alone (lens.half_pupil)"


def check_halves(scene: ParsedScene, camera: Camera) -> None:
    """Raise InputError for a scene file whose sensor is a pinhole, and a camera that sees halves of the pupil."""
    kind = scene.sensor().props.plugin_name()
    is_thin_lens = kind == "thinlens" or (
        kind == SENSOR and scene.settings.focus_distance_m is not None
    )
    if not is_thin_lens and camera.lens.prescription is None:
        _refuse_halves_of_a_pinhole(camera)


def _refuse_halves_of_a_pinhole(camera: Camera) -> None:
    """Raise InputError where a camera sees halves of the pupil."""
    if camera.sensor.dual_pixel:
        asked = "sensor.dual_pixel is true"
    elif camera.lens.half_pupil is not None:
        asked = f"lens.half_pupil is {camera.lens.half_pupil!r}"
    else:
        return
    raise InputError(
        f"{asked}, for the halves of a pupil, and the scene's sensor is a pinhole; take a thinlens sensor in the "
        "scene, give lens.prescription, or omit it."
    )
