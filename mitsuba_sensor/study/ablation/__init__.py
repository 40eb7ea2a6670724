"""``study ablation``: each noise source and each feature of the render off in turn, beside the seconds saved."""

from __future__ import annotations

from pathlib import Path

import mitsuba_sensor as ms

from ...pages.page import Study, study_of
from ..kit import Kit, Step, Subject
from .render import RenderAblation, Rendered, render_section
from .sensor import Moments, SensorAblation, SensorResults, sensor_section

RECORDS: tuple[type, ...] = (Moments, Rendered)
"""Classes that its measurements consist of."""

FEWEST_SAMPLES = 8
"""Two passes in each of four renders: the second is timed."""


def ablation(
    kit: Kit,
    subject: Subject,
    *,
    tolerance_dn: float = 0.02,
    frames: int = 8,
    seed: int = 1,
    serial: int = 1,
) -> Study:
    """What each noise source and each feature does to the picture, by its laws and in frames, and what it costs.

    kit : measures, and knows what is measured already.  tolerance_dn : of the plan that is put to the test [DN].
    frames : of each of 8 sensors, at least 2.  seed, serial : of the first frame and the first sensor.
    Raises InputError.
    """
    spp = subject.options.get("spp", 32)
    if frames < 2:
        raise ms.InputError(
            f"frames is {frames}; a sensor needs at least 2 frames to show temporal noise, e.g. 8."
        )
    if spp < FEWEST_SAMPLES:
        raise ms.InputError(
            f"spp is {spp}; the study compares parts of the render: ask for {FEWEST_SAMPLES} or more."
        )
    render = RenderAblation(kit, subject, spp, seed)
    sensor = SensorAblation(kit, subject, render.light, tolerance_dn, (frames, seed, serial))
    sensor_steps = list(sensor.steps())
    kit.take([Step("loading the scene", 5.0, render.scene)], sensor_steps)
    kit.take([*render.steps(), *sensor_steps])
    sections = sensor_section(SensorResults(sensor), sensor), render_section(render.changes())
    scene, camera, exposure = kit["loading the scene"], subject.camera, subject.exposure
    about = f"{scene['columns']} × {scene['rows']} pixels, {exposure.time_s:g} s, {exposure.temperature_k:g} K"
    title = f"What can be left out: {Path(subject.scene).stem}, {camera.name} ({about})"
    return study_of("ablation", title, sections)
