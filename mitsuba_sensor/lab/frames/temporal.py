"""Temporal mean and variance of a stack, without what all pixels of a frame share: light that drifts between frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from .stack import STRIP_VALUES, Stack

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
    mean_variance : over the pixels [DN²].  frames : N.  drift_dn : standard deviation of the frames' means beyond their noise [DN], 0 where none was found.
    lines_error : standard error of the mean variance that noise of whole rows and columns brings [DN²]: there are few.
    """

    mean: Float64Array
    variance: Float64Array
    mean_variance: float
    frames: int
    drift_dn: float
    lines_error: float

    @property
    def variance_error(self) -> float:
        """Standard error of the mean variance [DN²], from its scatter over pixels and by lines_error."""
        scatter = variance_over_pixels(self.variance, self.mean_variance)
        return math.hypot(math.sqrt(scatter / self.variance.size), self.lines_error)

    @property
    def drift_note(self) -> str:
        """By how much the frames drift, which was removed; nothing where they do not."""
        if not self.drift_dn:
            return ""
        drift = f"{self.drift_dn:.3g} DN"
        level = float(self.mean.mean())
        if level:
            drift += f" ({100 * self.drift_dn / abs(level):.2g} %)"
        return f"frame means drift by {drift}, removed from the variance"


def temporal(stack: Stack) -> Temporal:
    """Statistics over the frames. In each frame the mean of pixels that are equally bright is removed, so that light
    or a black level that drifts is not taken as noise; EMVA 1288 R4 6.6 removes the mean of all pixels, which is the
    same for flat fields, and so does this where drift moves no pixel more than others by what noise hides. Groups of 64
    pixels or more are equally bright: one where the pixels' means differ by noise
    alone, more of them the more they differ, at most 100.

    Raises InputError for a single frame, fewer than 16 pixels, and mosaics.
    """
    _check_stack(stack)
    plain = _statistics(stack, None)
    if plain.drift_dn and _drift_is_seen_in_pixels(stack, plain):
        return _statistics(stack, _group_equally_bright(stack))
    return plain


def _drift_is_seen_in_pixels(stack: Stack, plain: Temporal) -> bool:
    """Whether light that drifts moves pixels of different brightness differently, by what their variance shows.

    The signal is taken as a tenth of the mean or more: black level is the rest.
    """
    level = max(abs(float(plain.mean.mean())), 1e-300)
    moved_dn = 10 * plain.drift_dn / level * float(plain.mean.std())
    freedom = (plain.frames - 1) * plain.mean.size
    return moved_dn**2 > 0.1 * plain.mean_variance * math.sqrt(2 / freedom)


def variance_over_pixels(values: Float64Array, mean: float) -> float:
    """Variance of a map (H, W), whose mean is known, in strips of rows."""
    squares = 0.0
    height = max(1, STRIP_VALUES // values.shape[1])
    for top in range(0, len(values), height):
        rest = values[top : top + height] - mean
        squares += float(np.vdot(rest, rest))
    return squares / (values.size - 1)


def _statistics(stack: Stack, group: NDArray[np.intp] | None) -> Temporal:
    """Statistics over the frames without the mean of each group of pixels in each frame; of all pixels where None."""
    frames, pixels = len(stack), stack.shape[0] * stack.shape[1]
    freedom = frames - 1
    drift = stack.frame_means - stack.frame_means.mean()
    common = np.zeros((frames, 1))
    grown, count = pixels / (pixels - 1), np.array([pixels])
    if group is not None:
        count = np.bincount(group)
        common = _means_of_groups(stack, group, count)
    mean, variance = np.empty(stack.shape), np.empty(stack.shape)
    rows, columns = np.empty((frames, stack.shape[0])), np.zeros((frames, stack.shape[1]))
    per_row = np.full(stack.shape[1], 1 / stack.shape[1])
    for strip in stack.strips():
        block = stack.frames[:, strip].astype(np.float64)
        mean[strip] = block.mean(axis=0)
        block -= mean[strip]
        if group is None:
            block -= drift[:, None, None]
        else:
            place = group.reshape(stack.shape)[strip]
            block -= common[:, place]
        rows[:, strip] = block @ per_row
        columns += block.sum(axis=1)
        np.einsum("nij,nij->ij", block, block, out=variance[strip])
    columns /= stack.shape[0]
    if group is None:
        variance *= grown / freedom
    else:
        variance *= (count / (count - 1))[group].reshape(stack.shape) / freedom
    mean_variance = float(variance.mean())
    alone = mean_variance / pixels
    expected = max(
        alone,
        _variance_by_shared_noise(rows, freedom, alone),
        _variance_by_shared_noise(columns, freedom, alone),
    )
    between_frames = float(stack.frame_means.var(ddof=1))
    drift_dn = 0.0
    if between_frames > max(expected * _limit_of_ratio(freedom, DRIFT_FALSE_ALARM), 0.0):
        drift_dn = math.sqrt(between_frames - expected)
    lines_error = _error_by_lines(rows, columns, freedom, alone)
    return Temporal(mean, variance, mean_variance, frames, drift_dn, lines_error)


def _means_of_groups(
    stack: Stack, group: NDArray[np.intp], count: NDArray[np.intp]
) -> Float64Array:
    """Mean deviation of the pixels of each group from their means, in each frame, (N, groups) [DN]."""
    sums = [np.bincount(group, (frame - stack.mean).ravel()) for frame in stack.frames]
    return np.array(sums) / count


def _group_equally_bright(stack: Stack) -> NDArray[np.intp]:
    """Number of the group of equally bright pixels to which each pixel belongs, (pixels,)."""
    pixels = stack.mean.size
    number = np.arange(pixels) * _count_groups(stack) // pixels
    group = np.empty(pixels, np.intp)
    group[np.argsort(stack.mean, axis=None, kind="stable")] = number
    return group


def _count_groups(stack: Stack) -> int:
    """How many groups there are: each is wide beside the noise of a pixel's mean.

    Otherwise noise would decide which group a row belongs to.
    """
    noise = math.sqrt(float(stack.variance.mean()) / len(stack))
    wide = 1.0
    if noise:
        wide = float(stack.mean.std()) / (WIDTH * noise)
    return max(1, min(int(wide), stack.mean.size // GROUP_PIXELS, MOST_GROUPS))


def _variance_by_shared_noise(lines: Float64Array, freedom: int, alone: float) -> float:
    """Variance of the frames' means by noise that whole rows or columns share, 0 where there is none; (N, lines).

    alone : that by noise of the pixels alone [DN²].
    """
    count = lines.shape[1]
    between = float((lines**2).sum()) / freedom / max(count - 1, 1) / count
    limit = _limit_of_ratio(freedom * max(count - 1, 1), LINES_FALSE_ALARM)
    return between if between > alone * limit else 0.0


def _check_stack(stack: Stack) -> None:
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame has no temporal variance; pass 2 or more frames of each level."
        )
    if stack.shape[0] * stack.shape[1] < FEWEST_PIXELS:
        raise InputError(
            f"{stack.source}: frames of {stack.shape} have fewer than {FEWEST_PIXELS} pixels; pass more."
        )
    stack.require_one_filter()


def _error_by_lines(
    rows: Float64Array, columns: Float64Array, freedom: int, alone: float
) -> float:
    """Standard error of the mean variance by what rows and columns share in each frame, (N, lines) [DN²].

    The variance of such noise has as many degrees of freedom as there are lines in all frames, less those of means.
    alone : variance of the frames' means by noise of the pixels alone [DN²].
    """
    square = 0.0
    for lines in (rows, columns):
        free = freedom * (lines.shape[1] - 1)
        if free > 0:
            between = float((lines**2).sum()) / free
            of_pixels = alone * lines.shape[1]
            square += 2 * max(between - of_pixels, 0.0) ** 2 / free
    return math.sqrt(square)


def _limit_of_ratio(freedom: float, false_alarm: float) -> float:
    """Ratio of an estimated to the true variance that is exceeded in this share of the cases."""
    return float(scipy.special.chdtri(freedom, false_alarm)) / freedom
