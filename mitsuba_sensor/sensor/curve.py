"""A curved stage between noise and the converter: when noise is taken apart in front of it, and what is behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from ..core import Frame, Moments
from ..core.types import Float64Array
from .stage import Chain, Converter, Stage

CURVED_DN = 0.01
"""Noise is taken apart where the curve leaves its tangent by more than this within 2σ."""

HUGE = 1e60
"""A swing [V] so far beyond every converter that its noise does not matter."""

BEYOND, HALVINGS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0), 5
"""Distances from the mean at which it is asked whether a signal is on the scale of the converter [σ], and how often the
distance between two of them is halved."""

ADDED = 4.0
"""So many σ of what is added behind a curve can bring a signal back onto the scale."""


def behind(stage: Stage, m: Moments) -> Moments:
    """Moments behind a stage; means at HUGE where a curve has left all numbers: there noise changes no code."""
    if not stage.curved:
        return stage.moments(m)
    with np.errstate(over="ignore", invalid="ignore"):
        m = stage.moments(m)
    lost = ~(np.abs(m.mean) < HUGE)
    mean = np.where(lost, np.copysign(HUGE, np.nan_to_num(m.mean, nan=1.0)), m.mean)
    temporal, spatial = (np.where(lost, 0.0, x) for x in (m.temporal, m.spatial))
    return replace(m, mean=mean, temporal=temporal, spatial=spatial)


@dataclass(frozen=True, eq=False)
class Curve:
    """A curved stage.  after : the stages between it and the converter."""

    stage: Stage
    converter: Converter
    after: Chain
    frame: Frame

    @cached_property
    def later(self) -> float:
        """Nominal gain between it and the converter."""
        return math.prod(one.nominal_gain for one in self.after)

    @cached_property
    def margin_dn(self) -> float:
        """What noise and offsets behind it can move a signal by, at full scale."""
        per_v = self.converter.gain_dn_per_v
        full = (self.converter.highest - self.converter.black_level_dn) / per_v / self.later
        m = reduce(lambda m, stage: behind(stage, m), self.after, Moments(full, 0.0, 0.0, self.frame))
        return ADDED * per_v * math.sqrt(float(np.max(m.temporal)) + float(np.max(m.spatial)))

    def bend(self, mean: Float64Array, sigma: Float64Array) -> float:
        """The largest change of the slope within 2σ, as a share of it, where that shows in the codes."""
        x = [part.reshape(mean.shape[0], -1) for part in (mean - 2 * sigma, mean, mean + 2 * sigma)]
        with np.errstate(over="ignore", invalid="ignore"):
            low, centre, high = (self._dn(part) for part in x)
            away = np.abs(high - 2 * centre + low)
            bend = away / np.maximum(np.abs(high - centre) + np.abs(centre - low), 1e-300)
            ends = np.maximum(np.maximum(low, high), centre), np.minimum(np.minimum(low, high), centre)
            shown = (away > CURVED_DN) & (ends[0] > -1) & (ends[1] < self.converter.highest + 1)
        return float(np.max(bend[shown], initial=0.0))

    def leaves(self, mean: Float64Array, sigma: Float64Array, nodes: Float64Array, rest: float) -> float:
        """How far the curve leaves its tangent within 2σ of the rest about the nodes, in noise: at most, where that is
        on the scale.  nodes, rest : as shares of σ."""
        middle = np.unique(np.linspace(0, mean.shape[0] - 1, 9).astype(int))
        wide = sigma[middle].reshape(middle.size, -1, 1)
        x = mean[middle].reshape(middle.size, -1, 1) + wide * nodes[np.abs(nodes) < 3.5]
        with np.errstate(over="ignore", invalid="ignore"):
            low, centre, high = (self._dn(x + part * rest * wide) for part in (-2, 0, 2))
            away = np.abs(high - 2 * centre + low) / 2
            scale = self.converter.gain_dn_per_v * self.later * np.maximum(wide, 1e-300)
            on = (np.maximum(low, high) > -1) & (np.minimum(low, high) < self.converter.highest + 1)
            shown = on & (away > CURVED_DN)
        return float(np.max((away / scale)[shown], initial=0.0))

    def beyond(self, before: Moments, m: Moments) -> Moments:
        """Behind the curve. Of a normal beyond an end of the converter, or far wider than it, only a part is on its
        scale, and follows the curve there and not about the mean; one that does not reach the scale has no noise."""
        sigma = np.sqrt(before.temporal + before.spatial)
        x, sigma, *was = (np.array(y) for y in np.broadcast_arrays(before.mean, sigma, before.temporal, before.spatial))
        mean, *found = (np.array(np.broadcast_to(y, x.shape)) for y in (m.mean, m.temporal, m.spatial))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            side = self._side(x)
            off = (side != 0) & (sigma > 0)
            wide = (side == 0) & (self._side(x - sigma) != 0) & (self._side(x + sigma) != 0)
            for some, (slope, value) in (
                (off, self._tails(x[off], sigma[off])),
                (wide, self._middle(x[wide], sigma[wide])),
            ):
                mean[some] = np.clip(np.nan_to_num(value), -HUGE, HUGE)
                for one, variance in zip(found, was, strict=True):
                    one[some] = slope**2 * variance[some]
        return replace(m, mean=mean, temporal=found[0], spatial=found[1])

    def _tails(self, x: Float64Array, sigma: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Slope of the line along which tails come onto the scale from beyond, and its value at the mean.

        Where they do not, the slope is 0, and the value that of the curve.
        """
        there, inner, outer = self._side(x), np.zeros(x.size), np.zeros(x.size)
        for k, before in zip(BEYOND[::-1], (*BEYOND[-2::-1], 0.0), strict=True):
            for way in (-1.0, 1.0):
                left = self._side(x + way * k * sigma) != there
                outer[left], inner[left] = way * k, way * before
        reached = outer != 0
        for _ in range(HALVINGS):
            middle = 0.5 * (inner + outer)
            still = self._side(x + middle * sigma) == there
            inner, outer = np.where(still, middle, inner), np.where(still, outer, middle)
        start, value = x + outer * sigma, self._volts(x)
        step = sigma * np.sign(outer) / np.maximum(np.abs(outer), 1.0)  # a tail ends so soon
        at_end = self._volts(start)
        step = self._within(self._volts(start + step) - at_end, step)
        slope = (self._volts(start + step) - at_end) / step
        leaves = reached & np.isfinite(slope) & (slope * (x - start) * (value - at_end) > 0)
        return np.where(leaves, slope, 0.0), np.where(leaves, at_end + slope * (x - start), value)

    def _middle(self, x: Float64Array, sigma: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Slope of the curve about these means, as far as the scale goes, and its values."""
        step = self._within(self._volts(x + sigma) - self._volts(x - sigma), sigma)
        return (self._volts(x + step) - self._volts(x - step)) / (2 * step), self._volts(x)

    def _within(self, change_v: Float64Array, step: Float64Array) -> Float64Array:
        """A step as far as the scale goes.  change_v : over this one."""
        scale_v = (self.converter.highest + 2) / (self.converter.gain_dn_per_v * self.later)
        return step * np.minimum(scale_v / np.abs(change_v), 1.0)

    def _side(self, swing: Float64Array) -> Float64Array:
        """1 above the scale of the converter, −1 below it, 0 on it, or where what is added behind brings it there."""
        dn = self._dn(swing)
        above, below = dn >= self.converter.highest + 1 + self.margin_dn, dn <= -1 - self.margin_dn
        return np.where(np.isnan(dn) | above, 1.0, np.where(below, -1.0, 0.0))

    def _volts(self, swing: Float64Array) -> Float64Array:
        return np.asarray(self.stage.moments(Moments(swing, 0.0, 0.0, self.frame)).mean)

    def _dn(self, swing: Float64Array) -> Float64Array:
        """About the code of a swing in front of the curve."""
        return np.asarray(
            self.converter.black_level_dn + self.converter.gain_dn_per_v * self.later * self._volts(swing)
        )
