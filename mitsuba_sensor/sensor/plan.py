"""Plan of an exposure: what each stage changes in DN, which ones can be left out, and the seconds that this saves."""

from __future__ import annotations

import statistics
import time
from collections.abc import Collection
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import Exposure, Frame, Moments, Photons, SensorWindow, check_types, require
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from .camera import Camera
from .checks import as_photons
from .old_theory import FinalMoments, final_moments
from .precision import Float32, float32_effect
from .run import row_strips_of
from .stage import Chain, Stage, sample

RUNS = 5
"""Timed runs of each chain; they take turns, so that a machine that slows down slows both."""

LEVELS = 65
"""Light levels of the scene, from its darkest to its brightest pixel, at which effects are looked at."""


IDLE = "changes nothing"
"""Why a neutral stage is left out."""


@dataclass(frozen=True)
class Effect:
    """What one stage does, at the light level where it does most [DN]."""

    stage: str
    kept: bool
    mean_dn: float
    temporal_dn: float
    spatial_dn: float
    reason: str


@dataclass(frozen=True)
class Plan:
    """The stages of an exposure with their effects. ``print(plan.explain())``; ``expose(..., plan=plan)``."""

    camera: str
    tolerance_dn: float
    effects: tuple[Effect, ...]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)
    float32: Float32
    photons: Photons = field(repr=False)
    frame: Frame = field(repr=False)

    def explain(self) -> str:
        """A table for people."""
        head = (
            f"{'stage':<23}{'':<10}{'mean':>11}{'temporal σ':>12}{'spatial σ':>11}   what it changes here at most [DN]"
        )
        lines = [f"Plan for {self.camera}: a stage is left out if all that is left out moves no level by more than "
                 f"{self.tolerance_dn:g} DN.", head]  # fmt: skip
        for e in self.effects:
            numbers = f"{e.mean_dn:>11.4g}{e.temporal_dn:>12.4g}{e.spatial_dn:>11.4g}"
            lines.append(f"{e.stage:<23}{'kept' if e.kept else 'left out':<10}{numbers}   {e.reason}")
        whole_s, planned_s = self.seconds
        lines.append(self.float32.explain())
        lines.append(f"measured: {whole_s:.3g} s a frame with the whole chain, {planned_s:.3g} s with this plan")
        return "\n".join(lines)

    @property
    def precision(self) -> str:
        """What ``expose(plan=…)`` computes in unless it is told: float64 where float32 would move too much."""
        return self.float32.precision

    @cached_property
    def seconds(self) -> tuple[float, float]:
        """Measured seconds per frame, whole chain and plan: medians of interleaved runs of the scene's top strip."""
        rows = next(row_strips_of(self.frame.window.shape, NUMPY_FLOAT64.strip_pixels))
        strip = replace(self.photons.crop_rows(rows), variance_e2=None)
        frame = self.frame.on(NUMPY_FLOAT32 if self.precision == "float32" else NUMPY_FLOAT64)
        part = replace(frame, window=frame.window.crop_rows(rows))
        times: tuple[list[float], list[float]] = ([], [])
        for run in range(RUNS + 1):
            for taken, stages in zip(times, (self.whole, self.stages), strict=True):
                started = time.perf_counter()
                sample(stages, strip, replace(part, index=run, _blocks={}))
                taken.append(time.perf_counter() - started)
        share = (rows.stop - rows.start) / self.frame.window.shape[0]
        whole_s, planned_s = (statistics.median(taken[1:]) / share for taken in times)  # the first makes the maps
        return whole_s, planned_s

    def to_dict(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "camera": self.camera,
            "tolerance_dn": self.tolerance_dn,
            "stages": [asdict(effect) for effect in self.effects],
            "float32": {**asdict(self.float32), "precision": self.precision},
        }


def plan(
    camera: Camera,
    exposure: Exposure,
    photons: Photons | ArrayLike,
    tolerance_dn: float = 0.0,
    wavelengths_nm: ArrayLike | None = None,
) -> Plan:
    """Which stages this exposure needs, from the moments of the chain at the scene's light levels.

    photons, wavelengths_nm : as for :func:`expose`.
    tolerance_dn : how far the stages left out may together move mean, temporal σ or fixed σ at any level [DN];
        0 leaves out only what changes nothing at all.
    Raises InputError for a negative tolerance and for photons that ``expose`` would refuse.
    """
    check_types(camera, exposure)
    require("tolerance_dn", tolerance_dn, 0.0, float("inf"), "digital numbers, e.g. 0.02")
    light = as_photons(photons, camera, wavelengths_nm)
    levels, frame = _levels(light, camera, exposure)
    whole = camera.stages
    full = final_moments(whole, levels, frame)
    free = [stage for stage in whole if not stage.required]
    alone = {id(stage): _distance(full, final_moments(without(whole, [stage]), levels, frame)) for stage in free}
    out: list[Stage] = []
    small = (stage for stage in free if max(alone[id(stage)]) <= tolerance_dn)
    for stage in sorted(small, key=lambda stage: max(alone[id(stage)])):
        if max(_distance(full, final_moments(without(whole, [*out, stage]), levels, frame))) <= tolerance_dn:
            out.append(stage)
    kept = without(whole, out)
    effects = tuple(_effect(stage, alone.get(id(stage)), not _among(stage, kept)) for stage in whole)
    scene = Frame(exposure, SensorWindow(1, (light.mean.shape[0], light.mean.shape[1])))
    return Plan(camera.name, tolerance_dn, effects, kept, whole, float32_effect(kept, levels, frame), light, scene)


def _effect(stage: Stage, moved: tuple[float, float, float] | None, left_out: bool) -> Effect:
    if moved is None:
        return Effect(stage.label, True, 0.0, 0.0, 0.0, "changes the unit; always needed")
    reason = IDLE if max(moved) == 0 else "below the tolerance" if left_out else ""
    return Effect(stage.label, not left_out, *moved, reason)


def without(stages: Chain, out: Collection[Stage]) -> Chain:
    """The chain without these stages. (Those of a user need no hash, and may hold arrays.)"""
    return tuple(stage for stage in stages if not _among(stage, out))


def _among(stage: Stage, stages: Collection[Stage]) -> bool:
    return any(stage is other for other in stages)


def _levels(photons: Photons, camera: Camera, exposure: Exposure) -> tuple[Photons, Frame]:
    """Pixels from the darkest to the brightest, each under every colour filter: a small window of its own."""
    order = np.argsort(photons.total, axis=None)
    chosen = order[np.linspace(0, order.size - 1, min(LEVELS, order.size)).round().astype(int)]
    tile = camera.tile
    rows = photons.mean.reshape(order.size, -1)[chosen]
    window = np.repeat(np.repeat(rows[None], len(tile[0]), axis=1), len(tile), axis=0)
    mean = window if photons.mean.ndim == 3 else window[..., 0]
    frame = Frame(exposure, SensorWindow(0, (mean.shape[0], mean.shape[1])))
    return Photons(mean, photons.wavelengths_nm, detected=photons.detected), frame


def _distance(a: FinalMoments, b: FinalMoments) -> tuple[float, float, float]:
    """Largest change of mean, temporal σ and fixed σ over the levels, without and with rounding [DN]."""
    smooth, rounded = _between(a[0], b[0]), _between(a[1], b[1])
    return max(smooth[0], rounded[0]), max(smooth[1], rounded[1]), max(smooth[2], rounded[2])


def _between(a: Moments, b: Moments) -> tuple[float, float, float]:
    pairs = ((a.mean, b.mean), (np.sqrt(a.temporal), np.sqrt(b.temporal)), (np.sqrt(a.spatial), np.sqrt(b.spatial)))
    mean, temporal, fixed = (float(np.max(np.abs(np.asarray(x) - y))) for x, y in pairs)
    return mean, temporal, fixed
