"""Mean and variance of the codes of pixels that each have a mean count, a gain and an offset of their own.

* Away from full well and both ends of the converter the signal behind a straight chain is a sum of a Poisson count and
  a normal, whose characteristic function is known: the rounding of the codes in closed form.
* Where noise hides the steps the count is as good as normal there, also behind a curve that is straight within 2σ.
* Elsewhere sums over counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Frame, Moments
from ..core.code_law import code_moments
from ..core.rounding import NO_HARMONIC, rounded_poisson
from ..core.types import Float64Array
from .curve import behind
from .given_count import BLURRING, SHARP_DN
from .pixel_counts import FEW, MORE, REACH, CountLaws, CountNodes
from .pixel_table import tabulated
from .stage import Chain, Line, PixelNoise, Stage, converter_of

AT_ONCE = 2**19
"""Counts of all pixels that are looked at together: a bound of the memory."""

INSIDE = 9.0
"""σ between a signal and an end from which on the end does not matter."""

STRAIGHT_DN = 0.02
"""A curve whose third difference within 2σ is below this leaves a count's mean and variance to its second order."""

NOISELESS_DN = 0.05
"""Below this noise the harmonics of the steps of the converter are too many."""

SELDOM = 2e-3
"""In a state of less chance a count is taken as normal: at a clip its skewness moves the mean by 0.07 e- or less."""

Codes = tuple[Float64Array, Float64Array]
"""Mean [DN] and variance [DN²] of the codes of some pixels."""


Part: TypeAlias = "Stage | Line | PixelNoise"


@dataclass(frozen=True, eq=False)
class PixelCodes:
    """Some pixels of a strip in one state.

    parts : what stands between the count and the converter, for all pixels of the strip.
    numbers, law, chance : of these pixels, (P,): number in the strip, law of the count, and chance of the state.
    noise : mean and variance of noise behind the count, of all pixels of the strip, by number of the part.
    """

    stages: Chain
    frame: Frame
    parts: Sequence[Part]
    numbers: NDArray[np.intp]
    law: CountLaws
    chance: Float64Array
    noise: Mapping[int, tuple[Float64Array, Float64Array]]

    def some(self, which: NDArray[np.intp]) -> PixelCodes:
        """Some of them."""
        law = CountLaws(*(x[which] for x in self.law))
        return replace(self, numbers=self.numbers[which], law=law, chance=self.chance[which])

    def ideal(self, counts: Float64Array, rest_e2: Array = 0.0) -> Codes:
        """Mean and variance of the code before rounding of these counts, (…, P) [DN, DN²].

        rest_e2 : variance of a normal about each.
        """
        m = Moments(counts, np.broadcast_to(rest_e2, counts.shape), 0.0, self.frame)
        for number, part in enumerate(self.parts):
            if isinstance(part, Line):
                gain, offset = (x[self.numbers] for x in part)
                m = replace(m, mean=gain * m.mean + offset, temporal=gain**2 * m.temporal)
            elif isinstance(part, PixelNoise):
                mean, variance = (x[self.numbers] for x in self.noise[number])
                m = m.add(mean=mean, temporal=variance)
            else:
                m = behind(part, m)
        converter = converter_of(self.stages)
        mean, variance = (np.broadcast_to(x, counts.shape) for x in (m.mean, m.temporal))
        return converter.black_level_dn + converter.gain_dn_per_v * mean, converter.gain_dn_per_v**2 * variance

    def moments(self) -> Codes:
        """Mean and variance of the codes, (P,)."""
        mean, variance = np.empty(self.numbers.size), np.empty(self.numbers.size)
        for which, find in self._ways():
            for some in np.array_split(which, which.size // 2**14 + 1):
                if some.size:
                    mean[some], variance[some] = find(self.some(some))
        return mean, variance

    def _ways(self) -> Iterator[tuple[NDArray[np.intp], Callable[[PixelCodes], Codes]]]:
        """Which pixels to look at in which way."""
        mu, sigma, converter = self.law.mean, np.sqrt(self.law.variance), converter_of(self.stages)
        full = min((s.saturation_e for s in self.stages if s.saturation_e is not None), default=np.inf)
        at = np.array([-INSIDE, -2.0, -1.0, 0.0, 1.0, 2.0, INSIDE])[:, None]
        reach = mu + at * sigma
        reach[-1] += np.where(sigma > 0, 25.0, 0.0)
        x, noise = self.ideal(np.maximum(reach, 0.0))
        own = np.sqrt(noise[3])
        third = np.abs(x[5] - 2 * x[4] + 2 * x[2] - x[1]) if any(s.curved for s in self.stages) else np.zeros(mu.size)
        inside = (x.min(0) > INSIDE * own + 0.5) & (x.max(0) < converter.highest - 0.5 - INSIDE * own)
        inside &= (reach[-1] < full) & (third < STRAIGHT_DN) & (converter.inl_lsb is None)
        sure = (sigma == 0) | (reach[0] > full)
        slope = np.abs(x[4] - x[2]) / np.maximum(2 * sigma, 1e-300)
        sharp = (own < SHARP_DN) & (slope >= BLURRING) & ~sure
        straight = not any(s.curved for s in self.stages) and self.law.is_poisson
        closed = inside & ~sure & (own >= NOISELESS_DN) & (own < NO_HARMONIC) & straight
        smooth = inside & ~sure & ~closed & ~sharp & ((mu >= FEW) | (own >= SHARP_DN))
        smooth |= ~sure & ~closed & (self.chance < SELDOM)
        sums = ~(sure | closed | smooth)
        every = sums & (sharp | (mu < FEW))
        yield np.flatnonzero(sure), PixelCodes._sure
        yield np.flatnonzero(closed), PixelCodes._closed
        yield np.flatnonzero(smooth), PixelCodes._smooth
        yield np.flatnonzero(every), PixelCodes._every
        yield np.flatnonzero(sums & ~every), PixelCodes._spaced

    def _sure(self) -> Codes:
        """One count."""
        return self._over(CountNodes(self.law.mean[None, :], np.ones((1, 1)), np.zeros(1)))

    def _smooth(self) -> Codes:
        """The count is as good as normal."""
        return self._over(CountNodes(self.law.mean[None, :], np.ones((1, 1)), self.law.variance))

    def _closed(self) -> Codes:
        """Poisson and normal, rounded."""
        x, noise = self.ideal(np.stack([np.zeros(self.law.mean.size), self.law.mean]))
        return rounded_poisson(x[1], np.sqrt(noise[1]), (x[1] - x[0]) / self.law.mean, self.law.mean)

    def _every(self) -> Codes:
        """Sums over all counts."""
        return tabulated(self, PixelCodes._every_by_itself) or self._every_by_itself()

    def _every_by_itself(self) -> Codes:
        """Sums over all counts of each pixel; pixels of like means together."""
        mean, variance = np.empty(self.numbers.size), np.empty(self.numbers.size)
        left = np.argsort(self.law.mean)[::-1]
        while left.size:
            counts = 2 * REACH * np.sqrt(self.law.mean[left[0]]) + MORE
            here, left = np.split(left, [max(int(AT_ONCE / counts), 1)])
            part = self.some(here)
            mean[here], variance[here] = part._over(part.law.every_count())
        return mean, variance

    def _spaced(self) -> Codes:
        """Sums over counts a quarter of σ apart."""
        return tabulated(self, PixelCodes._spaced_by_itself) or self._spaced_by_itself()

    def _spaced_by_itself(self) -> Codes:
        """Sums over counts a quarter of σ apart, of each pixel."""
        return self._over(self.law.spaced())

    def _over(self, nodes: CountNodes) -> Codes:
        """Mean and variance of the codes over these counts."""
        converter = converter_of(self.stages)
        x, noise = self.ideal(nodes.counts, nodes.rest_e2)
        code, variance = code_moments(x, np.sqrt(noise), converter.highest, converter.inl_lsb)
        mean = np.sum(nodes.chances * code, axis=0)
        return mean, np.sum(nodes.chances * (variance + (code - mean) ** 2), axis=0)
