"""Error of the sensor's frames against their time: engine × precision × tolerance of the plan."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

from ...lab.statistics.estimators import ratio, spread, standard_error
from ..kit import (
    Array,
    Kit,
    Step,
    Subject,
    Values,
    measured_moments,
    pixel_difference,
    resized,
    time_one_turn,
)
from .render import SETTINGS

TURNS = 7
LARGE, SMALL = (1024, 1024), (128, 128)
"""Frames that are timed and compared pixel by pixel; frames whose moments are measured."""

SENSORS, FRAMES = 16, 2
"""Serial numbers, and frames of each."""

SIGNIFICANT = 4.0
"""Standard errors that a change may be beyond a tolerance by chance, in so many comparisons."""

LEAST_DN = 1e-5
"""No change below this is told apart: 0 has no place on a logarithmic axis."""

FRAMES_A_TURN = 8
Frames = Iterator[NDArray[np.unsignedinteger]]


class FrameSetting(NamedTuple):
    """One way to make frames.  tolerance_dn : of the plan [DN], or None for the whole chain."""

    engine: str
    precision: str
    tolerance_dn: float | None = None

    @property
    def name(self) -> str:
        """For measurements, tables and people."""
        if self.tolerance_dn is None:
            plan = ""
        else:
            plan = f", plan {self.tolerance_dn:g} DN"
        return f"{self.engine} {self.precision}{plan}"


REFERENCE = FrameSetting("numpy", "float64")
"""All others are compared with it: the whole chain, every count exact."""


class Sensor:
    """A camera in a scene's light, and what a kit measures of its frames.  light : renders it, when it is needed."""

    def __init__(self, kit: Kit, subject: Subject, light: Callable[[], ms.Photons]) -> None:
        self.kit, self.subject, self._light = kit, subject, cache(light)
        self._windows: dict[tuple[int, int], ms.Photons] = {}
        self._plans: dict[tuple[float, tuple[int, int]], ms.Plan] = {}
        self._streams: dict[str, Frames] = {}

    @cached_property
    def problems(self) -> dict[str, str]:
        """Engines that are not here, and why."""
        problems = {}
        for engine, *_ in SETTINGS["sensor"]["settings"]:
            try:
                ms.expose(
                    np.ones((1, 1)), self.subject.camera, self.subject.exposure, engine=engine
                )
            except ms.InputError as error:
                problems[engine] = str(error)
        return problems

    @cached_property
    def settings(self) -> list[FrameSetting]:
        """The whole chain on every engine that is here, and every plan."""
        settings = []
        for engine, precision, tolerances in SETTINGS["sensor"]["settings"]:
            if engine not in self.problems:
                settings += [FrameSetting(engine, precision, dn) for dn in (None, *tolerances)]
        return settings

    def steps(self) -> list[Step]:
        """All measurements."""
        steps = [
            Step(f"first frame: {one.name}", 1.0, partial(self.first, one))
            for one in self.settings
        ]
        steps += [
            Step(turn_key(turn), 2.0, partial(self.turn, turn)) for turn in range(TURNS + 1)
        ]
        steps += [
            Step(f"pixels: {one.name}", 2.0, partial(self.pixels, one)) for one in self.settings
        ]
        steps += [
            Step(f"moments: {one.name}", 1.0, partial(self.moments, one))
            for one in self.settings
        ]
        return steps

    def photons(self, shape: tuple[int, int]) -> ms.Photons:
        """The scene's light on a window of this size."""
        if shape not in self._windows:
            self._windows[shape] = resized(self._light(), shape)
        return self._windows[shape]

    def options(self, setting: FrameSetting, shape: tuple[int, int]) -> dict[str, Any]:
        """Options of an exposure; plans are made once."""
        options: dict[str, Any] = {"engine": setting.engine, "precision": setting.precision}
        dn = setting.tolerance_dn
        if dn is None:
            return options
        if (dn, shape) not in self._plans:
            plan = ms.plan(self.subject.camera, self.subject.exposure, self.photons(shape), dn)
            assert isinstance(plan, ms.Plan)  # of a camera with one read-out
            self._plans[dn, shape] = plan
        return {**options, "plan": self._plans[dn, shape]}

    def stream(self, setting: FrameSetting) -> Frames:
        """Frames of the large window, as long as they are asked for."""
        options = self.options(setting, LARGE)
        return ms.stream(
            self.photons(LARGE),
            self.subject.camera,
            self.subject.exposure,
            frames=2**31,
            **options,
        )

    def first(self, setting: FrameSetting) -> float:
        """Seconds until the first frame: light, maps and, unless it is compiled already, the kernel."""
        self.options(setting, LARGE)
        started = time.perf_counter()
        self._streams[setting.name] = self.stream(setting)
        next(self._streams[setting.name])
        return time.perf_counter() - started

    def turn(self, number: int) -> dict[str, float]:
        """Seconds of a frame of each setting; a compiled engine makes several, the next while one is computed."""
        tasks = {}
        for setting in self.settings:
            if setting.name not in self._streams:  # resumed: its first frame was timed before
                self.first(setting)
            count = FRAMES_A_TURN
            if setting.engine == "numpy":
                count = 1
            tasks[setting.name] = partial(take_frames, self._streams[setting.name], count)
        return time_one_turn(tasks, number)

    def pixels(self, setting: FrameSetting) -> Values:
        """One frame against the reference's with equal random bits; and against NumPy's in the same precision."""
        digital = next(self.stream(setting))
        on_numpy = next(self.stream(setting._replace(engine="numpy")))
        share_of_numpy = pixel_difference(digital, on_numpy)["share_of_pixels"]
        return {
            **pixel_difference(digital, next(self.stream(REFERENCE))),
            "share_of_numpy": share_of_numpy,
        }

    def moments(self, setting: FrameSetting) -> Array:
        """Mean, temporal and spatial variance of the frames of each sensor, averaged over the pixels, (3, sensors)."""
        options, values, spatial_mean = self.options(setting, SMALL), [], None
        for serial in range(1, SENSORS + 1):
            asked = {**options, "frames": FRAMES, "serial": serial, "seed": serial}
            frames = ms.expose(
                self.photons(SMALL), self.subject.camera, self.subject.exposure, **asked
            )
            if spatial_mean is None:  # of all sensors
                spatial_mean = frames.spatial_mean
            values.append(measured_moments(frames, spatial_mean).mean(axis=(1, 2)))
        return np.array(values).T


def turn_key(turn: int) -> str:
    """The name of one turn, the first of which compiles and does not count."""
    return f"frames of every setting, turn {turn} of {TURNS}"


def take_frames(frames: Frames, count: int) -> int:
    """So many frames of a stream; how many."""
    for _ in range(count):
        next(frames)
    return count


class Row:
    """One setting: its seconds, its pixels, and how far its moments are from those of others.

    change_dn, error_dn : of mean, temporal σ and spatial σ from the reference, (3,).
    """

    def __init__(self, sensor: Sensor, setting: FrameSetting) -> None:
        kit, whole = sensor.kit, setting._replace(tolerance_dn=None)
        turns = [kit[turn_key(turn + 1)] for turn in range(TURNS)]
        self.setting, self.first_s = setting, float(kit[f"first frame: {setting.name}"])
        self.seconds: list[float] = [turn[setting.name] for turn in turns]
        self.ns = spread(1e9 * one / math.prod(LARGE) for one in self.seconds)
        self.faster = ratio([turn[REFERENCE.name] for turn in turns], self.seconds)
        pairs = zip(self.seconds, (turn[whole.name] for turn in turns), strict=True)
        self.saved = spread(1 - mine / theirs for mine, theirs in pairs)
        self.pixels: dict[str, float] = kit[f"pixels: {setting.name}"]
        moments = [kit[f"moments: {one.name}"] for one in (setting, REFERENCE, whole)]
        self.change_dn, self.error_dn = change_of_moments(moments[0], moments[1])
        self.plan_change_dn, self.plan_error_dn = change_of_moments(moments[0], moments[2])

    @property
    def worst_dn(self) -> float:
        """The largest change from the reference, or what can be told."""
        return max(float(np.abs(self.change_dn).max()), LEAST_DN)

    def keeps(self, tolerance_dn: float) -> bool:
        """Whether every change from the reference is at most the tolerance, as far as the sensors can tell."""
        return bool(
            (np.abs(self.change_dn) <= tolerance_dn + SIGNIFICANT * self.error_dn).all()
        )


def change_of_moments(found: Array, other: Array) -> tuple[Array, Array]:
    """Changes of mean, temporal σ and spatial σ with standard errors, (3,), from moments (3, sensors).

    √a − √b = (a − b)/(√a + √b); where a variance is not resolved, its root is at least that of its standard error.
    """
    off = found - other
    value = off.mean(axis=1)
    error = np.apply_along_axis(standard_error, 1, off)
    roots = np.sqrt(np.maximum(found[1:].mean(axis=1), 0.0)) + np.sqrt(
        np.maximum(other[1:].mean(axis=1), 0.0)
    )
    least = np.sqrt(np.maximum(np.maximum(np.abs(value[1:]), error[1:]), np.finfo(float).tiny))
    unit = np.concatenate([np.ones_like(value[:1]), np.maximum(roots, least)])
    return value / unit, error / unit
