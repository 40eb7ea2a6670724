"""Effects of single stages on the codes of an exposure, and which stages may go together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core import Exposure, Frame, InputError
from ..core.types import Float64Array
from .light_levels import LightLevels
from .pixel_law import COARSE
from .stage import Chain, Stage, converter_of
from .theory import LightKind, Theory

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
        low, high = ends_of(light)
        if low < self.darkest_e or high > self.brightest_e:
            raise InputError(
                f"the plan was made for {self.darkest_e:.6g} … {self.brightest_e:.6g} mean photoelectrons per pixel, "
                f"and this light has {low:.6g} … {high:.6g}; make a plan for this one."
            )


@dataclass(frozen=True, eq=False)
class Trial:
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
        tolerance, sums = self.tolerance_dn, np.zeros(5)
        out: list[Stage] = []
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
    def _inside(self) -> NDArray[np.bool_]:
        """The levels at which the converter clips nothing."""
        converter, found = converter_of(self.whole), self.full.digital(self._levels_e)
        reach = 4 * np.sqrt(found.temporal + found.spatial) + 1
        return np.asarray((found.mean - reach > 0) & (found.mean + reach < converter.highest))

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


def without(stages: Chain, out: Collection[Stage]) -> Chain:
    """The chain without these stages. (Those of a user need no hash, and may hold arrays.)"""
    return tuple(stage for stage in stages if not among(stage, out))


def among(stage: Stage, stages: Collection[Stage]) -> bool:
    return any(stage is other for other in stages)


def ends_of(light: list[LightLevels]) -> tuple[float, float]:
    """Darkest and brightest pixel [e-]."""
    return min(float(one.light_e[0]) for one in light), max(float(one.light_e[-1]) for one in light)
