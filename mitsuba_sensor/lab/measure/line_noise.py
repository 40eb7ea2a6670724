"""Temporal row and column noise: what the pixels of a line share, new in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma, temporal_note
from ..frames.stack import Stack
from ..quantity import Quantity
from ..statistics.mean_squares import root, temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "analysis of variance over frames"


@dataclass(frozen=True, eq=False)
class LineNoise:
    """Temporal noise of rows, columns and pixels, whose squares add up to a pixel's temporal variance.

    row, column, pixel : standard deviations [DN]; [e-] by :meth:`per_gain`.
    rows, columns : standard deviation over the frames of each row's and column's mean, (H,) and (W,) [DN].
    """

    row: Quantity
    column: Quantity
    pixel: Quantity
    rows: Float64Array
    columns: Float64Array

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All three."""
        return self.row, self.column, self.pixel

    def per_gain(self, gain: Quantity | float) -> LineNoise:
        """In electrons.  gain : K [DN/e-]; the interval of a measured one widens these."""
        row, column, pixel = (one.divided(gain, "e-") for one in self.quantities)
        return LineNoise(row, column, pixel, self.rows, self.columns)

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
    found = temporal_mean_squares(stack) if len(stack) > 1 else None
    kinds = (
        ("σ_row", "temporal row noise"),
        ("σ_col", "temporal column noise"),
        ("σ_pixel", "temporal pixel noise"),
    )
    terms = (
        (found.row_variance(), found.column_variance(), found.pixel_variance())
        if found
        else ([], [], [])
    )
    quantities = []
    for kind, some in zip(kinds, terms, strict=True):
        value, low, high = root(some) if some else (math.nan,) * 3
        one = mark_clipped_sigma(Quantity(*kind, value, low, high, "DN", SECTION), stack).noted(
            temporal_note(stack)
        )
        one = (
            one.noted("a single line of pixels: rows, columns and pixels are not told apart")
            if found and not some
            else one
        )
        quantities.append(one.noted("not told from 0") if one.low == 0 else one)
    row, column, pixel = quantities
    return LineNoise(row, column, pixel, _spread(stack.row_means), _spread(stack.column_means))


def _spread(means: Float64Array) -> Float64Array:
    return (
        np.asarray(means.std(axis=0, ddof=1))
        if len(means) > 1
        else np.full(means.shape[1], np.nan)
    )
