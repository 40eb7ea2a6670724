"""The kit of all studies: their subject, steps measured once, tasks timed in turns."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Exposure, check_types
from ..render.light.irradiance import Irradiance
from ..render.passes.passes import SAMPLER
from ..render.passes.prepared import PreparedRender, prepare, render
from ..sensor.camera import Camera

Array = NDArray[np.float64]
Numbers = NDArray[Any]  # of any type, digital numbers for example
Values = dict[str, Any]  # measured values by name
Known = Mapping[str, Any]  # the same for reading
Progress = Callable[[float, float, str], None]  # told seconds of work done, seconds expected in all, and what is next
Task = Callable[[], object]  # something to be timed; an integer that it returns says how often it did its work


@dataclass(frozen=True, eq=False)
class Subject:
    """What a study of a scene is about: fields and options by name as in :func:`mitsuba_sensor.render`."""

    scene: str | os.PathLike[str]
    camera: Camera
    exposure: Exposure
    options: Known = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_types(self.camera, self.exposure)

    @cached_property
    def job(self) -> PreparedRender:
        """The scene as it is."""
        return self.job_with()

    def job_with(self, camera: Camera | None = None, sampler: str = SAMPLER, **options: Any) -> PreparedRender:
        """The scene, loaded for another camera, with another sampler or with other options."""
        return prepare(self.scene, camera or self.camera, self.exposure, sampler=sampler, **{**self.options, **options})

    def render(self, seed: int, **options: Any) -> Irradiance:
        """One render, with these options changed."""
        return render(self.scene, self.camera, self.exposure, seed=seed, **{**self.options, **options})


class Step(NamedTuple):
    """One measurement: its name, also for the progress bar; the seconds expected; what gives its value."""

    key: str
    seconds: float
    measure: Callable[[], Any]


class Kit:
    """Measures what is not measured yet, and says how long that will take. new : how many it measured itself.

    known : (value, seconds that it took) by key; as files (output/measurements.py), they let a stopped study go on."""

    def __init__(self, known: Values | None = None, progress: Progress | None = None) -> None:
        self.known = {} if known is None else known
        self.new, self._taken_s, self._progress = 0, 0.0, progress or (lambda *_: None)

    def __getitem__(self, key: str) -> Any:
        """A value that is measured already."""
        return self.known[key][0]

    @property
    def seconds(self) -> float:
        """Taken by all measurements, also by the runs before this one."""
        return float(sum(seconds for _, seconds in self.known.values()))

    def take(self, steps: Iterable[Step], after_s: float = 0.0) -> None:
        """Measure every step that is not known yet, in order. after_s : expected of the study behind these steps."""
        left = [step for step in steps if step.key not in self.known]
        before_s, expected_s = self._taken_s, 0.0
        for number, step in enumerate(left):
            pace = (self._taken_s - before_s) / expected_s if expected_s else 1.0  # of the steps so far
            rest_s = pace * sum(one.seconds for one in left[number:])
            self._progress(self._taken_s, self._taken_s + rest_s + after_s, step.key)
            started = time.perf_counter()
            value = step.measure()
            seconds = time.perf_counter() - started
            self.known[step.key] = value, seconds
            self.new, self._taken_s, expected_s = self.new + 1, self._taken_s + seconds, expected_s + step.seconds
        self._progress(self._taken_s, self._taken_s + after_s, "done")

    def measure(self, key: str, seconds: float, measure: Callable[[], Any]) -> Any:
        """One step, and its value."""
        self.take([Step(key, seconds, measure)])
        return self[key]


def one_turn(tasks: Mapping[str, Task], number: int) -> dict[str, float]:
    """Seconds of every task's work, in an order of its own for every turn: no task always follows the same one."""
    names, seconds = list(tasks), {}  # a machine that slows down between turns slows all tasks alike
    for place in np.random.default_rng(number).permutation(len(names)):
        start = time.perf_counter()
        runs = tasks[names[place]]()
        seconds[names[place]] = (time.perf_counter() - start) / (runs if isinstance(runs, int) else 1)
    return seconds


def in_turns(tasks: Mapping[str, Task], turns: int) -> dict[str, list[float]]:
    """Seconds of every task in each of so many turns, after one that compiles and does not count."""
    _, *counted = (one_turn(tasks, number) for number in range(turns + 1))
    return {name: [seconds[name] for seconds in counted] for name in tasks}
