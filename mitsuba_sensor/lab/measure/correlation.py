"""Correlation of temporal noise: from frame to frame in the same pixel, and between neighbours in the same frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped, temporal_note
from ..frames.stack import Stack
from ..quantity import Quantity, student_interval
from ..statistics.estimators import standard_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "autocorrelation of temporal noise"


@dataclass(frozen=True, eq=False)
class Correlation:
    """Of the deviations from each pixel's mean over the frames; 0 for noise that is new in every pixel and frame.

    temporal : by lag in frames, from 1 on.  horizontal, vertical : of neighbouring pixels.
    """

    temporal: tuple[Quantity, ...]
    horizontal: Quantity
    vertical: Quantity

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All of them."""
        return *self.temporal, self.horizontal, self.vertical

    def plot(self, ax: Axes) -> None:
        """Temporal correlation against the lag, with the 95 % intervals."""
        lags = range(1, len(self.temporal) + 1)
        values = np.array([one.value for one in self.temporal])
        ends = np.array([(one.low, one.high) for one in self.temporal]).reshape(-1, 2)
        ax.errorbar(
            lags,
            values,
            yerr=np.abs(ends - values[:, None]).T,
            fmt="o",
            ms=4,
            capsize=2,
            label="temporal",
        )
        ax.axhline(0, color="0.4", lw=1)
        ax.set(xlabel="lag [frames]", ylabel="correlation coefficient")


def correlation(stack: Stack, lags: int = 8) -> Correlation:
    """Of 3 frames or more, without what whole frames share.  lags : at most a third of the frames are measured.

    The mean over N frames takes σ²/N off every product, which is given back; noise that is correlated over the length
    of the stack looks constant, so that its correlation is underestimated. Temporal correlations have their intervals
    from the scatter over rows, those of neighbours from the scatter over frames.
    Raises InputError for a mosaic, and for fewer than one lag.
    """
    stack.require_one_filter()
    if lags < 1:
        raise InputError(f"lags is {lags}; it must be at least 1.")
    most = min(lags, max(1, len(stack) // 3))
    clipped = stack.clipping
    note = clipped.note or ("fewer than 3 frames" if len(stack) < 3 else temporal_note(stack))
    by_lag, by_side = (
        _products(stack, most) if len(stack) > 2 and clipped.usable else _nothing(stack, most)
    )
    temporal = (
        _quantity(f"ρ_{i + 1}", f"over {i + 1} frames", values + 1 / len(stack))
        for i, values in enumerate(by_lag)
    )
    grown = len(stack) / max(len(stack) - 1, 1)
    sides = (
        _quantity(f"ρ_{name}", f"of {name} neighbours", by_side[i] * grown)
        for i, name in enumerate(("horizontal", "vertical"))
    )
    marked = (mark_clipped(one, stack).noted(note) for one in temporal)
    return Correlation(tuple(marked), *(mark_clipped(one, stack).noted(note) for one in sides))


def _products(stack: Stack, lags: int) -> tuple[Float64Array, Float64Array]:
    """Mean products over the temporal variance: (lags, H) of each row over lags, (2, N) of neighbours in each frame."""
    drift = (stack.frame_means - stack.frame_means.mean())[:, None, None]
    by_lag, by_side = np.zeros((lags, stack.shape[0])), np.zeros((2, len(stack)))
    power, last = 0.0, None
    for rows in stack.strips():
        rest = stack.frames[:, rows] - stack.mean[rows] - drift
        power += float(np.vdot(rest, rest))
        for lag in range(1, lags + 1):
            by_lag[lag - 1, rows] = np.einsum("nij,nij->i", rest[lag:], rest[:-lag]) / (
                len(stack) - lag
            )
        by_side[0] += np.einsum("nij,nij->n", rest[:, :, 1:], rest[:, :, :-1])
        below = rest if last is None else np.concatenate((last, rest), axis=1)
        by_side[1] += np.einsum("nij,nij->n", below[:, 1:], below[:, :-1])
        last = rest[:, -1:].copy()
    variance = power / (len(stack) - 1) / stack.mean.size
    height, width = stack.shape
    pairs = np.array([[height * (width - 1)], [width * (height - 1)]], float)
    pairs[pairs == 0] = np.nan
    return by_lag / width / variance, by_side / pairs / variance


def _nothing(stack: Stack, lags: int) -> tuple[Float64Array, Float64Array]:
    return np.full((lags, stack.shape[0]), np.nan), np.full((2, len(stack)), np.nan)


def _quantity(symbol: str, name: str, values: Float64Array) -> Quantity:
    """Mean and Student's interval of independent values of the same expectation."""
    name = f"correlation of temporal noise {name}"
    if np.isnan(values).any():
        return Quantity(
            symbol, name, math.nan, math.nan, math.nan, "", SECTION, "nothing to compare with"
        )
    if len(values) == 1:
        note = "one row gives no interval"
        return Quantity(symbol, name, float(values[0]), -1.0, 1.0, "", SECTION, note)
    return Quantity(
        symbol,
        name,
        *student_interval(float(values.mean()), standard_error(values), len(values) - 1),
        "",
        SECTION,
    )
