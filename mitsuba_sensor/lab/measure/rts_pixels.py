"""Random telegraph signal (RTS) pixels: two levels over the frames of a dark stack, their distance and their share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Quantity, share_interval
from ..statistics.two_levels import TwoLevels, best_split, two_levels

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


@dataclass(frozen=True, eq=False)
class TelegraphPixels:
    """K pixels with two levels.

    fraction : of all pixels [%].  step : median of the distances of the two levels [DN]; [e-] by :meth:`per_gain`.
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

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both."""
        return self.fraction, self.step

    def per_gain(self, gain_dn_per_e: float) -> TelegraphPixels:
        """Steps in electrons."""
        arrays = {
            name: getattr(self, name) / gain_dn_per_e
            for name in ("steps", "step_errors", "detectable")
        }
        return replace(self, step=self.step.scaled(1 / gain_dn_per_e, "e-"), **arrays)

    def plot(self, ax: Axes) -> None:
        """Share of the frames in the upper level against the step, with standard errors of some."""
        some = slice(None, None, max(1, len(self.steps) // MOST_BARS))
        bars = self.shares[some], self.share_errors[some], self.step_errors[some]
        ax.plot(self.steps, self.shares, ".", ms=4, label="RTS pixels")
        ax.errorbar(
            self.steps[some],
            *bars,
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
    """Of 8 dark frames or more, without what whole frames share.

    false_alarm : probability that one pixel or more of a stack without RTS is named, if temporal noise is normal.
    Pixels whose variance is small, or whose levels are closer than 2.5 σ, are not found.
    Raises InputError for a mosaic, fewer frames, and a false alarm that is no probability.
    """
    stack.require_one_filter()
    if len(stack) < FEWEST_FRAMES or not 0 < false_alarm < 1:
        raise InputError(
            f"{len(stack)} frames and false_alarm {false_alarm!r}; RTS pixels need at least {FEWEST_FRAMES} frames and "
            "a probability between 0 and 1."
        )
    quiet = max(
        float(np.median(stack.variance)),
        TWO_CODES_DN2 if stack.frames.dtype.kind != "f" else 0.0,
    )
    limit = 2 * math.log(TAIL * stack.mean.size / false_alarm)
    screened = stack.variance > quiet * scipy.special.chdtri(len(stack) - 1, SCREEN) / (
        len(stack) - 1
    )
    rows, columns = np.nonzero(screened & (stack.variance > 0))
    found = [
        _fitted(stack, (rows[i : i + PIXELS], columns[i : i + PIXELS]), quiet, limit)
        for i in range(0, rows.size, PIXELS)
    ]
    table = np.concatenate([np.zeros((6, 0)), *found], axis=1)
    count, pixels = table.shape[1], stack.mean.size
    fraction = Quantity(
        "RTS", "share of RTS pixels", *share_interval(count, pixels), "", SECTION
    ).scaled(100, "%")
    step = Quantity("ΔRTS", "median step of the RTS pixels", *_median(table[2]), "DN", SECTION)
    step = step if count else step.noted("no RTS pixels")
    detectable = _detectable(quiet, limit, len(stack))
    fraction = fraction.noted(
        f"steps below about {detectable:.3g} DN are not found with {len(stack)} frames"
    )
    marked = [mark_clipped(one, stack) for one in (fraction, step)]
    row, column = table[:2].astype(np.intp)
    step_dn, step_error, share, share_error = table[2:]
    found_pixels = row, column, step_dn, step_error, share, share_error
    return TelegraphPixels(marked[0], marked[1], *found_pixels, detectable)


def _fitted(
    stack: Stack, places: tuple[NDArray[np.intp], NDArray[np.intp]], quiet: float, limit: float
) -> Float64Array:
    """Rows, columns, steps and shares with errors of the pixels among these that have two levels, (6, K)."""
    drift = stack.frame_means - stack.frame_means.mean()
    whole = stack.frames.dtype.kind != "f" and float(np.ptp(drift)) < 0.5
    values = stack.frames[:, places[0], places[1]].T - (0.0 if whole else drift)
    split, _ = best_split(np.sort(values, axis=1))
    some = split < LARGEST_SPLIT
    values, places = values[some], (places[0][some], places[1][some])
    if not len(values):
        return np.zeros((6, 0))
    fit = two_levels(values, whole, max(0.5 * math.sqrt(quiet), 0.1))
    fewest = np.minimum(fit.share, 1 - fit.share) * len(stack) > FEWEST_IN_A_LEVEL - 0.5
    chosen = (fit.gain > limit) & fewest & (fit.upper - fit.lower > APART * fit.sigma)
    step_errors, share_errors = _errors(fit, values)
    table = np.array([*places, fit.upper - fit.lower, step_errors, fit.share, share_errors])
    return np.asarray(table[:, chosen])


def _errors(fit: TwoLevels, values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Of the step, and of the share of a state that lasts: (1 + ρ)/(1 − ρ) times the variance of independent frames."""
    frames = values.shape[1]
    step = fit.sigma * np.sqrt(1 / (fit.share * frames) + 1 / ((1 - fit.share) * frames))
    state = (values > 0.5 * (fit.lower + fit.upper)[:, None]).astype(np.float64)
    rest = state - state.mean(axis=1, keepdims=True)
    power = np.maximum(np.square(rest).sum(axis=1), 1e-300)
    lasting = np.clip((rest[:, 1:] * rest[:, :-1]).sum(axis=1) / power, 0, 0.98)
    share = np.sqrt(fit.share * (1 - fit.share) / frames * (1 + lasting) / (1 - lasting))
    return step, share


def _median(steps: Float64Array) -> tuple[float, float, float]:
    """With the order statistics that contain it in 95 % of all samples; fewer than 6 give the smallest and largest."""
    if not steps.size:
        return math.nan, math.nan, math.nan
    ordered = np.sort(steps)
    away = int(scipy.special.bdtrik(0.025, len(steps), 0.5)) if len(steps) > 5 else 0
    return float(np.median(ordered)), float(ordered[away]), float(ordered[-1 - away])


def _detectable(quiet: float, limit: float, frames: int) -> float:
    """Step A of a pixel that is as long in both levels: N·(ln(1 + A²/4σ²) − 2 ln 2) reaches the limit."""
    return 2 * math.sqrt(quiet * math.expm1(limit / frames + 2 * math.log(2)))
