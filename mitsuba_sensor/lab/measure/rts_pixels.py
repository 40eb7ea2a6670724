"""Random telegraph signal (RTS) pixels: two levels over the frames of a dark stack, their distance and their share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Figures, Quantity, share_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "likelihood ratio of two levels and one"
FEWEST_FRAMES, FEWEST_IN_A_LEVEL = 8, 3
"""Of a stack; and of a level: one or two frames above all others are a particle's."""
TAIL = 4.0
"""Of normal values, twice the logarithm of the likelihood ratio exceeds x in at most 4·exp(−x/2) of the pixels: 1.9 was
found for 128 frames and less for fewer, of 60 000 to 200 000 pixels each."""
SCREEN = 1e-3
"""Share of quiet pixels whose variance is large enough for a fit."""
LARGEST_SPLIT = 1 - 2 / math.pi
"""Variance within two halves of normal values over the whole; two levels have less."""
APART = 2.5
"""Distance in σ below which two levels may be one skewed distribution: up to 2 they have one maximum."""
TWO_CODES_DN2 = 0.25
"""Variance of a constant that noise rounds to two codes as often: quiet integer frames have pixels of that and of 0."""
MOST_BARS = 20
"""Standard errors in a plot."""
PIXELS = 4096
"""Fitted at once: a bound of the memory."""
STEPS = 40
"""Steps of expectation and maximisation."""
LEAST_SIGMA_DN = 0.41
"""Of a level of whole codes: two neighbouring codes are then closer than APART and no two levels."""


@dataclass(frozen=True, eq=False)
class TelegraphPixels(Figures):
    """K pixels with two levels.

    fraction : of all pixels [%].  step : median of the distances of the two levels [DN].
    rows, columns : places, (K,).  steps, step_errors : distances and standard errors, (K,) in the unit of ``step``.
    shares, share_errors : of the frames in the upper level, (K,), with switching that is slower than the frames.
    detectable : step of a pixel that is in both levels equally long, from which on most are found.
    """

    fraction: Quantity
    step: Quantity
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    steps: Float64Array
    step_errors: Float64Array
    shares: Float64Array
    share_errors: Float64Array
    detectable: float

    def plot(self, ax: Axes) -> None:
        """Share of the frames in the upper level against the step, with standard errors of some."""
        every = slice(None, None, max(1, len(self.steps) // MOST_BARS))
        ax.plot(self.steps, self.shares, ".", ms=4, label="RTS pixels")
        ax.errorbar(
            self.steps[every],
            self.shares[every],
            self.share_errors[every],
            self.step_errors[every],
            fmt="none",
            elinewidth=0.5,
            ecolor="0.6",
            label="standard errors",
        )
        ax.axvline(self.detectable, color="0.4", ls="--", lw=1, label="detectable step")
        ax.set(
            xlabel=f"step [{self.step.unit}]",
            ylabel="share of the frames in the upper level",
            ylim=(0, 1),
        )


def rts_pixels(stack: Stack, false_alarm: float = 0.01) -> TelegraphPixels:
    """RTS pixels of 8 dark frames or more, without what whole frames share.

    false_alarm : probability that one pixel or more of a stack without RTS is named, if temporal noise is normal.
    Pixels whose variance is small, or whose levels are closer than 2.5 σ, are not found.
    Raises InputError for a mosaic, fewer frames, and a false alarm that is no probability.
    """
    stack.require_one_filter()
    frames, pixels = len(stack), stack.mean.size
    if frames < FEWEST_FRAMES or not 0 < false_alarm < 1:
        raise InputError(
            f"{frames} frames and false_alarm {false_alarm!r}; RTS pixels need at least {FEWEST_FRAMES} frames and "
            "a probability between 0 and 1."
        )
    quiet_dn2 = float(np.median(stack.variance))
    if stack.frames.dtype.kind != "f":
        quiet_dn2 = max(quiet_dn2, TWO_CODES_DN2)
    limit = 2 * math.log(TAIL * pixels / false_alarm)
    screen = quiet_dn2 * scipy.special.chdtri(frames - 1, SCREEN) / (frames - 1)
    places = np.argwhere((stack.variance > screen) & (stack.variance > 0))
    parts = [places[begin : begin + PIXELS] for begin in range(0, len(places), PIXELS)]
    tables = [_fit_pixels(stack, part, quiet_dn2, limit) for part in parts]
    table = np.concatenate([np.zeros((6, 0)), *tables], axis=1)
    detectable = _detectable_step(quiet_dn2, limit, frames)
    share = share_interval(table.shape[1] / pixels, pixels)
    fraction = Quantity("RTS", "share of RTS pixels", *share, "", SECTION).scaled(100, "%")
    fraction = fraction.noted(
        f"steps below about {detectable:.3g} DN are not found with {frames} frames"
    )
    median = _median_with_interval(table[2])
    step = Quantity("ΔRTS", "median step of the RTS pixels", *median, "DN", SECTION)
    return TelegraphPixels(
        mark_clipped(fraction, stack),
        mark_clipped(step.noted("" if table.shape[1] else "no RTS pixels"), stack),
        *table[:2].astype(np.intp),
        *table[2:],
        detectable,
    )


def _fit_pixels(
    stack: Stack, places: NDArray[np.intp], quiet_dn2: float, limit: float
) -> Float64Array:
    """Rows, columns, steps and shares with errors of the pixels among these that have two levels, (6, K)."""
    drift = stack.frame_means - stack.frame_means.mean()
    whole = stack.frames.dtype.kind != "f" and float(np.ptp(drift)) < 0.5
    values = stack.frames[:, *places.T].T - (0.0 if whole else drift)
    split, _ = _best_split(np.sort(values, axis=1))
    values, places = values[split < LARGEST_SPLIT], places[split < LARGEST_SPLIT]
    if not len(values):
        return np.zeros((6, 0))
    fit = _two_levels(values, max(0.5 * math.sqrt(quiet_dn2), LEAST_SIGMA_DN if whole else 0.1))
    step = fit.upper - fit.lower
    frames_in_rarer_level = np.minimum(fit.share, 1 - fit.share) * len(stack)
    chosen = (fit.gain > limit) & (step > APART * fit.sigma)
    chosen &= frames_in_rarer_level > FEWEST_IN_A_LEVEL - 0.5
    step_errors, share_errors = _errors(fit, values)
    table = np.array([*places.T, step, step_errors, fit.share, share_errors])
    return np.asarray(table[:, chosen])


@dataclass(frozen=True, eq=False)
class TwoLevels:
    """Of K pixels: the two levels and their common σ [DN], the share of the frames in the upper one, and by how much
    twice the log-likelihood exceeds that of one normal distribution; each (K,)."""

    lower: Float64Array
    upper: Float64Array
    sigma: Float64Array
    share: Float64Array
    gain: Float64Array


def _best_split(values: Float64Array) -> tuple[Float64Array, NDArray[np.intp]]:
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


def _two_levels(values: Float64Array, least_sigma: float) -> TwoLevels:
    """Two levels with normal noise fitted to (K, N) values by expectation and maximisation.

    least_sigma : of each level [DN]; without one, levels of few values have any likelihood.
    """
    values = np.sort(values, axis=1)
    _, low_count = _best_split(values)
    up = (np.arange(values.shape[1]) >= low_count[:, None]).astype(np.float64)
    for _ in range(STEPS):
        share = np.clip(up.mean(axis=1, keepdims=True), 1e-9, 1 - 1e-9)
        upper = (up * values).mean(axis=1, keepdims=True) / share
        lower = ((1 - up) * values).mean(axis=1, keepdims=True) / (1 - share)
        square = up * np.square(values - upper) + (1 - up) * np.square(values - lower)
        sigma = np.maximum(np.sqrt(square.mean(axis=1, keepdims=True)), least_sigma)
        in_upper = np.log(share) - 0.5 * np.square((values - upper) / sigma)
        in_lower = np.log(1 - share) - 0.5 * np.square((values - lower) / sigma)
        up = scipy.special.expit(in_upper - in_lower)
    two = (np.logaddexp(in_upper, in_lower) - np.log(sigma)).sum(axis=1)
    one_sigma = np.maximum(values.std(axis=1, keepdims=True), least_sigma)
    rest = (values - values.mean(axis=1, keepdims=True)) / one_sigma
    one = (-0.5 * np.square(rest) - np.log(one_sigma)).sum(axis=1)
    lower, upper, sigma, share = (part[:, 0] for part in (lower, upper, sigma, share))
    return TwoLevels(lower, upper, sigma, share, gain=2 * (two - one))


def _errors(fit: TwoLevels, values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Standard errors of the step, and of the share of the upper level.

    Of a level that lasts, the share has (1 + ρ)/(1 − ρ) times the variance of independent frames.
    """
    frames = values.shape[1]
    step = fit.sigma * np.sqrt(1 / (fit.share * frames) + 1 / ((1 - fit.share) * frames))
    state = (values > 0.5 * (fit.lower + fit.upper)[:, None]).astype(np.float64)
    rest = state - state.mean(axis=1, keepdims=True)
    power = np.maximum(np.square(rest).sum(axis=1), 1e-300)
    lasting = np.clip((rest[:, 1:] * rest[:, :-1]).sum(axis=1) / power, 0, 0.98)
    share = np.sqrt(fit.share * (1 - fit.share) / frames * (1 + lasting) / (1 - lasting))
    return step, share


def _median_with_interval(steps: Float64Array) -> tuple[float, float, float]:
    """Median, with the order statistics that contain it in 95 % of all samples.

    Fewer than 6 steps give the smallest and the largest.
    """
    if not steps.size:
        return math.nan, math.nan, math.nan
    ordered = np.sort(steps)
    beyond = 0
    if len(steps) > 5:
        beyond = int(scipy.special.bdtrik(0.025, len(steps), 0.5))
    return float(np.median(ordered)), float(ordered[beyond]), float(ordered[-1 - beyond])


def _detectable_step(quiet_dn2: float, limit: float, frames: int) -> float:
    """Step A of a pixel that is as long in both levels: N·(ln(1 + A²/4σ²) − 2 ln 2) reaches the limit."""
    return 2 * math.sqrt(quiet_dn2 * math.expm1(limit / frames + 2 * math.log(2)))
