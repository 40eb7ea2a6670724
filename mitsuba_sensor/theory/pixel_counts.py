"""Law of the electron count of single pixels, each with a mean and a variance of its own: nodes and their weights.

The laws are Poisson's, or that of c·n or of a + b + n with n of Poisson's law.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy

from ..core.types import Float64Array

FEW = 64.0
"""Below this mean every count is a node."""

REACH = 8.0
"""Counts further from their mean than so many σ are left out (1e-15)."""

MORE = 33
"""Counts beyond that, for the tail of small means."""

TINY = 1e-290
"""Chances and means below this one are none: what is divided by them would leave all numbers."""

EVEN: Float64Array = np.linspace(-REACH, REACH, 41)[:, None]
"""Edges of the cells of a count, 0.4 of its σ apart."""

ABOUT_END: Float64Array = np.linspace(-4.0, 4.0, 13)[:, None]
"""Edges of cells about an end of the converter, in σ of the noise behind the count."""

CELLS = EVEN.size + 2 * ABOUT_END.size
"""How many cells a count has at most, with one edge at the full well."""


class CountNodes(NamedTuple):
    """Counts, their chances, and the variance of a normal about each, (Q, P) or what broadcasts to it."""

    counts: Float64Array
    chances: Float64Array
    rest_e2: Float64Array


class CountLaws(NamedTuple):
    """n = shift + scale·m electrons, m of Poisson's law with this rate, (P,) each."""

    mean: Float64Array
    variance: Float64Array

    @property
    def scale(self) -> Float64Array:
        """Above 1 where the variance is larger than the mean."""
        return np.maximum(
            np.divide(
                self.variance, self.mean, out=np.ones(self.mean.shape), where=self.mean > TINY
            ),
            1.0,
        )

    @property
    def shift(self) -> Float64Array:
        """Above 0 where the variance is smaller than the mean."""
        return np.where(self.variance < self.mean * (1 - 1e-9), self.mean - self.variance, 0.0)

    @property
    def is_poisson(self) -> bool:
        """Whether all of them are Poisson's law."""
        return bool(np.all(np.abs(self.variance - self.mean) <= 1e-9 * self.mean))

    def as_normal(self) -> CountNodes:
        """One normal."""
        return CountNodes(self.mean[None, :], np.ones((1, 1)), self.variance)

    def every_count(self) -> CountNodes:
        """All counts within REACH."""
        scale, shift = self.scale, self.shift
        whole = np.floor(shift)
        one = np.sqrt(
            shift - whole
        )  # a count of 0 or 1 of this mean varies less than its mean by what is left
        rate = np.maximum(self.mean - whole - one, 0.0) / scale
        low = np.maximum(np.floor(rate - REACH * np.sqrt(rate)), 0.0)
        number = int(np.max(np.ceil(2 * REACH * np.sqrt(rate)), initial=0.0)) + MORE
        n: Float64Array = low + np.arange(float(number))[:, None]
        chance = _poisson(n, rate)
        chance /= chance.sum(axis=0)
        mixed = (1 - one) * chance
        mixed[1:] += one * chance[:-1]
        return CountNodes(whole + scale * n, mixed, np.zeros(1))

    def in_cells(
        self, ends_e: Float64Array, noise_e: Float64Array, full_well_e: float
    ) -> CountNodes:
        """Cells of the count with their means and variances: of means that are large.

        The count is that of a normal z, n = mean + σ·z + skew·(z² − 1) (Cornish and Fisher 1938), so that the moments
        of a cell are integrals of powers of z. No cell lies on both sides of the full well, and what lies above is it.

        ends_e : (2, P) counts at both ends of the converter, cells about which are as narrow as the noise there.
        noise_e : (P,) σ of the noise behind the count.  full_well_e : count that fills the well.
        """
        skew = self.scale / 6
        sigma = np.sqrt(np.maximum(self.variance - 2 * skew**2, 0.0))
        about = (end + noise_e * ABOUT_END for end in ends_e)
        wells = np.full((1, self.mean.size), full_well_e)
        places = np.concatenate([*about, wells])
        z = np.concatenate(
            [
                np.broadcast_to(EVEN, (EVEN.size, self.mean.size)),
                self._normal_of(places, sigma, skew),
            ]
        )
        z = np.sort(np.clip(z, -REACH, REACH), axis=0)
        below, density = scipy.special.ndtr(z), np.exp(-0.5 * z**2) / math.sqrt(2 * math.pi)
        power = [np.diff(below, axis=0), -np.diff(density, axis=0)]
        for order in range(1, 4):  # ∫ z^(k+1) φ = k·∫ z^(k−1) φ − [z^k φ]
            power.append(order * power[order - 1] - np.diff(z**order * density, axis=0))
        chance = np.where(power[0] > TINY, power[0], np.inf)
        first = (sigma * power[1] + skew * (power[2] - power[0])) / chance
        square = sigma**2 * power[2] + 2 * sigma * skew * (power[3] - power[1])
        square += skew**2 * (power[4] - 2 * power[2] + power[0])
        variance = np.maximum(square / chance - first**2, 0.0)
        count = np.maximum(self.mean + first, 0.0)
        full = z[:-1] >= self._normal_of(wells, sigma, skew)
        count, variance = np.where(full, full_well_e, count), np.where(full, 0.0, variance)
        return CountNodes(
            np.minimum(count, full_well_e), power[0] / power[0].sum(axis=0), variance
        )

    def _normal_of(
        self, counts_e: Float64Array, sigma: Float64Array, skew: Float64Array
    ) -> Float64Array:
        """The normal z of these counts, (C, P): the upper root of mean + σ·z + skew·(z² − 1) = count."""
        off = np.clip(counts_e - self.mean + skew, -1e30, 1e30)
        root = np.sqrt(np.maximum(sigma**2 + 4 * skew * off, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(
                np.nan_to_num(2 * off / (sigma + root), nan=0.0, posinf=REACH, neginf=-REACH)
            )


def _poisson(n: Float64Array, rate: Float64Array) -> Float64Array:
    """Poisson's law, for any number at least 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.where(n > 0, n * np.log(rate / np.maximum(n, 1e-300)), 0.0) + (n - rate)
    # ln n! = n ln n − n + what is left; differences of large numbers are taken before they are added
    left = scipy.special.gammaln(n + 1) - np.where(
        n > 0, n * np.log(np.maximum(n, 1e-300)) - n, 0.0
    )
    return np.asarray(np.exp(logarithm - left))
