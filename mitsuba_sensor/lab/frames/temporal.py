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
from ..statistics.mean_squares import MeanSquares, mean_squares_of
from .stack import Changes, Stack

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
FLICKER_DN_MIN = 1e-3  # below it are roundings of means, of a saturated stack for example


class Maps(NamedTuple):
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

    mean : of all values [DN].  of_means : variance over the pixels of their means [DN²].  frames : N.
    squares : mean squares of what changes from frame to frame, without what the pixels of a frame share.
    drift_dn : standard deviation of the frames' means beyond their noise [DN], 0 where none was found.
    """

    mean: float
    of_means: float
    frames: int
    squares: MeanSquares
    drift_dn: float

    @property
    def pixels(self) -> int:
        """Their number."""
        return self.squares.shape[0] * self.squares.shape[1]

    @property
    def variance(self) -> float:
        """Mean over the pixels of their variance over the frames, unbiased [DN²]."""
        return sum(term.value for term in self.squares.terms())

    @property
    def variance_error(self) -> float:
        """Standard error of the variance [DN²]: of the pixels, and of what whole rows and columns share."""
        return math.sqrt(sum(2 * term.value**2 / term.freedom for term in self.squares.terms()))

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
    if shared * math.sqrt(pairs) <= FLICKER_SIGMAS * variance or shared < FLICKER_DN_MIN**2:
        return 0.0
    return math.sqrt(shared)


def neighbour_correlation(stack: Stack) -> float:
    """Correlation of the temporal noise of horizontal neighbours, without what rows, columns and frames share."""
    some = stack.centre(CORRELATED)
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
    number = np.broadcast_to(np.arange(stack.shape[0])[:, None], stack.shape)
    common = stack.row_means - stack.row_means.mean(axis=0)
    groups = _Groups.of(number, common)
    return _found(stack, stack.changes_without(groups.common_to), 0.0)


def temporal(stack: Stack, maps: Maps | None = None) -> Temporal:
    """Statistics over the frames; those of each pixel are written into maps where some are given.

    In each frame the mean of pixels that are equally bright is removed, so that light or a black level that drifts is
    not taken as noise; EMVA 1288 R4 6.6 removes the mean of all pixels, which is the same for flat fields. Groups of 64
    pixels or so are equally bright: one where the pixels' means differ by noise alone, more of them the more they
    differ, at most 100.

    Raises InputError for a single frame, fewer than 16 pixels, and mosaics.
    """
    _check_stack(stack)
    plain = _found(stack, stack.changes, 0.0)
    between = float(stack.frame_means.var(ddof=1))
    expected, freedom = plain.squares.variance_of_mean(), len(stack) - 1
    drift_dn = 0.0
    if between > expected * float(scipy.special.chdtri(freedom, DRIFT_FALSE_ALARM)) / freedom:
        drift_dn = math.sqrt(between - expected)
    count = _count_groups(plain)
    if drift_dn and count > 1:
        groups = _group_equally_bright(stack, count)
    elif maps is None:
        return _found(stack, stack.changes, drift_dn)
    else:
        drift = stack.frame_means - stack.frame_means.mean()
        groups = _Groups.of(np.zeros(stack.shape, np.intp), drift[:, None])
    return _found(stack, stack.changes_without(groups.common_to, maps), drift_dn)


def _found(stack: Stack, changes: Changes, drift_dn: float) -> Temporal:
    squares = mean_squares_of(changes, stack.shape)
    return Temporal(changes.mean, changes.of_means, len(stack), squares, drift_dn)


class _Groups(NamedTuple):
    """number : of the group of each pixel, (H, W).  common : mean deviation of its pixels from their means in each
    frame, (N, groups) [DN].  grown : by how much that makes their variance too small, (groups,)."""

    number: NDArray[np.intp]
    common: Float64Array
    grown: Float64Array

    @classmethod
    def of(cls, number: NDArray[np.intp], common: Float64Array) -> Self:
        """Groups of two pixels or more."""
        sizes = np.bincount(number.ravel(), minlength=common.shape[1])
        return cls(number, common, sizes / np.maximum(sizes - 1, 1))

    def common_to(self, rows: slice) -> tuple[Float64Array, Float64Array]:
        """What the pixels of some rows have in common with their groups, and by how much that makes variances small."""
        number = self.number[rows]
        return self.common[:, number], self.grown[number]


def _group_equally_bright(stack: Stack, count: int) -> _Groups:
    """Groups of pixels whose means are about equal: about as many pixels are in each."""
    mean = stack.frames.mean(axis=0, dtype=np.float64)
    some = mean.ravel()[:: max(1, mean.size // MOST_SORTED)]
    edges = np.unique(np.quantile(some, np.arange(1, count) / count))
    number = np.searchsorted(edges, mean, side="right")
    sizes = np.maximum(np.bincount(number.ravel(), minlength=len(edges) + 1), 1)
    sums = [
        np.bincount(number.ravel(), (frame - mean).ravel(), len(sizes))
        for frame in stack.frames
    ]
    return _Groups.of(number, np.array(sums) / sizes)


def _count_groups(plain: Temporal) -> int:
    """How many groups there are: each is wide beside the noise of a pixel's mean.

    Otherwise noise would decide which group a row belongs to.
    """
    noise = math.sqrt(plain.variance / plain.frames) or 1e-300
    wide = math.sqrt(plain.of_means) / (WIDTH * noise)
    return int(max(1, min(wide, plain.pixels // GROUP_PIXELS, MOST_GROUPS)))


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
