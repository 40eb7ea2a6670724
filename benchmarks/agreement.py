"""Compare the means and the temporal variances of two stacks of frames, in standard errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

LIMIT = 5.0
"""Standard errors; exceeded by chance once in 1.7 million comparisons."""

BANDS = 8
"""Bands of columns, each compared separately: with a ramp these are different signal levels."""


@dataclass(frozen=True)
class Agreement:
    """The largest difference of any band, in standard errors of the difference.

    mean_z : difference of the means.  variance_z : difference of the temporal variances.
    mean_difference_dn, sigma_ratio : for whole frames, for information.
    """

    mean_z: float
    variance_z: float
    mean_difference_dn: float
    sigma_ratio: float

    def __bool__(self) -> bool:
        return self.mean_z < LIMIT and self.variance_z < LIMIT

    def as_json(self) -> dict[str, Any]:
        """The numbers, and whether the stacks agree."""
        return asdict(self) | {"agrees": bool(self)}


def stack(stream: Iterator[NDArray[Any]], frames: int) -> NDArray[Any]:
    """The next ``frames`` frames, (N, H, W)."""
    return np.stack(list(islice(stream, frames)))


def agreement(one: NDArray[Any], other: NDArray[Any]) -> Agreement:
    """Compare two stacks (N, H, W) [DN] of independent noise and equal fixed patterns."""
    bands = [_distance(*pair) for pair in zip(_bands(one), _bands(other), strict=True)]
    (mean_one, variance_one), (mean_other, variance_other) = (
        (frames.mean(), frames.var(axis=0, ddof=1).mean()) for frames in (one, other)
    )
    return Agreement(
        mean_z=max(mean for mean, _ in bands),
        variance_z=max(variance for _, variance in bands),
        mean_difference_dn=float(mean_one - mean_other),
        sigma_ratio=float(np.sqrt(variance_one / variance_other)),
    )


def _bands(frames: NDArray[Any]) -> list[NDArray[Any]]:
    return np.array_split(frames, min(BANDS, frames.shape[2]), axis=2)


def _distance(one: NDArray[Any], other: NDArray[Any]) -> tuple[float, float]:
    """Differences of the means and of the temporal variances of one band, in standard errors."""
    frames, pixels = len(one), one[0].size
    variances = [x.var(axis=0, ddof=1) for x in (one, other)]
    mean_error = np.sqrt(sum(v.mean() for v in variances) / (frames * pixels))
    variance_error = np.sqrt(sum(v.var() for v in variances) / pixels)
    return (
        _standard_errors(one.mean() - other.mean(), mean_error),
        _standard_errors(variances[0].mean() - variances[1].mean(), variance_error),
    )


def _standard_errors(difference: float, error: float) -> float:
    """0 if both are the same constant, as in a saturated band."""
    return (
        float(abs(difference) / error) if error else (0.0 if difference == 0 else float("inf"))
    )
