"""Error of a render against its wall time: references, pilots, and ladders of samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

from ..kit import Array, Kit, Step, Subject, read_table
from .results import FEWEST_RUNGS, PILOT_SPP, Result, Rung, Setting

SETTINGS = read_table(Path(__file__).with_name("settings.toml"))

REFERENCE_S = 15.0
"""Seconds that a reference may take, as a pilot render tells."""

RUN_S = 2.0
"""Seconds of the longest render of a run."""

MOST_RUNGS = 9
DARKEST_SHARE = 0.1
"""Of the mean light; errors of darker pixels are relative to so much, or they would be all."""


class Light(NamedTuple):
    """One render.

    electrons : of every pixel, (H, W).  own_error : of the electrons, relative to the pixel, (H, W).
    """

    electrons: Array
    own_error: Array
    spp: int
    seconds: float


class Render:
    """Every way to render a scene for a camera, and what a kit measures of them.

    tolerance : relative error of the electrons.  seeds : independent runs.  variants : of Mitsuba, or None for all.
    """

    def __init__(
        self,
        kit: Kit,
        subject: Subject,
        tolerance: float,
        seeds: int,
        variants: Sequence[str] | None,
    ) -> None:
        if not 0 < tolerance <= 1:
            raise ms.InputError(
                f"tolerance is {tolerance:g}; it must be a relative error above 0, e.g. 0.01."
            )
        if seeds != int(seeds) or seeds < 2:
            raise ms.InputError(
                f"seeds is {seeds}; it must be at least 2 independent runs, e.g. 4."
            )
        self.kit, self.subject, self.tolerance = kit, subject, tolerance
        self.seeds = range(1, int(seeds) + 1)
        self._asked = variants
        self._warm = ""

    @cached_property
    def settings(self) -> list[Setting]:
        """What is compared: options with the first variant, then the other variants as shipped."""
        names: list[str] = self.kit.measure("variants", 5.0, self._usable_variants)
        own = [
            Setting(name, {"denoise": False, **options})
            for name, options in SETTINGS["render"].items()
        ]
        first = [Setting(one.name, {**one.options, "variant": names[0]}) for one in own]
        return [
            *first,
            *(Setting(name, {"denoise": False, "variant": name}) for name in names[1:]),
        ]

    def _usable_variants(self) -> list[str]:
        """Variants that are asked for, else those that work here. Raises InputError where none does."""
        names, problems = [], []
        for name in self._asked or SETTINGS["variants"]["names"]:
            try:
                self.subject.render(1, spp=1, denoise=False, variant=name)
                names.append(name)
            except ms.InputError as problem:
                problems.append(problem)
        if problems and (self._asked or not names):
            raise problems[-1]
        return names

    def light(self, seed: int, spp: int, setting: Setting) -> Light:
        """One render and its electrons."""
        camera, exposure = self.subject.camera, self.subject.exposure
        irradiance = self.subject.render(seed, spp=spp, **setting.options)
        frames = ms.expose(ms.collect(irradiance, camera, exposure), camera, exposure)
        told = irradiance.statistics
        own_error = irradiance.relative_error.astype(np.float64)
        return Light(
            np.asarray(frames.detected.mean_e, dtype=np.float64),
            own_error,
            told.samples_per_pixel,
            told.seconds,
        )

    def photons(self) -> ms.Photons:
        """Light of a render, as the sensor side exposes it."""
        irradiance = self.subject.render(1, spp=64, denoise=False)
        return ms.collect(irradiance, self.subject.camera, self.subject.exposure)

    def measure(self, later: Sequence[Step]) -> None:
        """Measure references, pilots and runs.  later : steps of the study behind these."""
        references = {one.reference: one for one in self.settings[::-1] if one.is_reference}
        steps = [
            Step(
                f"reference: {kind}",
                REFERENCE_S,
                partial(self._reference, setting),
            )
            for kind, setting in references.items()
        ]
        steps += [
            Step(f"pilot: {one.name}", 2 * RUN_S, partial(self._pilot, one))
            for one in self.settings
        ]
        runs = [
            Step(self._run_key(one, seed), 2 * RUN_S, int)
            for one in self.settings
            for seed in self.seeds
        ]
        self.kit.take(steps, [*runs, *later])
        runs = []
        for setting in self.settings:
            pilot = self.kit[f"pilot: {setting.name}"]
            rungs, seconds = [spp for spp, _ in pilot], sum(taken for _, taken in pilot)
            for seed in self.seeds:
                runs.append(
                    Step(
                        self._run_key(setting, seed),
                        seconds,
                        partial(self._run, setting, rungs, seed),
                    )
                )
        self.kit.take(runs, later)

    def _run_key(self, setting: Setting, seed: int) -> str:
        return f"run {seed}: {setting.name}"

    def _reference(self, setting: Setting) -> Light:
        spp, seconds = self._pilot(setting)[-1]
        return self.light(
            0, max(2 ** round(math.log2(spp * REFERENCE_S / seconds)), 4 * spp), setting
        )

    def _pilot(self, setting: Setting) -> list[tuple[int, float]]:
        """Samples and seconds of renders, twice as many samples each time, until one is long enough."""
        self.light(0, PILOT_SPP, setting)  # compiles
        self._warm = setting.name
        rungs = list[tuple[int, float]]()
        while len(rungs) < FEWEST_RUNGS or (
            rungs[-1][1] < RUN_S / 2 and len(rungs) < MOST_RUNGS
        ):
            spp = PILOT_SPP * 2 ** len(rungs)
            rungs.append((spp, self.light(0, spp, setting).seconds))
        return rungs

    def _run(self, setting: Setting, rungs: Sequence[int], seed: int) -> list[Rung]:
        if self._warm != setting.name:
            self.light(0, PILOT_SPP, setting)
            self._warm = setting.name
        run = []
        for spp in rungs:
            light = self.light(1000 * seed + spp, spp, setting)
            run.append(
                Rung(
                    light.spp, light.seconds, self.squared_error(light, self.reference(setting))
                )
            )
        return run

    def reference(self, setting: Setting) -> Light:
        """What a setting is compared with."""
        reference: Light = self.kit[f"reference: {setting.reference}"]
        return reference

    def scale(self, reference: Light) -> tuple[NDArray[np.bool_], Array]:
        """Pixels that count, (H, W) bool, and the electrons that their errors are relative to."""
        electrons = reference.electrons
        seen = (electrons > 0) & (electrons < self.subject.camera.pixel.full_well_e)
        if not seen.any():
            seen = electrons > 0
        return seen, np.maximum(electrons, DARKEST_SHARE * electrons[seen].mean())

    def squared_error(self, light: Light, reference: Light) -> float:
        """Mean squared relative error of the electrons of one render, the reference's own error included."""
        seen, scale_e = self.scale(reference)
        return float(np.mean(((light.electrons - reference.electrons) / scale_e)[seen] ** 2))

    def own_square(self, setting: Setting) -> float:
        """Squared relative standard error of the reference."""
        reference = self.reference(setting)
        seen, scale_e = self.scale(reference)
        return float(np.mean((reference.own_error * reference.electrons / scale_e)[seen] ** 2))

    def results(self) -> list[Result]:
        """Every setting with its runs."""
        results = []
        for setting in self.settings:
            runs = [self.kit[self._run_key(setting, seed)] for seed in self.seeds]
            results.append(Result(setting, runs, self.own_square(setting)))
        return results
