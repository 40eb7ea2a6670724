"""Error of a render against its wall time: sampler, samples per pass, variant, banding; plain, spent and denoised."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError, require
from ...core.exposure import Exposure
from ...core.signals import Photons
from ...render.denoise import library
from ...render.variants import use
from ..page import Progress
from ..side import Side, later
from ..timing import Step, take_steps
from . import choice as render_choice
from .errors import Blocks, Judge, Run
from .frames import Framed, framed
from .page import page
from .parts import Found
from .reference import REFERENCE_S, Truth, reference, reference_photons, sources, truth_of
from .results import MEASURES, Result
from .series import Banding, Opened, Setting, Subject, settings, usable_variants

if TYPE_CHECKING:
    from ...sensor.camera import Camera

RUN_S = 2.5
"""Seconds that the passes of one run may take: so long is its ladder."""
FEWEST_PASSES, FEWEST_FRAMED, MOST_PASSES = 4, 32, 256
"""Of a run: three rungs; two sizes of blocks of which frames are drawn; nine rungs, more than enough for a slope."""
PILOT = 2
"""Passes that tell the time of one, after the first has compiled."""
COMPILE_S, JUDGING = 6.0, 1.4
"""Seconds until the first pass of a setting; seconds of a run over those of its passes. Cornell box, two cores."""
CHECKS = 3
"""Renders of the recommended words, with more samples after each that missed."""


def render_side(
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
    done: MutableMapping[str, Any],
    progress: Progress,
) -> Side:
    """Errors and seconds of every way to render this scene for this camera.

    tolerance : relative rms error of the electrons of a pixel, over the picture, for which words are recommended.
    seeds : independent runs of each setting, 2 … 64; their spread makes the intervals.
    parameters, scene_unit, columns : as for :func:`render.irradiance.render`.
    variants : of Mitsuba, the first with all settings; by default every spectral one that works here.
    done : what is measured already, by key; new measurements are added.
    Raises InputError for a variant that is not there, and for what :func:`render.irradiance.render` would refuse.
    """
    require("tolerance", tolerance, 1e-6, 1.0, "relative error, e.g. 0.01")
    if require("seeds", seeds, 2, 64, "independent runs, e.g. 4") != int(seeds):
        raise InputError(f"seeds is {seeds!r}; it must be a whole number of runs (e.g. 4).")
    study = _Study(Subject(scene, camera, exposure, parameters, scene_unit, columns), variants, done, progress)
    results = study.measure(int(seeds))
    found = Found(results, study.references, tolerance, usable_variants(None)[0].name, study.smooth)
    study.check(found)
    use(study.variants[0])  # the last one was another
    return page(found)


def light_for_frames(
    scene: str | os.PathLike[str],
    camera: Camera,
    exposure: Exposure,
    *,
    parameters: Mapping[str, Any] | None = None,
    variants: Sequence[str] | None = None,
    scene_unit: str | float | None = None,
    columns: int | None = None,
    done: MutableMapping[str, Any],
) -> Photons:
    """The light that the sensor side exposes: the reference, rendered for it where the journal has none yet."""
    subject = Subject(scene, camera, exposure, parameters, scene_unit, columns)
    setting = Setting(usable_variants(variants)[0].name)
    key = _reference_key(setting)
    if key not in done:
        done[key] = reference(subject, setting)
    return reference_photons(subject, done[key])


class _Study:
    """The measurements, in their order."""

    def __init__(
        self, subject: Subject, variants: Sequence[str] | None, done: MutableMapping[str, Any], progress: Progress
    ) -> None:
        self.subject, self._done, self._progress = subject, done, progress
        self.variants = usable_variants(variants)
        self._base = Setting(self.variants[0].name)
        bands = subject.ready(self._base).bands
        channels = bands.kind == "cube" and subject.camera.quantum_efficiency.quantum_yield is None
        self.settings = settings(self._base, self.variants, bands, channels)
        kinds = {one.banding for one in self.settings}
        self._references = [replace(self._base, banding=kind) for kind in ("auto", "cube", "channels") if kind in kinds]
        self.smooth = _has_denoiser()
        self._opened: tuple[str, Opened] | None = None
        self._spent_s = 0.0

    @property
    def references(self) -> dict[str, dict[str, Any]]:
        """As the journal has them, by banding."""
        return {one.banding: self._done[_reference_key(one)] for one in self._references}

    def measure(self, seeds: int) -> list[Result]:
        """References, ladders, runs; what is not in the journal yet."""
        first = [*map(self._reference, self._references), *map(self._pilot, self.settings)]
        self._take(first, after_s=len(self.settings) * seeds * RUN_S)
        self._take([step for one in self.settings for step in self._runs(one, seeds)])
        return [self._result(one, seeds) for one in self.settings]

    def _take(self, steps: list[Step], after_s: float = 0.0) -> None:
        """Take these steps; so many seconds are expected after them."""

        def told(spent_s: float, expected_s: float, words: str) -> None:
            self._total_s = spent_s
            self._progress(spent_s, expected_s, words)

        take_steps(steps, self._done, later(told, self._spent_s, after_s))
        self._spent_s = self._total_s

    def _reference(self, setting: Setting) -> Step:
        def measure() -> dict[str, Any]:
            cube = setting.banding == "cube"  # on the scale of the errors that it is taken off
            return reference(self.subject, setting, self._truth("auto").scale if cube else None)

        return Step(_reference_key(setting), REFERENCE_S + COMPILE_S, f"reference: {setting.banding}", measure)

    def _pilot(self, setting: Setting) -> Step:
        words = f"first passes: {setting.label(self._base)}"
        return Step(_ladder_key(setting), COMPILE_S, words, partial(self._ladder, setting))

    def _runs(self, setting: Setting, seeds: int) -> list[Step]:
        ladder = self._done[_ladder_key(setting)]
        seconds = JUDGING * ladder["passes"] * ladder["pass_s"]
        words = f"{setting.label(self._base)}, {ladder['passes']} passes"
        return [
            Step(_run_key(setting, run), seconds, f"{words}, run {run} of {seeds}", partial(self._run, setting, run))
            for run in range(1, seeds + 1)
        ]

    def _truth(self, banding: Banding) -> Truth:
        """What a banding is held against, as far as the references are there."""
        keys = {one.banding: _reference_key(one) for one in self._references}
        there = {kind: self._done[key] for kind, key in keys.items() if key in self._done}
        return truth_of(self.subject, there, banding)

    def _open(self, setting: Setting) -> Opened:
        """The setting, compiled; the last one is kept, and no other."""
        if self._opened is None or self._opened[0] != setting.key:
            self._opened = None
            opened = self.subject.ready(setting)
            opened.warm()
            self._opened = setting.key, opened
        return self._opened[1]

    def _ladder(self, setting: Setting) -> dict[str, Any]:
        """What a pass costs, how many passes a run has, a power of two, and at which exposure frames are drawn."""
        seconds: list[float] = []
        began = time.perf_counter()
        opened = self.subject.ready(setting)
        opened.each_pass(0, 1, lambda s, *_: seconds.append(s))
        first_s = time.perf_counter() - began
        opened.each_pass(0, PILOT, lambda s, *_: seconds.append(s))
        pass_s = min(seconds[1:])
        passes = 2 ** max(math.floor(math.log2(max(RUN_S / pass_s, 1.0))), 0)
        drawn = setting in (self._base, replace(self._base, banding="channels"))
        passes = int(np.clip(passes, FEWEST_FRAMED if drawn else FEWEST_PASSES, MOST_PASSES))
        return {
            "samples": opened.samples,
            "groups": opened.groups,
            "samples_per_pass": opened.samples_per_pass,
            "first_s": max(first_s - pass_s, 0.0),
            "pass_s": pass_s,
            "passes": passes,
            "framed": framed(self.subject, opened, self._truth(setting.banding), passes).to_dict() if drawn else None,
        }

    def _run(self, setting: Setting, run: int) -> dict[str, Any]:
        """All errors of one run."""
        opened, ladder = self._open(setting), self._done[_ladder_key(setting)]
        plan = Run(run, ladder["passes"], Framed.from_dict(ladder["framed"]), self.smooth and setting == self._base)
        judge = Judge(self.subject, opened, self._truth(setting.banding), plan)
        opened.each_pass(run, plan.passes, Blocks(judge.block).take)
        return judge.to_dict()

    def _result(self, setting: Setting, seeds: int) -> Result:
        of_electrons, of_bands = sources(self.references, setting.banding)
        return Result(
            setting,
            setting.label(self._base),
            self._done[_ladder_key(setting)],
            [self._done[_run_key(setting, run)] for run in range(1, seeds + 1)],
            {name: (of_bands if name == "irradiance" else of_electrons)[name] for name in MEASURES},
        )

    def check(self, found: Found) -> None:
        """Render with the recommended words until they keep the tolerance; then they are what is recommended."""
        if not found.choices or found.choices[0].seconds > render_choice.CHECK_S:
            return
        choice, own = found.choices[0], self.references
        for _ in range(CHECKS):
            truth = self._truth(choice.spectral)
            square = sources(own, choice.spectral)[0]["electrons"]
            key, words = f"render check {choice.words}", f"check: {choice.words}"
            measure = partial(render_choice.checked, self.subject, choice, truth, square)
            self._take([Step(key, 2 * choice.seconds + COMPILE_S, words, measure)])
            found.checks.append((choice, self._done[key]))
            if self._done[key]["error"] <= found.tolerance:
                return
            choice = render_choice.corrected(choice, self._done[key]["error"], found.tolerance)


def _has_denoiser() -> bool:
    try:
        library()
    except InputError:
        return False
    return True


def _reference_key(setting: Setting) -> str:
    return f"render reference {setting.variant} {setting.banding}"


def _ladder_key(setting: Setting) -> str:
    return f"render ladder {setting.key}"


def _run_key(setting: Setting, run: int) -> str:
    return f"render run {setting.key} {run}"
