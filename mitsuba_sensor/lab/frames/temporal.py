"""Temporal mean and variance of a stack, corrected for light that drifts between frames."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..statistics.mean_squares import MeanSquares, mean_squares_of
from .stack import Changes, Stack

PIXELS_MIN = 16
GROUP_PIXELS, GROUPS_MAX = 64, 100
GROUP_SIGMAS = 3.0
"""Width of a group of equally bright pixels [standard errors of a pixel's mean]."""
SORTED_MAX = 2**16
"""Number of pixel means that are sorted to find the limits of the groups."""
CORRELATION_SIDE = 256
"""Central rows and columns in which the noise of neighbours is compared."""
DRIFT_FALSE_ALARM = 1e-4
"""Fraction of stacks without drift for which drift is reported."""
FLICKER_SIGMAS, FLICKER_ROWS = 3.72, 4
"""A normal number exceeds this limit in 1e-4 of the stacks; crosstalk and coupling reach fewer rows."""
FLICKER_DN_MIN = 1e-3  # smaller values are rounding errors of means, e.g. of a saturated stack


class Maps(NamedTuple):
    """Temporal mean [DN] and unbiased variance [DN²] of each pixel, shape (H, W), filled by :func:`temporal`."""

    mean: Float64Array
    variance: Float64Array

    @classmethod
    def empty(cls, stack: Stack) -> Self:
        """Return maps of the size of a stack."""
        return cls(np.empty(stack.shape), np.empty(stack.shape))


@dataclass(frozen=True)
class Temporal:
    """Temporal statistics of a stack.

    mean : mean of all values [DN].  of_means : variance of the pixel means over the pixels [DN²].  frames : N.
    squares : temporal mean squares, without what the pixels of a frame share.
    drift_dn : standard deviation of the frame means in excess of their noise [DN]; 0 if none was found.
    """

    mean: float
    of_means: float
    frames: int
    squares: MeanSquares
    drift_dn: float

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.squares.shape[0] * self.squares.shape[1]

    @property
    def variance(self) -> float:
        """Unbiased temporal variance, averaged over the pixels [DN²]."""
        return sum(term.value for term in self.squares.terms())

    @property
    def variance_error(self) -> float:
        """Standard error of the variance [DN²] from pixel, row and column noise."""
        return math.sqrt(sum(2 * term.value**2 / term.freedom for term in self.squares.terms()))

    @property
    def spread_dn(self) -> float:
        """Standard deviation of the pixel means without the temporal noise that averaging leaves [DN]."""
        return math.sqrt(max(self.of_means - self.variance / self.frames, 0.0))

    @property
    def drift_note(self) -> str:
        """Size of the drift that was removed, or an empty text."""
        if not self.drift_dn:
            return ""
        drift = f"{self.drift_dn:.3g} DN"
        if self.mean:
            drift += f" ({100 * self.drift_dn / abs(self.mean):.2g} %)"
        return f"frame means drift by {drift}, removed from the variance"


def flicker_dn(stack: Stack) -> float:
    """Return the standard deviation of the fluctuation that rows 4 apart share [DN]; 0 if noise explains it.

    Light that flickers in front of a rolling shutter, with a period above 24 rows, causes it; row noise does not.
    """
    frames, (count, _) = len(stack), stack.shape
    pairs = (frames - 1) * (count - FLICKER_ROWS)
    if pairs < 32:  # too few for a normal distribution
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
    """Return the correlation of the temporal noise of horizontal neighbours, without row, column and frame noise."""
    centre = stack.centre(CORRELATION_SIDE)
    rest = centre.frames[1].astype(np.float64) - centre.frames[0]
    rest -= rest.mean(axis=1, keepdims=True)
    rest -= rest.mean(axis=0, keepdims=True)
    return float((rest[:, 1:] * rest[:, :-1]).mean() / max(np.square(rest).mean(), 1e-300))


def flicker_note(shared_dn: float, consequence: str) -> str:
    """Return a note on rows that fluctuate together by this much [DN], or an empty text for 0."""
    if not shared_dn:
        return ""
    return (
        f"neighbouring rows fluctuate together by {shared_dn:.3g} DN, like flickering light in front of a rolling "
        f"shutter: {consequence}; use light without flicker or a global shutter"
    )


def temporal_within_rows(stack: Stack) -> Temporal:
    """Return temporal statistics without the mean of each row of each frame. Raises InputError as temporal does."""
    _check_stack(stack)
    number = np.broadcast_to(np.arange(stack.shape[0])[:, None], stack.shape)
    common = stack.row_means - stack.row_means.mean(axis=0)
    groups = _Groups.of(number, common)
    return _statistics(stack, stack.changes_without(groups.common_to), 0.0)


def temporal(stack: Stack, maps: Maps | None = None) -> Temporal:
    """Return temporal statistics, and write the statistics of each pixel into ``maps``.

    The mean of equally bright pixels is removed from each frame, so drifting light or black level is not taken for
    noise. EMVA 1288 R4 6.6 removes the mean of all pixels, which is the same for flat fields. There is one group if the
    pixel means differ only by noise; otherwise up to 100 groups of at least 64 pixels.

    Raises InputError for a single frame, fewer than 16 pixels, and mosaics.
    """
    _check_stack(stack)
    plain = _statistics(stack, stack.changes, 0.0)
    between = float(stack.frame_means.var(ddof=1))
    expected, freedom = plain.squares.variance_of_mean(), len(stack) - 1
    drift_dn = 0.0
    if between > expected * float(scipy.special.chdtri(freedom, DRIFT_FALSE_ALARM)) / freedom:
        drift_dn = math.sqrt(between - expected)
    count = _count_groups(plain)
    if drift_dn and count > 1:
        groups = _group_equally_bright(stack, count)
    elif maps is None:
        return replace(plain, drift_dn=drift_dn)
    else:
        drift = stack.frame_means - stack.frame_means.mean()
        groups = _Groups.of(np.zeros(stack.shape, np.intp), drift[:, None])
    return _statistics(stack, stack.changes_without(groups.common_to, maps), drift_dn)


def _statistics(stack: Stack, changes: Changes, drift_dn: float) -> Temporal:
    squares = mean_squares_of(changes, stack.shape)
    return Temporal(changes.mean, changes.of_means, len(stack), squares, drift_dn)


class _Groups(NamedTuple):
    """Groups of equally bright pixels.

    number : group of each pixel, shape (H, W).  common : mean deviation of a group in each frame, shape (N, groups)
    [DN].  grown : factor that corrects the variances for its removal, shape (groups,).
    """

    number: NDArray[np.intp]
    common: Float64Array
    grown: Float64Array

    @classmethod
    def of(cls, number: NDArray[np.intp], common: Float64Array) -> Self:
        """Return the groups with their correction; a group has at least two pixels."""
        sizes = np.bincount(number.ravel(), minlength=common.shape[1])
        return cls(number, common, sizes / np.maximum(sizes - 1, 1))

    def common_to(self, rows: slice) -> tuple[Float64Array, Float64Array]:
        """Return the deviations to subtract from some rows and the correction of their variances."""
        number = self.number[rows]
        return self.common[:, number], self.grown[number]


def _group_equally_bright(stack: Stack, count: int) -> _Groups:
    """Return groups of pixels with about equal means, of about equal size."""
    mean = stack.frames.mean(axis=0, dtype=np.float64)
    sample = mean.ravel()[:: max(1, mean.size // SORTED_MAX)]
    edges = np.unique(np.quantile(sample, np.arange(1, count) / count))
    number = np.searchsorted(edges, mean, side="right")
    sizes = np.maximum(np.bincount(number.ravel(), minlength=len(edges) + 1), 1)
    sums = [
        np.bincount(number.ravel(), (frame - mean).ravel(), len(sizes))
        for frame in stack.frames
    ]
    return _Groups.of(number, np.array(sums) / sizes)


def _count_groups(plain: Temporal) -> int:
    """Return the number of groups, each wider than the noise of a pixel's mean; else noise would assign the pixels."""
    noise = math.sqrt(plain.variance / plain.frames) or 1e-300
    wide = math.sqrt(plain.of_means) / (GROUP_SIGMAS * noise)
    return int(max(1, min(wide, plain.pixels // GROUP_PIXELS, GROUPS_MAX)))


def _check_stack(stack: Stack) -> None:
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame shows no temporal variance; pass at least 2 frames of each level."
        )
    if stack.shape[0] * stack.shape[1] < PIXELS_MIN:
        raise InputError(
            f"{stack.source}: frames have {stack.shape[0]} × {stack.shape[1]} pixels; pass at least {PIXELS_MIN}."
        )
    stack.require_one_filter()
