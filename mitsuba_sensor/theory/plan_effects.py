"""Effects of single stages on the codes of an exposure, and which stages may go together."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Exposure, Frame, InputError, Moments
from ..core.types import Float64Array
from ..stages.propagate import propagate
from ..stages.stage import Chain, Stage, converter_of, place_of, without
from .light_levels import LightLevels
from .pixel_moments import PixelStrip
from .pixel_swing import Codes
from .plan_chances import PlanChances
from .plan_places import Places, places_of_extremes
from .plan_sample import PlanSample
from .response import Response
from .steps_shown import rounding_error_dn

FEW = 1 / 8
"""Expected pixels that a stage which is left out may move further than its share of the tolerance."""

MOST_LEVELS, FEWEST_LEVELS, WORK = 13, 4, 2**18
"""Levels of light at which the chains are compared. WORK normals may be added up for all of them: of a chain that takes
more, fewer levels are looked at."""

INSIDE = 0.5
"""Share of the pixels that the converter must not clip where changes in front of it count."""

OF_SATURATION = (0.5, 0.97, 0.9, 1.0)
"""Shares of the light that saturates a pixel at which the chains are compared, too; the first are the last to be left
out."""


@dataclass(frozen=True)
class Effect:
    """What one stage does by itself, at the light level where it does most.

    mean_dn, temporal_dn, spatial_dn : the change of the mean, and the root of the change of each variance [DN]: of the
        codes; or, where that is beyond the tolerance, before rounding and away from the clips.
    structure_dn : of what the pixels of a row or column share, what it does to the mean over that line, times the root
        of the line's length: to be compared with the noise of a pixel [DN].
    pixels_beyond : expected number of pixels whose own mean or σ it moves by more than the tolerance.
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

    def check(self, exposure: Exposure, light: LightLevels, shape: tuple[int, int]) -> None:
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
        low, high = float(light.light_e[0]), float(light.light_e[-1])
        if low < self.darkest_e or high > self.brightest_e:
            raise InputError(
                f"the plan was made for {self.darkest_e:.6g} … {self.brightest_e:.6g} mean photoelectrons per pixel, "
                f"and this light has {low:.6g} … {high:.6g}; make a plan for this one."
            )


@dataclass(frozen=True, eq=False)
class Trial:
    """A chain with and without stages, compared pixel by pixel over a range of light.

    yields : mean and variance of the electrons that a photon frees.
    """

    whole: Chain
    frame: Frame
    range: PlanRange
    yields: tuple[float, float]
    tolerance_dn: float
    _reach: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def effect(self, stage: Stage) -> Effect:
        """What one stage does by itself."""
        if stage.required or self._is_idle(stage):
            return Effect(stage.label, True, 0.0, 0.0, 0.0, 0.0, 0.0, "")
        effect = self.moved([stage], stage.label)
        own = self._length(stage) ** 0.5 * max(effect.temporal_dn, effect.spatial_dn)
        return replace(effect, structure_dn=max(own, effect.structure_dn))

    def moved(self, out: Collection[Stage], label: str = "") -> Effect:
        """What some stages do together.

        Means, σ and the mean of lines are of the average pixel, at the level of light where they move most. The
        converter can hide a change at one level and show it at the next, so the swing counts too, where it clips
        nothing; and so does the largest error that rounding makes where less noise hides its steps.
        """
        stages, full = without(self.whole, out), self.full
        rest = PlanChances.of(stages, self.sample)
        changes = [self._changes(full.swing, rest.swing, self._inside)]
        if (
            max(changes[0][0], *np.sqrt(changes[0][1:])) <= self.tolerance_dn
        ):  # else the stages are needed already
            rest = rest.with_codes(stages, self.sample)
            changes.append(
                self._changes(full.codes, rest.codes, np.ones(self._inside.shape, bool))
            )
        mean_dn, temporal_dn2, spatial_dn2 = np.max(changes, axis=0)
        steps_dn, of_lines_dn = self._shown_steps(rest, out)
        moved = self._moved(rest)
        self._reach[_key(out)] = tuple(map(self._reach_of, moved))
        expected = self.sample.shares @ (np.maximum(*moved) > self.tolerance_dn).any(axis=1)
        return Effect(
            label,
            True,
            float(mean_dn + steps_dn),
            math.sqrt(float(temporal_dn2)),
            math.sqrt(float(spatial_dn2)),
            of_lines_dn,
            min(float(expected), 1.0) * self._pixels,
            "",
        )

    def chosen(self, free: list[Stage], alone: dict[int, Effect]) -> list[Stage]:
        """Stages whose effects stay within the tolerance together, from the smallest on."""
        tolerance, sums = self.tolerance_dn, np.zeros(7)
        out: list[Stage] = []
        small = [stage for stage in free if alone[id(stage)].largest_dn <= tolerance]
        for stage in sorted(
            small,
            key=lambda stage: (alone[id(stage)].largest_dn, alone[id(stage)].pixels_beyond),
        ):
            e = alone[id(stage)]
            squares = (
                np.array(
                    [
                        e.temporal_dn,
                        e.spatial_dn,
                        max(e.temporal_dn, e.spatial_dn, e.structure_dn),
                    ]
                )
                ** 2
            )
            reach_dn, reach_sigma_dn = self._reach.get(_key([stage]), (0.0, 0.0))
            added = sums + np.array(
                [e.mean_dn, reach_dn, *squares, reach_sigma_dn**2, e.pixels_beyond]
            )
            within = bool(np.all(np.concatenate([added[:2], np.sqrt(added[2:6])]) <= tolerance))
            if (within and added[6] < 1) or tolerance == np.inf:
                out, sums = [*out, stage], added
        while out and tolerance != np.inf:
            together = self.moved(out)
            if together.largest_dn <= tolerance and together.pixels_beyond < 1:
                break
            out.pop()
        return out

    @cached_property
    def levels_e(self) -> Float64Array:
        """Levels of light at which the chains are compared: more of them where the response is curved."""
        response = Response.of(
            self.whole, self.frame, self.range.darkest_e, self.range.brightest_e
        )
        where_curved_e = _evenly(response.light_e, MOST_LEVELS - len(OF_SATURATION))
        below_saturation_e = self._levels_up_to_saturation_e
        levels_e = np.union1d(where_curved_e, below_saturation_e)
        sample = self._sample_at(levels_e)
        pixels = math.prod(sample.frame.window.shape)
        work = pixels * PixelStrip(self.whole, sample.light, sample.frame).work()
        count = max(int(levels_e.size * WORK / work), FEWEST_LEVELS)
        if count >= levels_e.size:
            return levels_e
        ends_e = np.union1d(levels_e[[0, -1]], below_saturation_e[: count // 2])
        return np.union1d(ends_e, _evenly(levels_e, count - ends_e.size))

    @property
    def _levels_up_to_saturation_e(self) -> Float64Array:
        """Levels below and at the clip of a pixel, as far as the light reaches: what is a share of the light shows
        most there."""
        converter = converter_of(self.whole)
        highest_dn = converter.highest - converter.black_level_dn
        wells_e = [stage.saturation_e for stage in self.whole if stage.saturation_e is not None]
        dark_e = self._dark_electrons_e
        clip_e = min([max(highest_dn, 1.0) / self._dn_per_e, *wells_e]) - dark_e
        top_e = min(max(clip_e, self.range.darkest_e), self.range.brightest_e)
        bottom_e = self.range.darkest_e
        return bottom_e + (top_e - bottom_e) * np.array(OF_SATURATION)

    @property
    def _dark_electrons_e(self) -> float:
        """Mean electrons of a pixel that gets no light [e-]."""
        fixed = [stage for stage in self.whole[1:] if stage.domain == "electrons"]
        mean = propagate(fixed, Moments(0.0, 0.0, 0.0, replace(self.frame, _blocks={}))).mean
        return float(np.max(np.asarray(mean, np.float64)))

    @property
    def _dn_per_e(self) -> float:
        """Nominal gain from electrons to digital numbers [DN/e-]."""
        gains = math.prod(stage.nominal_gain for stage in self.whole[1:-1])
        return gains * converter_of(self.whole).gain_dn_per_v

    @cached_property
    def sample(self) -> PlanSample:
        """The pixels that are compared."""
        return self._sample_at(self.levels_e)

    def _sample_at(self, levels_e: Float64Array) -> PlanSample:
        return PlanSample.of(
            self.whole, self.frame, levels_e, self.yields, self._extreme_places
        )

    @cached_property
    def _extreme_places(self) -> Places:
        """Where the stages that depend on the place do most and least."""
        levels_e = (self.range.darkest_e, self.range.brightest_e)
        return places_of_extremes(self.whole[1:-1], self.frame, levels_e)

    @cached_property
    def full(self) -> PlanChances:
        """What the whole chain makes of them."""
        return PlanChances.of(self.whole, self.sample).with_codes(self.whole, self.sample)

    def _changes(self, before: Codes, after: Codes, seen: NDArray[np.bool_]) -> list[float]:
        """Largest changes of mean, temporal and spatial variance of the average pixel [DN, DN², DN²].

        seen : the levels of light that count.
        """
        middle = slice(self.sample.middle)
        moved = after[0][middle] - before[0][middle]
        noise = after[1][middle] - before[1][middle]
        changes = (moved.mean(axis=0), noise.mean(axis=0), moved.var(axis=0))
        return [float(np.abs(change[seen]).max(initial=0.0)) for change in changes]

    def _shown_steps(self, rest: PlanChances, out: Collection[Stage]) -> tuple[float, float]:
        """Largest errors of the mean of a pixel, and of a line times the root of its length, that rounding makes
        because the noise of some stages no longer hides the steps of the converter [DN]."""
        shown, was_shown = (self._rounding_error_dn(x) for x in (rest, self.full))
        quieter = (rest.swing[1] < self.full.swing[1]) & self._inside
        steps = np.where(quieter, shown - was_shown, 0.0)
        lines = [stage for stage in self.whole if stage.shared_by is not None]
        if not lines:
            return float(steps.max(initial=0.0)), 0.0
        middle, variances = slice(self.sample.middle), []
        for stages, error_dn in ((without(self.whole, out), shown), (self.whole, was_shown)):
            within = self._spread_in_lines_dn2(stages)
            hiding_dn2 = -np.log(np.maximum(math.pi * error_dn[middle].max(axis=0), 1e-300)) / (
                2 * math.pi**2
            )
            variances.append(_rounding_variance_dn2(np.maximum(hiding_dn2, 0.0) + within))
        more = np.where(self._inside, variances[0] - variances[1], 0.0).max(initial=0.0)
        return float(steps.max(initial=0.0)), math.sqrt(
            2 * max(map(self._length, lines)) * more
        )

    def _rounding_error_dn(self, chances: PlanChances) -> Float64Array:
        """Largest error that rounding makes in the mean of every pixel, (P, L) [DN]."""
        own_dn, count_e = (np.sqrt(x).ravel() for x in (chances.own_dn2, chances.count_e2))
        return rounding_error_dn(own_dn, count_e, np.full(own_dn.size, self._dn_per_e)).reshape(
            chances.own_dn2.shape
        )

    def _is_idle(self, stage: Stage) -> bool:
        """Whether a stage hands on what it gets, or is a well that no pixel fills."""
        if stage.straight_below_e is not None:
            fullest = self.full.count_e + 9 * np.sqrt(self.full.count_e2) + 25
            return bool(fullest.max() < stage.straight_below_e)
        return self.hands_on(stage)

    def hands_on(self, stage: Stage) -> bool:
        """Whether a stage hands on what it gets, whatever that is."""
        if stage.saturation_e is not None:
            return False
        before = self.whole[place_of(stage, self.whole) - 1]
        window = self.sample.frame.window.crop_rows(slice(0, 1))
        swing: Array = np.ones(window.shape)
        signal = swing
        if before.domain == "electrons":
            signal = Electrons(swing)
        return (
            stage.sample(signal, replace(self.sample.frame, window=window, _blocks={}))
            is signal
        )

    def _spread_in_lines_dn2(self, stages: Chain) -> Float64Array:
        """Spatial variance inside of a line at every level of light, (L,), by the moments of the stages: of the
        pixels where it is the least."""
        inside = [stage for stage in stages[1:-1] if stage.shared_by is None]
        pixels = self.sample.frame.window
        window = replace(pixels, given=self.frame.window.given)
        light_e = self.sample.light.light
        m = propagate(
            inside, Moments(light_e, 0.0, 0.0, replace(self.frame, window=window, _blocks={}))
        )
        spatial_v2 = np.broadcast_to(np.asarray(m.spatial, np.float64), window.shape)
        return np.asarray(converter_of(stages).gain_dn_per_v ** 2 * spatial_v2.min(axis=0))

    def _moved(self, rest: PlanChances) -> tuple[Float64Array, Float64Array]:
        """How far the stages move mean and σ of every pixel, of codes or swing, (P, L) each [DN]."""
        means, sigmas = _distances(self.full.swing, rest.swing)
        means, sigmas = (np.where(self._inside, x, 0.0) for x in (means, sigmas))
        if not rest.has_codes:
            return means, sigmas
        of_codes = _distances(self.full.codes, rest.codes)
        return np.maximum(means, of_codes[0]), np.maximum(sigmas, of_codes[1])

    def _reach_of(self, moved: Float64Array) -> float:
        """How far the stages move any pixel of the frame, but FEW [DN]."""
        furthest = moved.max(axis=1)
        order = np.argsort(-furthest)
        expected = np.cumsum(self.sample.shares[order]) * self._pixels
        place = int(np.searchsorted(expected, FEW))
        if place < furthest.size:
            return float(furthest[order][place])
        return 0.0

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        """Where the converter clips nothing of most pixels, (L,)."""
        middle, converter = slice(self.sample.middle), converter_of(self.whole)
        mean_dn, variance_dn2 = (x[middle] for x in self.full.swing)
        reach_dn = 4 * np.sqrt(variance_dn2) + 0.5
        centre_dn = converter.black_level_dn + mean_dn
        inside = (centre_dn - reach_dn > 0) & (centre_dn + reach_dn < converter.highest)
        return np.asarray(inside.mean(axis=0) >= INSIDE)

    @property
    def _pixels(self) -> int:
        return self.range.rows * self.range.columns

    def _length(self, stage: Stage) -> int:
        """Pixels in the lines that share what a stage does."""
        lengths = {
            "column": self.range.rows,
            "row": self.range.columns,
            "frame": self._pixels,
        }
        return lengths.get(stage.shared_by or "", 0)


def _distances(before: Codes, after: Codes) -> tuple[Float64Array, Float64Array]:
    """How far mean and σ of every pixel are from each other [DN]."""
    return np.abs(after[0] - before[0]), np.sqrt(np.abs(after[1] - before[1]))


def _evenly(levels_e: Float64Array, count: int) -> Float64Array:
    """At most so many of some levels, the first and the last among them."""
    places = np.rint(np.linspace(0, levels_e.size - 1, min(count, levels_e.size))).astype(int)
    return np.asarray(levels_e[np.unique(places)])


def _rounding_variance_dn2(hiding_dn2: Float64Array) -> Float64Array:
    """Variance of that error over the places of the mean between two steps: Σ exp(−4π²k²σ²)/(2π²k²)."""
    k = np.arange(1.0, 65.0)[:, None]
    return np.asarray(
        np.sum(np.exp(-4 * (math.pi * k) ** 2 * hiding_dn2) / (2 * (math.pi * k) ** 2), axis=0)
    )


def _key(out: Collection[Stage]) -> int:
    return hash(frozenset(map(id, out)))
