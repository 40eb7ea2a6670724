"""What rounding to codes may do to the moments of a signal, wherever in a step of the converter it lies."""

from __future__ import annotations

import numpy as np

from ..core.types import Float64Array
from .given_count import GivenCount

TINY = 1e-30
"""Variance [DN²] that is none."""

MOST_HARMONICS, HIDDEN, SLOWEST = 2000.0, 0.7, 4.0
"""Harmonics of the steps that are looked at: so many, up to so much noise over a step of theirs, or so many electrons a
step."""


def rounding(analogue: Float64Array) -> Float64Array:
    """How far rounding to codes may move mean and variances of a signal in DN, wherever in a step it lies, (N, 3).

    The steps are blurred by the noise: their first harmonic falls with exp(-2π²σ²).
    """
    variance = analogue[:, 1] + analogue[:, 2]
    left = np.exp(-2 * np.pi**2 * variance)
    return np.stack([0.5 * left, (0.25 + 4 * variance) * left, 0.0 * left], axis=1)


def beats(given: GivenCount, electrons: Float64Array, analogue: Float64Array) -> Float64Array:
    """How far whole electrons may move mean and variances besides, where no noise behind the count hides them, (N, 3).

    Of steps 118.95 electrons wide some take 118 counts and others 119. Harmonic k of the steps, e^(-2π²k²σ²)/(πk) DN
    behind a noise of σ, then is a wave over f = |k·K − nearest integer| cycles per electron, K the slope [DN/e-]. The
    shot noise of λ electrons leaves e^(-x²/2) of it, x = 2πf√λ, so that a slow wave stays however many steps the noise
    covers; it moves the temporal variance by 2·Cov(signal, wave), at most 2·σ_temporal times the wave and x·e^(-x²/2).

    electrons : mean count of the levels.  K is taken from all counts within 4√λ: of a curve it is not one number.
    """
    quietest, shot = float(given.codes_before_rounding[1].min()), np.sqrt(electrons)
    low, high = slopes_about(given, electrons, 4 * shot)
    last = min(MOST_HARMONICS, HIDDEN / max(quietest, TINY), SLOWEST / max(given.dn_per_e, TINY))
    k = np.arange(1.0, last)
    if given.dn_per_e == 0 or not k.size:
        return np.zeros_like(analogue)
    ends = np.outer(low, k), np.outer(high, k)
    near = [np.abs(end - np.round(end)) for end in ends]
    slow = np.where(np.floor(ends[0]) < np.floor(ends[1]), 0.0, np.minimum(*near))
    x = [2 * np.pi * f * shot[:, None] for f in (slow, np.maximum(*near))]
    waves = np.exp(-2 * (np.pi * k * quietest) ** 2) / (np.pi * k) * (ends[1] > 0.5)  # below there is no other count
    mean = (waves * np.exp(-0.5 * x[0] ** 2)).sum(axis=1)
    steepest = np.clip(1.0, x[0], np.maximum(*x))
    moved = (waves * steepest * np.exp(-0.5 * steepest**2)).sum(axis=1)
    sigma = np.sqrt(np.maximum(analogue[:, 1:], 0.0)).T
    return np.stack([mean, mean**2 + 2 * sigma[0] * moved, mean**2 + 2 * sigma[1] * mean], axis=1)


def slopes_about(given: GivenCount, electrons: Float64Array, reach: Float64Array) -> tuple[Float64Array, Float64Array]:
    """The smallest and the largest slope of the codes [DN/e-] at the ends of an interval about each count."""
    counts, codes = given.counts, given.codes_before_rounding[0]
    if counts.size < 2:
        return np.zeros_like(electrons), np.zeros_like(electrons)
    slopes = np.abs(np.diff(codes) / np.diff(counts))
    ends = [np.interp(electrons + sign * reach, 0.5 * (counts[1:] + counts[:-1]), slopes) for sign in (-1, 0, 1)]
    return np.min(ends, axis=0), np.max(ends, axis=0)


def steps_of_lines(kept: Float64Array, before: Float64Array, of_lines: Float64Array) -> Float64Array:
    """How far rounding may move the variance of the means of lines, wherever in a step they lie [DN²].

    kept, before : variance inside of a line, less and more.  of_lines : of what the pixels of a line share. Lines that
    lie closer than a step crowd at one of them, where the slope of the mean code limits what can change.
    """
    crowded = np.maximum(1.0, 0.4 / np.sqrt(np.maximum(of_lines, TINY)))
    lost = [crowded * _steps_seen(v) + 4 * of_lines * np.exp(-2 * np.pi**2 * v) for v in (kept, before)]
    left = np.exp(-2 * np.pi**2 * kept)
    steepest = np.maximum(1 + 2 * left + 2 * left**4, 1 / np.sqrt(2 * np.pi * kept))
    return np.asarray(np.minimum(np.abs(lost[0] - lost[1]), of_lines * (steepest**2 - 1)))


def _steps_seen(variance: Float64Array) -> Float64Array:
    """Variance of the mean code about its signal that a noise leaves of even steps: Σ exp(-4π²k²·v)/(2π²k²) [DN²]."""
    waves = sum(np.exp(-4 * (np.pi * k) ** 2 * variance) / (2 * (np.pi * k) ** 2) for k in (1, 2, 3))
    return np.where(variance < 0.04, 1 / 12 + variance - np.sqrt(variance / np.pi), waves)
