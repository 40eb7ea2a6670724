"""Work-precision diagrams: error against run time, of the light and of the sensor."""

from __future__ import annotations

import os
from collections.abc import Mapping, MutableMapping, Sequence
from typing import TYPE_CHECKING, Any

from ..core.checks import check_types
from ..core.errors import InputError
from ..core.exposure import Exposure
from .page import Progress, Study
from .render.measure import light_for_frames, render_side
from .side import Side, later

if TYPE_CHECKING:
    from ..sensor.camera import Camera

SIDES = ("render", "sensor")
SENSOR_S = 60.0
"""Expected of the sensor side before it has said what it expects."""


def error_time(
    scene: str | os.PathLike[str],
    camera: Camera,
    exposure: Exposure,
    *,
    tolerance: float = 0.01,
    seeds: int = 4,
    parameters: Mapping[str, Any] | None = None,
    variants: Sequence[str] | None = None,
    scene_unit: str | float | None = None,
    columns: int | None = None,
    sides: Sequence[str] = SIDES,
    done: MutableMapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Study:
    """What an error costs, of the light that is rendered and of the frames that are made from it.

    tolerance, seeds, parameters, variants, scene_unit, columns : see :func:`study.render.measure.render_side`.
    sides : "render", "sensor" or both.
    done : what is measured already, by key; new measurements are added, so that a study can go on where it stopped.
    progress : called with seconds spent, seconds expected in all, and what is done now.
    Raises InputError.
    """
    check_types(camera, exposure)
    if isinstance(sides, str) or not sides or set(sides) - set(SIDES):
        raise InputError(f"sides is {sides!r}; it must be one or both of {', '.join(SIDES)}.")
    journal = {} if done is None else done
    tell = progress or (lambda done_s, expected_s, words: None)
    clock = _Clock(tell)
    words: dict[str, Any] = {
        "parameters": parameters, "variants": variants, "scene_unit": scene_unit, "columns": columns
    }  # fmt: skip
    found: list[Side] = []
    if "render" in sides:
        after_s = SENSOR_S if "sensor" in sides else 0.0
        found.append(
            render_side(
                scene, camera, exposure, tolerance=tolerance, seeds=seeds, done=journal,
                progress=later(clock.tell, 0.0, after_s), **words,
            )
        )  # fmt: skip
    if "sensor" in sides:
        from .sensor.measure import sensor_side

        photons = light_for_frames(scene, camera, exposure, done=journal, **words)
        found.append(
            sensor_side(photons, camera, exposure, done=journal, progress=later(clock.tell, clock.spent_s, 0.0))
        )
    return Study(
        "error-time",
        f"Error against run time: {os.path.basename(scene)}, {camera.name}",
        tuple(finding for side in found for finding in side.findings),
        all(side.passed for side in found),
        tuple(part for side in found for part in side.parts),
        {key: value for side in found for key, value in side.data.items()},
    )


class _Clock:
    """Hands progress on and remembers how much was spent."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self.spent_s = progress, 0.0

    def tell(self, spent_s: float, expected_s: float, words: str) -> None:
        """As a study calls it."""
        self.spent_s = spent_s
        self._progress(spent_s, expected_s, words)
