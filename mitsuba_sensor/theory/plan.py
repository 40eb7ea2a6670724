"""Plan of an exposure: what leaving out each stage changes in its frames, and which stages it does not need.

The samples of expected.py are taken with and without a stage, by the same random numbers. Beside the windows of the
light there are two with every level from its darkest to its brightest pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..camera.camera import Camera
from ..camera.camera_file import AnyCamera, camera_of
from ..core import Exposure, Frame, InputError, Photons, SensorWindow, check_types, require
from ..core.types import Float64Array
from ..sensor.checks import as_photons
from ..sensor.detection import Detected, detect
from ..sensor.expose import PreparedExposure, prepare_exposure
from ..sensor.fpn_maps import checked_maps
from ..sensor.options import ExposeOptions
from ..sensor.precision import Float32, float32_effect
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import ReadoutChain, combined_of
from ..stages.stage import Chain, detector_of, place_of, without
from ..stages.usual_range import warn_of_temperature
from .notebook import plan_html
from .plan_trial import Effect, Trial

SMALLEST_DN = 1e-6
"""Changes below this are shown as 0 [DN]."""

WIDTH = 1e-3
"""By so much the light may be darker or brighter than the light that the plan was made for."""

NEEDED = "changes the unit; always needed"
IDLE = "has no effect here"
BELOW = "below the tolerance"


@dataclass(frozen=True)
class PlanRange:
    """What a plan holds for: one exposure, windows up to this size, and light between these mean photoelectrons."""

    exposure: Exposure
    rows: int
    columns: int
    darkest_e: float
    brightest_e: float

    def check(self, exposure: Exposure, light_e: Float64Array, shape: tuple[int, int]) -> None:
        """Raise InputError for an exposure, a window or light beyond this range."""
        made = "make a plan for this one."
        if exposure != self.exposure:
            raise InputError(
                f"the plan was made for {self.exposure.time_s:g} s at {self.exposure.temperature_k:g} K, and this "
                f"exposure is {exposure.time_s:g} s at {exposure.temperature_k:g} K; {made}"
            )
        if shape[0] > self.rows or shape[1] > self.columns:
            raise InputError(
                f"the plan was made for {self.rows} × {self.columns} pixels, and this window has {shape[0]} × "
                f"{shape[1]}; {made}"
            )
        low, high = float(light_e.min()), float(light_e.max())
        if low < self.darkest_e or high > self.brightest_e:
            raise InputError(
                f"the plan was made for {self.darkest_e:.6g} … {self.brightest_e:.6g} mean photoelectrons per pixel, "
                f"and this light has {low:.6g} … {high:.6g}; {made}"
            )


@dataclass(frozen=True)
class Plan:
    """The stages of an exposure with their effects. ``print(plan.explain())``; ``expose(..., plan=plan)``.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        print(plan.left_out, plan.explain())

    clipped : share of the sampled pixels that are clipped, in which changes are only counted.  pixels : how many are
        sampled, with four samples each; what fewer than three in so many pixels have is not seen.
    """

    camera: str
    tolerance_dn: float
    effects: tuple[Effect, ...]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)
    float32: Float32
    range: PlanRange
    clipped: float
    pixels: int
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

    @property
    def precision(self) -> str:
        """What ``expose(plan=…)`` computes in unless it is told: float64 where float32 would move too much."""
        return self.float32.precision

    def explain(self) -> str:
        """A table for people."""
        held, names = self.range, ("mean", "temporal", "spatial", "lines", "pixels")
        lines = [
            f"Plan for {self.camera}: without what is left out, no sampled pixel changes by more than "
            f"{self.tolerance_dn:g} DN.",
            f"It holds for {held.darkest_e:.4g} … {held.brightest_e:.4g} mean photoelectrons per pixel, "
            f"{held.exposure.time_s:g} s at {held.exposure.temperature_k:g} K, {held.columns} × {held.rows} pixels.",
            "What leaving out each stage changes [DN], and the pixels that change by more than the tolerance:",
            f"{'stage':<26}{'':<9}" + "".join(f"{name:>10}" for name in names),
        ]
        for one in self.effects:
            numbers = (f"{x:.4g}" if x >= SMALLEST_DN else "0" for x in one.columns)
            cells = "".join(f"{text:>10}" for text in numbers)
            verdict = "kept" if one.kept else "left out"
            lines.append(f"{one.stage:<26}{verdict:<9}{cells}  {one.reason}".rstrip())
        lines.append(
            f"Of {self.pixels} sampled pixels {100 * self.clipped:.3g} % are clipped: their changes are only counted."
        )
        return "\n".join([*lines, self.float32.explain()])

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for an exposure, a window, measured maps or light that this plan was not made for."""
        self.range.check(frame.exposure, light.mean_e, frame.window.shape)
        own, given = self.frame.window.given, frame.window.given
        if own.keys() != given.keys() or not all(
            np.array_equal(own[name], given[name]) for name in own
        ):
            with_, has = (", ".join(sorted(maps)) or "none" for maps in (own, given))
            raise InputError(
                f"the plan was made for other measured maps ({with_}) than this exposure has ({has}); make a plan for "
                "this one: plan(…, maps=…)."
            )

    def to_dict(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "camera": self.camera,
            "tolerance_dn": self.tolerance_dn,
            "range": asdict(self.range),
            "stages": [asdict(effect) for effect in self.effects],
            "clipped": self.clipped,
            "pixels": self.pixels,
            "float32": {**asdict(self.float32), "precision": self.precision},
        }


@dataclass(frozen=True)
class CombinedPlan:
    """The plans of all read-outs of a camera. ``print(plan.explain())``; ``expose(..., plan=plan)``.

    ::

        plan = ms.plan("scmos_dual_gain", exposure, photons, tolerance_dn=0.5)
        print(plan.left_out, plan.readouts["low"].left_out)

    tolerance_dn : in the linear code, however it is combined.  readouts : the plan of each by its name.
    """

    camera: str
    tolerance_dn: float
    readouts: Mapping[str, Plan]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)

    def __repr__(self) -> str:
        count = sum(len(plan.effects) for plan in self.readouts.values())
        left_out = f"{len(self.left_out)} of {count} stages left out"
        return f"<CombinedPlan: {self.camera}, {left_out} within {self.tolerance_dn:g} DN>"

    @property
    def left_out(self) -> list[str]:
        """Read-out and label of the stages that are left out."""
        return [
            f"{name}: {label}" for name, one in self.readouts.items() for label in one.left_out
        ]

    @property
    def precision(self) -> str:
        """float64 where float32 would move the code of a read-out too much."""
        wide = any(plan.precision == "float64" for plan in self.readouts.values())
        return "float64" if wide else "float32"

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for an exposure, a window or light that this plan was not made for."""
        combined = combined_of(self.whole)
        assert combined is not None
        for readout in combined.readouts:
            own = light_of_readout(readout, light, frame)
            self.readouts[readout.name].check(own, readout.frame_of(frame))

    def explain(self) -> str:
        """A table for people, read-out by read-out."""
        tolerance = f"{self.tolerance_dn:g} DN"
        head = f"Plans for the read-outs of {self.camera}, whose linear code changes by at most {tolerance}:"
        parts = (f"read-out {name}\n{plan.explain()}" for name, plan in self.readouts.items())
        return "\n\n".join([head, *parts])

    def to_dict(self) -> dict[str, object]:
        """The same for programs."""
        plans = {name: plan.to_dict() for name, plan in self.readouts.items()}
        return {
            "camera": self.camera,
            "tolerance_dn": self.tolerance_dn,
            "readouts": plans,
            "stages": [
                {"readout": name, **x} for name, one in plans.items() for x in one["stages"]
            ],
            "float32": {name: one["float32"] for name, one in plans.items()},
        }


def plan(
    camera: AnyCamera,
    exposure: Exposure,
    photons: Photons | ArrayLike,
    tolerance_dn: float = 0.0,
    wavelengths_nm: ArrayLike | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
) -> Plan | CombinedPlan:
    """Which stages this exposure needs, by samples of its frames with and without each of them.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        frames = ms.expose(photons, camera, exposure, plan=plan)

    photons, wavelengths_nm, maps : as for :func:`expose`.
    tolerance_dn : how far the stages left out may together move any sampled pixel before rounding, and the mean of a
        row or column times the root of its length [DN]; 0 leaves out only what changes no sampled pixel.
    Of a camera with several read-outs: a plan for each, whose tolerance is that of the linear code.
    Raises InputError for a negative tolerance, and for photons and maps that ``expose`` would refuse.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    warn_of_temperature(exposure.temperature_k)
    if camera.readouts and maps:
        raise InputError(
            f"maps are of one read-out, and {camera.name} has {len(camera.readouts)}; leave them out, or plan for "
            "camera.at_readout(name)."
        )
    require("tolerance_dn", tolerance_dn, 0.0, 1e9, "digital numbers, e.g. 0.02")
    light = as_photons(photons, camera, wavelengths_nm)
    window = SensorWindow(1, (light.shape[0], light.shape[1]), light.origin, camera=camera.name)
    given = checked_maps(maps, window, camera)
    frame = Frame(exposure, replace(window, given=given))
    detected = detect(replace(light, variance_e2=None), detector_of(camera.stages), frame)
    return plan_of(camera, detected, frame, tolerance_dn)


def plan_of(
    camera: Camera, light: Detected, frame: Frame, tolerance_dn: float = 0.0
) -> Plan | CombinedPlan:
    """The plan of a window in light that is detected already; of several read-outs that of each."""
    combined = combined_of(camera.stages)
    if combined is None:
        return plan_for(camera, light, frame, tolerance_dn)
    plans, chains = dict[str, Plan](), list[ReadoutChain]()
    for readout, linear in zip(combined.readouts, combined.combination.readouts, strict=True):
        step_dn = combined.nominal_gain * linear.electrons_per_dn  # of the linear code
        own, light_of = (
            camera.readout_cameras[readout.name],
            light_of_readout(readout, light, frame),
        )
        found = plan_for(own, light_of, readout.frame_of(frame), tolerance_dn / step_dn)
        plans[readout.name] = found
        chains.append(replace(readout, stages=found.stages))
    planned = replace(combined, readouts=tuple(chains))
    return CombinedPlan(
        camera.name, tolerance_dn, plans, (*camera.stages[:-1], planned), camera.stages
    )


def prepare_planned_exposure(
    camera: Camera,
    exposure: Exposure,
    shape: tuple[int, ...],
    origin: tuple[int, int],
    options: ExposeOptions,
) -> PreparedExposure:
    """What :func:`sensor.expose.prepare_exposure` returns; its light gets a plan within ``tolerance_dn``.

    shape, origin : (rows, columns) of the window and its first pixel.  options : completed.  Raises InputError.
    """
    sensor, tolerance_dn = (
        prepare_exposure(camera, exposure, shape, origin, options),
        options["tolerance_dn"],
    )
    if tolerance_dn is None:
        return sensor
    return replace(sensor, planner=partial(plan_of, tolerance_dn=tolerance_dn))


# -- samples -----------------------------------------------------------------------------------------------------------


def plan_for(camera: Camera, light: Detected, frame: Frame, tolerance_dn: float) -> Plan:
    """The plan of a window of a camera with one read-out."""
    whole = camera.stages
    light_e = np.asarray(light.mean_e)
    trial = Trial(whole, light, frame, tolerance_dn)
    alone = trial.effects
    small = [
        stage
        for stage, one in zip(whole, alone, strict=True)
        if not stage.required and trial.is_within(one) and trial.is_clear_of(stage)
    ]
    out = sorted(small, key=lambda stage: alone[place_of(stage, whole)].largest_dn)
    while out and not trial.is_within(trial.together(out)):
        out.pop()
    effects = []
    for stage, one in zip(whole, alone, strict=True):
        left_out = any(stage is other for other in out)
        reason = NEEDED if stage.required else ""
        if left_out:
            reason = IDLE if one.largest_dn == one.pixels_beyond == 0 else BELOW
        effects.append(replace(one, kept=not left_out, reason=reason))
    kept = without(whole, out)
    held = PlanRange(
        frame.exposure,
        *frame.window.shape,
        float(light_e.min()) * (1 - WIDTH),
        float(light_e.max()) * (1 + WIDTH),
    )
    levels = trial.levels
    single = float32_effect(
        kept, levels.light_of(0), [*levels.frames_of(0)[0], *levels.frames_of(1)[1]]
    )
    return Plan(
        camera.name, tolerance_dn, tuple(effects), kept, whole, single, held, trial.clipped,
        trial.of_frame.pixels, frame,
    )  # fmt: skip
