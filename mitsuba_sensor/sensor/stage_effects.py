"""Effects of single stages on the codes of an exposure, and which stages may go together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Exposure, Frame, InputError
from ..core.backend import NUMPY_FLOAT64
from ..core.types import Float64Array
from .converter_steps import TINY, beats, rounding, steps_of_lines
from .light_kind import LightKind
from .light_levels import LightLevels
from .pixel_law import COARSE
from .stage import Chain, Stage, converter_of, place_of, total
from .theory import Theory
from .uncounted import theory_of, theory_without

NEVER = 1e-6  # expected pixels of a frame that fill a well, below which none does

FEW = 1 / 8
"""Expected pixels that a stage which is left out may move further than its share of the tolerance."""

TOO_CLOSE_E = 1e-9  # to 0: so much light is none


@dataclass(frozen=True)
class Effect:
    """What one stage does by itself, at the light level where it does most.

    mean_dn, temporal_dn, spatial_dn : the change of the mean, and the root of the change of each variance [DN]: of the
        codes; or, where that is beyond the tolerance, before rounding and away from the clips.
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
    _lost: dict[int, Float64Array] = field(default_factory=dict)

    @cached_property
    def full(self) -> Theory:
        """Theory of the whole chain."""
        theory, last = theory_of(self.whole, self.frame, self.kind), len(self.whole) - 1
        ends = [self.range.darkest_e, min(self.range.brightest_e, float(theory.nodes[-1]) / theory.electrons_per_light)]
        apart = [end for end in ends if end > TOO_CLOSE_E]  # a node next to 0 has no slope
        vars(theory)["nodes"] = np.union1d(theory.nodes, np.multiply(apart, theory.electrons_per_light))
        filling = [k - 1 for k, stage in enumerate(self.whole) if stage.saturation_e is not None]
        theory.prepare([*filling, last - 1])
        return theory

    def effect(self, stage: Stage) -> Effect:
        """Of one stage by itself."""
        if stage.required or self._idle(stage):
            return Effect(stage.label, True, 0.0, 0.0, 0.0, 0.0, 0.0, "")
        mean, temporal, spatial, dither = self.moved([stage])
        own, beyond = self._length(stage) ** 0.5 * max(temporal, spatial), self._tails_of(stage).beyond
        return Effect(stage.label, True, mean, temporal, spatial, max(own, dither), beyond(self.tolerance_dn), "")

    def moved(self, out: Collection[Stage]) -> tuple[float, float, float, float]:
        """What some stages do together [DN]: the largest change of the mean; roots of the largest changes of both
        variances, and of the variance that lines keep because the stages no longer hide steps of the converter."""
        rest, last = theory_without(self.full, out), len(self.whole) - 1
        scale = converter_of(self.whole).gain_dn_per_v ** np.array([1, 2, 2])
        analogue = [self._levels(rest, len(rest.stages) - 2) * scale, self._levels(self.full, last - 1) * scale]
        changes = [np.abs(analogue[0] - analogue[1])[self._inside]]  # before rounding, which can hide a change
        between = [
            rounding(a) + beats(t._given, self._electrons, a) for t, a in zip((rest, self.full), analogue, strict=True)
        ]
        changes.append(np.abs(between[0] - between[1]))  # of the levels that are looked at
        if np.max(changes[0] ** [1, 0.5, 0.5], initial=0.0) <= self.tolerance_dn:  # else it is needed already
            changes.append(np.abs(self._levels(rest, len(rest.stages) - 1) - self._levels(self.full, last)))
        mean, temporal, spatial = np.max([change.max(axis=0, initial=0.0) for change in changes], axis=0)
        lost = (analogue[1] - analogue[0])[:, 1:].sum(axis=1)
        if len(out) == 1:
            self._lost.update((id(stage), lost) for stage in out)
        in_lines = sum((self._lost[id(stage)] for stage in out if stage.shared_by is None), np.zeros(lost.size))
        return float(mean), float(np.sqrt(temporal)), float(np.sqrt(spatial)), self._dithered(in_lines)

    def _dithered(self, lost: Float64Array) -> float:
        """Root of the largest change of the variance of the means of lines, times their length, where the noise and
        the offsets within a line lose a variance at every level, and hide less of the steps of the converter [DN]."""
        lines = [stage for stage in self.whole if stage.shared_by is not None]
        if not lines or not lost.any():
            return 0.0
        within, of_lines = self._variances
        moved = steps_of_lines(np.maximum(within - lost, TINY), np.maximum(within, TINY), of_lines)
        return float(np.sqrt(max(map(self._length, lines)) * np.max(moved, initial=0.0)))

    @cached_property
    def _variances(self) -> tuple[Float64Array, Float64Array]:
        """In front of the converter, at every level, of what varies inside of a line, and of what its pixels share."""
        rest = theory_without(self.full, [stage for stage in self.whole if stage.shared_by is not None])
        gain, found = converter_of(self.whole).gain_dn_per_v, []
        for theory in (rest, self.full):
            found.append(gain**2 * self._levels(theory, len(theory.stages) - 2)[:, 1:].sum(axis=1))
        return found[0], np.maximum(found[1] - found[0], 0.0)

    def _length(self, stage: Stage) -> int:
        """Pixels in the lines that share what a stage does."""
        return {"column": self.range.rows, "row": self.range.columns}.get(stage.shared_by or "", 0)

    def chosen(self, free: list[Stage], alone: dict[int, Effect]) -> list[Stage]:
        """Stages whose effects stay within the tolerance together, from the smallest on."""
        tolerance, sums = self.tolerance_dn, np.zeros(6)
        out: list[Stage] = []
        small = [stage for stage in free if alone[id(stage)].largest_dn <= tolerance]
        for stage in sorted(small, key=lambda stage: (alone[id(stage)].largest_dn, alone[id(stage)].pixels_beyond)):
            e = alone[id(stage)]
            squares = np.array([e.temporal_dn, e.spatial_dn, max(e.temporal_dn, e.spatial_dn, e.structure_dn)]) ** 2
            added = sums + np.array([e.mean_dn, *squares, e.pixels_beyond, self._tails_of(stage).reach_dn])
            within = max(added[0], *np.sqrt(added[1:4]), added[5]) <= tolerance
            if (within and added[4] < 1) or tolerance == np.inf:
                out, sums = [*out, stage], added
        while (active := [stage for stage in out if alone[id(stage)].largest_dn]) and max(
            self.moved(active)
        ) > tolerance:
            out.pop()
        return out

    @cached_property
    def _levels_e(self) -> Float64Array:
        """Levels between the darkest and the brightest pixel, both included."""
        nodes = self.full.nodes / self.full.electrons_per_light
        low, high = self.range.darkest_e, min(self.range.brightest_e, float(nodes[-1]))
        return np.unique(np.concatenate([[low, high], nodes[(nodes > low) & (nodes < high)]]))

    @cached_property
    def _electrons(self) -> Float64Array:
        """Mean counts at the levels, light and dark together."""
        return self._levels_e * self.full.electrons_per_light + self.full._dark_e

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
            entering = theory.behind(self.whole[place_of(stage, self.whole) - 1], at)
            sigma = float(np.sqrt(entering.temporal + entering.spatial)[0])
            full = float(entering.mean[0]) + 9 * sigma >= stage.saturation_e
            return not full and theory.chance_to_fill(at) * pixels < NEVER
        return theory.is_neutral(stage)

    def _tails_of(self, stage: Stage) -> Tails:
        """Of the pixels that a stage moves much further than its σ says: by its law, or by the measured map."""
        conditions, pixels = self.full.conditions, self.range.rows * self.range.columns
        per_e, (share, step) = self.full.to_dn(self.whole[0]), stage.rare(conditions)
        parts = [(np.array([step * self.full.to_dn(stage)]), np.array([share * pixels]))]
        if (law := stage.pixel_law(conditions, COARSE)) is not None:
            steps = np.abs((law.gains - 1) * self._levels_e[-1] + law.offsets) * per_e
            parts.append((np.where(law.states > 0, steps, 0.0).max(axis=1), law.weights * pixels))
        if conditions.window.given.keys() & stage.fpn_maps(conditions.window).keys():
            moved = self._moved_by_map(stage)
            parts.append((moved, np.ones(moved.size)))
        return Tails(tuple(parts))

    def _moved_by_map(self, stage: Stage) -> Float64Array:
        """How far a stage with a measured map moves every pixel of the window, at the brightest level [DN]."""
        frame = replace(self.frame.on(NUMPY_FLOAT64), _blocks={})
        level = np.full(frame.window.shape, self._levels_e[-1])
        signal: Array = Electrons(level, 0.0)
        if stage.domain == "volts":
            before = self.whole[place_of(stage, self.whole) - 1]
            signal = np.full(level.shape, self.full.behind(before, self._levels_e[-1:]).mean[0])
        change = np.subtract(total(stage.sample(signal, frame)), total(signal))
        moved = np.abs(np.broadcast_to(change, level.shape)).ravel()
        return np.asarray(moved * self.full.to_dn(stage), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Tails:
    """How many pixels one stage moves how far.

    parts : steps [DN] and the expected number of pixels of each; of several descriptions the worst counts.
    """

    parts: tuple[tuple[Float64Array, Float64Array], ...]

    def beyond(self, tolerance_dn: float) -> float:
        """Expected number of pixels that it moves by more than the tolerance."""
        return max(float(pixels[steps > tolerance_dn].sum()) for steps, pixels in self.parts)

    @property
    def reach_dn(self) -> float:
        """How far it moves any pixel, but FEW."""
        reach = 0.0
        for steps, pixels in self.parts:
            order = np.argsort(-steps)
            place = int(np.searchsorted(np.cumsum(pixels[order]), FEW))
            reach = max(reach, float(steps[order][place]) if place < steps.size else 0.0)
        return reach


def ends_of(light: list[LightLevels]) -> tuple[float, float]:
    """Darkest and brightest pixel [e-]."""
    return min(float(one.light_e[0]) for one in light), max(float(one.light_e[-1]) for one in light)
