"""Temporal row and column noise: the noise that the pixels of a line share in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import Pattern, mark_clipped_sigma, mark_coarse, mark_rounding
from ..frames.stack import ROUNDING_DN2, Stack, rounding_error_dn2
from ..quantity import Figures, Quantity, no_value
from ..statistics.mean_squares import root, temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "analysis of variance over frames"


@dataclass(frozen=True, eq=False)
class LineNoise(Figures):
    """Temporal noise of rows, columns and pixels; their squares add up to the variance of a pixel without rounding.

    row, column, pixel : standard deviations [DN].
    rows, columns : temporal standard deviation of the mean of each row (H,) and column (W,) [DN].
    """

    row: Quantity
    column: Quantity
    pixel: Quantity
    rows: Float64Array
    columns: Float64Array

    def plot(self, ax: Axes) -> None:
        """Plot the temporal noise of each line mean, which includes averaged pixel noise."""
        ax.plot(self.rows, ".", ms=3, label="rows")
        ax.plot(self.columns, ".", ms=3, label="columns")
        ax.set(xlabel="row or column number", ylabel="temporal σ of the line mean [DN]")
        ax.set_ylim(bottom=0)


def line_noise(stack: Stack) -> LineNoise:
    """Measure σ_row, σ_col and σ_pixel of at least 2 frames of one exposure level.

    Fixed patterns, fluctuations of whole frames and the averaged pixel noise of line means are removed.
    Raises InputError for a mosaic.
    """
    stack.require_one_filter()
    squares = temporal_mean_squares(stack) if len(stack) > 1 else None

    def noise(part: str, name: str) -> Quantity:
        terms = [] if squares is None else squares.terms(part)
        sigma = no_value(f"σ_{part}", f"temporal {name} noise", "DN", SECTION)
        if terms:
            sigma = sigma.with_interval(root(terms))
        elif squares is not None:
            sigma = sigma.noted("rows, columns and pixels of a single line cannot be separated")
        sigma = mark_coarse(mark_clipped_sigma(sigma, stack), stack)
        sigma = mark_rounding(sigma, Pattern(stack, sigma))
        return sigma.noted("may be 0" if sigma.low == 0 else "")

    pixel = noise("pixel", "pixel")
    if stack.whole_codes and math.isfinite(pixel.value):
        error_dn2 = rounding_error_dn2(stack.changes.variance)
        removed_dn2 = ROUNDING_DN2 + np.array([0.0, error_dn2, -error_dn2])
        variances = np.square([pixel.value, pixel.low, pixel.high]) - removed_dn2
        pixel = pixel.with_interval(np.sqrt(np.maximum(variances, 0.0)).tolist())
    return LineNoise(
        row=noise("row", "row"),
        column=noise("col", "column"),
        pixel=pixel,
        rows=_temporal_deviation(stack.row_means),
        columns=_temporal_deviation(stack.column_means),
    )


def _temporal_deviation(means: Float64Array) -> Float64Array:
    """Return the temporal standard deviation of line means (N, lines), shape (lines,) [DN]; NaN for one frame."""
    if len(means) == 1:
        return np.full(means.shape[1], np.nan)
    return np.asarray(means.std(axis=0, ddof=1))
