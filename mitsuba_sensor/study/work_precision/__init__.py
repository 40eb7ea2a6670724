"""``study work-precision``: error against run time, of the light that is rendered and of the frames made from it."""

from __future__ import annotations

import os
from collections.abc import Sequence

from ...core import InputError
from ..kit import Kit
from ..page import Study, study_of
from ..subject import Subject
from .render import Render
from .render_page import render_section
from .sensor import Results, Sensor
from .sensor_page import sensor_section

SIDES = ("render", "sensor")


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
    seeds : independent runs of each setting, 2 … 64; their spread makes the intervals.
    variants : of Mitsuba, the first with all settings; by default every spectral one that works here.
    Raises InputError for a variant that is not there, and for what :func:`mitsuba_sensor.render` would refuse.
    """
    if isinstance(sides, str) or not sides or set(sides) - set(SIDES):
        raise InputError(f"sides is {sides!r}; it must be one or both of {', '.join(SIDES)}.")
    render, sections = Render(kit, subject, tolerance, seeds, variants), []
    if "render" in sides:
        render.measure()
        sections.append(render_section(render))
    if "sensor" in sides:
        sensor = Sensor(kit, subject, render.photons())
        sensor.measure()
        sections.append(sensor_section(Results(sensor)))
    title = f"Error against run time: {os.path.basename(subject.scene)}, {subject.camera.name}"
    return study_of("work-precision", title, sections)
