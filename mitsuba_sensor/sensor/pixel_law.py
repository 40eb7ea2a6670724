"""Laws of the pixels before the shot noise: gains and offsets, fixed or switching, by quantiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core.types import Float64Array, RandomBits

if TYPE_CHECKING:
    from .map_levels import MapLevels


@dataclass(frozen=True)
class Quantiles:
    """Standard normals from −8 to 8; with the weights a sum over them is an integral, to 1e-15 for smooth functions.

    step : between them.
    """

    step: float

    @cached_property
    def normals(self) -> Float64Array:
        """The normals."""
        return np.arange(-8.0, 8.0 + self.step / 2, self.step)

    @cached_property
    def weights(self) -> Float64Array:
        """The share of each."""
        weights = np.exp(-0.5 * self.normals**2)
        return np.asarray(weights / weights.sum())

    @cached_property
    def survival(self) -> Float64Array:
        """The chance that a normal is above each."""
        return np.asarray(scipy.special.ndtr(-self.normals))

    @cached_property
    def bits(self) -> RandomBits:
        """Random bits that a backend turns into these quantiles."""
        return np.clip(np.floor(self.survival * 2.0**32), 0, 2**32 - 1).astype(np.uint32)


COARSE, FINE = Quantiles(0.16), Quantiles(0.002)
"""For laws that are narrow and wide beside the shot noise."""


RARE = 0.02
"""Share of the pixels below which a kind shows in no average."""

MAP_STEP = 0.02
"""Of the groups of a measured map [σ]: 250 groups, which lose 3e-5 of a normal map's variance."""


@dataclass(frozen=True, eq=False)
class PixelLaw:
    """Mean electrons x of a pixel become gain·x + offset.

    weights : (K,) share of the pixels of each kind.
    gains, offsets : (K, S) of each kind in each of its states.
    states : (S,) share of the time that a pixel is in each state.
    """

    weights: Float64Array
    gains: Float64Array
    offsets: Float64Array
    states: Float64Array


@dataclass(frozen=True, eq=False)
class NoiseLaw:
    """Temporal noise that differs from pixel to pixel or is not normal: each kind has a mixture of normals.

    weights : (K,) share of the pixels of each kind.
    steps, variances : (K, T) of each kind in each state, in the unit of the stage.  states : (T,) chance of each.
    """

    weights: Float64Array
    steps: Float64Array
    variances: Float64Array
    states: Float64Array

    @property
    def quieter(self) -> float:
        """How much less than the mean variance that of the quietest normal is, of those that are not RARE."""
        mean, shares = self.weights @ ((self.variances + self.steps**2) @ self.states), self.shares
        return float(mean - self.variances[shares > min(RARE, 0.5 * shares.max())].min())

    @property
    def shares(self) -> Float64Array:
        """(K, T) of pixels and time together."""
        return np.outer(self.weights, self.states)


def fixed_gains(gains: Float64Array, weights: Float64Array) -> PixelLaw:
    """Every pixel has its gain."""
    return PixelLaw(weights, gains[:, None], np.zeros((gains.size, 1)), np.ones(1))


def fixed_offsets(offsets_e: Float64Array, weights: Float64Array) -> PixelLaw:
    """Every pixel has its offset [e-]."""
    return PixelLaw(weights, np.ones((offsets_e.size, 1)), offsets_e[:, None], np.ones(1))


def mixed(parts: Sequence[tuple[float, PixelLaw]]) -> PixelLaw:
    """Pixels of several laws without states of their own, by their shares."""
    weights = np.concatenate([share * law.weights for share, law in parts])
    gains, offsets = (np.concatenate([getattr(law, name) for _, law in parts]) for name in ("gains", "offsets"))
    return PixelLaw(weights / weights.sum(), gains, offsets, np.ones(1))


def borders_of(pixels: int, step: float) -> NDArray[np.intp]:
    """First number of every group of ordered pixels: quantiles of a normal law, so many σ apart."""
    borders = np.unique(np.rint(scipy.special.ndtr(np.arange(-8.0, 8.0, step)) * pixels).astype(np.intp))
    return borders[borders < pixels]


def of_map(levels: MapLevels, make: Callable[[Float64Array, Float64Array], PixelLaw]) -> PixelLaw:
    """The law of a measured map: means of groups of pixels in order, every pixel for itself at both ends.

    Few hot pixels keep their tail.
    """
    borders = borders_of(levels.size, MAP_STEP)
    return make(levels.means_between(borders), np.diff(borders, append=levels.size) / levels.size)


def normal_law(mean_e: Float64Array, temporal_e2: Float64Array, spatial_e2: Float64Array) -> PixelLaw:
    """A normal law about ``mean_e`` at every node, with a fixed and a temporal part."""
    none = Quantiles(16.0)
    fixed, moving = (Quantiles(0.4) if np.any(x) else none for x in (spatial_e2, temporal_e2))
    z, t = fixed.normals[:, None] * (fixed is not none), moving.normals * (moving is not none)
    spread = np.sqrt(spatial_e2)[:, None, None] * z + np.sqrt(temporal_e2)[:, None, None] * t
    return PixelLaw(fixed.weights, np.zeros((1, 1)), mean_e[:, None, None] + spread, moving.weights)
