"""Error of a render against its wall time: sampler, samples per pass, variant, banding; noise on top or compensated."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from ...core import InputError, Photons, require
from ...render.denoise import library
from ...render.variants import use
from ..kit import Kit, Step
from ..subject import Subject
from .errors import REFERENCE_S, Ladder, Reference, Run, Rung, Target, frame_exposure, render_reference
from .results import Choice, Result, checked, choices, corrected
from .series import RenderSetting, Series, all_settings, usable_variants

RUN_S = 2.5  # seconds that the passes of one run may take: so long is its ladder
FEWEST_PASSES, FEWEST_FRAMED, MOST_PASSES = 4, 32, 256  # of a run: for three rungs; for frames of two sizes; for nine
PILOT = 2  # passes that tell the time of one, after the first has compiled
COMPILE_S, COMPARING = 6.0, 1.4  # as expected until the first pass; of a run, over the seconds of its passes
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
        self.kit, self._subject, self._numbers = kit, subject, range(1, int(seeds) + 1)
        self._variants = usable_variants(variants)
        self._base = RenderSetting(self._variants[0].name)
        self.smooth = False
        with suppress(InputError):  # Open Image Denoise is not installed
            library()
            self.smooth = True
        self.checks: list[tuple[Choice, dict[str, float]]] = []
        self._open: Series | None = None

    def photons(self) -> Photons:
        """The light that the sensor side exposes: that of the reference."""
        self.kit.take([self._reference(self._base)])
        return self.target("auto").own.photons

    def measure(self) -> None:
        """References, ladders, runs and checks: what is not measured yet."""
        bands = Series(self._subject, self._base).bands
        channels = bands.kind == "cube" and self._subject.camera.quantum_efficiency.quantum_yield is None
        settings = all_settings(self._base, self._variants, bands, channels)
        own = [one for one in settings if one == self._base._replace(banding=one.banding) and one.banding != "loop"]
        first = [Step(f"first passes: {one.key}", COMPILE_S, partial(self._ladder, one)) for one in settings]
        self.kit.take([*map(self._reference, own), *first], len(settings) * len(self._numbers) * RUN_S)
        ladders: dict[RenderSetting, Ladder] = {one: self.kit[f"first passes: {one.key}"] for one in settings}
        self.kit.take(
            Step(f"run {k}: {one.key}", COMPARING * ladder.passes * ladder.pass_s, partial(self._run, one, ladder, k))
            for one, ladder in ladders.items()
            for k in self._numbers
        )
        self.references: dict[str, Reference] = {one.banding: self.kit[f"reference: {one.banding}"] for one in own}
        self.results: list[Result] = []
        for one, ladder in ladders.items():
            runs = [self.kit[f"run {k}: {one.key}"] for k in self._numbers]
            self.results.append(Result(one, one.label(self._base), ladder, runs, self.target(one.banding).squares))
        self.choices = choices(self.results, self.tolerance, usable_variants(None)[0].name)
        self._check()
        use(self._variants[0])  # the last one was another

    def _reference(self, setting: RenderSetting) -> Step:
        measure = partial(render_reference, self._subject, setting)
        return Step(f"reference: {setting.banding}", REFERENCE_S + COMPILE_S, measure)

    def target(self, banding: str) -> Target:
        """What a banding is compared with."""
        keys = {kind: f"reference: {kind}" for kind in ("auto", "cube", "channels")}
        there = {kind: self.kit[key] for kind, key in keys.items() if key in self.kit.known}
        return Target(self._subject, there, banding)

    def _ladder(self, setting: RenderSetting) -> Ladder:
        """What a pass costs, how many passes a run has, a power of two, and at which exposure frames are made."""
        began = time.perf_counter()
        series = Series(self._subject, setting)
        list(series.passes(0, 1))
        first_s = time.perf_counter() - began
        pass_s = min(block.seconds for block in series.passes(0, PILOT))
        framed = setting in (self._base, self._base._replace(banding="channels"))
        passes = 2 ** max(math.floor(math.log2(max(RUN_S / pass_s, 1.0))), 0)
        passes = int(np.clip(passes, FEWEST_FRAMED if framed else FEWEST_PASSES, MOST_PASSES))
        frames = frame_exposure(series, self.target(setting.banding), passes) if framed else None
        return Ladder(setting.samples, series.groups, max(first_s - pass_s, 0.0), pass_s, passes, frames)

    def _run(self, setting: RenderSetting, ladder: Ladder, number: int) -> dict[str, list[Rung]]:
        """All errors of one run. The scene that was compiled last is kept, and no other."""
        if self._open is None or self._open.setting != setting:
            self._open = None
            self._open = Series(self._subject, setting)
            if not self._open.loop:  # where every band compiles anew
                list(self._open.passes(0, 1))
        run = Run(self._open, self.target(setting.banding), ladder, number)
        return run.measure(self.smooth and setting == self._base)

    def _check(self) -> None:
        """Render with the recommended options until they keep the tolerance; then they are what is recommended."""
        choice = self.choices[0] if self.choices else None
        while choice is not None and (self.checks or choice.seconds <= CHECK_S):
            measure = partial(checked, choice, self.target(choice.spectral))
            found = self.kit.measure(f"check: {choice.options}", 2 * choice.seconds + COMPILE_S, measure)
            self.checks.append((choice, found))
            again = not self.reached and len(self.checks) < CHECKS
            choice = corrected(choice, found["error"], self.tolerance) if again else None

    @property
    def reached(self) -> bool:
        """Whether the recommended options were rendered and kept the tolerance."""
        return bool(self.checks) and self.checks[-1][1]["error"] <= self.tolerance
