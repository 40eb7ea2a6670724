"""Measured maps: rows, columns and pixels, each scaled to its σ without what averaging left of temporal noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
class CombinedMap:
    """Weighted sum of the mean frames of stacks.

    image : (H, W).  noises : mean squares of the temporal noise of a frame of each stack, and their factor in the map.
    """

    image: Float64Array
    noises: tuple[tuple[MeanSquares, float], ...]

    def spread(self) -> dict[str, tuple[float, float, float]]:
        """(value, low, high) of the standard deviation of rows, columns, pixels and all.

        Pixels that stand out are left out: they are what they are in the map, and no width of a distribution.
        """
        left_out = outliers(self.image, least_sigma=0.0)
        filled = int(np.count_nonzero(left_out))
        measured = spatial_mean_squares(fill(self.image, left_out), filled=filled)
        spreads: dict[str, tuple[float, float, float]] = {}
        for name, terms in PARTS.items():
            variance = terms(measured)
            for squares, factor in self.noises:
                variance += [term.times(-factor) for term in terms(squares)]
            spreads[name] = root(variance)
        return spreads

    def parts(self) -> dict[str, Float64Array]:
        """Deviations of rows (H, 1), columns (1, W) and pixels (H, W), without temporal noise."""
        spreads = self.spread()
        return parts_of(
            self.image,
            {name: spreads[name][0] if spreads[name][1] else 0.0 for name in spreads},
        )


def parts_of(image: Float64Array, sigmas: Mapping[str, float]) -> dict[str, Float64Array]:
    """Deviations of rows (H, 1), columns (1, W) and pixels (H, W) from the mean, each scaled to its σ.

    Pixels that stand out are scaled as the others are.
    """
    filled = fill(image, outliers(image, least_sigma=0.0))
    mean = filled.mean()
    rows = filled.mean(axis=1, keepdims=True) - mean
    columns = filled.mean(axis=0, keepdims=True) - mean
    parts = {"row": rows, "col": columns, "pixel": image - mean - rows - columns}
    return {name: scaled_to(part, sigmas[name]) for name, part in parts.items()}


def scaled_to(part: Float64Array, sigma: float) -> Float64Array:
    """A part of mean 0 with this standard deviation, at most its own; 0 where the wanted one is not known."""
    own = math.sqrt(float(np.square(part[~outliers(part, least_sigma=0.0)]).mean()))
    if not own or not math.isfinite(sigma):
        return part * 0.0
    return part * min(sigma / own, 1.0)
