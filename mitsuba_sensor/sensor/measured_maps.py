"""Measured maps of gains and offsets behind the shot noise: taken together, in groups of pixels that are alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import SensorWindow
from ..core.types import Array, Float64Array
from .pixel_law import borders_of
from .stage import Chain

STEPS = 0.16, 0.32, 0.64
"""Distances of the groups [σ], of which the first is taken that does not give too many."""


class Groups(NamedTuple):
    """Groups of pixels: their shares, mean gains and offsets, and the variance of both inside of each, (K,) each."""

    weights: Float64Array
    gains: Float64Array
    offsets: Float64Array
    of_gains: Float64Array
    of_offsets: Float64Array


class MeasuredMaps(NamedTuple):
    """A signal x becomes gain·x + offset, in every pixel of the window.

    gains, offsets : arrays that broadcast to (H, W), in the unit of the stage behind which they stand.
    """

    gains: Array
    offsets: Array

    @classmethod
    def of(cls, stages: Chain, window: SensorWindow) -> MeasuredMaps:
        """Of these stages, one behind the other."""
        gains, offsets = np.ones(1), np.zeros(1)
        for stage in stages:
            more, offset = stage.measured(window) or (stage.nominal_gain, 0.0)
            offsets = offsets * more + offset
            gains = gains * (1.0 if stage.measured(window) is None else more)
        return cls(gains, offsets)

    def groups(self, most: float) -> Groups:
        """Of pixels of nearly the same gain and offset; most : about how many."""
        if np.size(self.gains) == 1:
            weights, means, rest = _grouped(np.sort(self.offsets, axis=None), most)
            gains = np.full(weights.size, np.ravel(self.gains)[0])
            return Groups(weights / weights.sum(), gains, means, np.zeros(rest.size), rest)
        gains, offsets = (x.ravel() for x in np.broadcast_arrays(self.gains, self.offsets))
        order = np.argsort(gains)
        gains, offsets = gains[order], offsets[order]
        pixels, *of_gains = _grouped(gains, most if np.size(self.offsets) == 1 else np.sqrt(most))
        parts = np.split(offsets, np.cumsum(pixels[:-1]).astype(np.intp))
        found = [_grouped(np.sort(part), most / len(parts)) for part in parts]
        weights, means, rest = (np.concatenate(one) for one in zip(*found, strict=True))
        values, inside = (np.repeat(x, [one[0].size for one in found]) for x in of_gains)
        return Groups(weights / weights.sum(), values, means, inside, rest)


def _grouped(ordered: Float64Array, most: float) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Numbers, means and variances of groups of rising values: quantiles of a normal law, and none across a gap."""
    centre = float(ordered.mean())
    x = ordered - centre  # squares of small numbers are exact
    step = next((one for one in STEPS if borders_of(x.size, one).size <= most), STEPS[-1])
    gaps = np.flatnonzero(np.diff(x) > step * x.std()) + 1
    borders = np.union1d(borders_of(x.size, step), gaps)
    numbers = np.diff(borders, append=x.size).astype(np.float64)
    means, squares = (np.add.reduceat(part, borders) / numbers for part in (x, x**2))
    return numbers, centre + means, np.where(numbers > 1, np.maximum(squares - means**2, 0.0), 0.0)


def widened(values: Float64Array, weights: Float64Array, variance: float) -> Float64Array:
    """Means of groups, moved apart until their variance is that of all."""
    mean = np.average(values, weights=weights)
    between = np.average((values - mean) ** 2, weights=weights)
    return np.asarray(mean + (values - mean) * np.sqrt(variance / between if between else 1.0))


def groups_of(stages: Chain, window: SensorWindow, most: float) -> Groups:
    """Groups of the pixels of these stages, made once per window."""
    key = "measured", tuple(map(id, stages)), most
    _, found = window.cached(key, lambda: (stages, MeasuredMaps.of(stages, window).groups(most)))
    return found
