"""Plan of an exposure: the stages that it does not need, and the effect of omitting each stage.

The chain of expected.py is sampled with and without a stage, with the same random numbers, in windows of the light and
in two windows with every level from its darkest to its brightest pixel.
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
from ..core import (
    Exposure,
    Frame,
    InputError,
    Photons,
    SensorWindow,
    check_types,
    require,
)
from ..core.html import Table, facts, fragment
from ..sensor.checks import as_photons
from ..sensor.detection import Detected, detect
from ..sensor.expose import PreparedExposure, prepare_exposure
from ..sensor.fpn_maps import checked_maps
from ..sensor.options import ExposeOptions
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import combined_of
from ..stages.stage import Chain, detector_of
from ..stages.usual_range import warn_of_temperature
from .plan_trial import Effect, Trial

SMALLEST_DN = 1e-6
"""Changes below this are shown as 0 [DN]."""

LIGHT_TOLERANCE = 1e-3
"""Fraction by which light may be darker or brighter than the light of the plan."""

COLUMNS = ("mean", "temporal", "spatial", "lines", "pixels")


@dataclass(frozen=True)
class Plan:
    """The stages of an exposure and the effect of omitting each. ``print(plan.explain())``; ``expose(…, plan=plan)``.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        print(plan.left_out, plan.explain())

    tolerance_dn : tolerance [DN]; with several readouts, of the linear code. Effects are in codes of each readout.
    frame, darkest_e, brightest_e : exposure, largest window, measured maps and mean photoelectrons of the plan.
    clipped : fraction of the sampled pixels that are clipped; their changes are only counted.
    pixels : number of sampled pixels, with four samples each; effects in fewer than three of them may be missed.
    """

    camera: str
    tolerance_dn: float
    effects: tuple[Effect, ...]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)
    frame: Frame = field(repr=False)
    darkest_e: float
    brightest_e: float
    clipped: float
    pixels: int

    def __repr__(self) -> str:
        left_out = f"{len(self.left_out)} of {len(self.effects)} stages left out"
        return f"<Plan: {self.camera}, {left_out} within {self.tolerance_dn:g} DN>"

    def _repr_html_(self) -> str:
        head = {
            "camera": self.camera,
            "tolerance": f"{self.tolerance_dn:g} DN",
            "holds for": self.conditions,
        }
        rows = [
            (one.stage, _verdict(one), *(f"{x:.3g}" for x in one.columns), one.reason)
            for one in self.effects
        ]
        return fragment(
            "Plan of an exposure", facts(head), Table(("stage", "", *COLUMNS, "why"), rows)
        )

    @property
    def left_out(self) -> list[str]:
        """Labels of the omitted stages."""
        return [effect.stage for effect in self.effects if not effect.kept]

    @property
    def conditions(self) -> str:
        """Light, exposure and window of the plan."""
        exposure, (rows, columns) = self.frame.exposure, self.frame.window.shape
        return (
            f"{self.darkest_e:.4g} … {self.brightest_e:.4g} mean photoelectrons per pixel, "
            f"{exposure.time_s:g} s at {exposure.temperature_k:g} K, {columns} × {rows} pixels"
        )

    def explain(self) -> str:
        """Return a table for people."""
        first = max(26, *(len(one.stage) + 2 for one in self.effects))
        lines = [
            f"Plan for {self.camera}: omitting the stages left out changes no sampled pixel by more than "
            f"{self.tolerance_dn:g} DN.",
            f"It holds for {self.conditions}.",
            "Change by omitting each stage [DN], and number of pixels that change by more than the tolerance:",
            f"{'stage':<{first}}{'':<9}" + "".join(f"{name:>10}" for name in COLUMNS),
        ]
        for one in self.effects:
            numbers = (f"{x:.4g}" if x >= SMALLEST_DN else "0" for x in one.columns)
            cells = "".join(f"{text:>10}" for text in numbers)
            lines.append(
                f"{one.stage:<{first}}{_verdict(one):<9}{cells}  {one.reason}".rstrip()
            )
        lines.append(
            f"{100 * self.clipped:.3g} % of {self.pixels} sampled pixels are clipped; their changes are only counted."
        )
        return "\n".join(lines)

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for an exposure, window, measured maps or light that this plan does not cover."""
        own, shape, (low, high) = self.frame, frame.window.shape, _ends_e(light)
        maps, given = own.window.given, frame.window.given
        with_, has = (", ".join(sorted(one)) or "none" for one in (maps, given))
        same_maps = maps.keys() == given.keys() and all(
            np.array_equal(maps[name], given[name]) for name in maps
        )
        then, now = own.exposure, frame.exposure
        most = own.window.shape
        of_light = (
            f"{self.darkest_e:.6g} … {self.brightest_e:.6g} mean photoelectrons per pixel"
        )
        other = ""
        if now != then:
            at = (f"{one.time_s:g} s at {one.temperature_k:g} K" for one in (then, now))
            other = ", and this exposure is ".join(at)
        elif shape[0] > most[0] or shape[1] > most[1]:
            other = f"{most[0]} × {most[1]} pixels, and this window has {shape[0]} × {shape[1]}"
        elif low < self.darkest_e or high > self.brightest_e:
            other = f"{of_light}, and this light has {low:.6g} … {high:.6g}"
        elif not same_maps:
            other = f"other measured maps ({with_}) than this exposure has ({has})"
        if other:
            raise InputError(f"the plan was made for {other}; make a new plan.")

    def to_dict(self) -> dict[str, Any]:
        """Return the plan for programs."""
        rows, columns = self.frame.window.shape
        held = {"exposure": asdict(self.frame.exposure), "rows": rows, "columns": columns}
        light = {"darkest_e": self.darkest_e, "brightest_e": self.brightest_e}
        facts_of = {
            name: getattr(self, name)
            for name in ("camera", "tolerance_dn", "clipped", "pixels")
        }
        return {
            **facts_of,
            "range": held | light,
            "stages": [asdict(effect) for effect in self.effects],
        }


def plan(
    camera: AnyCamera,
    exposure: Exposure,
    photons: Photons | ArrayLike,
    tolerance_dn: float = 0.0,
    wavelengths_nm: ArrayLike | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
) -> Plan:
    """Return the stages that this exposure needs, from samples of its frames with and without each stage.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        frames = ms.expose(photons, camera, exposure, plan=plan)

    photons, wavelengths_nm, maps : as for :func:`expose`.
    tolerance_dn : largest change, by all omitted stages together, of any sampled pixel before rounding, and of the mean
        of a row or column times the root of its length [DN]. 0 omits only stages without effect. With several readouts
        it applies to the linear code.
    Raises InputError for a negative tolerance, and for photons and maps that ``expose`` rejects.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    warn_of_temperature(exposure.temperature_k)
    if camera.readouts and maps:
        raise InputError(
            f"maps belong to one readout, but {camera.name} has {len(camera.readouts)}; omit them, or plan for "
            "camera.at_readout(name)."
        )
    require("tolerance_dn", tolerance_dn, 0.0, 1e9, "digital numbers, e.g. 0.02")
    light = as_photons(photons, camera, wavelengths_nm)
    window = SensorWindow(1, (light.shape[0], light.shape[1]), light.origin, camera=camera.name)
    frame = Frame(exposure, replace(window, given=checked_maps(maps, window, camera)))
    detected = detect(light, detector_of(camera.stages), frame)
    return plan_of(camera, detected, frame, tolerance_dn)


def plan_of(camera: Camera, light: Detected, frame: Frame, tolerance_dn: float = 0.0) -> Plan:
    """Return the plan of a window in detected light, for all readouts."""
    stages, combined, (low, high) = camera.stages, combined_of(camera.stages), _ends_e(light)
    effects, trials = list[Effect](), list[Trial]()
    if combined is None:
        trials.append(Trial(stages, light, frame, tolerance_dn))
        effects, kept = trials[0].chosen()
    else:
        readouts = []
        for readout, linear in zip(
            combined.readouts, combined.combination.readouts, strict=True
        ):
            step_dn = combined.nominal_gain * linear.electrons_per_dn  # of the linear code
            own, of_light = readout.frame_of(frame), light_of_readout(readout, light, frame)
            trials.append(Trial(readout.stages, of_light, own, tolerance_dn / step_dn))
            moved, rest = trials[-1].chosen()
            effects += [replace(one, stage=f"{readout.name}: {one.stage}") for one in moved]
            readouts.append(replace(readout, stages=rest))
        kept = (*stages[:-1], replace(combined, readouts=tuple(readouts)))
    ends = low * (1 - LIGHT_TOLERANCE), high * (1 + LIGHT_TOLERANCE)
    clipped = max(float(trial.clipped.mean()) for trial in trials)
    pixels = trials[0].of_frame.pixels
    return Plan(
        camera.name, tolerance_dn, tuple(effects), kept, stages, frame, *ends, clipped, pixels
    )


def prepare_planned_exposure(
    camera: Camera,
    exposure: Exposure,
    shape: tuple[int, ...],
    origin: tuple[int, int],
    options: ExposeOptions,
) -> PreparedExposure:
    """Return the exposure of :func:`sensor.expose.prepare_exposure`, with a plan if ``tolerance_dn`` is set.

    shape, origin : (rows, columns) of the window and its first pixel.  options : completed.  Raises InputError.
    """
    prepared = prepare_exposure(camera, exposure, shape, origin, options)
    tolerance_dn = options["tolerance_dn"]
    if tolerance_dn is None:
        return prepared
    return replace(prepared, planner=partial(plan_of, tolerance_dn=tolerance_dn))


def _verdict(effect: Effect) -> str:
    return "kept" if effect.kept else "left out"


def _ends_e(light: Detected) -> tuple[float, float]:
    """Return the mean photoelectrons of the darkest and the brightest pixel in all exposures of the frame."""
    others = getattr(light.signal, "by_readout", None) or {}
    parts = [light.mean_e, *(np.asarray(one.light) for one in others.values())]
    return min(float(x.min()) for x in parts), max(float(x.max()) for x in parts)
