"""The light of one half-pupil, which one photodiode of a dual pixel sees.

A thin lens maps two random numbers to the disk of its aperture; the first number, below or above one half, determines
the side of the vertical diameter. A ray with half the range of numbers has half the weight, so the halves add up to the
whole. With a prescription, rays must cross the plane of the exit pupil on this side (lens_sensor.py).
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
"""Start of the range of the first number: the x axis of Mitsuba's cameras points to the left."""


class HalfPupil:
    """Rays of another sensor through one half of its aperture.  half : "left" or "right", seen from the camera."""

    def __init__(self, half: str) -> None:
        self._first = FIRST_NUMBER[half]

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return the ray of the inner sensor, and half its weight."""
        mi = mitsuba()
        time, wavelength, on_film, aperture = samples
        through = mi.Point2f(self._first + 0.5 * aperture.x, aperture.y)
        ray, weight = sensor.inner_ray((time, wavelength, on_film, through), active)
        return ray, 0.5 * weight


def with_half_pupil(
    sensor: MitsubaObject, view: View, camera: Camera | None
) -> tuple[MitsubaObject, tuple[str, ...]]:
    """Return the sensor with the half-pupil of the camera's lens, and notes; unchanged for a whole pupil. Raises
    InputError for a pinhole."""
    if camera is None:
        return sensor, ()
    half = camera.lens.half_pupil
    if view.aperture_radius_m == 0:
        _refuse_halves_of_a_pinhole(camera)
    if half is None:  # each half of dual pixels is loaded separately
        return sensor, ()
    notes = [half_note(half)]
    if view.sequential:  # its rays already pass the half
        return sensor, tuple(notes)
    if mitsuba().variant().startswith("scalar"):
        notes.append(IN_PYTHON)
    return sensor_class(mitsuba().variant())(sensor, HalfPupil(half)), tuple(notes)


def half_note(half: str) -> str:
    """Return the note on a render of one half."""
    return f"only the light of the {half} half of the pupil (lens.half_pupil)"


def check_halves(scene: ParsedScene, camera: Camera) -> None:
    """Raise InputError for a scene with a pinhole sensor and a camera that needs halves of the pupil."""
    kind = scene.sensor().props.plugin_name()
    is_thin_lens = kind == "thinlens" or (
        kind == SENSOR and scene.settings.focus_distance_m is not None
    )
    if not is_thin_lens and camera.lens.prescription is None:
        _refuse_halves_of_a_pinhole(camera)


def _refuse_halves_of_a_pinhole(camera: Camera) -> None:
    """Raise InputError if a camera needs halves of the pupil."""
    if camera.sensor.dual_pixel:
        field = "sensor.dual_pixel is true"
    elif camera.lens.half_pupil is not None:
        field = f"lens.half_pupil is {camera.lens.half_pupil!r}"
    else:
        return
    raise InputError(
        f"{field}, for the halves of a pupil, and the scene's sensor is a pinhole; take a thinlens sensor in the "
        "scene, give lens.prescription, or omit this field."
    )
