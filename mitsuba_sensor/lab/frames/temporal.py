"""Temporal mean and variance of a stack, without what all pixels of a frame share: light that drifts between frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from .stack import Stack, centre

FEWEST_PIXELS = 16
GROUP_PIXELS, MOST_GROUPS, WIDTH = 64, 100, 3.0
MOST_SORTED = 2**16
"""Pixels whose means are sorted to find where groups of equally bright ones end."""
CORRELATED = 256
"""Rows and columns of the centre in which the noise of neighbours is compared."""
DRIFT_FALSE_ALARM = 1e-4
"""Share of the stacks without drift in which drift is reported."""
FLICKER_SIGMAS, FLICKER_ROWS = 3.72, 4
"""A normal number is larger by chance in 1e-4 of the stacks; crosstalk and coupling do not reach so many rows."""
LINES_FALSE_ALARM = 1e-3
"""Share of the stacks with independent pixels in which rows or columns are taken as what fluctuates together."""


@dataclass(frozen=True, eq=False)
class Maps:
    """Mean [DN] and unbiased variance [DN²] of each pixel over the frames, (H, W), to be filled by :func:`temporal`."""

    mean: Float64Array
    variance: Float64Array

    @classmethod
    def empty(cls, stack: Stack) -> Self:
        """Maps of the size of a stack."""
        return cls(np.empty(stack.shape), np.empty(stack.shape))


@dataclass(frozen=True)
class Temporal:
    """Each pixel over the frames of a stack, and each frame over its pixels.

    mean : of all values [DN].  variance : mean over the pixels of their variance over the frames [DN²], unbiased,
    without the fluctuation that the pixels of a frame share.  frames : N.
    of_means, of_variances : variances over the pixels of their means [DN²] and of their variances [DN⁴].
    pixels : their number.  drift_dn : standard deviation of the frames' means beyond their noise [DN], 0 where none was
    found.  lines_error : standard error of the variance that noise of whole rows and columns brings [DN²]: there are
    few.
    """

    mean: float
    variance: float
    of_means: float
    of_variances: float
    frames: int
    pixels: int
    drift_dn: float
    lines_error: float

    @property
    def variance_error(self) -> float:
        """Standard error of the variance [DN²], from its scatter over pixels and by lines_error."""
        return math.hypot(math.sqrt(self.of_variances / self.pixels), self.lines_error)

    @property
    def spread_dn(self) -> float:
        """Standard deviation of the pixels' means without what averaging leaves of temporal noise [DN]."""
        return math.sqrt(max(self.of_means - self.variance / self.frames, 0.0))

    @property
    def drift_note(self) -> str:
        """By how much the frames drift, which was removed; nothing where they do not."""
        if not self.drift_dn:
            return ""
        drift = f"{self.drift_dn:.3g} DN"
        if self.mean:
            drift += f" ({100 * self.drift_dn / abs(self.mean):.2g} %)"
        return f"frame means drift by {drift}, removed from the variance"


def flicker_dn(stack: Stack) -> float:
    """Standard deviation of what rows share with others 4 rows away from frame to frame [DN], 0 if chance explains it.

    So does light that flickers before a rolling shutter, with a period above 24 rows; row noise differs in each row.
    """
    frames, (count, _) = len(stack), stack.shape
    pairs = (frames - 1) * (count - FLICKER_ROWS)
    if pairs < 32:  # too few for the normal law
        return 0.0
    rows = stack.row_means - stack.row_means.mean(axis=0)
    rows = rows - rows.mean(axis=1, keepdims=True)
    profile = stack.row_means.mean(axis=0) - stack.row_means.mean()
    rows = rows - np.outer(rows @ profile, profile) / max(profile @ profile, 1e-300)  # drift
    shared = float(np.sum(rows[:, :-FLICKER_ROWS] * rows[:, FLICKER_ROWS:])) / pairs
    variance = float(np.sum(rows**2)) / (frames - 1) / count
    return math.sqrt(shared) if shared * math.sqrt(pairs) > FLICKER_SIGMAS * variance else 0.0


def neighbour_correlation(stack: Stack) -> float:
    """Correlation of the temporal noise of horizontal neighbours, without what rows, columns and frames share."""
    some = centre(stack, CORRELATED)
    rest = some.frames[1].astype(np.float64) - some.frames[0]
    rest -= rest.mean(axis=1, keepdims=True)
    rest -= rest.mean(axis=0, keepdims=True)
    return float((rest[:, 1:] * rest[:, :-1]).mean() / max(np.square(rest).mean(), 1e-300))


def flicker_note(stack: Stack, removed: str) -> str:
    """By how much rows fluctuate together, or nothing.  removed : what this means for the figures."""
    shared_dn = flicker_dn(stack)
    if not shared_dn:
        return ""
    return (
        f"neighbouring rows fluctuate together by {shared_dn:.3g} DN from frame to frame, as under light that flickers "
        f"before a rolling shutter: {removed}; use light without flicker or a global shutter"
    )


def temporal_within_rows(stack: Stack) -> Temporal:
    """Statistics over the frames, without the mean of each row in each frame. Raises InputError as temporal does."""
    _check_stack(stack)
    height, width = stack.shape
    number = np.broadcast_to(np.arange(height)[:, None], stack.shape)
    common = stack.row_means - stack.row_means.mean(axis=0)
    return _statistics(
        stack, _Groups(number, common, np.full(height, width / (width - 1))), None
    )


def temporal(stack: Stack, maps: Maps | None = None) -> Temporal:
    """Statistics over the frames; those of each pixel are written into maps where some are given.

    In each frame the mean of pixels that are equally bright is removed, so that light or a black level that drifts is
    not taken as noise; EMVA 1288 R4 6.6 removes the mean of all pixels, which is the same for flat fields, and so does
    this where drift moves no pixel more than others by what noise hides. Groups of 64 pixels or so are equally bright:
    one where the pixels' means differ by noise alone, more of them the more they differ, at most 100.

    Raises InputError for a single frame, fewer than 16 pixels, and mosaics.
    """
    _check_stack(stack)
    plain = _statistics(stack, None, maps)
    if plain.drift_dn and _drift_is_seen_in_pixels(plain):
        return _statistics(stack, _group_equally_bright(stack, plain), maps)
    return plain


def _drift_is_seen_in_pixels(plain: Temporal) -> bool:
    """Whether light that drifts moves pixels of different brightness differently, by what their variance shows.

    The signal is taken as a tenth of the mean or more: black level is the rest.
    """
    level = max(abs(plain.mean), 1e-300)
    moved_dn = 10 * plain.drift_dn / level * math.sqrt(plain.of_means)
    freedom = (plain.frames - 1) * plain.pixels
    return moved_dn**2 > 0.1 * plain.variance * math.sqrt(2 / freedom)


def _statistics(stack: Stack, groups: _Groups | None, maps: Maps | None) -> Temporal:
    """Statistics over the frames without the mean of each group of pixels in each frame; of all pixels where None."""
    frames, pixels = len(stack), stack.shape[0] * stack.shape[1]
    freedom = frames - 1
    drift = stack.frame_means - stack.frame_means.mean()
    rows, columns = np.empty((frames, stack.shape[0])), np.zeros((frames, stack.shape[1]))
    per_row = np.full(stack.shape[1], 1 / stack.shape[1])
    of_means, of_variances = RunningVariance(), RunningVariance()
    for strip in stack.strips():
        block = np.asarray(stack.frames[:, strip], np.float64, copy=True)
        mean = block.mean(axis=0)
        block -= mean
        unbiased: float | Float64Array = pixels / (pixels - 1) / freedom
        if groups is None:
            block -= drift[:, None, None]
        else:
            number = groups.number[strip]
            block -= groups.common[:, number]
            unbiased = groups.grown[number] / freedom
        rows[:, strip] = block @ per_row
        columns += block.sum(axis=1)
        variance = np.einsum("nij,nij->ij", block, block)
        variance *= unbiased
        of_means.add(mean)
        of_variances.add(variance)
        if maps is not None:
            maps.mean[strip], maps.variance[strip] = mean, variance
    columns /= stack.shape[0]
    alone = of_variances.mean / pixels
    return Temporal(
        mean=of_means.mean,
        variance=of_variances.mean,
        of_means=of_means.variance,
        of_variances=of_variances.variance,
        frames=frames,
        pixels=pixels,
        drift_dn=_drift_dn(stack, rows, columns, alone),
        lines_error=_error_by_lines(rows, columns, freedom, alone),
    )


@dataclass
class RunningVariance:
    """Mean and variance of values that come in parts (Chan, Golub and LeVeque 1983)."""

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def add(self, values: Float64Array) -> None:
        """Some more values."""
        mean = float(values.mean())
        rest = values - mean
        count = self.count + values.size
        step = mean - self.mean
        self.squares += float(np.vdot(rest, rest)) + step**2 * self.count * values.size / count
        self.mean += step * values.size / count
        self.count = count

    @property
    def variance(self) -> float:
        """Unbiased variance of all values."""
        return self.squares / max(self.count - 1, 1)


def _drift_dn(stack: Stack, rows: Float64Array, columns: Float64Array, alone: float) -> float:
    """Standard deviation of the frames' means beyond their noise [DN], 0 where chance explains it.

    rows, columns : deviations of lines from their means, (N, lines) [DN].  alone : variance of the frames' means by
    noise of the pixels alone [DN²].
    """
    freedom = len(stack) - 1
    expected = max(
        alone,
        _variance_by_shared_noise(rows, freedom, alone),
        _variance_by_shared_noise(columns, freedom, alone),
    )
    between_frames = float(stack.frame_means.var(ddof=1))
    if between_frames > max(expected * _limit_of_ratio(freedom, DRIFT_FALSE_ALARM), 0.0):
        return math.sqrt(between_frames - expected)
    return 0.0


class _Groups(NamedTuple):
    """number : of the group of each pixel, (H, W).  common : mean deviation of its pixels from their means in each
    frame, (N, groups) [DN].  grown : by how much that makes their variance too small, (groups,)."""

    number: NDArray[np.intp]
    common: Float64Array
    grown: Float64Array


def _group_equally_bright(stack: Stack, plain: Temporal) -> _Groups:
    """Groups of pixels whose means are about equal: about as many pixels are in each."""
    mean = stack.frames.mean(axis=0, dtype=np.float64)
    some = np.sort(mean.ravel()[:: max(1, mean.size // MOST_SORTED)])
    count = _count_groups(plain)
    edges = np.unique(some[np.arange(1, count) * some.size // count])
    number = np.searchsorted(edges, mean, side="right")
    sizes = np.bincount(number.ravel(), minlength=len(edges) + 1)
    sums = [
        np.bincount(number.ravel(), (frame - mean).ravel(), len(sizes))
        for frame in stack.frames
    ]
    common = np.array(sums) / np.maximum(sizes, 1)
    return _Groups(number, common, sizes / np.maximum(sizes - 1, 1))


def _count_groups(plain: Temporal) -> int:
    """How many groups there are: each is wide beside the noise of a pixel's mean.

    Otherwise noise would decide which group a row belongs to.
    """
    noise = math.sqrt(plain.variance / plain.frames)
    wide = 1.0
    if noise:
        wide = math.sqrt(plain.of_means) / (WIDTH * noise)
    return max(1, min(int(wide), plain.pixels // GROUP_PIXELS, MOST_GROUPS))


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
