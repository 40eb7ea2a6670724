"""Mean squares of rows, columns and pixels (analysis of variance), and intervals of their sums and differences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.stack import Changes, Stack
from ..quantity import LEVEL
from .outliers import Pixels


@dataclass(frozen=True)
class MeanSquare:
    """An estimate with the distribution value·χ²(freedom)/freedom.

    other_variance : additional variance of the estimate, e.g. of a mean product of two images.
    """

    value: float
    freedom: float
    other_variance: float = 0.0

    def times(self, factor: float) -> MeanSquare:
        """Return this estimate times an exact number."""
        return replace(
            self, value=self.value * factor, other_variance=self.other_variance * factor**2
        )

    def __truediv__(self, number: float) -> MeanSquare:
        return self.times(1 / number)

    def __neg__(self) -> MeanSquare:
        return self.times(-1)


@dataclass(frozen=True)
class MeanSquares:
    """Mean squares of an image of H × W pixels, with expectations W·σ_row² + σ², H·σ_col² + σ² and σ².

    rows, columns : None for a single row or column.
    """

    rows: MeanSquare | None
    columns: MeanSquare | None
    pixels: MeanSquare
    shape: tuple[int, int]

    def divided(self, by: Sequence[float]) -> MeanSquares:
        """Return rows, columns and pixels, each divided by an exact number."""
        pixels = self.pixels / by[2]
        if self.rows is None or self.columns is None:
            return replace(self, pixels=pixels)
        return replace(
            self, rows=self.rows / by[0], columns=self.columns / by[1], pixels=pixels
        )

    def terms(self, part: str = "all") -> list[MeanSquare]:
        """Return the terms of a variance: ``row`` is σ_row² = (rows − pixels)/W, ``col`` likewise, ``pixel`` is σ², and
        ``all`` the sum of the three. A single line of pixels has only ``all``."""
        if self.rows is None or self.columns is None:
            return [self.pixels] if part == "all" else []
        height, width = self.shape
        rows, columns = self.rows / width, self.columns / height
        parts = {
            "row": [rows, -self.pixels / width],
            "col": [columns, -self.pixels / height],
            "pixel": [self.pixels],
            "all": [rows, columns, self.pixels.times(1 - 1 / width - 1 / height)],
        }
        return parts[part]

    def variance_of_mean(self) -> float:
        """Return the variance of the mean of the image."""
        variance = self.pixels.value
        if self.rows is not None and self.columns is not None:
            variance = self.rows.value + self.columns.value - self.pixels.value
        return max(variance, self.pixels.value) / (self.shape[0] * self.shape[1])


def combined(terms: Iterable[MeanSquare]) -> tuple[float, float, float]:
    """Return (value, low, high) of a sum of independent estimates, some with negative signs.

    Modified large samples: distances to the exact chi-square limits of the terms add in quadrature (Graybill and Wang,
    J. Am. Stat. Assoc. 75, 869, 1980; Ting et al., J. Stat. Comput. Simul. 35, 135, 1990, without cross terms).
    """
    total = below = above = 0.0
    z = float(scipy.special.ndtri((1 + LEVEL) / 2))
    for term in terms:
        if not term.value:
            continue
        toward_low, toward_high = _relative_distances(term)
        other = z**2 * term.other_variance
        total += term.value
        below += (toward_low * term.value) ** 2 + other
        above += (toward_high * term.value) ** 2 + other
    return total, total - math.sqrt(below), total + math.sqrt(above)


def _relative_distances(term: MeanSquare) -> tuple[float, float]:
    """Return the distances to the lower and upper limit of an estimate, over its value."""
    small = float(scipy.special.chdtri(term.freedom, (1 + LEVEL) / 2))
    large = float(scipy.special.chdtri(term.freedom, (1 - LEVEL) / 2))
    down, up = 1 - term.freedom / large, math.inf
    if small > 0:
        up = term.freedom / small - 1
    if term.value > 0:
        return (down, up)
    return (up, down)


def root(terms: Iterable[MeanSquare], scale: float = 1.0) -> tuple[float, float, float]:
    """Return (value, low, high) of the square root of a variance times a factor; 0 for a negative variance.

    If the whole interval is negative, the upper limit is what noise about 0 allows.
    """
    variance, least, most = combined(terms)
    if most < 0:
        most -= variance
    value, low, high = (math.sqrt(max(0.0, x)) * scale for x in (variance, least, most))
    return value, low, high


def spatial_mean_squares(
    first: Float64Array, second: Float64Array | None = None, filled: int = 0
) -> MeanSquares:
    """Return mean squares of an image (H, W), or mean products of two images of the same pixels.

    filled : number of pixels that were filled from their rows and columns.

    Degrees of freedom assume normal, independent values; significant tails or correlations of neighbouring lines reduce
    them.
    """
    height, width = first.shape
    if min(first.shape) == 1:
        line = other_line = _centred(first.ravel())
        if second is not None:
            other_line = _centred(second.ravel())
        freedom = max(first.size - 1 - filled, 1)
        pixels = _mean_product(line, other_line, freedom, are_lines=True)
        return MeanSquares(None, None, pixels, first.shape)
    parts = other_parts = _parts(first)
    if second is not None:
        other_parts = _parts(second)
    (rows, columns, rest), (other_rows, other_columns, other_rest) = parts, other_parts
    by_row = _mean_product(rows, other_rows, height - 1, are_lines=True)
    by_column = _mean_product(columns, other_columns, width - 1, are_lines=True)
    freedom = max((height - 1) * (width - 1) - filled, 1)
    pixels = _mean_product(rest, other_rest, freedom, are_lines=False)
    return MeanSquares(by_row.times(width), by_column.times(height), pixels, first.shape)


def temporal_mean_squares(stack: Stack, left_out: Pixels | None = None) -> MeanSquares:
    """Return temporal mean squares of N ≥ 2 frames, without the frame means.  left_out : pixels to ignore."""
    changes, pixels, count = stack.changes, stack.shape[0] * stack.shape[1], 0
    variance, square = changes.variance * pixels, changes.square * pixels
    if left_out is not None and (count := int(np.count_nonzero(left_out))):
        ignored = stack.frames[:, left_out] - stack.frame_means[:, None]
        variances = ignored.var(axis=0, ddof=1)
        variance, square = variance - variances.sum(), square - variances @ variances
    kept = max(pixels - count, 1)
    return mean_squares_of(
        changes._replace(variance=variance / kept, square=square / kept), stack.shape
    )


def mean_squares_of(changes: Changes, shape: tuple[int, int]) -> MeanSquares:
    """Return mean squares from one pass over a stack; uneven variances of the pixels reduce the degrees of freedom."""
    (height, width), more = shape, len(changes.rows) - 1
    total = more * changes.variance * height * width
    uneven = 1.0
    if changes.variance:  # variances with n degrees of freedom have E[s⁴] = σ⁴·(n + 2)/n
        uneven = max(1.0, changes.square * more / (more + 2) / changes.variance**2)
    if min(shape) == 1:
        freedom = more * (max(shape) - 1)
        only = (
            MeanSquare(total / freedom, freedom / uneven) if freedom else MeanSquare(0.0, 1.0)
        )
        return MeanSquares(None, None, only, shape)
    by_row = width * float(np.square(changes.rows).sum())
    by_column = height * float(np.square(changes.columns).sum())
    rest = max(total - by_row - by_column, 0.0)
    row_freedom, column_freedom = more * (height - 1), more * (width - 1)
    freedom = more * (height - 1) * (width - 1)
    return MeanSquares(
        rows=MeanSquare(by_row / row_freedom, row_freedom),
        columns=MeanSquare(by_column / column_freedom, column_freedom),
        pixels=MeanSquare(rest / freedom, freedom / uneven),
        shape=shape,
    )


def _centred(values: Float64Array) -> Float64Array:
    return np.asarray(values - values.mean())


def _parts(image: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return deviations of row and column means from the mean, and the remaining deviations of the pixels."""
    mean = image.mean()
    rows, columns = image.mean(axis=1) - mean, image.mean(axis=0) - mean
    return rows, columns, image - mean - rows[:, None] - columns


def _mean_product(
    first: Float64Array, second: Float64Array, freedom: float, *, are_lines: bool
) -> MeanSquare:
    """Return the mean product of two arrays of deviations; for equal arrays it is a variance.

    For different arrays, the product has a variance in addition to that of chi-square.
    """
    product = float(np.vdot(first, second)) / freedom
    squares = float(np.vdot(first, first)) / freedom * float(np.vdot(second, second)) / freedom
    normal = squares + product**2
    if not normal:
        return MeanSquare(0.0, freedom)
    tails = float(np.square(first * second).mean()) - product**2
    excess = 1.0
    if tails / normal > 1 + 7.5 / math.sqrt(first.size):
        excess = tails / normal
    if are_lines:
        excess *= _excess_of_correlation(first)
    other_variance = max(0.0, squares - product**2) * excess / freedom
    return MeanSquare(product, freedom / excess, other_variance)


def _excess_of_correlation(values: Float64Array) -> float:
    """Return 1 + 2·Σρ², the excess variance of a variance of correlated values, for ρ until it is within 2/√n of 0."""
    power, excess = float(values @ values), 1.0
    for lag in range(1, len(values) // 2):
        correlation = float(values[lag:] @ values[:-lag]) / power
        if correlation**2 < 4 / len(values):
            break
        excess += 2 * correlation**2
    return excess
