"""The kit of all studies: their subject, steps that are measured once, tasks timed in turns."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

from ..files.texts import read_toml

Array = NDArray[np.float64]
Values = dict[str, Any]
"""Measured values by name."""

Task = Callable[[], object]
"""Something to be timed; an integer that it returns says how often it did its work."""


def read_table(path: Path) -> Values:
    """Settings and cases of a study, from the TOML file beside its code."""
    return read_toml(path)


@dataclass(frozen=True, eq=False)
class Subject:
    """Scene, camera and exposure of a study; options as in :func:`mitsuba_sensor.render`."""

    scene: str | os.PathLike[str]
    camera: ms.Camera
    exposure: ms.Exposure
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.camera.readouts:
            names = ", ".join(readout.name for readout in self.camera.readouts)
            raise ms.InputError(
                f"{self.camera.name} has the read-outs {names}, and a study is of one; "
                "take one of them by its name, from camera.at_readout (--readout)."
            )

    def render(
        self, seed: int, camera: ms.Camera | None = None, **options: Any
    ) -> ms.Irradiance:
        """One render, perhaps of another camera or with other options."""
        asked = {**self.options, **options}
        return ms.render(self.scene, camera or self.camera, self.exposure, seed=seed, **asked)


class Step(NamedTuple):
    """One measurement.

    key : its name, also for the progress bar.  seconds : that it takes, in proportion to other steps.
    measure : gives its value.
    """

    key: str
    seconds: float
    measure: Callable[[], Any]


Progress = Callable[[str, float], object]
"""Told the step that begins, and the share of the work that is done."""


class Kit:
    """Measures what is not measured yet, and tells how much of it is done.

    known : (value, seconds that it took) by key; as files (output/measurements.py), they let a stopped study go on.
    progress : told before each step.  clock : in seconds.  new : steps that were measured here.
    """

    def __init__(
        self,
        known: Values | None = None,
        progress: Progress | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.known = {} if known is None else known
        self.new = 0
        self._clock = clock
        self._done_s = 0.0
        self._progress = progress

    def __getitem__(self, key: str) -> Any:
        """A value that is measured already."""
        return self.known[key][0]

    @property
    def seconds(self) -> float:
        """Seconds that all measurements took, also those of runs before this one."""
        return float(sum(seconds for _, seconds in self.known.values()))

    @property
    def longest_step(self) -> str:
        """The name of the step that took most time, and its seconds."""
        key = max(self.known, key=lambda name: float(self.known[name][1]), default="")
        if key:
            return f"{key} ({self.known[key][1]:.1f} s)"
        return ""

    def take(self, steps: Iterable[Step], later: Sequence[Step] = ()) -> None:
        """Measure every step that is not known yet, in order.  later : steps of the study behind these."""
        waiting = [step for step in steps if step.key not in self.known]
        left_s = sum(step.seconds for step in [*waiting, *later] if step.key not in self.known)
        for step in waiting:
            self._tell(step.key, left_s)
            started = self._clock()
            value = step.measure()
            self.known[step.key] = value, self._clock() - started
            self._done_s += step.seconds
            left_s -= step.seconds
            self.new += 1
        self._tell("done", left_s)

    def measure(self, key: str, seconds: float, measure: Callable[[], Any]) -> Any:
        """The value of one step."""
        self.take([Step(key, seconds, measure)])
        return self[key]

    def _tell(self, now: str, left_s: float) -> None:
        if self._progress is not None:
            whole_s = self._done_s + left_s
            self._progress(now, self._done_s / whole_s if whole_s else 1.0)


def time_one_turn(tasks: Mapping[str, Task], number: int) -> dict[str, float]:
    """Seconds of every task's work, in an order of its own for every turn: no task always follows the same one."""
    names = list(tasks)
    seconds = {}
    for place in np.random.default_rng(number).permutation(len(names)):
        name = names[place]
        started = time.perf_counter()
        runs = tasks[name]()
        taken = time.perf_counter() - started
        seconds[name] = taken / runs if isinstance(runs, int) else taken
    return seconds


def time_in_turns(tasks: Mapping[str, Task], turns: int) -> dict[str, list[float]]:
    """Seconds of every task in each turn, after one that compiles and does not count.

    A machine that slows down between turns slows all tasks alike.
    """
    counted = [time_one_turn(tasks, number) for number in range(turns + 1)][1:]
    return {name: [seconds[name] for seconds in counted] for name in tasks}


def resized(photons: ms.Photons, shape: tuple[int, int]) -> ms.Photons:
    """The light on a window of another size, each pixel that of the nearest; taken as exact."""
    sizes = zip(photons.mean.shape[:2], shape, strict=True)
    rows, columns = (
        np.linspace(0, there - 1, here).round().astype(int) for there, here in sizes
    )
    mean = np.ascontiguousarray(photons.mean[rows][:, columns])
    return photons.changed(mean=mean, in_band=None, origin=(0, 0))


def measured_moments(sensors: Sequence[NDArray[np.unsignedinteger]]) -> Array:
    """Mean, temporal and spatial variance of the frames of each sensor, averaged over the pixels, (3, S) [DN, DN²].

    sensors : frames of each, (N, H, W). Spatial is the squared distance of a pixel from its mean over all sensors, less
    what temporal noise adds.
    """
    digital = np.array(sensors)
    means, temporal = digital.mean(axis=1), digital.var(axis=1, ddof=1).mean(axis=(1, 2))
    spatial = spatial_variances(means) - temporal / digital.shape[1]
    return np.stack([means.mean(axis=(1, 2)), temporal, spatial])


def spatial_variances(means: Array) -> Array:
    """Squared distance of each sensor's pixels from their mean over all sensors, averaged, (S,).  means : (S, H, W)."""
    squares = (means - means.mean(axis=0)) ** 2
    unbiased: Array = squares.mean(axis=(1, 2)) * len(means) / (len(means) - 1)
    return unbiased


def pixel_difference(frame: NDArray[np.number], reference: NDArray[np.number]) -> Values:
    """How far a frame is from another one with equal random bits: share of the pixels, largest and rms step [DN]."""
    step = np.abs(frame.astype(np.float64) - reference)
    rms_dn = float(np.sqrt(np.mean(step**2)))
    return {
        "share_of_pixels": float(np.mean(step > 0)),
        "largest_dn": float(step.max()),
        "rms_dn": rms_dn,
    }
