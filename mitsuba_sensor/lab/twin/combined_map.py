"""A map as a sum of the mean frames of stacks, and its spread over rows, columns and pixels without temporal noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.types import Float64Array
from ..statistics.mean_squares import MeanSquare, MeanSquares, root, spatial_mean_squares
from ..statistics.outliers import fill, outliers

PARTS: dict[str, Callable[[MeanSquares], list[MeanSquare]]] = {
    "row": MeanSquares.row_variance,
    "col": MeanSquares.column_variance,
    "pixel": MeanSquares.pixel_variance,
    "all": MeanSquares.variance,
}


@dataclass(frozen=True)
class Noise:
    """Mean squares of the temporal noise of one frame, and the factor with which they are in a map."""

    squares: MeanSquares
    factor: float


@dataclass(frozen=True)
class CombinedMap:
    """image : (H, W).  noises : temporal noise that the frames' average left in it."""

    image: Float64Array
    noises: tuple[Noise, ...]

    def spread(self, scale: float = 1.0) -> dict[str, tuple[float, float, float]]:
        """(value, low, high) of the standard deviation of rows, columns, pixels and all, times a factor.

        Pixels that stand out are left out: they are what they are in the map, and no width of a distribution.
        """
        left_out = outliers(self.image, least_sigma=0.0)
        image = fill(self.image, left_out)
        measured = spatial_mean_squares(image, filled=int(np.count_nonzero(left_out)))
        spreads: dict[str, tuple[float, float, float]] = {}
        for name, terms in PARTS.items():
            variance = terms(measured)
            for noise in self.noises:
                variance += [term.times(-noise.factor) for term in terms(noise.squares)]
            spreads[name] = root(variance, scale)
        return spreads

    def parts(self) -> dict[str, Float64Array]:
        """Deviations of rows (H, 1), columns (1, W) and pixels (H, W) from the mean, each with the σ of its pattern.

        What averaging left of the temporal noise widens each part; it is scaled down to the σ without it. A part whose
        σ is not told from 0 is 0.
        """
        filled = fill(self.image, outliers(self.image, least_sigma=0.0))
        mean = filled.mean()
        rows = filled.mean(axis=1, keepdims=True) - mean
        columns = filled.mean(axis=0, keepdims=True) - mean
        parts = {"row": rows, "col": columns, "pixel": self.image - mean - rows - columns}
        spreads = self.spread()
        for name, part in parts.items():
            sigma, low, _ = spreads[name]
            if not low > 0:
                sigma = 0.0
            parts[name] = scaled_to(part, sigma)
        return parts


def scaled_to(part: Float64Array, sigma: float) -> Float64Array:
    """A part of mean 0 with this standard deviation, at most its own; 0 where the wanted one is not known.

    Pixels that stand out are scaled as the others are.
    """
    own = math.sqrt(float(np.square(part[~outliers(part, least_sigma=0.0)]).mean()))
    if not own or not math.isfinite(sigma):
        return part * 0.0
    return part * min(sigma / own, 1.0)
