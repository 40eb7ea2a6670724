"""Mean and variance of the codes of pixels that each have a mean count, a gain and an offset of their own.

* Away from full well and both ends of the converter the signal behind a straight chain is a sum of a Poisson count and
  a normal, whose characteristic function is known: the rounding of the codes in closed form.
* Where noise hides the steps the count is as good as normal there, also behind a curve that is straight within 2σ.
* Elsewhere sums over counts; where noise is wide beside a curve, it is taken apart in front of it (swing.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.old_code_law import code_moments
from ..core.rounding import NO_HARMONIC, rounded_poisson
from ..core.types import Float64Array
from ..stages.stage import converter_of
from .pixel_counts import CELLS as COUNT_CELLS
from .pixel_counts import FEW, MORE, REACH, CountNodes
from .pixel_swing import AT_ONCE, INSIDE, ONE_COUNT, Codes, PixelSwing, chunks, normals_of
from .pixel_table import tabulated
from .steps_shown import electrons_show
from .swing import CELLS, STRAIGHT_DN, Normals

SHARP_DN = 0.5
"""Noise behind the count [DN] below which single electrons and steps of the converter show in the codes: at this one
they move a mean by 0.002 DN."""

NOISELESS_DN = 0.05
"""Below this noise the harmonics of the steps of the converter are too many, unless shot noise damps them."""

SHOWN_DN, SHOWN_AMONG_MANY_DN, MANY = 1e-4, 1e-2, 400.0
"""Single electrons count where they move the mean of a pixel further than the first of these; where an end of the
converter or the well is near, and so many electrons make the sum over all of them long, further than the second."""

SELDOM = 2e-3
"""In a state of less chance a count is taken as normal: at a clip its skewness moves the mean by 0.07 e- or less."""


class PixelCodes(PixelSwing):
    """The codes of these pixels."""

    def work(self) -> float:
        """How many normals are added up for each of these pixels on average, where no table helps."""
        counts = 0.0
        for which, find in self._ways():
            mean_e = self.law.mean[which]
            of_each = np.full(which.size, 1.0)
            if find in (PixelCodes._every, PixelCodes._every_apart):
                of_each = 2 * REACH * np.sqrt(mean_e) + MORE
            elif find in (PixelCodes._cells, PixelCodes._cells_apart):
                of_each = np.full(which.size, float(COUNT_CELLS))
            if find in (
                PixelCodes._certain_apart,
                PixelCodes._every_apart,
                PixelCodes._cells_apart,
            ):
                of_each = of_each * CELLS
            counts += float(of_each.sum())
        return counts / max(self.numbers.size, 1)

    def moments(self) -> Codes:
        """Mean and variance of the codes, (P,)."""
        mean, variance = np.empty(self.numbers.size), np.empty(self.numbers.size)
        for which, find in self._ways():
            for some in chunks(which, 2**14):
                mean[some], variance[some] = find(self.some(some))
        return mean, variance

    def _ways(self) -> Iterator[tuple[NDArray[np.intp], Callable[[PixelCodes], Codes]]]:
        """Which pixels to look at in which way."""
        mu, sigma, converter = (
            self.law.mean,
            np.sqrt(self.law.variance),
            converter_of(self.stages),
        )
        full = self.full_well_e
        at = np.array([-INSIDE, -2.0, -1.0, 0.0, 1.0, 2.0, INSIDE])[:, None]
        reach = mu + at * sigma
        reach[-1] += np.where(sigma > 0, 25.0, 0.0)
        x, noise = self.of_counts(np.maximum(reach, 0.0))
        own = np.sqrt(noise[3])
        straight = not self.is_curved
        if straight:
            third = np.zeros(mu.size)
        else:
            third = np.abs(x[5] - 2 * x[4] + 2 * x[2] - x[1])
        inside = (x.min(0) > INSIDE * own + 0.5) & (
            x.max(0) < converter.highest - 0.5 - INSIDE * own
        )
        inside &= (reach[-1] < full) & (third < STRAIGHT_DN) & (converter.inl_lsb is None)
        wide = self.widest_excess_dn(inside) > STRAIGHT_DN
        wide |= self._multiplied_and_cut(inside)
        certain = (sigma == 0) | (reach[0] > full)
        slope = np.abs(x[4] - x[2]) / np.maximum(2 * sigma, 1e-300)
        least_dn = np.where(inside | (mu < MANY), SHOWN_DN, SHOWN_AMONG_MANY_DN)
        sharp = ~certain & electrons_show(own, sigma, slope, least_dn)
        noisy = ((own >= NOISELESS_DN) | (mu >= FEW)) & (own < NO_HARMONIC)
        closed = inside & ~certain & ~wide & noisy & straight & self.law.is_poisson
        smooth = (
            inside & ~certain & ~wide & ~closed & ~sharp & ((mu >= FEW) | (own >= SHARP_DN))
        )
        smooth |= ~certain & ~wide & ~closed & (self.chance < SELDOM)
        sums = ~(certain | closed | smooth)
        every = sums & (sharp | (mu < FEW))
        yield np.flatnonzero(certain & ~wide), PixelCodes._certain
        yield np.flatnonzero(closed), PixelCodes._closed
        yield np.flatnonzero(smooth), PixelCodes._smooth
        yield np.flatnonzero(every & ~wide), PixelCodes._every
        yield np.flatnonzero(sums & ~every & ~wide), PixelCodes._cells
        yield np.flatnonzero(certain & wide), PixelCodes._certain_apart
        yield np.flatnonzero(every & wide), PixelCodes._every_apart
        yield np.flatnonzero(sums & ~every & wide), PixelCodes._cells_apart

    def _multiplied_and_cut(self, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Where an end of the converter or of a register cuts the law of what leaves the register, (P,).

        inside : where no end of the converter does.
        """
        cut, (mean_e, variance_e2) = np.zeros(inside.size, bool), self.law
        for stage in self.stages:
            if stage.multiplication is not None:
                gain, spread = stage.multiplication
                reach_e = mean_e + INSIDE * np.sqrt(variance_e2 + spread * mean_e)
                cut |= ~inside | (gain * reach_e > stage.limits[1])
        return cut

    def _certain(self) -> Codes:
        """There is one count."""
        return self._over(CountNodes(self.law.mean[None, :], ONE_COUNT, np.zeros(1)))

    def _certain_apart(self) -> Codes:
        """There is one count, and noise that is wide beside a curve."""
        return replace(self, take_apart=True)._in_chunks(PixelCodes._certain)

    def _smooth(self) -> Codes:
        """The count is as good as normal."""
        return self._over(self.law.as_normal())

    def _closed(self) -> Codes:
        """Poisson and normal, rounded."""
        x, noise = self.of_counts(np.stack([np.zeros(self.law.mean.size), self.law.mean]))
        return rounded_poisson(
            x[1], np.sqrt(noise[1]), (x[1] - x[0]) / self.law.mean, self.law.mean
        )

    def _every(self) -> Codes:
        """Sums over all counts."""
        return tabulated(self, PixelCodes._every_by_itself) or self._every_by_itself()

    def _every_apart(self) -> Codes:
        """Sums over all counts, and noise that is wide beside a curve."""
        return replace(self, take_apart=True)._every()

    def _every_by_itself(self) -> Codes:
        """Sums over all counts of each pixel; pixels of like means together."""
        mean, variance = np.empty(self.numbers.size), np.empty(self.numbers.size)
        left = np.argsort(self.law.mean)[::-1]
        at_once = AT_ONCE
        if self.take_apart:
            at_once = AT_ONCE // 2**6
        while left.size:
            counts = 2 * REACH * np.sqrt(self.law.mean[left[0]]) + MORE
            here, left = np.split(left, [max(int(at_once / counts), 1)])
            part = self.some(here)
            mean[here], variance[here] = part._over(part.law.every_count())
        return mean, variance

    def _cells(self) -> Codes:
        """Sums over cells of the count."""
        return tabulated(self, PixelCodes._cells_by_itself) or self._cells_by_itself()

    def _cells_apart(self) -> Codes:
        """Sums over cells of the count, and noise that is wide beside a curve."""
        return replace(self, take_apart=True)._cells()

    def _cells_by_itself(self) -> Codes:
        """Sums over cells of the count, of each pixel."""
        return replace(self, well_is_passed=True)._in_chunks(PixelCodes._over_cells)

    def _over_cells(self) -> Codes:
        """Sums over cells that are narrow where the converter ends."""
        mean, sigma, highest = (
            self.law.mean,
            np.sqrt(self.law.variance),
            converter_of(self.stages).highest,
        )
        counts = np.maximum(mean + np.linspace(-REACH, REACH, 9)[:, None] * sigma, 0.0)
        counts = np.minimum(counts, self.full_well_e)
        dn, variance = self.of_counts(counts)
        low, high = (_first_at(dn, counts, level) for level in (0.5, highest - 0.5))
        dn_per_e = np.abs(dn[-1] - dn[0]) / np.maximum(counts[-1] - counts[0], 1e-300)
        noise_e = np.sqrt(variance[4]) / np.maximum(dn_per_e, 1e-300)
        ends = np.stack([low, high])
        return self._over(self.law.in_cells(ends, np.minimum(noise_e, sigma), self.full_well_e))

    def _in_chunks(self, find: Callable[[PixelCodes], Codes]) -> Codes:
        """The same pixels, a few at a time."""
        mean, variance = np.empty(self.numbers.size), np.empty(self.numbers.size)
        for some in chunks(
            np.arange(self.numbers.size), AT_ONCE // 2**9 if self.take_apart else 2**13
        ):
            mean[some], variance[some] = find(self.some(some))
        return mean, variance

    def _over(self, nodes: CountNodes) -> Codes:
        """Mean and variance of the codes over these counts."""
        converter = converter_of(self.stages)
        chances, means, variances = self.ideal(Normals(*normals_of(nodes)))
        code, variance = code_moments(
            means, np.sqrt(variances), converter.highest, converter.inl_lsb
        )
        mean = np.sum(chances * code, axis=0)
        return mean, np.sum(chances * (variance + (code - mean) ** 2), axis=0)


def _first_at(dn: Float64Array, counts: Float64Array, level_dn: float) -> Float64Array:
    """Count at which a signal first passes a level, (P,), by straight lines between some; inf where it does not."""
    above = dn >= level_dn
    passes = above[1:] != above[:-1]
    place = np.argmax(passes, axis=0)[None]
    low, high = (np.take_along_axis(dn, place + k, axis=0)[0] for k in (0, 1))
    before, after = (np.take_along_axis(counts, place + k, axis=0)[0] for k in (0, 1))
    share = np.divide(level_dn - low, high - low, out=np.zeros(low.shape), where=high != low)
    return np.where(passes.any(axis=0), before + share * (after - before), np.inf)
