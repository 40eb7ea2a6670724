"""Maximum likelihood of normal noise that was rounded to whole codes: below about half a code its variance says little.

A code is k where m + σz lies between k - ½ and k + ½, the first and the last code where it lies beyond. The mean m
differs from pixel to pixel. Shifting all codes of a pixel by a whole number changes nothing but m, so the likelihood of
the codes relative to the pixel's smallest depends on σ and on the distribution of the fractions of m alone. Where the
pixels' means differ by more than a code it is uniform; else it is a wrapped normal law, fitted beside σ, and one in ten
thousand pixels has another mean. Pixels whose codes reach the first code have no such freedom: their m is normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.types import Float64Array

MOST_VALUES = 2**17
"""Codes that are used, of pixels at equal distances: they give σ within 0.3 %, or 2 % where few pixels change code."""
SMALLEST_DN, LARGEST_DN = 0.04, 2.0
"""Range of σ that is searched [DN]: below it next to no pixel shows two codes, above it rounding does not matter."""
PHASES = 64, 24
"""Nodes per code for m, for pixels that spread over at most, or more than, 4 codes: these have a larger σ."""
UNIFORM_DN = 0.6
"""Spread of the means from which on their fractions are uniform within 0.2 %: 2 exp(-2π²·0.6²)."""
OUTLIERS = 1e-4
FEWEST_OF_A_THIRD_CODE = 20
"""Two transitions, one code apart, are the scale of σ. Pixels that are alike and change between two codes do not show
it, so that their σ has only an upper limit; 20 values say σ within some 5 %."""
FROM_THE_END_DN = 4.0
"""Pixels with means as near as this to the first code [DN] are not shifted; 5 σ of the largest σ that needs this."""
WIDEST = 16
"""Codes over which a pixel may spread: more is not this noise."""
CHI2 = 3.841458820694124  # 95 % quantile of chi-square with one degree of freedom


@dataclass(frozen=True)
class RoundedNormal:
    """sigma_dn : most likely σ [DN].  low_dn, high_dn : 95 % interval by the profile of the likelihood.

    identified : whether the interval has a lower end: alike pixels that change between two codes may do so by any σ.
    left_out : share of the pixels that spread over too many codes.
    """

    sigma_dn: float
    low_dn: float
    high_dn: float
    identified: bool
    left_out: float


def rounded_normal(frames: NDArray[Any], last_code: int | None = None) -> RoundedNormal:
    """σ of noise that was rounded, from whole codes (N, H, W), N at least 2; last_code clips, None where it is far."""
    codes = frames.reshape(len(frames), -1)
    codes = codes[:, :: max(1, codes.size // MOST_VALUES)].astype(np.int64)
    if last_code is not None and codes.mean() > last_code / 2:
        codes = last_code - codes  # clipped from above is clipped from below
    narrow = np.ptp(codes, axis=0) < WIDEST
    left_out, codes = 1 - float(narrow.mean()), codes[:, narrow]
    if not codes.size:
        return RoundedNormal(math.nan, math.nan, math.nan, False, left_out)
    signed = codes.min() < 0  # the range does not end at 0
    free = signed | (codes.mean(axis=0) >= FROM_THE_END_DN)
    if free.mean() > 0.2:
        likelihood = _Likelihood(codes[:, free], clipped=False)
    else:
        likelihood = _Likelihood(codes[:, ~free], clipped=True)
    return _search_sigma(likelihood, left_out)


class _Likelihood:
    """Log-likelihood of σ with the normal law of the means that fits best to it: centre, width, share of outliers."""

    def __init__(self, codes: NDArray[np.int64], clipped: bool) -> None:
        self.clipped = clipped
        if clipped:
            relative = codes
        else:
            relative = codes - codes.min(axis=0)
        spread = int(relative.max()) + 1
        counts = np.stack([(relative == code).sum(axis=0) for code in range(spread)], axis=1)
        # Pixels with equal counts of their codes are equally likely.
        kinds, pixels = np.unique(counts, axis=0, return_counts=True)
        self.counts, self.pixels = kinds.astype(np.float64), pixels.astype(np.float64)
        few_codes, many_codes = PHASES
        self.phases = many_codes if np.ptp(codes, axis=0).max() >= 4 else few_codes
        if clipped:
            first_mean = -3.0
        else:
            first_mean = -2.0
        self.means = np.arange(first_mean, spread + 1.0, 1 / self.phases)
        means = codes.mean(axis=0)
        quartiles = np.percentile(means, (25, 75))
        spread_dn = float(np.ptp(quartiles)) / 1.349  # of a normal law, not moved by hot pixels
        self.uniform = not clipped and spread_dn > UNIFORM_DN
        often = np.sort(np.bincount(codes.ravel() - codes.min()))
        self.scaled = self.uniform or (len(often) > 2 and often[-3] >= FEWEST_OF_A_THIRD_CODE)
        self.start = self._centre(means), math.log(min(max(spread_dn, 0.03), UNIFORM_DN))

    def _centre(self, means: Float64Array) -> float:
        """First guess: the median; of fractions the mean direction."""
        if self.clipped:
            return float(np.median(means))
        return float(np.angle(np.exp(2j * math.pi * means).mean())) / (2 * math.pi)

    def __call__(self, sigma: float) -> float:
        """Log-likelihood of σ: the larger, the more likely."""
        chance, log_factor = self._chance_of_codes(sigma)
        if self.uniform:
            return float(self.pixels @ (np.log(chance.mean(axis=1)) + log_factor))

        def missing(law: Float64Array) -> float:
            return -float(self.pixels @ np.log(chance @ self._weights(law)))

        start = np.array(self.start)
        around = start + np.array([[0, 0], [sigma / 8, 0], [0, -0.7]])
        options = {"xatol": 1e-3, "fatol": 1e-2, "initial_simplex": around}
        best = scipy.optimize.minimize(missing, start, method="Nelder-Mead", options=options)
        return float(self.pixels @ log_factor) - float(best.fun)

    def _weights(self, law: Float64Array) -> Float64Array:
        """Weights of the nodes of m, or of its fractions, for a centre and the log of a width."""
        centre, width, nodes = law[0], math.exp(min(max(law[1], -5.0), 3.0)), self.phases
        edges = self.means[0] + np.arange(len(self.means) + 1) / nodes - 0.5 / nodes
        if not self.clipped:
            edges = np.arange(-3 * nodes, 3 * nodes + 1) / nodes - 0.5 / nodes + centre // 1
        mass = np.diff(scipy.special.ndtr((edges - centre) / width))
        if not self.clipped:
            mass = mass.reshape(-1, nodes).sum(axis=0)
        return np.asarray((1 - OUTLIERS) * mass + OUTLIERS / len(mass))

    def _chance_of_codes(self, sigma: float) -> tuple[Float64Array, Float64Array]:
        """P(codes of a pixel | mean) (kinds, nodes), of fractions of the mean over all shifts of it, as a share of a
        factor, whose logarithm is the second (kinds,)."""
        edges = np.arange(self.counts.shape[1] + 1) - 0.5
        below = scipy.special.ndtr((edges[:, None] - self.means) / sigma)
        above = scipy.special.ndtr((self.means - edges[:, None]) / sigma)
        if self.clipped:
            below[0], above[0] = 0.0, 1.0
        # Of two differences that are equal the one of small numbers is exact.
        between = np.where(below[:-1] < 0.5, below[1:] - below[:-1], above[:-1] - above[1:])
        logs = self.counts @ np.log(np.maximum(between, 1e-300))
        log_factor = logs.max(axis=1)
        logs -= log_factor[:, None]
        chance = np.exp(logs, out=logs)
        if not self.clipped:
            chance = chance.reshape(len(chance), -1, self.phases).sum(axis=1)
        return chance, log_factor


def _search_sigma(likelihood: _Likelihood, left_out: float) -> RoundedNormal:
    """Search in σ: a scan, the best of it made finer, then the ends of the interval."""
    scan = np.geomspace(SMALLEST_DN, LARGEST_DN, 9)
    values = [likelihood(sigma) for sigma in scan]
    best = int(np.argmax(values))
    ends = scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)]
    fine = scipy.optimize.minimize_scalar(
        lambda sigma: -likelihood(sigma),
        bounds=ends,
        method="bounded",
        options={"xatol": 2e-3 * scan[best]},
    )
    sigma, most = float(fine.x), max(-float(fine.fun), values[best])

    def fallen(other: float) -> float:
        return 2 * (most - likelihood(other)) - CHI2

    low = _end_of_interval(fallen, sigma, SMALLEST_DN)
    high = _end_of_interval(fallen, sigma, LARGEST_DN)
    identified = bool(low > SMALLEST_DN and likelihood.scaled)
    if not identified:
        low = 0.0
    if high >= LARGEST_DN:
        high = math.inf
    return RoundedNormal(sigma, low, high, identified, left_out)


def _end_of_interval(fallen: Callable[[float], float], sigma: float, limit: float) -> float:
    """Where twice the log-likelihood has fallen by the 95 % quantile, or the limit where it does not."""
    if limit > sigma:
        step = 1.02
    else:
        step = 1 / 1.02
    inside, outside = sigma, sigma * step
    while (outside - limit) * (step - 1) < 0 and fallen(outside) < 0:
        inside, outside, step = outside, outside * step**2, step**2
    if (outside - limit) * (step - 1) >= 0:
        if fallen(limit) < 0:
            return limit
        outside = limit
    if fallen(inside) >= 0:
        return inside
    return float(scipy.optimize.brentq(fallen, inside, outside, xtol=2e-3 * sigma))
