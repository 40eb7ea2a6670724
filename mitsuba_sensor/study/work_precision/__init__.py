"""``study work-precision``: error against run time, of the light that is rendered and of the frames made from it."""

from __future__ import annotations

import os
from collections.abc import Sequence

import mitsuba_sensor as ms

from ...pages.page import Study, study_of
from ..kit import Kit, Subject
from .render import Light, Render
from .render_page import render_section
from .results import Rung
from .sensor import Sensor
from .sensor_page import sensor_section

SIDES = ("render", "sensor")
RECORDS: tuple[type, ...] = (Light, Rung)
"""Classes that its measurements consist of."""


def work_precision(
    kit: Kit,
    subject: Subject,
    *,
    tolerance: float = 0.01,
    seeds: int = 4,
    variants: Sequence[str] | None = None,
    sides: Sequence[str] = SIDES,
) -> Study:
    """What an error costs, of a render and of the frames.

    kit : measures, and knows what is measured already.  sides : "render", "sensor" or both.
    tolerance : relative rms error of the electrons of a pixel, over the picture, for which options are recommended.
    seeds : independent runs of each setting; their spread makes the intervals.
    variants : of Mitsuba, the first with all settings; by default those that work here.
    Raises InputError for a variant that is not there, and for what :func:`mitsuba_sensor.render` would refuse.
    """
    if isinstance(sides, str) or not sides or set(sides) - set(SIDES):
        raise ms.InputError(
            f"sides is {sides!r}; it must be one or both of {', '.join(SIDES)}."
        )
    render, sections = Render(kit, subject, tolerance, seeds, variants), []
    sensor = Sensor(kit, subject, render.photons)
    if "sensor" in sides:
        sensor_steps = sensor.steps()
    else:
        sensor_steps = []
    if "render" in sides:
        render.measure(sensor_steps)
        sections.append(render_section(render))
    if "sensor" in sides:
        kit.take(sensor_steps)
        sections.append(sensor_section(sensor))
    title = f"Error against run time: {os.path.basename(subject.scene)}, {subject.camera.name}"
    return study_of("work-precision", title, sections)
