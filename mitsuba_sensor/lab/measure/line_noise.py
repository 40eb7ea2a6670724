"""Temporal row and column noise: what the pixels of a line share, new in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma, mark_coarse, mark_rounding
from ..frames.stack import ROUNDING_DN2, Stack, rounding_error_dn2
from ..quantity import Figures, Quantity, no_value
from ..statistics.mean_squares import root, temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "analysis of variance over frames"


@dataclass(frozen=True, eq=False)
class LineNoise(Figures):
    """Temporal noise of rows, columns and pixels, whose squares add up to a pixel's temporal variance without rounding.

    row, column, pixel : standard deviations [DN].
    rows, columns : standard deviation over the frames of each row's and column's mean, (H,) and (W,) [DN].
    """

    row: Quantity
    column: Quantity
    pixel: Quantity
    rows: Float64Array
    columns: Float64Array

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
    squares = temporal_mean_squares(stack) if len(stack) > 1 else None

    def noise(part: str, name: str) -> Quantity:
        terms = [] if squares is None else squares.terms(part)
        sigma = no_value(f"σ_{part}", f"temporal {name} noise", "DN", SECTION)
        if terms:
            sigma = sigma.with_interval(root(terms))
        elif squares is not None:
            sigma = sigma.noted(
                "a single line of pixels: rows, columns and pixels are not told apart"
            )
        sigma = mark_coarse(mark_rounding(mark_clipped_sigma(sigma, stack), stack), stack)
        return sigma.noted("not told from 0" if sigma.low == 0 else "")

    pixel = noise("pixel", "pixel")
    if stack.whole_codes and squares is not None:
        pixel = _without_rounding(pixel, rounding_error_dn2(stack.changes.variance))
    return LineNoise(
        row=noise("row", "row"),
        column=noise("col", "column"),
        pixel=pixel,
        rows=_deviation_over_frames(stack.row_means),
        columns=_deviation_over_frames(stack.column_means),
    )


def _without_rounding(sigma: Quantity, error_dn2: float) -> Quantity:
    """A standard deviation [DN] without what rounding adds to its square, 1/12 DN² give or take an error."""
    if math.isnan(sigma.value):
        return sigma
    removed_dn2 = ROUNDING_DN2 + np.array([0.0, error_dn2, -error_dn2])
    variances = np.square([sigma.value, sigma.low, sigma.high]) - removed_dn2
    return sigma.with_interval(np.sqrt(np.maximum(variances, 0.0)).tolist())


def _deviation_over_frames(means: Float64Array) -> Float64Array:
    """Standard deviation over the frames of each line's mean, (N, lines) → (lines,) [DN]; NaN for one frame."""
    if len(means) == 1:
        return np.full(means.shape[1], np.nan)
    return np.asarray(means.std(axis=0, ddof=1))
