"""Samplers of counts, also those of other simulators, and the distance of each one's law from Poisson's.

A count is a function of 32 random bits that falls as their number rises: the share of the 2³² numbers that draw more
than n is the place where n + 1 turns into n, which bisection finds in 32 steps. Rounding to float32 moves it by a few
numbers, and no result here by more than 2 % (tests compare it with the full count of all numbers).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import poisson

from ...core import arrays, types
from ...core.backend import Backend
from ...sensor.run import choose_backend
from ..frames import BACKENDS
from ..kit import Array

EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR = "exact", "quantile", "Gaussian", "mean only", "NumPy Generator"
SAMPLERS = (EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)
OWN = SAMPLERS[:2]  # what the package offers: in float64 SciPy's exact quantile, in float32 its own quantile function
LARGEST_MEAN = 9.2e18  # ``Generator.poisson`` refuses means that int64 cannot count: those above 9.22e18
DRAWS = 2**21  # draws of a third party's generator for each mean
NUMBERS = 2**32

Law = dict[str, float | None]
"""A law of counts against the Poisson law of the same mean: "variation", ½Σ|p − q|; "resolution", below which that
cannot be told from 0; relative errors of "mean", "variance" and "skewness", which of a single value is None."""


class FrameSetting(NamedTuple):
    """One way to make frames. tolerance_dn : of the plan [DN], or None for the whole chain."""

    engine: str
    precision: str
    sampler: str
    tolerance_dn: float | None = None

    @property
    def name(self) -> str:
        """For measurements, tables and people."""
        plan = "" if self.tolerance_dn is None else f", plan {self.tolerance_dn:g} DN"
        return f"{self.engine} {self.precision}, {self.sampler}{plan}"

    @property
    def compiled(self) -> bool:
        """Whether a kernel makes the frames."""
        return self.engine in BACKENDS

    def backend(self) -> Backend:
        """Who does the arithmetic, with the sampler's law in the place of the engine's own."""
        own = choose_backend(self.engine, self.precision, 0)
        if self.sampler in OWN:
            return own
        other = copy.copy(own)  # all that is not counted keeps its bits
        other.poisson = partial(DRAWN[self.sampler], own)  # type: ignore[method-assign]
        return other


REFERENCE = FrameSetting("numpy", "float64", EXACT)  # all others are compared with it: whole chain, every law exact


def gaussian(backend: Backend, bits: types.Array, mean: types.Array) -> types.Array:
    """round(λ + √λ·z), not below 0: what many simulators do."""
    return arrays.maximum(arrays.floor(mean + arrays.sqrt(mean) * backend.normal(bits) + 0.5), 0.0)


def generator(backend: Backend, bits: types.Array, mean: types.Array) -> types.Array:
    """NumPy's ``Generator.poisson``, a third party: exact by rejection, and with a state."""
    random = np.random.default_rng(bits.ravel()[:4])  # so a frame can be made again, but a crop is not the frame's crop
    return random.poisson(np.minimum(mean, LARGEST_MEAN), bits.shape).astype(np.float32)


DRAWN = {GAUSSIAN: gaussian, MEAN_ONLY: lambda backend, bits, mean: mean, GENERATOR: generator}


def drawn_law(setting: FrameSetting, mean: float) -> Law:
    """The law that a sampler draws at a mean [events], rounded to float32: every engine is given the same."""
    exact, backend = float(np.float32(mean)), setting.backend()
    if setting.sampler != GENERATOR:
        return law_of(lambda bits: counts_of(backend, bits, exact), exact)
    bits = np.random.default_rng(1).integers(0, NUMBERS, DRAWS, dtype=np.uint32)
    return law_of_counts(counts_of(backend, bits, exact), exact)


def counts_of(backend: types.Array, bits: types.RandomBits, mean: float) -> Array:
    """What a line of random bits (N,) draws from one mean, on whichever :class:`Backend`."""
    counts = backend.poisson(backend.uint(bits) if backend.compiled else bits, backend.number(mean))
    return np.broadcast_to(np.asarray(counts, dtype=np.float64), bits.shape)


def law_of(draw: Callable[[types.RandomBits], Array], mean: float) -> Law:
    """The law of all random bits. ``draw`` must not rise with them; ``mean`` is the λ that it was given [events]."""
    highest, lowest = (float(x) for x in draw(np.array([0, NUMBERS - 1], dtype=np.uint32)))
    if highest == lowest:
        return compared(np.array([lowest]), np.ones(1), mean, 0.0)
    n = np.arange(lowest, highest + 1)
    low, high = np.zeros(n.size - 1, dtype=np.int64), np.full(n.size - 1, NUMBERS - 1, dtype=np.int64)
    while (low < high).any():  # the first number that draws n or less: as many numbers draw more
        middle = (low + high) // 2
        there = draw(middle.astype(np.uint32)) <= n[:-1]
        low, high = np.where(there, low, np.minimum(middle + 1, high)), np.where(there, middle, high)
    at_most = np.append(1 - low / NUMBERS, 1.0)
    return compared(n, np.diff(at_most, prepend=0.0), mean, n.size / NUMBERS)


def law_of_counts(counts: Array, mean: float) -> Law:
    """The law that so many independent draws show; the resolution is what as many exact ones would show by chance."""
    n, seen = np.unique(counts, return_counts=True)
    q = poisson.pmf(np.arange(n[0], n[-1] + 1), mean)
    by_chance = 0.5 * float(np.sqrt(2 / np.pi * q * (1 - q) / counts.size).sum())
    return compared(n, seen / counts.size, mean, by_chance)


def compared(n: Array, share: Array, mean: float, resolution: float) -> Law:
    """The law that takes each ``n`` with this ``share``, all of which add up to 1, against Poisson's."""
    exact = poisson.pmf(n, mean)  # 0 where n is no whole number
    variation = 0.5 * float(np.abs(share - exact).sum() + 1 - exact.sum())
    shift = float(np.sum(share * (n - mean)))
    second, third = (float(np.sum(share * (n - mean - shift) ** k)) for k in (2, 3))
    skewness = third / second**1.5 * mean**0.5 - 1 if second > 0 else None
    known = {"variation": variation, "resolution": resolution, "mean": shift / mean, "variance": second / mean - 1}
    return {**known, "skewness": skewness}
