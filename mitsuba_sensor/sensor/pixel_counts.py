"""Law of the electron count of single pixels, each with a mean and a variance of its own: nodes and their weights.

The laws are those of count_law.py: Poisson's, or that of c·n or of a + b + n with n of Poisson's law.
"""

from __future__ import annotations

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

Z: Float64Array = np.arange(-REACH, REACH + 0.1, 0.25)[:, None]
"""Nodes of a count [σ]."""

REST = 0.18
"""σ of the normal about each of these nodes, as a share of that of the count: the ripple of their sum is below 1e-4."""


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
        return np.maximum(np.divide(self.variance, self.mean, out=np.ones(self.mean.shape), where=self.mean > 0), 1.0)

    @property
    def shift(self) -> Float64Array:
        """Above 0 where the variance is smaller than the mean."""
        return np.where(self.variance < self.mean * (1 - 1e-9), self.mean - self.variance, 0.0)

    @property
    def is_poisson(self) -> bool:
        """Whether all of them are Poisson's law."""
        return bool(np.all(np.abs(self.variance - self.mean) <= 1e-9 * self.mean))

    def every_count(self) -> CountNodes:
        """All counts within REACH."""
        scale, shift = self.scale, self.shift
        whole = np.floor(shift)
        one = np.sqrt(shift - whole)  # a count of 0 or 1 of this mean varies less than its mean by what is left
        rate = np.maximum(self.mean - whole - one, 0.0) / scale
        low = np.maximum(np.floor(rate - REACH * np.sqrt(rate)), 0.0)
        number = int(np.max(np.ceil(2 * REACH * np.sqrt(rate)), initial=0.0)) + MORE
        n: Float64Array = low + np.arange(float(number))[:, None]
        chance = _poisson(n, rate)
        chance /= chance.sum(axis=0)
        mixed = (1 - one) * chance
        mixed[1:] += one * chance[:-1]
        return CountNodes(whole + scale * n, mixed, np.zeros(1))

    def spaced(self) -> CountNodes:
        """Nodes a quarter of σ apart, each with a narrow normal: of means that are large."""
        rate = (self.mean - self.shift) / self.scale
        m = np.maximum(rate + np.sqrt(rate) * Z, 0.0)
        chance = np.where(rate + np.sqrt(rate) * Z > 0, _poisson(m, rate), 0.0)
        chance /= chance.sum(axis=0)
        off = m - np.sum(chance * m, axis=0)
        off *= np.sqrt((1 - REST**2) * self.variance / np.sum(chance * off**2, axis=0))
        return CountNodes(self.mean + off, chance, REST**2 * self.variance)


def _poisson(n: Float64Array, rate: Float64Array) -> Float64Array:
    """Poisson's law, for any number at least 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.where(n > 0, n * np.log(rate / np.maximum(n, 1e-300)), 0.0) + (n - rate)
    # ln n! = n ln n − n + what is left; differences of large numbers are taken before they are added
    left = scipy.special.gammaln(n + 1) - np.where(n > 0, n * np.log(np.maximum(n, 1e-300)) - n, 0.0)
    return np.asarray(np.exp(logarithm - left))
