"""Random telegraph signal (RTS) pixels: two levels over the frames of a dark stack, with their step and duty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Figures, Quantity, share_interval
from ..statistics.estimators import require_probability

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "likelihood ratio of two levels and one"
FRAMES_MIN = 8
LEVEL_FRAMES_MIN = 3
"""Smallest number of frames in a level: particles brighten one or two frames."""
TAIL = 4.0
"""For normal values, twice the logarithm of the likelihood ratio exceeds x with a probability of at most 4·exp(−x/2);
128 frames had a factor of 1.9, fewer frames less, in 60 000 to 200 000 pixels each."""
SCREENED = 1e-3
"""Fraction of quiet pixels whose variance is large enough for a fit."""
SPLIT_VARIANCE_MAX = 1 - 2 / math.pi
"""Variance within two halves of normal values over the whole variance; two levels have less."""
STEP_SIGMAS_MIN = 2.5
"""Smallest distance of two levels in σ; two normal distributions closer than 2σ have a single maximum."""
TWO_CODES_DN2 = 0.25
"""Variance of a constant that noise rounds equally often to two codes."""
PIXELS_AT_ONCE = 4096
STEPS = 40
"""Number of steps of expectation and maximisation."""
SIGMA_MIN_DN = 0.41
"""Smallest σ of a level of whole codes: two neighbouring codes are then too close to be two levels."""


@dataclass(frozen=True, eq=False)
class TelegraphPixels(Figures):
    """K pixels with two levels.

    fraction : of all pixels [%].  step : median distance of the two levels [DN].
    rows, columns : places, shape (K,).  steps : distances in the unit of ``step``.  shares : fractions of the frames in
    the upper level.  detectable : step from which on most pixels with equally long levels are found.
    """

    fraction: Quantity
    step: Quantity
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    steps: Float64Array
    shares: Float64Array
    detectable: float

    def plot(self, ax: Axes) -> None:
        """Plot the fraction of frames in the upper level versus the step."""
        ax.plot(self.steps, self.shares, ".", ms=4, label="RTS pixels")
        ax.axvline(self.detectable, color="0.4", ls="--", lw=1, label="detectable step")
        ax.set(
            xlabel=f"step [{self.step.unit}]",
            ylabel="fraction of the frames in the upper level",
            ylim=(0, 1),
        )


def rts_pixels(stack: Stack, false_alarm: float = 0.01) -> TelegraphPixels:
    """Find RTS pixels in at least 8 dark frames, without fluctuations of whole frames.

    false_alarm : probability of one or more false RTS pixels in a stack with normal temporal noise.
    Pixels with a small variance, or with levels closer than 2.5 σ, are not found.
    Raises InputError for a mosaic, fewer frames, and an impossible probability.
    """
    stack.require_one_filter()
    frames, pixels = len(stack), stack.mean.size
    if frames < FRAMES_MIN:
        raise InputError(
            f"RTS pixels need at least {FRAMES_MIN} dark frames; this stack has {frames}."
        )
    require_probability(false_alarm)
    quiet_dn2 = float(np.median(stack.variance))
    if stack.frames.dtype.kind != "f":
        quiet_dn2 = max(quiet_dn2, TWO_CODES_DN2)
    limit = 2 * math.log(TAIL * pixels / false_alarm)
    screen = quiet_dn2 * scipy.special.chdtri(frames - 1, SCREENED) / (frames - 1)
    places = np.argwhere((stack.variance > screen) & (stack.variance > 0))
    tables = [
        _fit_pixels(stack, places[begin : begin + PIXELS_AT_ONCE], quiet_dn2, limit)
        for begin in range(0, len(places), PIXELS_AT_ONCE)
    ]
    rows, columns, steps, shares = np.concatenate([np.zeros((4, 0)), *tables], axis=1)
    # A pixel that is equally long in both levels: N·(ln(1 + A²/4σ²) − 2 ln 2) reaches the limit.
    detectable = 2 * math.sqrt(quiet_dn2 * math.expm1(limit / frames + 2 * math.log(2)))
    share = share_interval(len(steps) / pixels, pixels)
    fraction = Quantity("RTS", "fraction of RTS pixels", *share, "", SECTION).scaled(100, "%")
    fraction = fraction.noted(
        f"steps below about {detectable:.3g} DN are not found with {frames} frames"
    )
    median = _median_with_interval(steps)
    step = Quantity("ΔRTS", "median step of the RTS pixels", *median, "DN", SECTION)
    return TelegraphPixels(
        mark_clipped(fraction, stack),
        mark_clipped(step.noted("" if len(steps) else "no RTS pixels"), stack),
        rows.astype(np.intp),
        columns.astype(np.intp),
        steps,
        shares,
        detectable,
    )


def _fit_pixels(
    stack: Stack, places: NDArray[np.intp], quiet_dn2: float, limit: float
) -> Float64Array:
    """Return rows, columns, steps and upper fractions of those pixels that have two levels, shape (4, K)."""
    drift = stack.frame_means - stack.frame_means.mean()
    whole = stack.frames.dtype.kind != "f" and float(np.ptp(drift)) < 0.5
    values = np.sort(stack.frames[:, *places.T].T - (0.0 if whole else drift), axis=1)
    within, _ = _best_split(values)
    values, places = values[within < SPLIT_VARIANCE_MAX], places[within < SPLIT_VARIANCE_MAX]
    if not len(values):
        return np.zeros((4, 0))
    fit = _two_levels(values, max(0.5 * math.sqrt(quiet_dn2), SIGMA_MIN_DN if whole else 0.1))
    frames_in_rarer_level = np.minimum(fit.share, 1 - fit.share) * len(stack)
    chosen = (fit.gain > limit) & (fit.step > STEP_SIGMAS_MIN * fit.sigma)
    chosen &= frames_in_rarer_level > LEVEL_FRAMES_MIN - 0.5
    return np.asarray(np.array([*places.T, fit.step, fit.share])[:, chosen])


class _TwoLevels(NamedTuple):
    """Fitted levels of K pixels, shape (K,) each.

    step, sigma : distance and common σ of the levels [DN].  share : fraction of the frames in the upper level.
    gain : twice the gain in log-likelihood over one normal distribution.
    """

    step: Float64Array
    sigma: Float64Array
    share: Float64Array
    gain: Float64Array


def _best_split(values: Float64Array) -> tuple[Float64Array, NDArray[np.intp]]:
    """Return the least variance within two groups over the whole variance, and the size of the lower group.

    values : shape (K, N), sorted along N.
    """
    count = values.shape[1]
    rest = values - values.mean(axis=1, keepdims=True)
    sums = np.cumsum(rest, axis=1)[:, :-1]
    sizes = np.arange(1, count)
    between = np.square(sums) * count / (sizes * (count - sizes))
    total = np.maximum(np.einsum("kn,kn->k", rest, rest), 1e-300)
    return 1 - between.max(axis=1) / total, between.argmax(axis=1) + 1


def _two_levels(values: Float64Array, sigma_min: float) -> _TwoLevels:
    """Fit two levels with normal noise to sorted values (K, N) by expectation and maximisation.

    sigma_min : smallest σ of a level [DN]; without it, levels of few values have any likelihood.
    """
    _, low_count = _best_split(values)
    up = (np.arange(values.shape[1]) >= low_count[:, None]).astype(np.float64)
    for _ in range(STEPS):
        share = np.clip(up.mean(axis=1, keepdims=True), 1e-9, 1 - 1e-9)
        upper = (up * values).mean(axis=1, keepdims=True) / share
        lower = ((1 - up) * values).mean(axis=1, keepdims=True) / (1 - share)
        square = up * np.square(values - upper) + (1 - up) * np.square(values - lower)
        sigma = np.maximum(np.sqrt(square.mean(axis=1, keepdims=True)), sigma_min)
        in_upper = np.log(share) - 0.5 * np.square((values - upper) / sigma)
        in_lower = np.log(1 - share) - 0.5 * np.square((values - lower) / sigma)
        up = scipy.special.expit(in_upper - in_lower)
    two = (np.logaddexp(in_upper, in_lower) - np.log(sigma)).sum(axis=1)
    single = np.maximum(values.std(axis=1, keepdims=True), sigma_min)
    rest = (values - values.mean(axis=1, keepdims=True)) / single
    one = (-0.5 * np.square(rest) - np.log(single)).sum(axis=1)
    step, sigma, share = (column[:, 0] for column in (upper - lower, sigma, share))
    return _TwoLevels(step, sigma, share, 2 * (two - one))


def _median_with_interval(steps: Float64Array) -> tuple[float, float, float]:
    """Return the median and the order statistics that contain it in 95 % of all samples; all of fewer than 6 steps."""
    if not steps.size:
        return math.nan, math.nan, math.nan
    ordered = np.sort(steps)
    beyond = 0
    if len(steps) > 5:
        beyond = int(scipy.special.bdtrik(0.025, len(steps), 0.5))
    return float(np.median(ordered)), float(ordered[beyond]), float(ordered[-1 - beyond])
