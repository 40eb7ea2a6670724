"""A map as a sum of the mean frames of stacks, and its spread over rows, columns and pixels without temporal noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.types import Float64Array
from ..statistics.mean_squares import MeanSquare, MeanSquares, root, spatial_mean_squares

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
        """(value, low, high) of the standard deviation of rows, columns, pixels and all, times a factor."""
        measured = spatial_mean_squares(self.image)
        return {
            name: root([*terms(measured), *self._noise(terms)], scale)
            for name, terms in PARTS.items()
        }

    def _noise(self, terms: Callable[[MeanSquares], list[MeanSquare]]) -> list[MeanSquare]:
        return [
            one.times(-noise.factor) for noise in self.noises for one in terms(noise.squares)
        ]

    def parts(self) -> dict[str, Float64Array]:
        """Deviations of rows (H, 1), columns (1, W) and pixels (H, W) from the mean, each with the σ of its pattern.

        What averaging left of the temporal noise widens each part; it is scaled down to the σ without it. A part whose
        σ is not told from 0 is 0.
        """
        mean = self.image.mean()
        rows = self.image.mean(axis=1, keepdims=True) - mean
        columns = self.image.mean(axis=0, keepdims=True) - mean
        found = {"row": rows, "col": columns, "pixel": self.image - mean - rows - columns}
        wanted = self.spread()
        return {
            name: scaled_to(part, wanted[name][0] if wanted[name][1] > 0 else 0.0)
            for name, part in found.items()
        }


def scaled_to(part: Float64Array, sigma: float) -> Float64Array:
    """A part of mean 0 with this standard deviation, at most its own."""
    own = math.sqrt(float(np.square(part).mean()))
    return part * (min(sigma / own, 1.0) if own and math.isfinite(sigma) else 0.0)


def weighted(images: Sequence[Float64Array], weights: Sequence[float]) -> Float64Array:
    """Their sum with weights, one image at a time."""
    total = np.zeros(images[0].shape)
    for image, weight in zip(images, weights, strict=True):
        total += weight * image
    return total
