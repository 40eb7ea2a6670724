"""What lint says of chief rays and microlenses: how much less the corner of the picture gets."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ...camera.camera import Camera
from ...optics.f_number_law import chief_ray_deg, microlens_deg, slant_response
from ...optics.intrinsics import View
from ..scene.scene_file import SceneFile
from .finding import Finding

SEEN = 0.02
"""Loss of the corner that is worth a finding."""


def microlens_findings(scene: SceneFile, view: View, camera: Camera) -> Iterator[Finding]:
    """The farthest corner, where the chief ray is not that of the microlenses. Raises InputError where a table ends."""
    if camera.pixel.angular_response is None:
        return
    reach = []
    for axis, first, count in zip(view.axis, view.crop_offset, view.crop_size, strict=True):
        reach.append(max(axis - first, first + count - axis))
    height_mm = np.array([math.hypot(*reach) * camera.pixel.pitch_x_um * 1e-3])
    chief = float(chief_ray_deg(view, camera, height_mm)[0])
    made_for = float(microlens_deg(camera, height_mm)[0])
    response = float(slant_response(view, camera, height_mm)[0])
    if response > 1 - SEEN:
        return
    what = (
        f"the chief ray of the corner comes at {chief:.3g} degrees, its microlens is made for {made_for:.3g}, and its "
        f"pixel has {response:.3g} of the response"
    )
    remedy = "the picture has it; pixel.microlens_cra_deg and lens.pupil_magnification say for which angles"
    yield Finding("note", scene.where(scene.sensor()), what, remedy)
