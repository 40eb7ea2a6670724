"""Signal of single pixels behind the count, part by part: a sum of normals about each count."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Frame, Moments
from ..core.types import Float64Array
from ..stages.stage import Chain, Line, PixelNoise, Stage, converter_of
from .pixel_counts import FEW, MORE, CountLaws, CountNodes
from .register_law import cells_of_gamma_laws
from .swing import STRAIGHT_DN, Curve, Normals, pass_curve

AT_ONCE = 2**19
"""Counts of all pixels that are looked at together: a bound of the memory."""

INSIDE = 9.0
"""σ between a signal and an end from which on the end does not matter."""

Codes = tuple[Float64Array, Float64Array]
"""Mean [DN] and variance [DN²] of the codes of some pixels."""

Part: TypeAlias = "Stage | Line | PixelNoise"

ONE_COUNT: Float64Array = np.ones((1, 1))
"""Chance of a count that is certain."""


@dataclass(frozen=True, eq=False)
class PixelSwing:
    """Some pixels of a strip in one state, and their signal behind the count.

    parts : what stands between the count and the converter, for all pixels of the strip.
    numbers, law, chance : of these pixels, (P,): number in the strip, law of the count, and chance of the state.
    noise : mean and variance of noise behind the count, of all pixels of the strip, by number of the part.
    take_apart : whether noise is wide beside a curve.
    well_is_passed : whether the counts are those that a full well has left.
    """

    stages: Chain
    frame: Frame
    parts: Sequence[Part]
    numbers: NDArray[np.intp]
    law: CountLaws
    chance: Float64Array
    noise: Mapping[int, tuple[Float64Array, Float64Array]]
    take_apart: bool = False
    well_is_passed: bool = False

    @property
    def is_curved(self) -> bool:
        """Whether the response of a stage is curved."""
        return any(stage.curved for stage in self.stages)

    @property
    def full_well_e(self) -> float:
        """Count that fills the smallest well that clips; one with a knee is a curved stage."""
        clipping = (s.saturation_e for s in self.stages if not s.curved)
        return min((well_e for well_e in clipping if well_e is not None), default=np.inf)

    def some(self, which: NDArray[np.intp]) -> Self:
        """Some of these pixels."""
        law = CountLaws(*(x[which] for x in self.law))
        return replace(self, numbers=self.numbers[which], law=law, chance=self.chance[which])

    def swings(self, normals: Normals) -> Iterator[tuple[Normals, Normals]]:
        """In front of each part and behind it, part by part; the first ones are electrons."""
        for number, part in enumerate(self.parts):
            before, normals = self._pass(number, part, normals)
            yield before, normals

    def ideal(self, normals: Normals) -> Normals:
        """Law of the code before rounding [DN, DN²]."""
        for _, behind in self.swings(normals):
            normals = behind
        converter = converter_of(self.stages)
        means = converter.black_level_dn + converter.gain_dn_per_v * normals.means
        return Normals(normals.chances, means, converter.gain_dn_per_v**2 * normals.variances)

    def of_counts(
        self, counts: Float64Array, rest_e2: Array = 0.0
    ) -> tuple[Float64Array, Float64Array]:
        """Mean and variance of the code before rounding of each of these counts, (…, P) [DN, DN²].

        rest_e2 : variance of a normal about each.
        """
        whole = self
        if self.take_apart:
            whole = replace(self, take_apart=False)
        _, means, variances = whole.ideal(
            Normals(ONE_COUNT, counts, np.broadcast_to(rest_e2, counts.shape))
        )
        return np.broadcast_to(means, counts.shape), np.broadcast_to(variances, counts.shape)

    def analogue(self) -> Iterator[Codes]:
        """Mean and variance of the signal behind each part, (P,), in its unit."""
        fullest = self.law.mean + INSIDE * np.sqrt(self.law.variance) + MORE
        few = (self.law.mean < FEW) & ((fullest >= self.full_well_e) | self._count_is_curved())
        found: list[list[Float64Array]] = [
            [np.empty(few.size), np.empty(few.size)] for _ in self.parts
        ]
        for which, nodes_of in ((few, CountLaws.every_count), (~few, CountLaws.as_normal)):
            for some in chunks(np.flatnonzero(which), AT_ONCE // 2**7):
                part = self.some(some)
                inside = np.ones(some.size, bool)
                excess_dn = part.widest_excess_dn(inside).max(initial=0.0)
                part = replace(part, take_apart=bool(excess_dn > STRAIGHT_DN))
                for sums, (_, law) in zip(
                    found, part.swings(Normals(*normals_of(nodes_of(part.law)))), strict=True
                ):
                    mean = np.sum(law.chances * law.means, axis=0)
                    sums[0][some] = mean
                    sums[1][some] = np.sum(
                        law.chances * (law.variances + (law.means - mean) ** 2), axis=0
                    )
        yield from ((mean, variance) for mean, variance in found)

    def _count_is_curved(self) -> NDArray[np.bool_]:
        """Where a curve distorts the law of the count."""
        if not self.is_curved:
            return np.zeros(self.numbers.size, bool)
        steps = np.array([-2.0, -1.0, 1.0, 2.0])[:, None]
        dn, _ = self.of_counts(
            np.maximum(self.law.mean + steps * np.sqrt(self.law.variance), 0.0)
        )
        return np.asarray(np.abs(dn[3] - 2 * dn[2] + 2 * dn[1] - dn[0]) > STRAIGHT_DN)

    def _pass(self, number: int, part: Part, normals: Normals) -> tuple[Normals, Normals]:
        """What enters a part, taken apart where that is needed, and what leaves it."""
        chances, means, variances = normals
        if isinstance(part, Line):
            gain, offset, added = (x[self.numbers] for x in part)
            return normals, Normals(chances, gain * means + offset, gain**2 * variances + added)
        if isinstance(part, PixelNoise):
            mean, variance = (x[self.numbers] for x in self.noise[number])
            return normals, Normals(chances, means + mean, variances + variance)
        if self.well_is_passed and part.saturation_e is not None and not part.curved:
            return normals, normals
        if self.take_apart and part.multiplication is not None:
            return normals, self._multiplied(number, part, part.multiplication, normals)
        if part.curved:
            if self.take_apart and np.any(variances):
                normals = self._curve(number, part).take_apart(normals)
            return normals, pass_curve(part, normals, self.frame)
        m = part.moments(
            Moments(means, np.broadcast_to(variances, means.shape), 0.0, self.frame)
        )
        return normals, Normals(chances, np.asarray(m.mean), np.asarray(m.temporal))

    def _multiplied(
        self, number: int, part: Stage, multiplication: tuple[float, float], normals: Normals
    ) -> Normals:
        """Cells of the gamma laws behind a register, cut where it is full."""
        (gain, spread), full_e = multiplication, part.limits[1]
        behind = self._curve(number, part)
        dn_per_e = behind.converter.gain_dn_per_v * behind.later_gain
        ends_dn = np.array([0.5, behind.converter.highest - 0.5])
        ends_e = (ends_dn - behind.converter.black_level_dn) / dn_per_e
        variances = gain**2 * (normals.variances + spread * normals.means)
        laws = Normals(normals.chances, gain * normals.means, variances)
        cells = cells_of_gamma_laws(
            laws, np.append(ends_e, full_e), behind.later_noise_dn / dn_per_e
        )
        full = cells.means >= full_e
        return Normals(
            cells.chances, np.minimum(cells.means, full_e), np.where(full, 0.0, cells.variances)
        )

    def _curve(self, number: int, stage: Stage) -> Curve:
        """A curved part and what stands behind it."""
        converter, gain, noise_v2 = converter_of(self.stages), 1.0, 0.0
        for later, part in enumerate(self.parts[number + 1 :], start=number + 1):
            if isinstance(part, Line):
                middle = float(np.median(part.gain))
                gain, noise_v2 = (
                    gain * middle,
                    middle**2 * noise_v2 + float(part.variance.max()),
                )
                noise_v2 += float(np.ptp(part.offset)) ** 2
            elif isinstance(part, PixelNoise):
                noise_v2 += float(max(x.max() for x in self.noise[later][1:])) + float(
                    np.square(self.noise[later][0]).max()
                )
            else:
                gain, noise_v2 = gain * part.nominal_gain, part.nominal_gain**2 * noise_v2
        return Curve(
            stage, converter, self.frame, gain, converter.gain_dn_per_v * math.sqrt(noise_v2)
        )

    def widest_excess_dn(self, inside: NDArray[np.bool_]) -> Float64Array:
        """By how much a curve distorts the noise in front of it at most, (P,) [DN].

        inside : where neither end of the converter cuts the signal, so that only mean and variance of it count.
        """
        excess = np.zeros(self.numbers.size)
        if not self.is_curved:
            return excess
        whole = replace(self, take_apart=False)
        sigma = np.sqrt(self.law.variance)
        counts = np.maximum(
            self.law.mean + np.array([-6.0, -3.0, 0.0, 3.0, 6.0])[:, None] * sigma, 0.0
        )
        start = Normals(ONE_COUNT, counts, np.zeros(counts.shape))
        for number, (before, _) in enumerate(whole.swings(start)):
            part = self.parts[number]
            if isinstance(part, Stage) and part.curved:
                variances = np.broadcast_to(before.variances, counts.shape)
                curve = self._curve(number, part)
                means = np.broadcast_to(before.means, counts.shape)
                excess = np.maximum(excess, curve.excess_dn(means, variances, inside))
        return excess


def normals_of(nodes: CountNodes) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Chances, counts and the variance about each, all of one shape but for the chances."""
    return nodes.chances, nodes.counts, np.broadcast_to(nodes.rest_e2, nodes.counts.shape)


def chunks(which: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    """Parts of an array of about this size."""
    if which.size:
        yield from np.array_split(which, which.size // size + 1)
