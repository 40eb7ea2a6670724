"""A fitted figure with its frames; and measured maps of rows, columns and pixels, scaled to their σ without temporal
noise."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import Quantity
from ..statistics.mean_squares import MeanSquares, root, spatial_mean_squares
from ..statistics.outliers import fill, outliers


@dataclass(frozen=True)
class Fitted:
    """A figure and a description of the frames that it was fitted to."""

    quantity: Quantity
    frames: str

    @property
    def known(self) -> bool:
        """Return True if the frames show the figure."""
        return math.isfinite(self.quantity.value)

    @property
    def source(self) -> str:
        """``fit: 2.31 (2.29 to 2.33) e-, 64 frames dark_10ms/…``."""
        q = self.quantity
        figure = f"{q.value:.4g} ({q.low:.4g} to {q.high:.4g}) {q.unit}".rstrip()
        text = f"fit: {figure}, {self.frames}"
        if q.note:
            text += f"; {q.note}"
        return text

    def known_as(self, quantity: Quantity) -> Fitted:
        """Return another figure of the same frames."""
        return Fitted(quantity, self.frames)


def frames_of(*stacks: Stack) -> str:
    """Return the number of frames and their files: ``64 frames dark_10ms/a.tiff … b.tiff``."""
    count = sum(len(stack) for stack in stacks)
    sources = list(dict.fromkeys(short(stack.source) for stack in stacks))
    shown = ", ".join(sources[:2])
    if len(sources) > 2:
        more = len(sources) - 2
        shown += f" and {more} more stack{'s' * (more != 1)}"
    return f"{count} frame{'s' * (count != 1)} {shown}"


def short(source: str) -> str:
    """Return the last two parts of the path of the first file."""
    first, dots, _ = source.partition(" … ")
    parts = first.replace(os.sep, "/").split("/")
    if not dots:
        return "/".join(parts[-2:])
    if len(parts) > 1:
        return f"{parts[-2]}/…"
    return f"{first} …"


PARTS = ("row", "col", "pixel", "all")


@dataclass(frozen=True)
class CombinedMap:
    """Weighted sum of the mean frames of stacks.

    image : shape (H, W).  noises : mean squares of the temporal noise of each stack, and their factors in the image.
    """

    image: Float64Array
    noises: tuple[tuple[MeanSquares, float], ...]

    def spread(self) -> dict[str, tuple[float, float, float]]:
        """Return (value, low, high) of the standard deviation of rows, columns, pixels and all, without outliers."""
        left_out = outliers(self.image, least_sigma=0.0)
        filled = int(np.count_nonzero(left_out))
        measured = spatial_mean_squares(fill(self.image, left_out), filled=filled)
        spreads: dict[str, tuple[float, float, float]] = {}
        for part in PARTS:
            noises = [(squares.terms(part), factor) for squares, factor in self.noises]
            left = [term.times(-factor) for terms, factor in noises for term in terms]
            spreads[part] = root([*measured.terms(part), *left])
        return spreads

    def parts(self) -> dict[str, Float64Array]:
        """Return the deviations of rows (H, 1), columns (1, W) and pixels (H, W), without temporal noise."""
        spreads = self.spread()
        return parts_of(
            self.image,
            {name: spreads[name][0] if spreads[name][1] else 0.0 for name in spreads},
        )


def parts_of(image: Float64Array, sigmas: Mapping[str, float]) -> dict[str, Float64Array]:
    """Return the deviations of rows (H, 1), columns (1, W) and pixels (H, W) from the mean, each scaled to its σ."""
    filled = fill(image, outliers(image, least_sigma=0.0))
    mean = filled.mean()
    rows = filled.mean(axis=1, keepdims=True) - mean
    columns = filled.mean(axis=0, keepdims=True) - mean
    parts = {"row": rows, "col": columns, "pixel": image - mean - rows - columns}
    return {name: scaled_to(part, sigmas[name]) for name, part in parts.items()}


def scaled_to(part: Float64Array, sigma: float) -> Float64Array:
    """Return deviations scaled down to this standard deviation; 0 if it is unknown."""
    measured = math.sqrt(float(np.square(part[~outliers(part, least_sigma=0.0)]).mean()))
    if not measured or not math.isfinite(sigma):
        return part * 0.0
    return part * min(sigma / measured, 1.0)
