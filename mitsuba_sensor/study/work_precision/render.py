"""Error of a render against its wall time: sampler, samples per pass, variant, banding; noise on top or compensated."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...core.errors import InputError, require
from ...core.signals import Photons
from ...render.denoise import library
from ...render.variants import use
from ..kit import Kit, Step
from ..subject import Subject
from .choice import Choice, checked, choices, corrected
from .errors import Run
from .per_frame import frame_exposure
from .reference import REFERENCE_S, Reference, Target, render_reference
from .render_results import Ladder, Result
from .series import Series, Setting, all_settings, loaded, usable_variants

RUN_S = 2.5  # seconds that the passes of one run may take: so long is its ladder
FEWEST_PASSES, FEWEST_FRAMED, MOST_PASSES = 4, 32, 256
"""Of a run: three rungs; two sizes of blocks of which frames are made; nine rungs, more than enough for a slope."""
PILOT = 2  # passes that tell the time of one, after the first has compiled
COMPILE_S, COMPARING = 6.0, 1.4
"""Seconds until the first pass of a setting; seconds of a run over those of its passes. Cornell box, two cores."""
CHECK_S = 15.0  # A recommendation that takes longer is not checked
CHECKS = 3  # renders of the recommended options, with more samples after each that missed


class Render:
    """Every way to render this scene for this camera, and what a kit measures of them.

    tolerance : relative rms error of the electrons of a pixel, over the picture, for which options are recommended.
    seeds : independent runs of each setting, 2 … 64; their spread makes the intervals.
    variants : of Mitsuba, the first with all settings; by default every spectral one that works here.
    Raises InputError for a variant that is not there, and for what :func:`mitsuba_sensor.render` would refuse.
    """

    def __init__(
        self, kit: Kit, subject: Subject, tolerance: float, seeds: int, variants: Sequence[str] | None = None
    ) -> None:
        self.tolerance = require("tolerance", tolerance, 1e-6, 1.0, "relative error, e.g. 0.01")
        if require("seeds", seeds, 2, 64, "independent runs, e.g. 4") != int(seeds):
            raise InputError(f"seeds is {seeds!r}; it must be a whole number of runs (e.g. 4).")
        self.kit, self._subject, self._seeds = kit, subject, int(seeds)
        self._variants = usable_variants(variants)
        self._base = Setting(self._variants[0].name)
        self.smooth = denoiser_is_here()
        self.checks: list[tuple[Choice, dict[str, float]]] = []
        self._open: tuple[Setting, Series] | None = None

    def photons(self) -> Photons:
        """The light that the sensor side exposes: that of the reference."""
        self.kit.take([self._reference(self._base)])
        light: Photons = self.kit[f"reference: {self._base.banding}"].photons
        return light

    def measure(self) -> None:
        """References, ladders, runs and checks: what is not measured yet."""
        bands = loaded(self._subject, self._base).bands
        channels = bands.kind == "cube" and self._subject.camera.quantum_efficiency.quantum_yield is None
        self.settings = all_settings(self._base, self._variants, bands, channels)
        own = [one for one in self.settings if one in (self._base, *self._bandings("cube", "channels"))]
        after_s = len(self.settings) * self._seeds * RUN_S
        self.kit.take([*map(self._reference, own), *map(self._pilot, self.settings)], after_s)
        self.references: dict[str, Reference] = {one.banding: self.kit[f"reference: {one.banding}"] for one in own}
        self.kit.take(step for one in self.settings for step in self._runs(one))
        self.results = [self._result(one) for one in self.settings]
        self.choices = choices(self.results, self.tolerance, usable_variants(None)[0].name)
        self._check()
        use(self._variants[0])  # the last one was another

    def _bandings(self, *kinds: str) -> list[Setting]:
        return [replace(self._base, banding=kind) for kind in kinds]

    def _reference(self, setting: Setting) -> Step:
        def measure() -> Reference:
            auto = setting.banding != "cube"  # which is on the scale of the errors that it is taken off
            return render_reference(self._subject, setting, None if auto else self._target("auto").scale)

        return Step(f"reference: {setting.banding}", REFERENCE_S + COMPILE_S, measure)

    def _pilot(self, setting: Setting) -> Step:
        return Step(f"first passes: {setting.key}", COMPILE_S, partial(self._ladder, setting))

    def _runs(self, setting: Setting) -> list[Step]:
        ladder: Ladder = self.kit[f"first passes: {setting.key}"]
        seconds, numbers = COMPARING * ladder.passes * ladder.pass_s, range(1, self._seeds + 1)
        return [Step(f"run {k}: {setting.key}", seconds, partial(self._run, setting, k)) for k in numbers]

    def _target(self, banding: str) -> Target:
        """What a banding is compared with, as far as the references are there."""
        kinds = ("auto", "cube", "channels")
        there = {kind: self.kit[f"reference: {kind}"] for kind in kinds if f"reference: {kind}" in self.kit.known}
        return Target(self._subject, there, banding)

    def _opened(self, setting: Setting) -> Series:
        """The setting, compiled; the last one is kept, and no other."""
        if self._open is None or self._open[0] != setting:
            self._open = None
            series = loaded(self._subject, setting)
            series.warm()
            self._open = setting, series
        return self._open[1]

    def _ladder(self, setting: Setting) -> Ladder:
        """What a pass costs, how many passes a run has, a power of two, and at which exposure frames are made."""
        seconds: list[float] = []
        began = time.perf_counter()
        series = loaded(self._subject, setting)
        series.each_pass(0, 1, lambda s, *_: seconds.append(s))
        first_s = time.perf_counter() - began
        series.each_pass(0, PILOT, lambda s, *_: seconds.append(s))
        pass_s = min(seconds[1:])
        passes = 2 ** max(math.floor(math.log2(max(RUN_S / pass_s, 1.0))), 0)
        framed = setting in (self._base, *self._bandings("channels"))
        passes = int(np.clip(passes, FEWEST_FRAMED if framed else FEWEST_PASSES, MOST_PASSES))
        make = partial(frame_exposure, self._subject, series)
        frames = make(self._target(setting.banding), passes) if framed else None
        return Ladder(series.samples, series.groups, max(first_s - pass_s, 0.0), pass_s, passes, frames)

    def _run(self, setting: Setting, number: int) -> dict[str, list[dict[str, object]]]:
        """All errors of one run."""
        ladder: Ladder = self.kit[f"first passes: {setting.key}"]
        series, target, smooth = self._opened(setting), self._target(setting.banding), setting == self._base
        run = Run(self._subject, series, target, number, ladder.passes, ladder.framed, self.smooth and smooth)
        return run.measure()

    def _result(self, setting: Setting) -> Result:
        runs = [self.kit[f"run {k}: {setting.key}"] for k in range(1, self._seeds + 1)]
        ladder, own = self.kit[f"first passes: {setting.key}"], self._target(setting.banding).squares
        return Result(setting, setting.label(self._base), ladder, runs, own)

    def _check(self) -> None:
        """Render with the recommended options until they keep the tolerance; then they are what is recommended."""
        choice = self.choices[0] if self.choices else None
        if choice is None or choice.seconds > CHECK_S:
            return
        for _ in range(CHECKS):
            measure = partial(checked, self._subject, choice, self._target(choice.spectral))
            found = self.kit.measure(f"check: {choice.options}", 2 * choice.seconds + COMPILE_S, measure)
            self.checks.append((choice, found))
            if self.reached:
                return
            choice = corrected(choice, found["error"], self.tolerance)

    @property
    def reached(self) -> bool:
        """Whether the recommended options were rendered and kept the tolerance."""
        return bool(self.checks) and self.checks[-1][1]["error"] <= self.tolerance


def denoiser_is_here() -> bool:
    """Whether Open Image Denoise is installed."""
    try:
        library()
    except InputError:
        return False
    return True
