"""What rounding to codes may do to the moments of a signal, wherever in a step of the converter it lies."""

from __future__ import annotations

import numpy as np

from ..core.types import Float64Array
from .given_count import GivenCount

TINY = 1e-30
"""Variance [DN²] that is none."""


def rounding(analogue: Float64Array) -> Float64Array:
    """How far rounding to codes may move mean and variances of a signal in DN, wherever in a step it lies, (N, 3).

    The steps are blurred by the noise: their first harmonic falls with exp(-2π²σ²).
    """
    variance = analogue[:, 1] + analogue[:, 2]
    left = np.exp(-2 * np.pi**2 * variance)
    return np.stack([0.5 * left, (0.25 + 4 * variance) * left, 0.0 * left], axis=1)


def beats(given: GivenCount, analogue: Float64Array) -> Float64Array:
    """How far whole electrons may move mean and variances besides, where no noise behind the count hides them, (N, 3).

    Of steps 118.95 electrons wide some take 118 counts and others 119, which comes and goes with the light, however
    many steps the shot noise covers: a wave of at most half an electron in the mean, and in the variances
    2·Cov(signal, wave), at most 2·e^(-½) times σ times the wave.
    """
    if given.dn_per_e == 0:
        return np.zeros_like(analogue)
    noise_e = given.codes_before_rounding[1].min() / given.dn_per_e
    wave = min(given.dn_per_e, 1.0) / 2 * np.exp(-2 * (np.pi * noise_e) ** 2)
    return np.append(np.full((len(analogue), 1), wave), wave**2 + 2 * np.exp(-0.5) * wave * analogue[:, 1:] ** 0.5, 1)


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
