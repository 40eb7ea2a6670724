"""Error of the sensor's frames against their time: engine × precision × sampler × tolerance of the plan."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from ...core.errors import require
from ...core.exposure import Exposure
from ...core.llvm import drjit
from ...core.signals import Photons
from ...sensor.camera import Camera
from ...sensor.checks import as_photons
from ..page import Progress
from ..side import Side
from ..timing import Step, one_turn, take_steps
from . import results as sensor_results
from .frames import (
    DEVICES,
    LARGE,
    REFERENCE,
    SMALL,
    Chains,
    difference,
    measured,
    plan_settings,
    planned,
    predicted,
)  # fmt: skip
from .page import page
from .poisson_law import law_of, law_of_counts
from .samplers import GAUSSIAN, GENERATOR, MEAN_ONLY, QUANTILE, Setting, draws_of, problem_of

ENGINES = ("numpy", "drjit", "cuda")

MEANS = (0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e6)
"""Of the Poisson laws that are judged [events]."""

TURNS = 9
"""In each of which every setting makes frames."""

FRAMES_A_TURN = {"numpy": 1, "drjit": 8, "cuda": 8}
"""A compiled engine traces a frame while it computes the one before: several together show what a stream costs."""

ENDLESS = 2**31
"""More frames than any turn takes."""

DRAWS = 2**21
"""Draws of a third party's generator for each mean."""

EXPECTED_NS = {"numpy float64": 450.0, "numpy float32": 120.0, "drjit float32": 15.0, "cuda float32": 2.0}
"""Per pixel, on two cores of an AMD EPYC: for the estimate before anything is measured."""

BAND_NS = 3.0
"""Per pixel and band, where NumPy detects the light anew for every frame: for the same estimate."""

OPENING_S, THEORY_S, LAW_S = 0.5, 0.1, 0.1
"""Of a stream's kernel and maps, of the moments of a chain, and of one Poisson law: for the same estimate."""


def sensor_side(
    photons: Photons,
    camera: Camera,
    exposure: Exposure,
    *,
    tolerances_dn: Sequence[float] = (0, 0.02, 0.2, 1, 5),
    done: MutableMapping[str, Any],
    progress: Progress,
) -> Side:
    """Errors and nanoseconds per pixel of every way to make this camera's frames under this light.

    photons : mean photons of the scene, as :func:`collect` makes them; a render's variance in them is left out.
    tolerances_dn : of the plans that are tried [DN], each 0 or more.
    done : what is measured already, by key; new measurements are added.
    Raises InputError for photons that ``expose`` would refuse and for a negative tolerance.
    """
    tolerances = [require("tolerances_dn", float(x), 0.0, float("inf"), "e.g. 0.02") for x in tolerances_dn]
    chains = Chains(camera, exposure, as_photons(photons, camera))
    for tolerance_dn in tolerances:
        if (key := sensor_results.plan_key(tolerance_dn)) not in done:
            done[key] = planned(chains, tolerance_dn)
    if sensor_results.ENGINES_KEY not in done:
        done[sensor_results.ENGINES_KEY] = {engine: problem_of(engine) for engine in ENGINES}
    here = [engine for engine in ENGINES if done[sensor_results.ENGINES_KEY][engine] is None]
    settings = all_settings(here, {x: done[sensor_results.plan_key(x)]["precision"] for x in tolerances})
    streams = Streams(chains)
    try:
        take_steps(list(steps(chains, settings, streams)), done, progress)
    finally:
        streams.close()
    return page(sensor_results.gather(done, settings, tolerances, MEANS, TURNS), done)


def all_settings(here: list[str], precisions: dict[float, str]) -> list[Setting]:
    """Every engine and sampler with the whole chain, then every plan. precisions : of the plans by their tolerance."""
    samplers = [Setting(engine, "float32", sampler) for sampler in (QUANTILE, GAUSSIAN, MEAN_ONLY) for engine in here]
    plans = [one for dn, precision in precisions.items() for one in plan_settings(dn, precision, here)]
    return [REFERENCE, *samplers, Setting("numpy", "float32", GENERATOR), *plans]


class Streams:
    """Frames of every setting, kept open from turn to turn, so that kernels and maps are made once."""

    def __init__(self, chains: Chains) -> None:
        self._chains = chains
        self._open: dict[str, Iterator[Any]] = {}

    def first(self, setting: Setting) -> float:
        """Seconds until the first frame: light, maps and, unless Dr.Jit has it already, the kernel."""
        start = time.perf_counter()
        self._open[setting.name] = self._chains.frames(setting, ENDLESS)
        next(self._open[setting.name])
        return time.perf_counter() - start

    def turn(self, number: int, settings: list[Setting]) -> dict[str, float]:
        """Seconds of a frame of each, in an order of its own for every turn: no setting always follows the same."""
        for setting in settings:
            if setting.name not in self._open:  # resumed: its first frame was timed before
                self.first(setting)
        order = np.random.default_rng(number).permutation(len(settings))
        return one_turn({settings[i].name: partial(self._some, settings[i]) for i in order})

    def _some(self, setting: Setting) -> int:
        """The next frames. What a kernel has begun is waited for: nobody works in another's turn."""
        count = FRAMES_A_TURN[setting.engine]
        for _ in range(count):
            next(self._open[setting.name])
        if setting.compiled:
            drjit().sync_thread()
        return count

    def close(self) -> None:
        """Let threads and maps go."""
        while self._open:
            self._open.popitem()[1].close()  # type: ignore[attr-defined]


def steps(chains: Chains, settings: list[Setting], streams: Streams) -> Iterator[Step]:
    """All that is measured, in order; what is timed comes first, while no other work has warmed a kernel."""
    keys, frame_s = sensor_results, partial(_seconds, chains, LARGE)
    for setting in settings:
        yield Step(
            keys.first_key(setting), OPENING_S + frame_s(setting), f"first frame: {setting.name}",
            partial(streams.first, setting),
        )  # fmt: skip
    turn_s = sum(FRAMES_A_TURN[setting.engine] * frame_s(setting) for setting in settings)
    for turn in range(TURNS):
        words = f"turn {turn + 1} of {TURNS}, a frame of {len(settings)} settings each"
        yield Step(keys.turn_key(turn, settings), turn_s, words, partial(streams.turn, turn, settings))
    yield from error_steps(chains, settings)
    yield from law_steps(settings)


def error_steps(chains: Chains, settings: list[Setting]) -> Iterator[Step]:
    """Frames against the reference: pixels with equal words, moments, and what theory says of them."""
    keys = sensor_results
    for tolerance_dn in dict.fromkeys(setting.tolerance_dn for setting in settings):
        measure: Callable[[], Any] = partial(predicted, chains, tolerance_dn)
        yield Step(keys.theory_key(tolerance_dn), THEORY_S, "moments in theory", measure)
    for setting in settings:
        if setting.sampler != GENERATOR:  # its draws do not come from the words
            measure = partial(difference, chains, setting)
            seconds = 2 * _seconds(chains, LARGE, setting)
            yield Step(keys.difference_key(setting), seconds, f"pixels: {setting.name}", measure)
        if not setting.compiled:
            measure = partial(measured, chains, setting)
            seconds = 2 * DEVICES * _seconds(chains, SMALL, setting)
            yield Step(keys.moments_key(setting), seconds, f"moments: {setting.name}", measure)


def law_steps(settings: list[Setting]) -> Iterator[Step]:
    """The law of every sampler and engine at every mean."""
    for setting in settings:
        if setting.tolerance_dn is None:
            for mean in MEANS:
                words = f"Poisson law, mean {mean:g}: {setting.name}"
                yield Step(sensor_results.law_key(setting, mean), LAW_S, words, partial(judged, setting, mean))


def judged(setting: Setting, mean: float) -> dict[str, Any]:
    """The law that a sampler draws at a mean [events], rounded to float32: every engine is given the same."""
    held, backend = float(np.float32(mean)), setting.backend()
    if setting.sampler == GENERATOR:
        words = np.random.default_rng(1).integers(0, 2**32, DRAWS, dtype=np.uint32)
        return asdict(law_of_counts(draws_of(backend, words, held), held))
    return asdict(law_of(lambda words: draws_of(backend, words, held), held))


def _seconds(chains: Chains, shape: tuple[int, int], setting: Setting) -> float:
    """Expected for one frame."""
    mean = chains.photons.mean
    bands = 0 if mean.ndim == 2 or setting.compiled else mean.shape[2]
    return 1e-9 * (EXPECTED_NS[f"{setting.engine} {setting.precision}"] + BAND_NS * bands) * shape[0] * shape[1]
