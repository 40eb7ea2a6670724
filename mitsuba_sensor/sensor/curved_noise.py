"""Swing at the converter given the electron count: normal, or a mixture of normals where noise meets a curve.

A curved stage bends a wide noise into another law. There the noise in front of it is taken apart: nodes that carry most
of it, and a narrow normal rest about each, for which the second order of Moments.through is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..core import Frame, Moments
from ..core.types import Float64Array
from .stage import Chain, Stage

BENT = 0.01
"""Noise is taken apart where the slope changes by more than this share within 2σ to either side."""

FARTHEST = 5.0
"""How far out the nodes lie [σ]."""

WIDE, NARROW_REST, REST = 0.2, 0.08, 0.25
"""σ of the narrow normals as a share of the noise: the small one where the slope changes by more than WIDE."""

ALONE: Float64Array = np.ones(1)

MOST = 1_500_000
"""Values at most: beyond them noise is not taken apart."""


class Parting(NamedTuple):
    """Of a normal: nodes and a rest, of variance 1 together.  z, weights : of the nodes.  rest : σ."""

    z: Float64Array
    weights: Float64Array
    rest: float

    @classmethod
    def of(cls, rest: float) -> Parting:
        """Nodes 1.4 σ of the rest apart: their ripple is 6e-5."""
        number = np.floor(FARTHEST * 0.7 / rest)
        z = np.arange(-number, number + 1) * (rest / 0.7)
        weights = np.exp(-0.5 * z**2 / (1 - rest**2))
        return cls(z, weights / weights.sum(), rest)


PARTINGS = (Parting.of(NARROW_REST), Parting.of(REST))


@dataclass(frozen=True, eq=False)
class Swing:
    """Normals for every count, node of the temporal noise and node of what is fixed.

    m : mean and variances, (C, T·S).  temporal, fixed : (T,), (S,) weights of the nodes.
    """

    m: Moments
    temporal: Float64Array
    fixed: Float64Array

    @classmethod
    def behind(cls, stages: Chain, counts: Float64Array, frame: Frame) -> Swing:
        """Of these counts behind these stages."""
        found = cls(Moments(counts[:, None], np.zeros((1, 1)), np.zeros((1, 1)), frame), ALONE, ALONE)
        for stage in stages:
            if stage.curved:
                found = found._apart(stage)
            with np.errstate(over="ignore", invalid="ignore"):  # a curve far beyond its range
                found = replace(found, m=stage.moments(found.m))
        return found

    @cached_property
    def parts(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Mean, temporal and spatial variance, (C, T, S)."""
        counts = np.shape(self.m.mean)[0]
        flat, shape = (counts, self.temporal.size * self.fixed.size), (counts, self.temporal.size, self.fixed.size)
        mean, temporal, spatial = (
            np.broadcast_to(x, flat).reshape(shape) for x in (self.m.mean, self.m.temporal, self.m.spatial)
        )
        return mean, temporal, spatial

    def _apart(self, stage: Stage) -> Swing:
        """With nodes for what is wide beside the curve of the stage."""
        mean, temporal, spatial = self.parts
        found, weights = [mean, temporal, spatial], [self.temporal, self.fixed]
        for axis in (0, 1):
            sigma = np.sqrt(found[axis + 1])
            bend = self._bend(stage, found[0], sigma)
            fitting = [p for p in PARTINGS[bend <= WIDE :] if found[0].size * p.z.size <= MOST]
            if bend <= BENT or not fitting:
                continue
            parting = fitting[0]
            shape = (mean.shape[0], -1, found[0].shape[2]) if axis == 0 else (mean.shape[0], found[0].shape[1], -1)
            z = parting.z.reshape((-1, 1) if axis == 0 else (-1,))
            sigma, centre, other = (np.expand_dims(x, axis + 2) for x in (sigma, found[0], found[2 - axis]))
            moved = centre + sigma * z
            rest, same = (np.broadcast_to(x, moved.shape) for x in ((parting.rest * sigma) ** 2, other))
            found[0], found[axis + 1], found[2 - axis] = (x.reshape(shape) for x in (moved, rest, same))
            weights[axis] = np.outer(weights[axis], parting.weights).ravel()
        flat = [x.reshape(mean.shape[0], -1) for x in found]
        m = replace(self.m, mean=flat[0], temporal=flat[1], spatial=flat[2])
        return Swing(m, *weights)

    def _bend(self, stage: Stage, mean: Float64Array, sigma: Float64Array) -> float:
        """The largest change of the slope of a stage within 2σ, as a share of the slope."""
        flat = [x.reshape(mean.shape[0], -1) for x in (mean - 2 * sigma, mean, mean + 2 * sigma)]
        with np.errstate(over="ignore", invalid="ignore"):
            low, centre, high = (stage.moments(replace(self.m, mean=x, temporal=0.0, spatial=0.0)).mean for x in flat)
            bend = np.abs(high - 2 * centre + low) / np.maximum(np.abs(high - centre) + np.abs(centre - low), 1e-300)
        return float(np.nan_to_num(bend).max())
