"""How far the law that a sampler draws is from Poisson's: total variation, mean, variance and skewness.

A count is a function of 32 random bits, and it falls as their number rises. So the share of all 2³² numbers that draw
more than n is the place where n + 1 turns into n, which bisection finds in 32 steps: the whole law for the price of a
few thousand draws. Rounding to float32 puts the numbers next to such a place out of order; that moves the place by a
few of them, and no result here by more than 2 % (tests compare it with the full count of all numbers).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..statistics import Array

NUMBERS = 2**32

Draw = Callable[[NDArray[np.uint32]], Array]


@dataclass(frozen=True)
class Law:
    """A law of counts against the Poisson law of the same mean.

    variation : ½Σ|p − q|.  resolution : below this the variation cannot be told from 0.
    mean, variance, skewness : relative errors; the skewness of a single value is not defined: None.
    """

    variation: float
    resolution: float
    mean: float
    variance: float
    skewness: float | None


def law_of(draw: Draw, mean: float) -> Law:
    """The law of all random bits. ``draw`` must not rise with them; ``mean`` is the λ that it was given [events]."""
    highest, lowest = (float(x) for x in draw(np.array([0, NUMBERS - 1], dtype=np.uint32)))
    if highest == lowest:
        return compared(np.array([lowest]), np.ones(1), mean, 0.0)
    n = np.arange(lowest, highest + 1)
    at_most = np.append(1 - _first_at_most(draw, n[:-1]) / NUMBERS, 1.0)
    return compared(n, np.diff(at_most, prepend=0.0), mean, n.size / NUMBERS)


def _first_at_most(draw: Draw, n: Array) -> NDArray[np.int64]:
    """The first number that draws n or less, for every n: as many numbers draw more."""
    low, high = np.zeros(n.size, dtype=np.int64), np.full(n.size, NUMBERS - 1, dtype=np.int64)
    while (low < high).any():
        middle = (low + high) // 2
        there = draw(middle.astype(np.uint32)) <= n
        low, high = np.where(there, low, np.minimum(middle + 1, high)), np.where(there, middle, high)
    return low


def law_of_counts(counts: Array, mean: float) -> Law:
    """The law that so many independent draws show; the resolution is what as many exact ones would show by chance."""
    from scipy.stats import poisson  # half a second to import

    n, seen = np.unique(counts, return_counts=True)
    q = poisson.pmf(np.arange(n[0], n[-1] + 1), mean)
    by_chance = 0.5 * float(np.sqrt(2 / np.pi * q * (1 - q) / counts.size).sum())
    return compared(n, seen / counts.size, mean, by_chance)


def compared(n: Array, share: Array, mean: float, resolution: float) -> Law:
    """The law that takes each ``n`` with this ``share``, all of which add up to 1, against Poisson's."""
    from scipy.stats import poisson

    exact = poisson.pmf(n, mean)  # 0 where n is no whole number
    variation = 0.5 * float(np.abs(share - exact).sum() + 1 - exact.sum())
    shift = float(np.sum(share * (n - mean)))
    second, third = (float(np.sum(share * (n - mean - shift) ** k)) for k in (2, 3))
    skewness = third / second**1.5 * mean**0.5 - 1 if second > 0 else None
    return Law(variation, resolution, shift / mean, second / mean - 1, skewness)
