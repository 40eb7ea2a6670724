"""Black level, offsets, dark current and temporal noise in the dark, with maps of offsets and dark current."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import Pattern, mark_rounding
from ..frames.stack import Stack
from ..measure.dark_current import dark_current, errors_of_means
from ..measure.dark_signal import distributions_of
from ..quantity import Quantity, no_value, student_interval
from ..statistics.mean_squares import MeanSquare, MeanSquares, root, temporal_mean_squares
from .evidence import CombinedMap, Fitted, frames_of

SECTION = "fit"
READ = no_value("σ_read", "read noise of the pixels, rms", "DN", SECTION)
FRAME = no_value("σ_frame", "jitter of the black level from frame to frame", "DN", SECTION)
SPREAD_OVER_NOISE_MIN = 3.0
"""Spread of the dark current over the remaining noise from which on its distribution is fitted."""


@dataclass(frozen=True, eq=False)
class Dark:
    """Parameters from dark frames of one temperature.

    black : black level at exposure time 0 [DN].  rate : mean dark signal [DN/s].  cv : σ over mean of the rates.
    offsets, rates : maps of the pixels [DN, DN/s]; rates is None for one exposure time.
    distribution : name of the distribution of the rates in a camera file, or None.
    quiet : stack that shows the temporal noise.
    """

    black: Fitted
    rate: Fitted
    cv: Fitted
    offsets: CombinedMap
    rates: CombinedMap | None
    distribution: str | None
    quiet: Stack

    def window(self, rows: slice, columns: slice) -> Dark:
        """Return offsets and rates of some rows and columns."""
        offsets = replace(self.offsets, image=self.offsets.image[rows, columns])
        rates = self.rates
        if rates is not None:
            rates = replace(rates, image=rates.image[rows, columns])
        return replace(self, offsets=offsets, rates=rates)

    def expected_frame(self, exposure_s: float) -> Float64Array:
        """Return the expected mean frame of an exposure time, shape (H, W) [DN]."""
        if self.rates is None:
            return self.offsets.image
        return self.offsets.image + exposure_s * self.rates.image

    def dsnu(self, part: str) -> Fitted:
        """Return DSNU of the ``pixel``, ``row`` or ``col`` offsets [DN]."""
        name, spread = "dark signal non-uniformity", self.offsets.spread()
        dsnu, pixels = (
            Quantity(f"DSNU_{each}", name, *spread[each], "DN", SECTION)
            for each in (part, "pixel")
        )
        pattern = Pattern(self.quiet, dsnu, None if part == "pixel" else pixels)
        return self.black.known_as(mark_rounding(dsnu, pattern))


def dark_over_time(stacks: Sequence[Stack]) -> Dark:
    """Fit black level, dark current and their maps to bias and dark stacks of one temperature."""
    squares = [temporal_mean_squares(stack) for stack in stacks]
    times = np.array([stack.exposure_s for stack in stacks])
    counts = np.array([len(stack) for stack in stacks])
    quiet = min(stacks, key=lambda stack: (stack.exposure_s, -len(stack)))
    frames = frames_of(*stacks)
    black = no_value("black", "black level", "DN", SECTION)
    rate = no_value("µ_I", "dark current from the mean", "DN/s", SECTION)
    several_times = len(set(times.tolist())) > 1
    if several_times:
        current = dark_current(stacks)
        black = black.with_interval(current.line.offset_interval)
        rate = replace(current.from_mean, symbol=rate.symbol)
    else:
        why = "one exposure time: dark current is part of the black level"
        errors, freedom = errors_of_means(stacks)
        weights = counts / counts.sum()
        mean = float(weights @ [stack.frame_means.mean() for stack in stacks])
        error = math.sqrt(float(weights**2 @ errors**2))
        black = black.with_interval(student_interval(mean, error, min(freedom, 1e9))).noted(why)
        rate = rate.noted(why)
    variances = [max(sum(term.value for term in one.terms()), 1e-9) for one in squares]
    at_zero, per_second = _line_weights(times, counts / np.array(variances))
    offsets = _combine(stacks, squares, at_zero)
    rates = _combine(stacks, squares, per_second) if several_times else None
    cv, distribution = _nonuniformity(rates, rate, stacks)
    return Dark(
        black=Fitted(black, frames),
        rate=Fitted(rate, frames),
        cv=Fitted(cv, frames),
        offsets=offsets,
        rates=rates,
        distribution=distribution,
        quiet=quiet,
    )


def _line_weights(
    times: Float64Array, weights: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the weights of points in a line's value at time 0 and in its slope (0 for a single time)."""
    if len(set(times.tolist())) < 2:
        return weights / weights.sum(), np.zeros(len(times))
    s0, s1, s2 = (float((weights * times**power).sum()) for power in range(3))
    det = s0 * s2 - s1**2
    return weights * (s2 - s1 * times) / det, weights * (s0 * times - s1) / det


def _combine(
    stacks: Sequence[Stack], squares: Sequence[MeanSquares], weights: Float64Array
) -> CombinedMap:
    """Return the weighted sum of the mean frames, with its remaining temporal noise."""
    image = sum(weight * stack.mean for weight, stack in zip(weights, stacks, strict=True))
    factors = [w**2 / len(stack) for w, stack in zip(weights.tolist(), stacks, strict=True)]
    return CombinedMap(np.asarray(image), tuple(zip(squares, factors, strict=True)))


def _nonuniformity(
    rates: CombinedMap | None, rate: Quantity, stacks: Sequence[Stack]
) -> tuple[Quantity, str | None]:
    """Return D_N and the distribution of the pixels' rates."""
    cv = no_value("D_N", "non-uniformity of the dark current", "", SECTION)
    coarse = next((stack.coarse for stack in stacks if stack.coarse), "")
    if rates is None or not rate.low > 0 or coarse:
        return cv.noted(coarse or "the dark current may be 0"), None
    spread = rates.spread()["all"]
    cv = cv.with_interval(spread).divided(rate, "")
    noise = math.sqrt(max(float(rates.image.var()) - spread[0] ** 2, 0.0))
    if not spread[1] > 0 or spread[0] <= SPREAD_OVER_NOISE_MIN * noise:
        return cv, None
    positive = np.sort(rates.image[rates.image > 0])
    name = distributions_of(positive)[0].name
    return cv, {
        "normal": "gaussian",
        "log-normal": "lognormal",
        "inverse Gaussian": "wald",
    }.get(name, name)


def read_noise(dark: Dark, pixel: Quantity, gain: Quantity) -> Quantity:
    """Return the temporal noise of a pixel without dark shot noise [DN]."""
    if not math.isfinite(pixel.value):
        return READ.noted(pixel.note)
    shot_dn2, error_dn2 = 0.0, 0.0
    if dark.rate.known:
        rate, seconds = dark.rate.quantity, dark.quiet.exposure_s
        shot_dn2 = max(gain.value * rate.value * seconds, 0.0)
        error_dn2 = gain.value * 0.5 * (rate.high - rate.low) * seconds
    middle = pixel.value**2 - shot_dn2
    down = math.hypot(pixel.value**2 - pixel.low**2, error_dn2)
    up = math.hypot(pixel.high**2 - pixel.value**2, error_dn2)
    ends = READ.with_interval((middle, middle - down, middle + up))
    return ends.mapped(lambda v: math.sqrt(max(v, 0.0)), note=pixel.note)


def frame_noise(stacks: Sequence[Stack]) -> Fitted:
    """Return the jitter of the frame means in excess of pixel, row and column noise, from all dark stacks.

    Only the scatter within stacks counts, since the black level may drift between stacks.
    """
    freedom = sum(len(stack) - 1 for stack in stacks)
    coarse = next((stack.coarse for stack in stacks if stack.coarse), "")
    if coarse:
        return Fitted(FRAME.noted(coarse), frames_of(*stacks))
    between = within = 0.0
    for stack in stacks:
        share = (len(stack) - 1) / freedom
        between += share * float(stack.frame_means.var(ddof=1))
        within += share * temporal_mean_squares(stack).variance_of_mean()
    lines = freedom * (min(stacks[0].shape) - 1)
    terms = [MeanSquare(between, freedom), -MeanSquare(within, max(lines, 1))]
    figure = FRAME.with_interval(root(terms))
    if not figure.low > 0:
        figure = replace(figure, value=0.0).noted("not significantly different from 0")
    return Fitted(figure, frames_of(*stacks))
