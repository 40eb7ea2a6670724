"""Measured maps of gains and offsets behind the shot noise: taken together, in groups of pixels that are alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import SensorWindow
from ..core.types import Array, Float64Array
from .map_levels import MapLevels
from .pixel_law import borders_of
from .stage import Chain, Stage

STEPS = 0.16, 0.32, 0.64
"""Distances of the groups [σ], of which the first is taken that does not give too many."""

BLURRED = 0.5
"""Groups may lie so far apart, in σ of the normal offsets that every pixel has besides: two values at that distance
move the fourth moment of those by 0.8 %, and the chance of a code by 3e-4."""


class Groups(NamedTuple):
    """Groups of pixels: their shares, mean gains and offsets, and the variance of both inside of each, (K,) each."""

    weights: Float64Array
    gains: Float64Array
    offsets: Float64Array
    of_gains: Float64Array
    of_offsets: Float64Array


class MeasuredMaps(NamedTuple):
    """A signal x becomes gain·x + offset, in every pixel of the window of these stages, one behind the other."""

    stages: Chain
    window: SensorWindow

    def __call__(self, rows: slice) -> tuple[Array, Array]:
        """Gains and offsets of some rows, arrays that broadcast to them, in the unit of the last stage."""
        window, gains, offsets = self.window.crop_rows(rows), np.ones((1, 1)), np.zeros((1, 1))
        for stage in self.stages:
            measured = stage.measured(window)
            more, offset = measured or (stage.nominal_gain, 0.0)
            offsets = offsets * more + offset
            gains = gains if measured is None else gains * more
        return gains, offsets

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of all maps together."""
        rows, columns = np.broadcast_shapes((1, 1), *(x.shape for x in self.window.given.values()))
        return rows, columns

    def groups(self, most: float, blur: float = 0.0) -> Groups:
        """Of pixels of nearly the same gain and offset; most : about how many.  blur : σ of other, normal offsets."""
        gains, offsets = self(slice(0, 2))
        if gains.size == 1:
            (found,) = MapLevels.of_groups(self._offsets, self.shape)
            parts, of_gains = [_grouped(found, most, blur)], MapLevels(np.ones(1), gains.ravel(), np.zeros(1))
        else:
            bounds = self._bounds_of_gains(most if offsets.size == 1 else np.sqrt(most))
            of_gains, levels = self._apart(bounds)
            parts = [_grouped(one, most / len(levels), blur) for one in levels]
        weights, means, rest = (np.concatenate(one) for one in zip(*parts, strict=True))
        values, inside = (np.repeat(x, [one.pixels.size for one in parts]) for x in of_gains[1:])
        return Groups(weights / weights.sum(), values, means, inside, rest)

    def _bounds_of_gains(self, most: float) -> Float64Array:
        """Between the gains of groups."""
        (levels,) = MapLevels.of_groups(self._gains, self.shape)
        firsts = _firsts(levels, most)[1:]
        return np.asarray(0.5 * (levels.means[firsts - 1] + levels.means[firsts]))

    def _apart(self, bounds: Float64Array) -> tuple[MapLevels, list[MapLevels]]:
        """Gains of the groups between these bounds, and levels of the offsets of each."""

        def group(rows: slice) -> NDArray[np.intp]:
            return np.asarray(np.searchsorted(bounds, self._gains(rows)))

        gains, offsets = (
            MapLevels.of_groups(part, self.shape, group, bounds.size + 1) for part in (self._gains, self._offsets)
        )
        used = [(one.together(), levels) for one, levels in zip(gains, offsets, strict=True) if one.pixels.size]
        return MapLevels(*map(np.concatenate, zip(*(one for one, _ in used), strict=True))), [part for _, part in used]

    def _gains(self, rows: slice) -> Array:
        return self(rows)[0]

    def _offsets(self, rows: slice) -> Array:
        return self(rows)[1]


def _firsts(levels: MapLevels, most: float, blur: float = 0.0) -> NDArray[np.intp]:
    """First levels of groups: quantiles of a normal law, and none across a gap."""
    number, sigma = levels.size, np.sqrt(levels.variance())
    step = next((one for one in STEPS if borders_of(number, one).size <= most), STEPS[-1])
    step = max([step, *(one for one in STEPS if one * sigma <= BLURRED * blur)])
    gaps = np.flatnonzero(np.diff(levels.means) > step * sigma) + 1
    return np.union1d(levels.firsts(borders_of(number, step)), gaps)


def _grouped(levels: MapLevels, most: float, blur: float) -> MapLevels:
    """Pixels of nearly the same value; most : about how many groups."""
    return levels.in_groups(_firsts(levels, most, blur))


def widened(values: Float64Array, weights: Float64Array, variance: float) -> Float64Array:
    """Means of groups, moved apart until their variance is that of all."""
    mean = np.average(values, weights=weights)
    between = np.average((values - mean) ** 2, weights=weights)
    return np.asarray(mean + (values - mean) * np.sqrt(variance / between if between else 1.0))


def is_measured(stage: Stage, window: SensorWindow) -> bool:
    """Whether a stage has a measured map there: asked of one row, for all are a copy."""
    return stage.measured(window.crop_rows(slice(0, 1))) is not None


def groups_of(stages: Chain, window: SensorWindow, most: float, blur: float) -> Groups:
    """Groups of the pixels of these stages, made once per window."""
    key = "measured", tuple(map(id, stages)), most, blur
    _, found = window.cached(key, lambda: (stages, MeasuredMaps(stages, window).groups(most, blur)))
    return found
