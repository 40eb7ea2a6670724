"""Temporal row and column noise: what the pixels of a line share, new in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_temporal_sigma
from ..frames.stack import ROUNDING_DN2, Stack, rounding_error_dn2
from ..quantity import Quantity, no_value
from ..statistics.mean_squares import MeanSquare, root, temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "analysis of variance over frames"


@dataclass(frozen=True, eq=False)
class LineNoise:
    """Temporal noise of rows, columns and pixels, whose squares add up to a pixel's temporal variance without rounding.

    row, column, pixel : standard deviations [DN].
    rows, columns : standard deviation over the frames of each row's and column's mean, (H,) and (W,) [DN].
    """

    row: Quantity
    column: Quantity
    pixel: Quantity
    rows: Float64Array
    columns: Float64Array

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Row, column and pixel noise."""
        return self.row, self.column, self.pixel

    def plot(self, ax: Axes) -> None:
        """Temporal noise of every line's mean; the smaller the noise of its pixels, the nearer to σ_row and σ_col."""
        ax.plot(self.rows, ".", ms=3, label="rows")
        ax.plot(self.columns, ".", ms=3, label="columns")
        ax.set(
            xlabel="number of the row or column", ylabel="temporal σ of the line's mean [DN]"
        )
        ax.set_ylim(bottom=0)


def line_noise(stack: Stack) -> LineNoise:
    """σ_row and σ_col of a stack of 2 frames or more, of one light.

    What is fixed (each pixel's mean), what whole frames share (drift of light or black level) and what averaging a line
    leaves of its pixels' noise are removed. Raises InputError for a mosaic.
    """
    stack.require_one_filter()
    rows, columns, pixels = _variance_terms(stack)
    pixel = _noise("σ_pixel", "temporal pixel noise", pixels, stack)
    if stack.whole_codes and len(stack) > 1:
        pixel = _without_rounding(pixel, rounding_error_dn2(float(stack.variance.mean())))
    return LineNoise(
        row=_noise("σ_row", "temporal row noise", rows, stack),
        column=_noise("σ_col", "temporal column noise", columns, stack),
        pixel=pixel,
        rows=_deviation_over_frames(stack.row_means),
        columns=_deviation_over_frames(stack.column_means),
    )


def _variance_terms(
    stack: Stack,
) -> tuple[list[MeanSquare], list[MeanSquare], list[MeanSquare]]:
    """Terms of the temporal variances of rows, columns and pixels, which one frame does not have."""
    if len(stack) == 1:
        return [], [], []
    squares = temporal_mean_squares(stack)
    return squares.row_variance(), squares.column_variance(), squares.pixel_variance()


def _noise(symbol: str, name: str, terms: list[MeanSquare], stack: Stack) -> Quantity:
    """The root of a variance with its interval [DN], and what restricts it."""
    noise = no_value(symbol, name, "DN", SECTION)
    if terms:
        value, low, high = root(terms)
        noise = replace(noise, value=value, low=low, high=high)
    noise = mark_temporal_sigma(noise, stack)
    if not terms and len(stack) > 1:
        noise = noise.noted(
            "a single line of pixels: rows, columns and pixels are not told apart"
        )
    if noise.low == 0:
        noise = noise.noted("not told from 0")
    return noise


def _without_rounding(sigma: Quantity, error_dn2: float) -> Quantity:
    """A standard deviation [DN] without what rounding adds to its square, 1/12 DN² give or take an error."""
    if math.isnan(sigma.value):
        return sigma
    removed_dn2 = ROUNDING_DN2 + np.array([0.0, error_dn2, -error_dn2])
    variances = np.square([sigma.value, sigma.low, sigma.high]) - removed_dn2
    value, low, high = np.sqrt(np.maximum(variances, 0.0)).tolist()
    return replace(sigma, value=value, low=low, high=high)


def _deviation_over_frames(means: Float64Array) -> Float64Array:
    """Standard deviation over the frames of each line's mean, (N, lines) → (lines,) [DN]; NaN for one frame."""
    if len(means) == 1:
        return np.full(means.shape[1], np.nan)
    return np.asarray(means.std(axis=0, ddof=1))
