"""Maximum likelihood of noise that differs from pixel to pixel, from the sample variances of the pixels.

A sample variance of n + 1 frames is v·χ²(n)/n. The variances v themselves differ: v = floor + a·m·exp(2sz − 2s²) with z
normal, which is a log-normal σ of root mean square √m; a coefficient of variation of σ follows as sqrt(exp(s²) − 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from ...core.types import Float64Array
from ..quantity import LEVEL, TWO_SIDED

STEP, FARTHEST = 1 / 12, 6.0
"""Nodes of z, and the largest: closer together than χ²(n) is wide for 1000 frames and a cv of 0.5."""
BINS = 400
WIDEST = 1.5
"""Largest s that is searched: a cv of 2.9."""
SMALLEST_CV = 0.01
"""Spread of σ beside noisy pixels that is none."""
MOST_NOISY = 0.3
"""Share of the pixels above which noisy ones are no exception."""
NOISY_STARTS = (0.02, 3.0), (0.003, 6.0), (0.1, 1.8)
"""Shares and factors from which the search begins."""
CLEARLY_NOISY = 12.0
"""Gain of the log-likelihood by two more numbers, from which on there are noisy pixels: by chance once in 100 000."""
WIDER = 1.5
"""Standard error over that with the other numbers held: they are correlated by up to 0.75."""
CHI2 = 3.841458820694124  # 95 % quantile of chi-square with one degree of freedom


class HiddenSpread(NamedTuple):
    """(value, low, high) of the mean variance m, and of the cv of σ."""

    variance: tuple[float, float, float]
    cv: tuple[float, float, float]

    def beside(self, noisy: NoisyPixels) -> HiddenSpread:
        """Of all pixels the mean variance, of those that are not noisy the cv; the intervals are as wide."""
        wide = noisy.variance / self.variance[0]
        least = max(noisy.cv - 0.5 * (self.cv[2] - self.cv[0]), 0.0)
        cv = noisy.cv, least, noisy.cv + 0.5 * (self.cv[2] - self.cv[0])
        if noisy.cv < SMALLEST_CV:
            cv = 0.0, 0.0, cv[2]
        _, low, high = self.variance
        return HiddenSpread((noisy.variance, wide * low, wide * high), cv)


class Mixed(NamedTuple):
    """v = floor + own·m·(log-normal of mean 1) + shared·m: what removing line means leaves of each pixel's variance."""

    floor: float
    own: float
    shared: float


def hidden_spread(variances: Float64Array, freedom: int, mixed: Mixed) -> HiddenSpread:
    """Mean variance and cv of σ from the sample variances of all pixels, each with so many degrees of freedom."""
    likelihood = _Likelihood(variances, freedom, mixed)
    mean = float(variances.mean())
    start = math.log(max(mean - mixed.floor, 1e-3 * mean))
    spread = likelihood.first_guess()
    simplex = [(start, spread), (start + 0.02, spread), (start, spread + 0.05)]
    options = {"xatol": 1e-5, "fatol": 1e-4, "initial_simplex": simplex}
    best = scipy.optimize.minimize(
        lambda x: -likelihood(x[0], abs(x[1])),
        simplex[0],
        method="Nelder-Mead",
        options=options,
    )
    log_m, s, most = float(best.x[0]), abs(float(best.x[1])), -float(best.fun)
    if s < 1e-3:
        s = 0.0
    error_m = _error_from_curvature(
        lambda d: likelihood(log_m + d, s) - most, 0.02 / math.sqrt(len(variances) / 1000)
    )

    def fallen(other: float) -> float:
        inner = scipy.optimize.minimize_scalar(
            lambda x: -likelihood(x, other),
            bounds=(log_m - 8 * error_m, log_m + 8 * error_m),
            method="bounded",
            options={"xatol": 0.05 * error_m},
        )
        return 2 * (most + float(inner.fun)) - CHI2

    low, high = _interval_of_spread(fallen, s)
    z = float(scipy.special.ndtri((1 + LEVEL) / 2))
    m = math.exp(log_m)
    return HiddenSpread(
        variance=(m, m * math.exp(-z * error_m), m * math.exp(z * error_m)),
        cv=(_cv_of_sigma(s), _cv_of_sigma(low), _cv_of_sigma(high)),
    )


class NoisyPixels(NamedTuple):
    """(value, low, high) of the share of noisy pixels and of their σ over that of the others; and what is left for all:
    the mean variance m, and the cv of σ among those that are not noisy.
    """

    share: tuple[float, float, float]
    factor: tuple[float, float, float]
    variance: float
    cv: float


def noisy_pixels(
    variances: Float64Array, freedom: int, mixed: Mixed, one_law: HiddenSpread
) -> NoisyPixels | None:
    """The noisy pixels, where a second group of pixels makes the variances far more likely; None elsewhere."""
    likelihood = _Likelihood(variances, freedom, mixed)
    log_m = math.log(one_law.variance[0])
    s = math.sqrt(math.log1p(one_law.cv[0] ** 2))
    alone = likelihood(log_m, s)

    def missing(x: Float64Array) -> float:
        log_mean, spread, log_share, log_excess = map(float, x)
        of_noisy, times = math.exp(min(log_share, 0.0)), 1 + math.exp(min(log_excess, 6.0))
        if of_noisy > MOST_NOISY:
            return -alone + 1e3 * (of_noisy - MOST_NOISY + 1)
        return -likelihood(log_mean, abs(spread), of_noisy, times)

    starts = [(log_m, 0.5 * s, math.log(share), math.log(k - 1)) for share, k in NOISY_STARTS]
    x, least = _least_of(missing, starts)
    if -least < alone + CLEARLY_NOISY:
        return None
    share = _interval_of_logarithm(float(x[2]), _error_along(missing, x, 2))
    excess = _interval_of_logarithm(float(x[3]), _error_along(missing, x, 3))
    return NoisyPixels(
        share=(share[0], share[1], min(share[2], 1.0)),
        factor=(1 + excess[0], 1 + excess[1], 1 + excess[2]),
        variance=math.exp(float(x[0])),
        cv=_cv_of_sigma(abs(float(x[1]))),
    )


def _least_of(
    missing: Callable[[Float64Array], float], starts: list[tuple[float, float, float, float]]
) -> tuple[Float64Array, float]:
    """Where a function of four numbers is least, and its value there."""
    fits = []
    for start in starts:
        simplex = np.array(start) + np.vstack([np.zeros(4), np.diag([0.02, 0.05, 0.5, 0.3])])
        options = {"xatol": 1e-4, "fatol": 1e-3, "initial_simplex": simplex, "maxiter": 600}
        fits.append(
            scipy.optimize.minimize(missing, simplex[0], method="Nelder-Mead", options=options)
        )
    best = min(fits, key=lambda fit: float(fit.fun))
    return np.asarray(best.x), float(best.fun)


def _error_along(missing: Callable[[Float64Array], float], x: Float64Array, axis: int) -> float:
    """Standard error of one of the numbers, the others as they are most likely beside it, about: wider by WIDER."""
    least = missing(x)

    def change(d: float) -> float:
        moved = x.copy()
        moved[axis] += d
        return least - missing(moved)

    return WIDER * _error_from_curvature(change, 0.05)


def _interval_of_logarithm(value: float, error: float) -> tuple[float, float, float]:
    """(value, low, high) of a number whose logarithm has this standard error."""
    half = TWO_SIDED * error
    return math.exp(value), math.exp(value - half), math.exp(value + half)


class _Likelihood:
    """Log-likelihood of ln m and s, of variances that are put into narrow bins."""

    def __init__(self, variances: Float64Array, freedom: int, mixed: Mixed) -> None:
        values = np.sort(variances, axis=None)
        middle = float(np.median(values))
        group = np.floor(np.arcsinh(values / max(middle, 1e-300)) * (BINS / 6))
        starts = np.concatenate(([0], np.flatnonzero(np.diff(group)) + 1))
        self.weights = np.diff(np.append(starts, values.size)).astype(np.float64)
        self.values = np.add.reduceat(values, starts) / self.weights
        self.half, self.mixed = freedom / 2, mixed
        self.z = np.arange(-FARTHEST, FARTHEST + STEP / 2, STEP)
        self.law = np.exp(-0.5 * self.z**2)
        self.law /= self.law.sum()

    def first_guess(self) -> float:
        """s of the middle half of the variances, without the floor."""
        order = np.cumsum(self.weights) / self.weights.sum()
        low, high = np.interp((0.25, 0.75), order, self.values)
        spread = math.log(max(high, 1e-300) / max(low, 1e-300)) / 1.349
        by_chance = math.sqrt(float(scipy.special.polygamma(1, self.half)))
        return 0.5 * math.sqrt(max(spread**2 - by_chance**2, 0.01))

    def __call__(
        self, log_m: float, s: float, share: float = 0.0, factor: float = 1.0
    ) -> float:
        """Log-likelihood of ln m and s: the larger, the more likely.

        share, factor : of the pixels that have so many times the σ of the others.
        """
        if s > WIDEST:
            return -math.inf
        log_normal = np.exp(2 * s * self.z - 2 * s**2) / (1 + share * (factor**2 - 1))
        law = self.law
        if share:
            log_normal = np.concatenate([log_normal, factor**2 * log_normal])
            law = np.concatenate([(1 - share) * law, share * law])
        m = math.exp(log_m)
        v = self.mixed.floor + m * (self.mixed.own * log_normal + self.mixed.shared)
        chance = -self.half * (np.log(v) + self.values[:, None] / v)
        most = chance.max(axis=1)
        return float(self.weights @ (np.log(np.exp(chance - most[:, None]) @ law) + most))


def _error_from_curvature(change: Callable[[float], float], step: float) -> float:
    """Standard error from the curvature of a log-likelihood, at a step of about that size."""
    for _ in range(20):
        drop = -(change(step) + change(-step)) / 2
        if 0.1 < drop < 2:
            break
        step *= min(max(math.sqrt(0.5 / max(drop, 1e-9)), 0.1), 10.0)
    return step / math.sqrt(2 * max(drop, 1e-12))


def _interval_of_spread(fallen: Callable[[float], float], s: float) -> tuple[float, float]:
    """Where twice the log-likelihood has fallen by the 95 % quantile; 0 or infinity where it does not."""
    low = 0.0
    if s > 0 and fallen(0.0) > 0:
        low = float(scipy.optimize.brentq(fallen, 0.0, s, xtol=1e-4))
    outside = max(1.05 * s, s + 0.01)
    while outside < WIDEST and fallen(outside) < 0:
        outside = s + 2 * (outside - s)
    if outside >= WIDEST:
        return low, math.inf
    return low, float(scipy.optimize.brentq(fallen, s, outside, xtol=1e-4))


def _cv_of_sigma(s: float) -> float:
    """Coefficient of variation of a log-normal σ whose logarithm has the standard deviation s."""
    if s < math.inf:
        return math.sqrt(math.expm1(s**2))
    return math.inf
