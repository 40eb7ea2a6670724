"""Shared by the studies: subject, steps with progress, times in turns, moments of frames, and files."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

from ..core.versions import machine, versions
from ..files.appearing import output_folder, require_folder, write_drawing
from ..files.texts import write_json, write_page
from ..lab.statistics.estimators import standard_error
from ..pages.drawing import png
from ..pages.html_page import html
from ..pages.page import Study, Table

Array = NDArray[np.float64]
Options = dict[str, Any]
"""Options of a render, an exposure or a camera file, by name."""
Task = Callable[[], object]
"""A task to time; an integer result is the number of repetitions of its work."""
Progress = Callable[[str, float], object]
"""Called with the step that begins and the fraction of the work done."""

PAGE, NUMBERS = "study.html", "study.json"
QUANTITIES = "mean", "temporal σ", "spatial σ"


@dataclass(frozen=True, eq=False)
class Subject:
    """Scene, camera and exposure of a study.  options : of :func:`mitsuba_sensor.render`."""

    scene: str | os.PathLike[str]
    camera: ms.Camera
    exposure: ms.Exposure
    options: Options = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.camera.readouts:
            names = ", ".join(readout.name for readout in self.camera.readouts)
            raise ms.InputError(
                f"{self.camera.name} has the readouts {names}, and a study measures one of them; choose it with "
                "camera.at_readout."
            )

    def render(
        self, seed: int, camera: ms.Camera | None = None, **options: Any
    ) -> ms.Irradiance:
        """Render once, optionally for another camera or with other options."""
        asked = {**self.options, "progress": False, **options}
        return ms.render(self.scene, camera or self.camera, self.exposure, seed=seed, **asked)

    def photons(self, light: ms.Irradiance) -> ms.Photons:
        """Return the photons of one exposure to this light."""
        return ms.collect(light, self.camera, self.exposure)


def measured(steps: Mapping[str, Callable[[], Any]], progress: Progress) -> dict[str, Any]:
    """Run the steps and return their values by name."""
    values = {}
    for number, (name, measure) in enumerate(steps.items()):
        progress(name, number / len(steps))
        values[name] = measure()
    progress("done", 1.0)
    return values


def time_in_turns(tasks: Mapping[str, Task], turns: int) -> dict[str, list[float]]:
    """Return the seconds of each task in each turn, after one uncounted turn that compiles.

    The order changes between turns, so no task always follows the same task, and a slower machine slows all of them.
    """
    names, seconds = list(tasks), {name: list[float]() for name in tasks}
    for turn in range(turns + 1):
        for place in np.random.default_rng(turn).permutation(len(names)):
            started = time.perf_counter()
            runs = tasks[names[place]]()
            taken = time.perf_counter() - started
            if turn:
                seconds[names[place]].append(taken / (runs if isinstance(runs, int) else 1))
    return seconds


def moments(frames: Sequence[NDArray[np.unsignedinteger]]) -> Array:
    """Return mean, temporal and spatial variance of each sensor unit, averaged over the pixels, (3, S) [DN, DN²].

    The spatial variance is a pixel's squared distance from its mean over all units, minus the temporal contribution.
    frames : of each sensor unit, (N, H, W).
    """
    digital = np.array(frames, np.float64)
    means, temporal = digital.mean(axis=1), digital.var(axis=1, ddof=1).mean(axis=(1, 2))
    squares = np.square(means - means.mean(axis=0)).mean(axis=(1, 2))
    spatial = squares * len(means) / (len(means) - 1) - temporal / digital.shape[1]
    return np.stack([means.mean(axis=(1, 2)), temporal, spatial])


def change_of_moments(found: Array, other: Array) -> tuple[Array, Array]:
    """Return the changes of mean, temporal σ and spatial σ and their standard errors, (3,) each.

    √a − √b = (a − b)/(√a + √b). The root of an unresolved variance is at least the root of its standard error.
    found, other : moments (3, S) of the same sensor units.
    """
    off = found - other
    value, error = off.mean(axis=1), np.array([standard_error(row) for row in off])
    roots = sum(np.sqrt(np.maximum(one[1:].mean(axis=1), 0.0)) for one in (found, other))
    least = np.sqrt(np.maximum(np.maximum(np.abs(value[1:]), error[1:]), np.finfo(float).tiny))
    unit = np.array([1.0, *np.maximum(roots, least)])
    return value / unit, error / unit


def run_study(
    folder: Path,
    study: Callable[[Progress], Study],
    about: Mapping[str, object],
    progress: Progress = lambda now, share: None,
    every_picture: bool = False,
) -> Study:
    """Run a study and write its page, its numbers and its first picture, or every picture."""
    require_folder(folder)
    began, load = time.perf_counter(), "unknown"
    if hasattr(os, "getloadavg"):  # not on Windows
        load = f"{os.getloadavg()[0]:.1f} processes were running when the study began"
    outcome = study(progress)
    made: dict[str, object] = {"machine": machine(), "load": load, "versions": versions()}
    made["seconds"] = round(time.perf_counter() - began, 1)
    outcome = replace(outcome, data={**outcome.data, **about, **made})
    pictures = [part for part in outcome.parts if not isinstance(part, Table)]
    files = {
        f"{outcome.name}-{number}.png" if number > 1 else f"{outcome.name}.png": picture
        for number, picture in enumerate(pictures if every_picture else pictures[:1], start=1)
    }
    with output_folder(folder, [PAGE, NUMBERS, *files]) as scratch:
        write_page(scratch / PAGE, html(outcome))
        write_json(scratch / NUMBERS, outcome.to_dict())
        for name, picture in files.items():
            write_drawing(scratch / name, png(picture))
    return outcome
