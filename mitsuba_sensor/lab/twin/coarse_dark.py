"""Black level, offsets and noise of dark frames whose noise is below a code, from mean, variances and shares of codes.

Where rounding is coarse, mean and variance of the codes depend on where the signal lies between two codes. A pixel of
mean x and noise σ has the mean m(x, σ) and the variance v(x, σ) of a rounded normal; x is normal from pixel to pixel.
The three numbers are those that give the frames' mean, temporal and spatial variance, and how often each code is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...core.code_law import code_moments
from ...core.types import Float64Array
from ..frames.rounding import ROUNDING_DN2, has_whole_codes
from ..frames.series import COARSE_DN2
from ..frames.stack import Stack
from .dark import Dark

FEWEST_FRAMES, FEWEST_CODES, MOST_CODES = 8, 3, 24
"""Frames of a stack, and codes that they show, for which the three are told apart."""
Z: Float64Array = np.linspace(-5.0, 5.0, 201)
"""Nodes of the pixels' means."""
SHARES: Float64Array = np.exp(-0.5 * Z**2) / np.exp(-0.5 * Z**2).sum()
RARE = 1e-3
"""Share of the codes below which one is not looked at: hot pixels have them."""
MEAN_DN, TEMPORAL, SPATIAL, OF_CODES = 0.002, 0.003, 0.02, 0.1
"""How far off mean, the variances and shares of codes may be, the last three relative: laws are not quite normal."""


@dataclass(frozen=True)
class CoarseDark:
    """level : mean of the signal before rounding.  offsets : σ of the pixels' means [DN].

    sigma : temporal σ of a pixel [DN].  slope : of the mean code over the mean signal.
    """

    level: float
    offsets: float
    sigma: float
    slope: float

    def applied(self, dark: Dark) -> Dark:
        """Dark with the black level of the signal before rounding, and offsets of its width."""
        quantity = dark.black.quantity
        shift = self.level - quantity.value
        half = math.hypot(0.5 * (quantity.high - quantity.low), shift)
        low, high = self.level - half, self.level + half
        moved = replace(quantity, value=self.level, low=low, high=high, note="")
        moved = moved.noted("before rounding, by how often each code is seen")
        own = float(dark.offsets.image.std())
        wider = self.offsets / own
        mean = dark.offsets.image.mean()
        image = mean + shift + wider * (dark.offsets.image - mean)
        offsets = replace(dark.offsets, image=image, noises=())
        return replace(dark, black=dark.black.known_as(moved), offsets=offsets)


def coarse_of(stack: Stack) -> CoarseDark | None:
    """The numbers of a stack whose noise is below 0.7 DN; None of another one."""
    coarse = has_whole_codes(stack) and float(stack.variance.mean()) < COARSE_DN2 + ROUNDING_DN2
    if coarse:
        return coarse_dark(stack)
    return None


def dark_noise_dn2(stack: Stack, coarse: CoarseDark | None) -> float:
    """Temporal variance of a dark stack without rounding [DN²]."""
    if coarse is not None:
        return coarse.sigma**2
    variance = float(stack.variance.mean())
    if has_whole_codes(stack):
        return max(variance - ROUNDING_DN2, 0.0)
    return variance


def coarse_dark(stack: Stack) -> CoarseDark | None:
    """The numbers of a dark stack; None where too few frames or codes tell them apart."""
    if stack.frames.dtype.kind not in "ui":
        return None
    largest = int(stack.frames.max()) + 1
    every = np.zeros(largest, np.int64)
    for frame in stack.frames:
        every += np.bincount(frame.ravel(), minlength=largest)
    codes = np.flatnonzero(every)
    counts = every[codes]
    if len(stack) < FEWEST_FRAMES or not FEWEST_CODES <= codes.size <= MOST_CODES:
        return None
    temporal = float(stack.variance.mean())
    seen = _Seen(
        mean=float(stack.frame_means.mean()),
        temporal=temporal,
        spatial=max(float(stack.mean.var()) - temporal / len(stack), 1e-6),
        codes=codes.astype(np.float64),
        shares=counts / counts.sum(),
    )
    fits = [scipy.optimize.least_squares(seen.deviations, start) for start in _starts(seen)]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    level, spread, sigma = float(best[0]), math.exp(float(best[1])), math.exp(float(best[2]))
    step = 0.01
    ends = [_moments(level + sign * step, spread, sigma)[0] for sign in (-1, 1)]
    return CoarseDark(level, spread, sigma, (ends[1] - ends[0]) / (2 * step))


def _starts(seen: _Seen) -> list[tuple[float, float, float]]:
    """Places between two codes, with noise that the variance may come from."""
    places = (seen.mean, seen.mean - 0.15, seen.mean + 0.15)
    log_spread = 0.5 * math.log(seen.spatial)
    return [(place, log_spread, math.log(sigma)) for place in places for sigma in (0.15, 0.3)]


@dataclass(frozen=True)
class _Seen:
    """What the frames show: mean, variances, and the share of each code."""

    mean: float
    temporal: float
    spatial: float
    codes: Float64Array
    shares: Float64Array

    def deviations(self, p: Float64Array) -> Float64Array:
        """Of (x₀, ln d, ln σ) from the frames, in what is allowed."""
        level, spread, sigma = float(p[0]), math.exp(p[1]), math.exp(p[2])
        mean, temporal, spatial = _moments(level, spread, sigma)
        often = self.shares > RARE
        total = math.hypot(spread, sigma)
        edges = (self.codes[often] + np.array([[-0.5], [0.5]]) - level) / total
        expected = np.maximum(np.diff(scipy.special.ndtr(edges), axis=0)[0], 1e-12)
        of_codes = np.log(expected / self.shares[often]) / OF_CODES
        moments = [
            (mean - self.mean) / MEAN_DN,
            math.log(max(temporal, 1e-12) / self.temporal) / TEMPORAL,
            math.log(max(spatial, 1e-12) / self.spatial) / SPATIAL,
        ]
        return np.concatenate([moments, of_codes])


def _moments(level: float, spread: float, sigma: float) -> tuple[float, float, float]:
    """Mean, temporal and spatial variance of the codes of pixels at x₀ ± d with the noise σ."""
    mean, variance = code_moments(level + spread * Z, np.full(Z.size, sigma), 2**24)
    average = float(SHARES @ mean)
    return average, float(SHARES @ variance), float(SHARES @ (mean - average) ** 2)
