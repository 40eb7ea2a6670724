"""Correlation of temporal noise between frames of the same pixel, and between neighbours in the same frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped, mark_coarse
from ..frames.stack import Stack
from ..quantity import Figures, Quantity, no_value, student_interval
from ..statistics.estimators import standard_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "autocorrelation of temporal noise"


@dataclass(frozen=True, eq=False)
class Correlation(Figures):
    """Correlation coefficients of the deviations from the temporal mean; 0 for independent noise.

    temporal : by lag in frames, from 1 on.  horizontal, vertical : of neighbouring pixels.
    """

    temporal: tuple[Quantity, ...]
    horizontal: Quantity
    vertical: Quantity

    def plot(self, ax: Axes) -> None:
        """Plot temporal correlation versus lag, with 95 % intervals."""
        ends = np.array([(x.value, x.low, x.high) for x in self.temporal])
        values, bars = ends[:, 0], np.abs(ends[:, 1:] - ends[:, :1]).T
        lags = range(1, len(values) + 1)
        ax.errorbar(lags, values, yerr=bars, fmt="o", ms=4, capsize=2, label="temporal")
        ax.axhline(0, color="0.4", lw=1)
        ax.set(xlabel="lag [frames]", ylabel="correlation coefficient")


def correlation(stack: Stack, lags: int = 8) -> Correlation:
    """Measure correlation in at least 3 frames, without fluctuations of whole frames.

    lags : largest lag, at most a third of the frames.

    The bias −σ²/N of the mean over N frames is corrected. Noise that is correlated over the whole stack looks constant,
    so its correlation is underestimated. Intervals come from the scatter over rows for temporal correlations, and over
    frames for neighbours.
    Raises InputError for a mosaic, and for fewer than one lag.
    """
    stack.require_one_filter()
    if lags < 1:
        raise InputError(f"lags is {lags}; it must be at least 1.")
    frames, clipping = len(stack), stack.clipping
    most = min(lags, max(1, frames // 3))
    by_lag = np.full((most, stack.shape[0]), np.nan)
    by_side = np.full((2, frames), np.nan)
    if frames > 2 and clipping.usable:
        by_lag, by_side = _mean_products(stack, most)
    note = clipping.note or ("fewer than 3 frames" if frames < 3 else "")

    def coefficient(end: str, what: str, values: Float64Array) -> Quantity:
        name = f"correlation of temporal noise {what}"
        figure = no_value(f"ρ_{end}", name, "", SECTION)
        mean = float(values.mean())
        if math.isnan(mean):
            figure = figure.noted("there is nothing to compare with")
        elif len(values) == 1:
            figure = figure.with_interval((mean, -1.0, 1.0)).noted("one row gives no interval")
        else:
            error = standard_error(values)
            figure = figure.with_interval(student_interval(mean, error, len(values) - 1))
        return mark_coarse(mark_clipped(figure, stack), stack).noted(note)

    grown = frames / max(frames - 1, 1)
    return Correlation(
        tuple(
            coefficient(f"{lag}", f"over {lag} frames", values + 1 / frames)
            for lag, values in enumerate(by_lag, start=1)
        ),
        coefficient("horizontal", "of horizontal neighbours", by_side[0] * grown),
        coefficient("vertical", "of vertical neighbours", by_side[1] * grown),
    )


def _mean_products(stack: Stack, lags: int) -> tuple[Float64Array, Float64Array]:
    """Return mean products over the temporal variance: rows by lag (lags, H), neighbours by frame (2, N).

    They are NaN if all frames are equal.
    """
    frames = len(stack)
    drift = (stack.frame_means - stack.frame_means.mean())[:, None, None]
    by_lag, by_side = np.zeros((lags, stack.shape[0])), np.zeros((2, frames))
    power, last_row = 0.0, None
    for rows in stack.strips():
        rest = stack.frames[:, rows] - stack.mean[rows] - drift
        power += float(np.vdot(rest, rest))
        for lag in range(1, lags + 1):
            products = np.einsum("nij,nij->i", rest[lag:], rest[:-lag])
            by_lag[lag - 1, rows] = products / (frames - lag)
        by_side[0] += np.einsum("nij,nij->n", rest[:, :, 1:], rest[:, :, :-1])
        below = rest
        if last_row is not None:
            below = np.concatenate((last_row, rest), axis=1)
        by_side[1] += np.einsum("nij,nij->n", below[:, 1:], below[:, :-1])
        last_row = rest[:, -1:].copy()
    if not power:
        return np.full_like(by_lag, np.nan), np.full_like(by_side, np.nan)
    variance = power / (frames - 1) / stack.mean.size
    height, width = stack.shape
    pairs = np.array([[height * (width - 1)], [width * (height - 1)]], float)
    pairs[pairs == 0] = np.nan
    return by_lag / width / variance, by_side / pairs / variance
