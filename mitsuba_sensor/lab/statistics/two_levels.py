"""Two levels in the frames of a pixel: maximum likelihood, against one normal distribution, of many pixels at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.types import Float64Array
from ..frames.rounding import ROUNDING_DN2

STEPS = 40
"""Steps of expectation and maximisation."""
TRIED_SIGMAS = np.geomspace(0.6, 1.6, 11)
TRIED_MEANS = np.linspace(-0.2, 0.2, 5)
"""Of one normal distribution, times the sample's σ and σ away from the sample's mean: rounded values have their largest
likelihood beside their moments."""


@dataclass(frozen=True, eq=False)
class TwoLevels:
    """Of K pixels: the two levels and their common σ [DN], the share of the frames in the upper one, and by how much
    twice the log-likelihood exceeds that of one normal distribution; each (K,)."""

    lower: Float64Array
    upper: Float64Array
    sigma: Float64Array
    share: Float64Array
    gain: Float64Array


def best_split(values: Float64Array) -> tuple[Float64Array, NDArray[np.intp]]:
    """Least variance within two groups of the sorted values, over the whole variance, and the size of the lower group.

    values : (K, N), sorted along N.
    """
    count = values.shape[1]
    rest = values - values.mean(axis=1, keepdims=True)
    sums = np.cumsum(rest, axis=1)[:, :-1]
    sizes = np.arange(1, count)
    between = np.square(sums) * count / (sizes * (count - sizes))
    total = np.maximum(np.einsum("kn,kn->k", rest, rest), 1e-300)
    return 1 - between.max(axis=1) / total, between.argmax(axis=1) + 1


def two_levels(values: Float64Array, whole_numbers: bool, least_sigma: float) -> TwoLevels:
    """Two levels fitted to (K, N) values.

    whole_numbers : codes of an ADC, whose probabilities are integrals over 1 DN.
    least_sigma : of each level [DN]; without one, levels of few values have any likelihood.
    """
    values = np.sort(values, axis=1)
    count = values.shape[1]
    _, low_count = best_split(values)
    share = 1 - low_count / count
    lower_group = np.arange(count) < low_count[:, None]
    lower = np.average(values, axis=1, weights=lower_group)
    upper = np.average(values, axis=1, weights=~lower_group)
    inside = values - np.where(lower_group, lower[:, None], upper[:, None])
    sigma = np.maximum(np.sqrt(np.square(inside).mean(axis=1)), least_sigma)
    for _ in range(STEPS):
        log_odds = np.clip(_log_odds(values, lower, upper, sigma, share), -500, 500)
        up = 1 / (1 + np.exp(log_odds))
        share = np.clip(up.mean(axis=1), 1e-9, 1 - 1e-9)
        upper = np.einsum("kn,kn->k", up, values) / (share * count)
        lower = np.einsum("kn,kn->k", 1 - up, values) / ((1 - share) * count)
        from_upper = np.square(values - upper[:, None])
        from_lower = np.square(values - lower[:, None])
        square = up * from_upper + (1 - up) * from_lower
        sigma = np.maximum(np.sqrt(square.mean(axis=1)), least_sigma)
    sigma = _without_rounding(sigma, whole_numbers, least_sigma)
    chance_lower = np.exp(_log_chance(values, lower, sigma, whole_numbers))
    chance_upper = np.exp(_log_chance(values, upper, sigma, whole_numbers))
    chance = (1 - share)[:, None] * chance_lower + share[:, None] * chance_upper
    two = np.log(np.maximum(chance, 1e-300)).sum(axis=1)
    one = _one_level(values, whole_numbers, least_sigma)
    return TwoLevels(lower, upper, sigma, share, gain=2 * (two - one))


def _log_odds(
    values: Float64Array,
    lower: Float64Array,
    upper: Float64Array,
    sigma: Float64Array,
    share: Float64Array,
) -> Float64Array:
    """ln(P(lower)/P(upper)) of each value."""
    middle, step = 0.5 * (lower + upper), (upper - lower) / np.square(sigma)
    return np.asarray(
        np.log((1 - share) / share)[:, None] - step[:, None] * (values - middle[:, None])
    )


def _without_rounding(
    sigma: Float64Array, whole_numbers: bool, least_sigma: float
) -> Float64Array:
    return np.sqrt(np.maximum(np.square(sigma) - ROUNDING_DN2 * whole_numbers, least_sigma**2))


def _log_chance(
    values: Float64Array, mean: Float64Array, sigma: Float64Array, whole_numbers: bool
) -> Float64Array:
    """Logarithm of the probability of each value's code, or of the density there."""
    z = (values - mean[:, None]) / sigma[:, None]
    if not whole_numbers:
        return np.asarray(-0.5 * np.square(z) - np.log(sigma * np.sqrt(2 * np.pi))[:, None])
    half, away = 0.5 / sigma[:, None], -np.abs(z)
    chance = scipy.special.ndtr(away + half) - scipy.special.ndtr(away - half)
    return np.asarray(np.log(np.maximum(chance, 1e-300)))


def _one_level(values: Float64Array, whole_numbers: bool, least_sigma: float) -> Float64Array:
    """Largest log-likelihood of one normal distribution for each pixel."""
    mean = values.mean(axis=1)
    sigma = _without_rounding(values.std(axis=1), whole_numbers, least_sigma)
    if not whole_numbers:
        return np.asarray(_log_chance(values, mean, sigma, False).sum(axis=1))
    best = np.full(len(values), -np.inf)
    for factor in TRIED_SIGMAS:
        for shift in TRIED_MEANS:
            likelihood = _log_chance(values, mean + shift * sigma, factor * sigma, True)
            best = np.maximum(best, likelihood.sum(axis=1))
    return best
