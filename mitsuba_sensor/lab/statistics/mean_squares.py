"""Mean squares of rows, columns and pixels (analysis of variance), and intervals of their sums and differences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import LEVEL


@dataclass(frozen=True)
class MeanSquare:
    """An estimate that follows value·χ²(freedom)/freedom.

    other_variance : of the estimate, beside that of the chi-square law (of a mean product of two images, for example).
    """

    value: float
    freedom: float
    other_variance: float = 0.0

    def times(self, factor: float) -> MeanSquare:
        """This estimate times a number that is known."""
        return replace(
            self, value=self.value * factor, other_variance=self.other_variance * factor**2
        )

    def __truediv__(self, number: float) -> MeanSquare:
        return self.times(1 / number)

    def __neg__(self) -> MeanSquare:
        return self.times(-1)


@dataclass(frozen=True)
class MeanSquares:
    """Of an image of H × W pixels, with the expectations W·σ_row² + σ², H·σ_col² + σ² and σ².

    Rows and columns are None for a single column or row, which cannot be told from its pixels.
    """

    rows: MeanSquare | None
    columns: MeanSquare | None
    pixels: MeanSquare
    shape: tuple[int, int]

    def divided(self, by: Sequence[float]) -> MeanSquares:
        """Rows, columns and pixels each by a number that is known."""
        rows, columns = (
            one and one / number
            for one, number in zip((self.rows, self.columns), by, strict=False)
        )
        return replace(self, rows=rows, columns=columns, pixels=self.pixels / by[2])

    def row_variance(self) -> list[MeanSquare]:
        """Terms of σ_row² = (rows − pixels)/W."""
        return [self.rows / self.shape[1], -self.pixels / self.shape[1]] if self.rows else []

    def column_variance(self) -> list[MeanSquare]:
        """Terms of σ_col² = (columns − pixels)/H."""
        return (
            [self.columns / self.shape[0], -self.pixels / self.shape[0]] if self.columns else []
        )

    def pixel_variance(self) -> list[MeanSquare]:
        """Terms of σ² of the pixels alone."""
        return [self.pixels] if self.rows else []

    def variance(self) -> list[MeanSquare]:
        """Terms of the sum of the three."""
        if not (self.rows and self.columns):
            return [self.pixels]
        height, width = self.shape
        return [
            self.rows / width,
            self.columns / height,
            self.pixels.times(1 - 1 / width - 1 / height),
        ]

    def variance_of_mean(self) -> float:
        """Of the mean of the image."""
        lines = (
            self.rows.value if self.rows else 0.0,
            self.columns.value if self.columns else 0.0,
        )
        both = sum(lines) - self.pixels.value if self.rows else self.pixels.value
        return max(both, self.pixels.value) / (self.shape[0] * self.shape[1])


def combined(terms: Iterable[MeanSquare]) -> tuple[float, float, float]:
    """(value, low, high) of a sum of independent estimates, some of them times a negative number.

    Modified large samples: the distances to the exact chi-square limits of the terms add in quadrature (Graybill and
    Wang, J. Am. Stat. Assoc. 75, 869, 1980; Ting et al., J. Stat. Comput. Simul. 35, 135, 1990, without cross terms).
    """
    total = below = above = 0.0
    z = float(scipy.special.ndtri((1 + LEVEL) / 2))
    for term in terms:
        small, large = (
            float(scipy.special.chdtri(term.freedom, p))
            for p in ((1 + LEVEL) / 2, (1 - LEVEL) / 2)
        )
        down, up = 1 - term.freedom / large, term.freedom / small - 1 if small > 0 else math.inf
        toward_low, toward_high = (down, up) if term.value > 0 else (up, down)
        total += term.value
        below += (
            (toward_low * term.value) ** 2 + z**2 * term.other_variance if term.value else 0.0
        )
        above += (
            (toward_high * term.value) ** 2 + z**2 * term.other_variance if term.value else 0.0
        )
    return total, total - math.sqrt(below), total + math.sqrt(above)


def root(terms: Iterable[MeanSquare], scale: float = 1.0) -> tuple[float, float, float]:
    """(value, low, high) of the square root of a variance, times a factor; 0 where the variance is found negative."""
    value, low, high = (math.sqrt(max(0.0, one)) * scale for one in combined(terms))
    return value, low, high


def spatial_mean_squares(
    first: Float64Array, second: Float64Array | None = None
) -> MeanSquares:
    """Of one image, or mean products of two images of the same pixels, (H, W) each.

    Degrees of freedom are those of normal, independent values, fewer where tails or correlations of neighbouring lines
    are larger than chance has them.
    """
    height, width = first.shape
    if min(first.shape) == 1:
        line = _centred(first.ravel()), _centred((first if second is None else second).ravel())
        return MeanSquares(
            None, None, _mean_product(line, first.size - 1, lines=True), first.shape
        )
    parts = _parts(first)
    rows, columns, rest = zip(parts, parts if second is None else _parts(second), strict=True)
    return MeanSquares(
        _mean_product(rows, height - 1, lines=True).times(width),
        _mean_product(columns, width - 1, lines=True).times(height),
        _mean_product(rest, (height - 1) * (width - 1), lines=False),
        first.shape,
    )


def temporal_mean_squares(stack: Stack) -> MeanSquares:
    """Of what changes from frame to frame in N ≥ 2 frames: deviations from each pixel's and each frame's mean."""
    height, width = stack.shape
    drift = stack.frame_means - stack.frame_means.mean()
    more = len(stack) - 1
    total = more * float(stack.variance.sum()) - height * width * float(drift @ drift)
    uneven = _unevenness(stack.variance, more)
    if min(stack.shape) == 1:
        pixels = max(height, width) - 1
        return MeanSquares(
            None,
            None,
            _of_sum(total, more * pixels, uneven) if pixels else _nothing(),
            stack.shape,
        )
    by_row, by_column = (
        size * float(np.square(means - means.mean(axis=0) - drift[:, None]).sum())
        for means, size in ((stack.row_means, width), (stack.column_means, height))
    )
    rest = max(total - by_row - by_column, 0.0)
    return MeanSquares(
        MeanSquare(by_row / (more * (height - 1)), more * (height - 1)),
        MeanSquare(by_column / (more * (width - 1)), more * (width - 1)),
        _of_sum(rest, more * (height - 1) * (width - 1), uneven),
        stack.shape,
    )


def _of_sum(total: float, freedom: float, uneven: float) -> MeanSquare:
    return MeanSquare(total / freedom, freedom / uneven)


def _nothing() -> MeanSquare:
    return MeanSquare(0.0, 1.0)


def _unevenness(variance: Float64Array, more: int) -> float:
    """E[σ⁴]/E[σ²]² over the pixels; variances with n degrees of freedom have E[s⁴] = σ⁴·(n + 2)/n."""
    mean = float(variance.mean())
    return (
        max(1.0, float(np.square(variance).mean()) * more / (more + 2) / mean**2)
        if mean
        else 1.0
    )


def _centred(values: Float64Array) -> Float64Array:
    return np.asarray(values - values.mean())


def _parts(image: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Deviations of the means of rows and columns from the image's mean, and what is left of the pixels."""
    mean = image.mean()
    rows, columns = image.mean(axis=1) - mean, image.mean(axis=0) - mean
    return rows, columns, image - mean - rows[:, None] - columns


def _mean_product(
    pair: tuple[Float64Array, Float64Array], freedom: float, lines: bool
) -> MeanSquare:
    """Of deviations from the mean; with itself a variance. Of two images also the variance that a product has more."""
    first, second = pair
    product = float(np.vdot(first, second)) / freedom
    squares = float(np.vdot(first, first)) / freedom * float(np.vdot(second, second)) / freedom
    normal = squares + product**2
    if not normal:
        return MeanSquare(0.0, freedom)
    tails = float(np.square(first * second).mean()) - product**2
    excess = tails / normal if tails / normal > 1 + 7.5 / math.sqrt(first.size) else 1.0
    excess *= _correlated_lines(first) if lines else 1.0
    return MeanSquare(
        product, freedom / excess, max(0.0, squares - product**2) * excess / freedom
    )


def _correlated_lines(values: Float64Array) -> float:
    """1 + 2·Σρ², by which a variance of correlated values is less certain; ρ until it is within 2/√n of 0."""
    power, found = float(values @ values), 1.0
    for lag in range(1, len(values) // 2):
        correlation = float(values[lag:] @ values[:-lag]) / power
        if correlation**2 < 4 / len(values):
            break
        found += 2 * correlation**2
    return found
