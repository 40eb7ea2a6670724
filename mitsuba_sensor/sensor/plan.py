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

from ..core import Exposure, Frame, InputError, Photons, SensorWindow, check_types, require
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from ..core.types import Float64Array
from .camera import Camera
from .checks import as_photons
from .light_levels import WIDTH, LightLevels, light_levels
from .pixel_law import COARSE
from .precision import Float32, float32_effect
from .run import row_strips_of
from .stage import Chain, Stage, converter_of, sample
from .theory import PLAIN, LightKind, Theory

RUNS = 5  # timed runs of each chain; they take turns, so that a machine that slows down slows both
LEVELS = 65  # pixels of the scene, from dark to bright, on which float32 is compared with float64
IDLE = "changes nothing"  # why a neutral stage is left out
NEVER = 1e-6  # expected pixels of a frame that fill a well, below which none does


@dataclass(frozen=True)
class Effect:
    """What one stage does by itself, at the light level where it does most.

    mean_dn, temporal_dn, spatial_dn : the change of the mean, and the root of the change of each variance [DN].
    structure_dn : of what the pixels of a row or column share, what it does to the mean over that line, times the root
        of the line's length: to be compared with the noise of a pixel [DN].
    pixels_beyond : expected number of pixels that it moves by more than the tolerance, of a law with tails.
    """

    stage: str
    kept: bool
    mean_dn: float
    temporal_dn: float
    spatial_dn: float
    structure_dn: float
    pixels_beyond: float
    reason: str

    @property
    def largest_dn(self) -> float:
        """The largest of its changes [DN]."""
        return max(self.mean_dn, self.temporal_dn, self.spatial_dn, self.structure_dn)


@dataclass(frozen=True)
class PlanRange:
    """What a plan holds for.

    exposure : the very one.  rows, columns : of the window, at most.
    darkest_e, brightest_e : mean photoelectrons of the pixels under their colour filters.
    """

    exposure: Exposure
    rows: int
    columns: int
    darkest_e: float
    brightest_e: float

    def check(self, exposure: Exposure, light: list[LightLevels], shape: tuple[int, int]) -> None:
        """Raise InputError for an exposure, a window or light beyond this range."""
        if exposure != self.exposure:
            raise InputError(
                f"the plan was made for {self.exposure.time_s:g} s at {self.exposure.temperature_k:g} K, and this "
                f"exposure is {exposure.time_s:g} s at {exposure.temperature_k:g} K; make a plan for this one."
            )
        if shape[0] > self.rows or shape[1] > self.columns:
            raise InputError(
                f"the plan was made for {self.rows} × {self.columns} pixels, and this window has {shape[0]} × "
                f"{shape[1]}; make a plan for this one."
            )
        low, high = _ends(light)
        if low < self.darkest_e or high > self.brightest_e:
            raise InputError(
                f"the plan was made for {self.darkest_e:.6g} … {self.brightest_e:.6g} mean photoelectrons per pixel, "
                f"and this light has {low:.6g} … {high:.6g}; make a plan for this one."
            )


@dataclass(frozen=True)
class Plan:
    """The stages of an exposure with their effects. ``print(plan.explain())``; ``expose(..., plan=plan)``."""

    camera: str
    tolerance_dn: float
    effects: tuple[Effect, ...]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)
    float32: Float32
    range: PlanRange
    photons: Photons = field(repr=False)
    frame: Frame = field(repr=False)

    @property
    def left_out(self) -> list[str]:
        """Labels of the stages that are left out."""
        return [effect.stage for effect in self.effects if not effect.kept]

    def explain(self) -> str:
        """A table for people."""
        names = ("mean", "temporal σ", "spatial σ", "structure", "pixels")
        head = f"{'stage':<24}{'':<10}" + "".join(f"{name:>12}" for name in names)
        lines = [
            f"Plan for {self.camera}: all that is left out moves no level by more than {self.tolerance_dn:g} DN.",
            f"It holds for {self.range.darkest_e:.4g} … {self.range.brightest_e:.4g} mean photoelectrons per pixel, "
            f"{self.range.exposure.time_s:g} s at {self.range.exposure.temperature_k:g} K.",
            head + "   what it changes by itself at most [DN]; pixels beyond the tolerance",
        ]
        for e in self.effects:
            numbers = (e.mean_dn, e.temporal_dn, e.spatial_dn, e.structure_dn, e.pixels_beyond)
            kept = "kept" if e.kept else "left out"
            lines.append(f"{e.stage:<24}{kept:<10}" + "".join(f"{x:>12.4g}" for x in numbers) + f"   {e.reason}")
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
            "range": asdict(self.range),
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
    """Which stages this exposure needs, from the theory of the codes over the range of light of the scene.

    photons, wavelengths_nm : as for :func:`expose`.
    tolerance_dn : how far the stages left out may together move the mean, the temporal σ, the spatial σ or the mean of
        a row or column (times the root of its length) at any level of light between the darkest and the brightest
        pixel, and more than which they may not be expected to move any pixel of a law with tails [DN]; 0 leaves out
        only what changes nothing at all.
    Raises InputError for a negative tolerance and for photons that ``expose`` would refuse.
    """
    check_types(camera, exposure)
    require("tolerance_dn", tolerance_dn, 0.0, float("inf"), "digital numbers, e.g. 0.02")
    light = as_photons(photons, camera, wavelengths_nm)
    window = SensorWindow(1, (light.mean.shape[0], light.mean.shape[1]), light.origin)
    frame, whole = Frame(exposure, window), camera.stages
    levels = light_levels(replace(light, variance_e2=None), whole[0], frame)
    darkest, brightest = _ends(levels)
    held = PlanRange(exposure, *window.shape, darkest * (1 - WIDTH), brightest * (1 + WIDTH))
    trial = _Trial(whole, frame, held, levels[-1].kind if levels[-1].kind.yield_mean > 1 else PLAIN, tolerance_dn)
    alone = {id(stage): trial.effect(stage) for stage in whole}
    out = trial.chosen([stage for stage in whole if not stage.required], alone)
    kept = without(whole, out)
    effects = tuple(_verdict(stage, alone[id(stage)], not _among(stage, kept)) for stage in whole)
    pixels, small = _some_pixels(light, camera, exposure)
    return Plan(
        camera.name, tolerance_dn, effects, kept, whole, float32_effect(kept, pixels, small), held, light, frame
    )


@dataclass(frozen=True, eq=False)
class _Trial:
    """Chains with and without stages, compared over a range of light."""

    whole: Chain
    frame: Frame
    range: PlanRange
    kind: LightKind
    tolerance_dn: float

    @cached_property
    def full(self) -> Theory:
        """Theory of the whole chain."""
        return Theory.of(self.whole, self.frame, self.kind)

    def effect(self, stage: Stage) -> Effect:
        """Of one stage by itself."""
        if stage.required or self._idle(stage):
            return Effect(stage.label, True, 0.0, 0.0, 0.0, 0.0, 0.0, "")
        mean, temporal, spatial = self.moved([stage])
        rows, columns = self.range.rows, self.range.columns
        length = {"column": rows, "row": columns}.get(stage.shared_by or "", 0)
        structure = float(np.sqrt(length)) * max(temporal, spatial)
        return Effect(stage.label, True, mean, temporal, spatial, structure, self._beyond(stage), "")

    def moved(self, out: Collection[Stage]) -> tuple[float, float, float]:
        """Largest change of the mean, and roots of the largest changes of both variances, without some stages [DN]."""
        rest, last = self.full.without(out), len(self.whole) - 1
        changes = [np.abs(self._levels(rest, len(rest.stages) - 1) - self._levels(self.full, last))]
        gain = converter_of(self.whole).gain_dn_per_v
        inside = self._inside
        if inside.any():  # before rounding, which can hide a change
            scale = np.array([gain, gain**2, gain**2])
            analogue = self._levels(rest, len(rest.stages) - 2) - self._levels(self.full, last - 1)
            changes.append(np.abs(analogue[inside]) * scale)
        mean, temporal, spatial = np.max([change.max(axis=0) for change in changes], axis=0)
        return float(mean), float(np.sqrt(temporal)), float(np.sqrt(spatial))

    def chosen(self, free: list[Stage], alone: dict[int, Effect]) -> list[Stage]:
        """Stages whose effects stay within the tolerance together, from the smallest on."""
        tolerance, out, sums = self.tolerance_dn, [], np.zeros(5)
        small = [stage for stage in free if alone[id(stage)].largest_dn <= tolerance]
        for stage in sorted(small, key=lambda stage: (alone[id(stage)].largest_dn, alone[id(stage)].pixels_beyond)):
            e = alone[id(stage)]
            added = sums + np.array([e.mean_dn, e.temporal_dn**2, e.spatial_dn**2, e.structure_dn**2, e.pixels_beyond])
            if max(added[0], *np.sqrt(added[1:4])) <= tolerance and (added[4] < 1 or tolerance == np.inf):
                out, sums = [*out, stage], added
        while (active := [stage for stage in out if alone[id(stage)].largest_dn]) and max(
            self.moved(active)
        ) > tolerance:
            out.pop()
        return out

    @cached_property
    def _levels_e(self) -> Float64Array:
        """Levels between the darkest and the brightest pixel, both included."""
        low, high = self.range.darkest_e, min(self.range.brightest_e, float(self.full.nodes[-1]))
        nodes = self.full.nodes
        return np.unique(np.concatenate([[low, high], nodes[(nodes > low) & (nodes < high)]]))

    def _levels(self, theory: Theory, number: int) -> Float64Array:
        return np.stack(theory.behind(theory.stages[number], self._levels_e), axis=1)

    @cached_property
    def _inside(self) -> Float64Array:
        """The levels at which the converter clips nothing."""
        converter, found = converter_of(self.whole), self.full.digital(self._levels_e)
        reach = 4 * np.sqrt(found.temporal + found.spatial) + 1
        return (found.mean - reach > 0) & (found.mean + reach < converter.highest)

    def _idle(self, stage: Stage) -> bool:
        """Whether nothing changes without the stage: its law is none, and so are its moments; or no well fills."""
        theory = self.full
        if stage.saturation_e is not None:
            pixels, at = self.range.rows * self.range.columns, np.array([self._levels_e[-1]])
            entering = theory.behind(self.whole[self.whole.index(stage) - 1], at)
            sigma = float(np.sqrt(entering.temporal + entering.spatial)[0])
            full = float(entering.mean[0]) + 9 * sigma >= stage.saturation_e
            return not full and theory.chance_to_fill(at) * pixels < NEVER
        return theory.is_neutral(stage)

    def _beyond(self, stage: Stage) -> float:
        """Expected number of pixels that a law with tails moves by more than the tolerance."""
        pixels, per_e = self.range.rows * self.range.columns, self.full.to_dn(self.whole[0])
        share, size_dn = stage.rare(self.full.conditions)
        beyond = share if size_dn * self.full.to_dn(stage) > self.tolerance_dn else 0.0
        law = stage.pixel_law(self.full.conditions, COARSE)
        if law is not None:
            moved = np.abs((law.gains - 1) * self._levels_e[-1] + law.offsets) * per_e > self.tolerance_dn
            beyond = max(beyond, float(law.weights @ np.any(moved & (law.states > 0), axis=1)))
        return pixels * beyond


def _verdict(stage: Stage, alone: Effect, left_out: bool) -> Effect:
    if stage.required:
        return replace(alone, reason="changes the unit; always needed")
    idle = alone.largest_dn == 0 and alone.pixels_beyond == 0
    return replace(alone, kept=not left_out, reason=IDLE if idle else "below the tolerance" if left_out else "")


def without(stages: Chain, out: Collection[Stage]) -> Chain:
    """The chain without these stages. (Those of a user need no hash, and may hold arrays.)"""
    return tuple(stage for stage in stages if not _among(stage, out))


def _among(stage: Stage, stages: Collection[Stage]) -> bool:
    return any(stage is other for other in stages)


def _ends(light: list[LightLevels]) -> tuple[float, float]:
    """Darkest and brightest pixel [e-]."""
    return min(float(one.light_e[0]) for one in light), max(float(one.light_e[-1]) for one in light)


def _some_pixels(photons: Photons, camera: Camera, exposure: Exposure) -> tuple[Photons, Frame]:
    """Pixels from dark to bright, each under every colour filter: a small window of its own."""
    total, tile = photons.total.ravel(), camera.tile
    spread = np.linspace(0, total.size - 1, min(LEVELS, total.size)).round().astype(int)
    chosen = np.unique(np.concatenate([spread, [total.argmin(), total.argmax()]]))
    rows = photons.mean.reshape(total.size, -1)[chosen[np.argsort(total[chosen], kind="stable")]]
    window = np.repeat(np.repeat(rows[None], len(tile[0]), axis=1), len(tile), axis=0)
    mean = window if photons.mean.ndim == 3 else window[..., 0]
    frame = Frame(exposure, SensorWindow(0, (mean.shape[0], mean.shape[1])))
    return Photons(mean, photons.wavelengths_nm, detected=photons.detected), frame
