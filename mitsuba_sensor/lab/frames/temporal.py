"""Temporal mean and variance of a stack, without what all pixels of a frame share: light that drifts between frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from .stack import Stack

FEWEST_PIXELS = 16
GROUP_PIXELS, MOST_GROUPS, WIDTH = 64, 100, 3.0
DRIFT_FALSE_ALARM = 1e-4
"""Share of the stacks without drift in which drift is reported."""
LINES_FALSE_ALARM = 1e-3
"""Share of the stacks with independent pixels in which rows or columns are taken as what fluctuates together."""


@dataclass(frozen=True, eq=False)
class Temporal:
    """Each pixel over the frames of a stack, and each frame over its pixels.

    mean : (H, W) [DN].  variance : (H, W) [DN²], unbiased, without the fluctuation that the pixels of a frame share.
    frames : N.  drift_dn : standard deviation of the frames' means beyond their noise [DN], 0 where none was found.
    """

    mean: Float64Array
    variance: Float64Array
    frames: int
    drift_dn: float

    @property
    def variance_error(self) -> float:
        """Standard error of the mean variance [DN²], from its scatter over pixels, rows or columns."""
        return _error_of_the_mean(self.variance)

    @property
    def drift_note(self) -> str:
        """What was found and removed, or nothing."""
        if not self.drift_dn:
            return ""
        share = (
            f" ({100 * self.drift_dn / abs(level):.2g} %)"
            if (level := float(self.mean.mean()))
            else ""
        )
        return f"frame means drift by {self.drift_dn:.3g} DN{share}, removed from the variance"


def temporal(stack: Stack) -> Temporal:
    """Statistics over the frames. In each frame the mean of pixels that are equally bright is removed, so that light
    or a black level that drifts is not taken as noise; EMVA 1288 R4 6.6 removes the mean of all pixels, which is the
    same for flat fields. Groups of 64 pixels or more are equally bright: one where the pixels' means differ by noise
    alone, more of them the more they differ, at most 100.

    Raises InputError for a single frame, fewer than 16 pixels, and mosaics.
    """
    _check(stack)
    frames, pixels = len(stack), stack.mean.size
    groups = _groups(stack)
    group = np.empty(pixels, np.intp)
    group[np.argsort(stack.mean, axis=None, kind="stable")] = (
        np.arange(pixels) * groups // pixels
    )
    count = np.bincount(group)
    square = np.zeros(pixels)
    rows, columns = np.empty((frames, stack.shape[0])), np.empty((frames, stack.shape[1]))
    for number, frame in enumerate(stack.frames):
        rest = (frame - stack.mean).ravel()
        rest -= (np.bincount(group, rest) / count)[group]
        square += rest**2
        image = rest.reshape(stack.shape)
        rows[number], columns[number] = image.mean(axis=1), image.mean(axis=0)
    freedom = frames - 1
    variance = (square * (count / (count - 1))[group] / freedom).reshape(stack.shape)
    expected = max(
        float(variance.mean()) / pixels,
        *(_of_lines(lines, freedom, variance) for lines in (rows, columns)),
    )
    found = float(stack.frame_means.var(ddof=1))
    drifts = found > expected * _limit(freedom, DRIFT_FALSE_ALARM) and found > 0
    return Temporal(
        stack.mean, variance, frames, math.sqrt(found - expected) if drifts else 0.0
    )


def _groups(stack: Stack) -> int:
    """How many: a group is wide beside the noise of a pixel's mean, lest noise decides which group a row belongs to."""
    noise = math.sqrt(float(stack.variance.mean()) / len(stack))
    wide = float(stack.mean.std()) / (WIDTH * noise) if noise else 1.0
    return max(1, min(int(wide), stack.mean.size // GROUP_PIXELS, MOST_GROUPS))


def _of_lines(lines: Float64Array, freedom: int, variance: Float64Array) -> float:
    """Variance of the frames' means by noise that whole rows or columns share, 0 where there is none; (N, lines)."""
    count = lines.shape[1]
    between = float((lines**2).sum()) / freedom / max(count - 1, 1) / count
    alone = float(variance.mean()) / variance.size
    return (
        between
        if between > alone * _limit(freedom * max(count - 1, 1), LINES_FALSE_ALARM)
        else 0.0
    )


def _check(stack: Stack) -> None:
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame has no temporal variance; pass 2 or more frames of each level."
        )
    if stack.mean.size < FEWEST_PIXELS:
        raise InputError(
            f"{stack.source}: frames of {stack.shape} have fewer than {FEWEST_PIXELS} pixels; pass more."
        )
    stack.require_one_filter()


def _error_of_the_mean(values: Float64Array) -> float:
    """Of a map: pixels are independent, but where whole rows or columns vary more than that allows, those are."""
    square = float(values.var(ddof=1)) / values.size
    largest = square
    for lines in (values.mean(axis=1), values.mean(axis=0)):
        if len(lines) > 7 and square:
            between = float(lines.var(ddof=1)) / len(lines)
            if between > square * _limit(len(lines) - 1, LINES_FALSE_ALARM):
                largest = max(largest, between)
    return math.sqrt(largest)


def _limit(freedom: float, false_alarm: float) -> float:
    """What an estimate with so many degrees of freedom exceeds in this share of the cases, over the true variance."""
    return float(scipy.special.chdtri(freedom, false_alarm)) / freedom
