"""The law of single pixels: mean and variance over temporal noise behind every stage, with fixed-pattern noise maps.

Stages without temporal noise act on the pixels as they do in a frame, with the maps of this serial. The count has its
law about the mean that they leave, the noise behind it is normal, and so the law of the code is known (pixel_codes.py).
Everything else that the package says of frames is an average of this law over pixels (frame_theory.py).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, Moments
from ..core.types import Float64Array
from ..sensor.choices import check_law
from ..sensor.detection import Detected
from ..sensor.run import row_strips_of
from ..sensor.threads import for_each
from ..stages.propagate import propagate
from ..stages.recorder import has_temporal_noise
from ..stages.stage import Chain, Line, PixelNoise, Stage
from .pixel_codes import PixelCodes
from .pixel_counts import CountLaws
from .pixel_swing import Codes, Part
from .sampled_pixels import SampledWindow

STRIP = 2**15
"""Pixels that are looked at together."""

HIGHEST_E = 1e30
"""Mean electrons of a pixel in infinite light."""

STRAIGHT = 1e-6
"""A stage whose gain changes by a smaller share over its signal is a straight line."""


class PixelMoments(NamedTuple):
    """Mean [DN] and temporal variance [DN²] of the code of every pixel, (H, W)."""

    mean: NDArray[np.float32]
    temporal: NDArray[np.float32]


class State(NamedTuple):
    """Of every pixel: chance of this state, its electrons, and variance that a stage of temporal noise has added."""

    chance: Array
    electrons: Electrons
    variance_e2: Array = 0.0


def pixel_moments(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Mean and temporal variance of the codes of a window, for the maps of its serial, strip by strip.

    Raises InputError for a chain with a stage that has no law.
    """
    check_clean_is_known(stages)
    shape = frame.window.shape
    found = PixelMoments(np.empty(shape, np.float32), np.empty(shape, np.float32))

    def write(rows: slice) -> None:
        window = frame.window  # whose maps are known where it is one strip
        if rows != slice(0, shape[0]):
            window = window.crop_rows(rows)
        part = replace(frame, window=window, _blocks={})
        mean, variance = PixelStrip(stages, light.crop_rows(rows).signal, part).codes()
        found.mean[rows], found.temporal[rows] = (
            x.reshape(part.window.shape) for x in (mean, variance)
        )

    for_each(write, row_strips_of(shape, STRIP))
    return found


def check_clean_is_known(stages: Chain) -> None:
    """Raise InputError for a chain whose clean frame is not known."""
    check_law(stages, "the clean frame and its variance are", "average many frames")


@dataclass(frozen=True, eq=False)
class PixelStrip:
    """Some rows of a window.  light : mean photoelectrons, (H, W)."""

    stages: Chain
    light: Electrons
    frame: Frame

    def codes(self) -> Codes:
        """Mean and variance of the code of every pixel, (P,) [DN, DN²]."""
        last = len(self.stages) - 1
        return self.behind([last])[last]

    def behind(self, numbers: Collection[int]) -> dict[int, Codes]:
        """Mean and variance of the signal of every pixel behind these stages, (P,) each, in their units."""
        sums = {number: _Mixture(self.pixels) for number in numbers}
        states = self._states(sums)
        for number in range(self.count, self.split):
            if number in sums:
                for state in states:
                    law = self._count_law(state, number + 1)
                    sums[number].add(
                        slice(None), self._flat(state.chance), law.mean, law.variance
                    )
        if any(number >= self.split for number in sums):
            self._add_behind_count(sums, states)
        return {number: mixture.moments() for number, mixture in sums.items()}

    def _add_behind_count(self, sums: dict[int, _Mixture], states: list[State]) -> None:
        """Add the signal behind the stages that work on single counts, in every state of the pixels."""
        last = len(self.stages) - 1
        analogue = any(self.split <= number < last for number in sums)
        for law in self._laws(states):
            if last in sums:
                sums[last].add(law.numbers, law.chance, *law.moments())
            if analogue:
                for number, moments in enumerate(law.analogue(), start=self.split):
                    if number in sums:
                        sums[number].add(law.numbers, law.chance, *moments)

    def _laws(self, states: list[State]) -> Iterator[PixelCodes]:
        """The law of the codes in every state of the pixels, of those pixels that are ever in it."""
        for state, noise in itertools.product(states, self._noise()):
            chance = self._flat(state.chance) * math.prod(one for one, _, _ in noise.values())
            pixels = np.flatnonzero(chance)
            if pixels.size:
                moved = {number: (step, own) for number, (_, step, own) in noise.items()}
                count_law = CountLaws(*(x[pixels] for x in self._count_law(state, self.split)))
                yield PixelCodes(
                    self.stages,
                    self.frame,
                    self.parts,
                    pixels,
                    count_law,
                    chance[pixels],
                    moved,
                )

    def work(self) -> float:
        """How many normals are added up for the codes of each pixel on average, where no table helps."""
        total, laws = 0.0, self._laws(self._states({}))
        for law in laws:
            total += law.work() * law.numbers.size / self.pixels
        return total

    def noise_behind_count_dn(self, counts_e: Float64Array, rare: float) -> Float64Array:
        """σ of the noise behind each count in the quietest state of every pixel, (C, P) [DN].

        rare : chance below which a state does not count.
        """
        pixels = np.arange(self.pixels)
        whole = np.ones(pixels.size)
        counts = np.broadcast_to(counts_e[:, None], (counts_e.size, pixels.size))
        quietest = np.full(counts.shape, np.inf)
        for noise in self._noise():
            chance = math.prod((float(np.max(one)) for one, _, _ in noise.values()), start=1.0)
            moved = {number: (step, own) for number, (_, step, own) in noise.items()}
            law = PixelCodes(
                self.stages,
                self.frame,
                self.parts,
                pixels,
                CountLaws(whole, whole),
                whole,
                moved,
            )
            if chance > rare:
                quietest = np.minimum(quietest, np.sqrt(law.of_counts(counts)[1]))
        return quietest

    @property
    def pixels(self) -> int:
        """How many there are."""
        return self.frame.window.shape[0] * self.frame.window.shape[1]

    @cached_property
    def count(self) -> int:
        """The first stage that makes whole electrons; without one the first behind the mean electrons."""
        counted = (
            k for k, s in enumerate(self.stages) if s.counts_electrons or s.frees_electrons
        )
        return next(counted, self.split)

    @cached_property
    def split(self) -> int:
        """The first stage that works on single counts: a full well, or volts."""
        at = (
            k
            for k, s in enumerate(self.stages)
            if s.saturation_e is not None or s.domain in ("volts", "DN")
        )
        return next(
            k
            for k in at
            if k >= next((k for k, s in enumerate(self.stages) if s.counts_electrons), 0)
        )

    @cached_property
    def parts(self) -> list[Part]:
        """What stands between the count and the converter, for these pixels."""
        pairs = itertools.pairwise(self.stages[self.split - 1 : -1])
        return [self._part(stage, before) for before, stage in pairs]

    def _part(self, stage: Stage, before: Stage) -> Part:
        """A stage behind the count: noise of every pixel, a gain and an offset of every pixel, or the stage itself."""
        if (noise := stage.pixel_noise(self.frame)) is not None:
            states = (
                (self._flat(chance), self._flat(x), self._flat(own))
                for chance, x, own in noise.states
            )
            return PixelNoise(tuple(states))
        if before.domain != "volts" or stage.domain != "volts" or stage.curved:
            return stage
        if has_temporal_noise(stage, before, self.frame):
            return self._noisy_line(stage) or stage
        zero = np.zeros(self.frame.window.shape)
        offset = stage.sample(zero, self.frame)
        gain = stage.sample(zero + 1.0, self.frame) - offset
        return Line(self._flat(gain), self._flat(offset), np.zeros(self.pixels))

    def _noisy_line(self, stage: Stage) -> Line | None:
        """Gain, offset and added variance of a stage, by its moments; None where the noise depends on the signal."""
        shape = self.frame.window.shape

        def at(swing_v: float) -> Moments:
            return stage.moments(Moments(np.full(shape, swing_v), 0.0, 0.0, self.frame))

        dark, bright, brighter = at(0.0), at(1.0), at(2.0)
        gain, more = bright.mean - dark.mean, brighter.mean - bright.mean
        same = np.allclose(gain, more, rtol=STRAIGHT) and np.allclose(
            dark.temporal, brighter.temporal, rtol=STRAIGHT
        )
        if not same:
            return None
        offset = self._flat(dark.mean) + self._unwritten(stage, dark)
        return Line(self._flat(gain), offset, self._flat(dark.temporal))

    def _unwritten(self, stage: Stage, m: Moments) -> Float64Array:
        """Fixed offsets of a stage that has temporal noise too: known by their variance alone."""
        window = self.frame.window
        if not np.any(m.spatial) or not isinstance(window, SampledWindow):
            return np.zeros(self.pixels)
        return self._flat(np.sqrt(m.spatial) * window.normal(f"unwritten {stage.label}"))

    def _states(self, sums: dict[int, _Mixture]) -> list[State]:
        """The pixels in front of the count, in each of their states; their signal is added to ``sums``."""
        light = self.light.mapped(lambda values: np.asarray(values, np.float64))
        states = [State(1.0, replace(light, light=np.minimum(light.light, HIGHEST_E)))]
        for number, stage in enumerate(self.stages[: self.count]):
            if number:
                before = self.stages[number - 1]
                states = [
                    after for state in states for after in self._behind(stage, before, state)
                ]
            if number in sums:
                for chance, electrons, variance_e2 in states:
                    law = (self._flat(x) for x in (chance, electrons.total, variance_e2))
                    sums[number].add(slice(None), *law)
        return states

    def _behind(self, stage: Stage, before: Stage, state: State) -> Iterator[State]:
        """In front of the count: as in a frame where there is no temporal noise, else in each of its states."""
        if outcomes := stage.outcomes(state.electrons, self.frame):
            yield from (
                state._replace(chance=state.chance * chance, electrons=e)
                for chance, e in outcomes
            )
        elif has_temporal_noise(stage, before, self.frame):
            was = state.electrons
            m = stage.moments(Moments(was.total, 0.0, 0.0, self.frame))
            moved = (
                m.mean - was.total + self._unwritten(stage, m).reshape(self.frame.window.shape)
            )
            electrons = replace(was, light=was.light + moved)
            yield State(state.chance, electrons, state.variance_e2 + m.temporal)
        else:
            yield state._replace(electrons=stage.sample(state.electrons, self.frame))

    def _count_law(self, state: State, end: int) -> CountLaws:
        """Mean and variance of the count, and of what multiplies electrons up to stage number ``end``."""
        e = state.electrons
        m = propagate(
            self.stages[self.count : end],
            Moments(
                e.total,
                0.0,
                0.0,
                self.frame,
                light=Moments(e.light, 0.0, 0.0, self.frame),
                yield_mean=e.yield_mean,
                yield_variance=e.yield_variance,
                variance_e2=e.variance_e2,
            ),
        )
        return CountLaws(self._flat(m.mean), self._flat(m.temporal + state.variance_e2))

    def _noise(self) -> Iterator[dict[int, tuple[Array, Array, Array]]]:
        """Every combination of the normals of noise behind the count: chance, mean and variance, by number of part."""
        mixed = {
            k: part.states for k, part in enumerate(self.parts) if isinstance(part, PixelNoise)
        }
        for some in itertools.product(*mixed.values()):
            yield dict(zip(mixed, some, strict=True))

    def _flat(self, x: Array) -> Float64Array:
        return np.broadcast_to(np.asarray(x, np.float64), self.frame.window.shape).reshape(-1)


class _Mixture:
    """Mean and variance of every pixel over its states."""

    def __init__(self, pixels: int) -> None:
        self.chance, self.mean, self.square = (np.zeros(pixels) for _ in range(3))

    def add(
        self,
        pixels: NDArray[np.intp] | slice,
        chance: Float64Array,
        mean: Float64Array,
        variance: Float64Array,
    ) -> None:
        """One more state; means and squares are those of all states so far (West 1979), so that none is subtracted."""
        was = self.chance[pixels]
        total = was + chance
        share = np.divide(chance, total, out=np.zeros(total.shape), where=total > 0)
        off = mean - self.mean[pixels]
        self.mean[pixels] += share * off
        self.square[pixels] += chance * variance + was * share * off**2
        self.chance[pixels] = total

    def moments(self) -> Codes:
        """Mean and variance, (P,)."""
        return self.mean, np.divide(
            self.square, self.chance, out=np.zeros(self.mean.size), where=self.chance > 0
        )
