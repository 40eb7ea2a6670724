"""Swing at the converter given the electron count: normal, or a mixture of normals where noise meets a curve.

A curved stage makes another law of a wide noise. There the noise in front of it is taken apart: nodes that carry most
of it, and a narrow normal rest about each, for which the second order of Moments.through is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Frame, Moments
from ..core.types import Float64Array
from .curve import Curve, behind
from .measured_maps import groups_of, is_measured, widened
from .pixel_law import NoiseLaw
from .stage import Chain, Converter

FARTHEST = 6.0
"""How far out the nodes lie [σ]."""

TURNING = 0.01
"""Noise is taken apart where the slope changes by more than so much of it within 2σ."""

RESTS = 0.25, 0.1, 0.04, 0.015
"""σ of the narrow normals as a share of the noise: the first that leaves its tangent by less than LEAVING of the noise
within 2σ."""

LEAVING = 2e-3

ALONE: Float64Array = np.ones(1)

MOST = 1_500_000
"""Values at most: noise is not taken apart further."""


MOST_OF_MAPS, HIDDEN = 300_000, 0.3
"""Values at most in the groups of measured maps; share of the noise below which it hides what differs in a group."""


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
        weights /= weights.sum()
        return cls(z * np.sqrt((1 - rest**2) / (weights @ z**2)), weights, rest)


PARTINGS = tuple(map(Parting.of, RESTS))


@dataclass(frozen=True, eq=False)
class Swing:
    """Normals for every count, node of the temporal noise and node of what is fixed.

    m : mean and variances, (C, T·S).  temporal, fixed : (T,), (S,) weights of the nodes.
    """

    m: Moments
    temporal: Float64Array
    fixed: Float64Array

    @classmethod
    def behind(cls, stages: Chain, converter: Converter, counts: Float64Array, frame: Frame) -> Swing:
        """Of these counts behind these stages, in front of the converter."""
        found = cls(Moments(counts[:, None], np.zeros((1, 1)), np.zeros((1, 1)), frame), ALONE, ALONE)
        maps: Chain = ()  # with measured maps, and gains behind them
        for number, stage in enumerate(stages):
            law, measured = stage.noise_law(frame), is_measured(stage, frame.window)
            if maps and (stage.curved or law is not None):
                found, maps = found._in_groups(maps), ()
            if stage.curved:
                curve = Curve(stage, converter, stages[number + 1 :], frame)
                found = found._apart(curve)
            if measured or (maps and stage.nominal_gain != 1):
                maps += (stage,)
            if not measured and law is None:
                m = behind(stage, found.m)
                found = replace(found, m=curve.beyond(found.m, m) if stage.curved else m)
            elif law is not None:
                found = found._with(law)
        return found._in_groups(maps) if maps else found

    @cached_property
    def parts(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Mean, temporal and spatial variance, (C, T, S)."""
        counts = np.shape(self.m.mean)[0]
        flat, shape = (counts, self.temporal.size * self.fixed.size), (counts, self.temporal.size, self.fixed.size)
        mean, temporal, spatial = (
            np.broadcast_to(x, flat).reshape(shape) for x in (self.m.mean, self.m.temporal, self.m.spatial)
        )
        return mean, temporal, spatial

    def of_counts(self, rows: slice | NDArray[np.intp]) -> Swing:
        """Of some of the counts."""
        mean, temporal, spatial = (x[rows].reshape(-1, self.temporal.size * self.fixed.size) for x in self.parts)
        return replace(self, m=replace(self.m, mean=mean, temporal=temporal, spatial=spatial))

    def of_kinds(self, kinds: NDArray[np.bool_], states: slice) -> Swing:
        """Some of the kinds of pixels, in some of the states."""
        temporal, fixed = self.temporal[states] / self.temporal[states].sum(), self.fixed[kinds]
        flat = [x[:, states, kinds].reshape(x.shape[0], -1) for x in self.parts]
        return Swing(replace(self.m, mean=flat[0], temporal=flat[1], spatial=flat[2]), temporal, fixed)

    def _with(self, law: NoiseLaw) -> Swing:
        """Noise of its own in every kind of pixels, which are fixed."""
        mean, temporal, spatial = (x[:, :, None, :, None] for x in self.parts)  # (C, T, steps, S, kinds)
        moved = mean + law.steps.T[:, None, :]
        more, same = (np.broadcast_to(x, moved.shape) for x in (temporal + law.variances.T[:, None, :], spatial))
        weights = [np.outer(*both).ravel() for both in ((self.temporal, law.states), (self.fixed, law.weights))]
        flat = [x.reshape(moved.shape[0], -1) for x in (moved, more, same)]
        return Swing(replace(self.m, mean=flat[0], temporal=flat[1], spatial=flat[2]), *weights)

    def _in_groups(self, maps: Chain) -> Swing:
        """In groups of pixels that are alike; what is left inside of a group is normal where no noise hides it."""
        mean, temporal, spatial = (x[..., None] for x in self.parts)  # (C, T, S, groups)
        blur = float(np.sqrt(spatial.min()))
        weights, gains, offsets, of_gains, rest = groups_of(maps, self.m.frame.window, MOST_OF_MAPS // mean.size, blur)
        left = float(weights @ rest)
        if not spatial.any() and not of_gains.any() and left < HIDDEN**2 * temporal.min():
            variance = left + float(weights @ (offsets - weights @ offsets) ** 2)
            offsets, rest = widened(offsets, weights, variance), np.zeros(rest.size)
        moved, fixed = gains * mean + offsets, gains**2 * spatial + of_gains * mean**2 + rest
        parts = moved, *(np.broadcast_to(x, moved.shape) for x in (gains**2 * temporal, fixed))
        flat = [x.reshape(moved.shape[0], -1) for x in parts]
        kinds = np.outer(self.fixed, weights).ravel()
        return Swing(replace(self.m, mean=flat[0], temporal=flat[1], spatial=flat[2]), self.temporal, kinds)

    def _apart(self, curve: Curve) -> Swing:
        """With nodes for what is wide beside the curve."""
        mean, *variances = self.parts  # (C, T, S)
        weights = [self.temporal, self.fixed]
        for axis in (0, 1):
            sigma = np.sqrt(variances[axis])
            coarsest, *finer = PARTINGS  # which may be twice as large
            fitting = [coarsest] if mean.size * coarsest.z.size <= 2 * MOST else []
            fitting += [one for one in finer if mean.size * one.z.size <= MOST]
            if curve.bend(mean, sigma) <= TURNING or not fitting:
                continue
            fine = (one for one in fitting if curve.leaves(mean, sigma, one.z, one.rest) <= LEAVING)
            parting = next(fine, fitting[-1])
            shape = (mean.shape[0], -1, mean.shape[2]) if axis == 0 else (*mean.shape[:2], -1)
            z = parting.z.reshape((-1, 1) if axis == 0 else (-1,))
            centre, sigma, other = (np.expand_dims(x, axis + 2) for x in (mean, sigma, variances[1 - axis]))
            moved = centre + sigma * z
            rest, same = (np.broadcast_to(x, moved.shape) for x in ((parting.rest * sigma) ** 2, other))
            mean, variances[axis], variances[1 - axis] = (x.reshape(shape) for x in (moved, rest, same))
            weights[axis] = np.outer(weights[axis], parting.weights).ravel()
        flat = [x.reshape(mean.shape[0], -1) for x in (mean, *variances)]
        return Swing(replace(self.m, mean=flat[0], temporal=flat[1], spatial=flat[2]), *weights)
