"""Plan of an exposure: what each stage changes in DN, which ones can be left out, and the seconds that this saves."""

from __future__ import annotations

import statistics
import time
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..camera.camera import Camera
from ..core import (
    Electrons,
    Exposure,
    Frame,
    InputError,
    Photons,
    SensorWindow,
)
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from ..sensor.detection import Detected
from ..sensor.precision import Float32, float32_effect
from ..sensor.run import row_strips_of
from ..stages.stage import Chain, Stage, sample, without, without_law
from .light_levels import WIDTH, light_levels
from .notebook import plan_html
from .plan_effects import Effect, PlanRange, Trial

RUNS = 5
"""Timed runs of each chain; they take turns, so that a machine that slows down slows both."""

SMALLEST_DN = 1e-6
"""Changes below this are shown as 0 [DN]."""

LEVELS = 65
"""Pixels of the scene, from dark to bright, on which float32 is compared with float64."""

WORTH_SAVING = 0.1
"""Share of the time of a frame from which on a plan is said to save time."""

WITHOUT_THEM = "Stages that have no theory are not in the chain of which the numbers below are"
"""Said where there are some: what they do to the effects of the others is not known."""

IDLE = "has no effect here"  # why a neutral stage is left out
NEEDED = "changes the unit; always needed"
NO_LAW = "has no theory (no `moments`); always kept"
COUPLED = "has no theory (it couples neighbours); always kept"


@dataclass(frozen=True)
class Plan:
    """The stages of an exposure with their effects. ``print(plan.explain())``; ``expose(..., plan=plan)``.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        print(plan.left_out, plan.explain())
    """

    camera: str
    tolerance_dn: float
    effects: tuple[Effect, ...]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)
    float32: Float32
    range: PlanRange
    light: Detected = field(repr=False)
    frame: Frame = field(repr=False)

    def __repr__(self) -> str:
        left_out = f"{len(self.left_out)} of {len(self.effects)} stages left out"
        return f"<Plan: {self.camera}, {left_out} within {self.tolerance_dn:g} DN>"

    def _repr_html_(self) -> str:
        return plan_html(self)

    @property
    def left_out(self) -> list[str]:
        """Labels of the stages that are left out."""
        return [effect.stage for effect in self.effects if not effect.kept]

    def explain(self) -> str:
        """A table for people."""
        whole_s, planned_s = self.seconds
        names = ("mean", "temporal", "spatial", "structure", "pixels")
        held = self.range
        times = f"A frame takes {whole_s:.3g} s with all stages and {planned_s:.3g} s with this plan"
        if planned_s > (1 - WORTH_SAVING) * whole_s:
            times += ": no stage left out is worth a tenth of that"
        lines = [
            f"Plan for {self.camera}: without what is left out, mean and σ of a pixel change by at most "
            f"{self.tolerance_dn:g} DN.",
            f"It holds for {held.darkest_e:.4g} … {held.brightest_e:.4g} mean photoelectrons per pixel, "
            f"{held.exposure.time_s:g} s at {held.exposure.temperature_k:g} K, {held.columns} × {held.rows} pixels.",
            f"{times}.",
            "What each stage changes by itself at most [DN], and the pixels where that is more than the tolerance:",
            f"{'stage':<26}{'':<9}" + "".join(f"{name:>10}" for name in names),
        ]
        for e in self.effects:
            numbers = (e.mean_dn, e.temporal_dn, e.spatial_dn, e.structure_dn, e.pixels_beyond)
            kept = "left out"
            if e.kept:
                kept = "kept"
            row = (
                f"{e.stage:<26}{kept:<9}"
                + "".join(f"{_number(x):>10}" for x in numbers)
                + f"  {e.reason}"
            )
            lines.append(row.rstrip())
        if without_law(self.whole):
            lines.append(f"{WITHOUT_THEM}.")
        lines.append(self.float32.explain())
        return "\n".join(lines)

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for an exposure, a window, measured maps or light that this plan was not made for."""
        self.range.check(frame.exposure, light_levels(light), frame.window.shape)
        own, given = self.frame.window.given, frame.window.given
        if own.keys() != given.keys() or not all(
            np.array_equal(own[name], given[name]) for name in own
        ):
            with_, has = (", ".join(sorted(maps)) or "none" for maps in (own, given))
            raise InputError(
                f"the plan was made for other measured maps ({with_}) than this exposure has ({has}); make a plan for "
                "this one: plan(…, maps=…)."
            )

    @property
    def precision(self) -> str:
        """What ``expose(plan=…)`` computes in unless it is told: float64 where float32 would move too much."""
        return self.float32.precision

    @cached_property
    def seconds(self) -> tuple[float, float]:
        """Measured seconds per frame, whole chain and plan: medians of interleaved runs of the scene's top strip."""
        rows = next(row_strips_of(self.frame.window.shape, NUMPY_FLOAT64.strip_pixels))
        strip = replace(self.light.photons.crop_rows(rows), variance_e2=None)
        frame = self.frame.on(NUMPY_FLOAT32 if self.precision == "float32" else NUMPY_FLOAT64)
        part = replace(frame, window=frame.window.crop_rows(rows))
        times: tuple[list[float], list[float]] = ([], [])
        for run in range(RUNS + 1):
            for taken, stages in zip(times, (self.whole, self.stages), strict=True):
                started = time.perf_counter()
                sample(stages, strip, replace(part, index=run, _blocks={}))
                taken.append(time.perf_counter() - started)
        share = (rows.stop - rows.start) / self.frame.window.shape[0]
        whole_s, planned_s = (
            statistics.median(taken[1:]) / share for taken in times
        )  # the first makes the maps
        return whole_s, planned_s

    def to_dict(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "camera": self.camera,
            "tolerance_dn": self.tolerance_dn,
            "range": asdict(self.range),
            "stages": [asdict(effect) for effect in self.effects],
            "float32": {**asdict(self.float32), "precision": self.precision},
        }


def _number(value: float) -> str:
    """A number of the table; 0 where it is too small to be of use."""
    if value >= SMALLEST_DN:
        return f"{value:.4g}"
    return "0"


def plan_for(camera: Camera, light: Detected, frame: Frame, tolerance_dn: float = 0.0) -> Plan:
    """The plan of a window in light that is detected already; measured maps are those of the frame's window."""
    whole, window, levels = camera.stages, frame.window, light_levels(light)
    unknown = without_law(whole)
    lawful = without(whole, unknown)
    darkest, brightest = float(levels.light_e[0]), float(levels.light_e[-1])
    held = PlanRange(
        frame.exposure, *window.shape, darkest * (1 - WIDTH), brightest * (1 + WIDTH)
    )
    trial = Trial(lawful, frame, held, _largest_yield(light.signal), tolerance_dn)
    alone = {id(stage): trial.effect(stage) for stage in lawful}
    if unknown:
        out = [stage for stage in lawful if not stage.required and trial.hands_on(stage)]
    else:
        out = trial.chosen([stage for stage in whole if not stage.required], alone)
    kept = without(whole, out)
    effects = tuple(
        _verdict(stage, alone.get(id(stage)), any(stage is one for one in out))
        for stage in whole
    )
    single = float32_effect(kept, *_some_pixels(light.photons, camera, frame.exposure))
    return Plan(camera.name, tolerance_dn, effects, kept, whole, single, held, light, frame)


def _largest_yield(light: Electrons) -> tuple[float, float]:
    """Mean and variance of the electrons that a photon frees, where it frees most."""
    mean, variance = (
        np.broadcast_to(x, np.shape(light.light))
        for x in (light.yield_mean, light.yield_variance)
    )
    brightest = np.unravel_index(np.argmax(mean), mean.shape)
    return float(mean[brightest]), float(variance[brightest])


def _verdict(stage: Stage, alone: Effect | None, left_out: bool) -> Effect:
    """What is said of a stage.  alone : what it does by itself; None where its law is not known."""
    if alone is None:
        reason = COUPLED if stage.reach_px else NO_LAW
        return Effect(stage.label, True, 0.0, 0.0, 0.0, 0.0, 0.0, reason)
    if stage.required:
        return replace(alone, reason=NEEDED)
    if not left_out:
        return alone
    idle = alone.largest_dn == 0 and alone.pixels_beyond == 0
    return replace(alone, kept=False, reason=IDLE if idle else "below the tolerance")


def _some_pixels(photons: Photons, camera: Camera, exposure: Exposure) -> tuple[Photons, Frame]:
    """Pixels from dark to bright, each under every colour filter: a small window of its own."""
    total, tile = photons.total.ravel(), camera.tile
    spread = np.linspace(0, total.size - 1, min(LEVELS, total.size)).round().astype(int)
    chosen = np.unique(np.concatenate([spread, [total.argmin(), total.argmax()]]))
    rows = photons.at(chosen[np.argsort(total[chosen], kind="stable")])
    window = np.repeat(np.repeat(rows[None], len(tile[0]), axis=1), len(tile), axis=0)
    if len(photons.shape) == 3:
        mean = window
    else:
        mean = window[..., 0]
    frame = Frame(exposure, SensorWindow(0, (mean.shape[0], mean.shape[1])))
    alone = photons.changed(variance_e2=None, origin=(0, 0), in_band=None, by_readout=None)
    return alone.changed(mean=mean), frame
