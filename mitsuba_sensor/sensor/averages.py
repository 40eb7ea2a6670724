"""Averages of a tabulated function of mean electrons over the law of a stage in front of the shot noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
import scipy

from ..core.types import Float64Array, NumpyArray
from .interpolation import interpolation
from .pixel_law import COARSE, FINE, PixelLaw, Quantiles


class Average(Protocol):
    """(nodes, stages, 3), mean and variances behind some stages → the same in front of one of them."""

    @property
    def has_states(self) -> bool:
        """Whether pixels switch between states."""

    def averaged(
        self, values: Float64Array, modes: Float64Array | None = None, of_dark: Float64Array | None = None
    ) -> Float64Array:
        """Means average; the spread of the means adds to a variance.

        modes : (nodes, J) how the mean behind the last stage follows the fixed offsets there, at J of them; without
            them all states of a pixel are taken to follow in the same way.
        of_dark : the values of dark electrons, where they are others than those of light. What gains act on is light.
        """


def average_over(law_at: Callable[[Quantiles], PixelLaw], nodes: Float64Array, end_e: float, gap_e: float) -> Average:
    """The average over a law.

    end_e : where the pixel is full.  gap_e : a law whose quantiles lie closer than this before the end is a sum over
        them; a wider one is an integral over its distribution, for no quantile may hit the noise next to the end.
    """
    law = law_at(COARSE)
    if law.states.size > 1 or law.gains.ndim != 2 or law.weights.size == 1:
        return ByQuantiles.of(law, nodes)
    of_gains = bool(np.ptp(law.gains) > 0)
    values = np.sort((law.gains if of_gains else law.offsets)[:, 0])
    gaps = np.diff(values) * (end_e / np.maximum(values[1:], 1e-300) if of_gains else 1.0)
    if np.max(gaps[values[:-1] < (np.inf if of_gains else end_e)], initial=0.0) <= gap_e:
        return ByQuantiles.of(law, nodes)
    return ByDistribution.of(law_at(FINE), nodes, of_gains)


@dataclass(frozen=True, eq=False)
class ByQuantiles:
    """Sums over the kinds of pixels and their states."""

    law: PixelLaw
    matrix: scipy.sparse.csr_array
    nodes: int
    light: Float64Array

    @property
    def has_states(self) -> bool:
        """Whether pixels switch between states."""
        return self.law.states.size > 1

    @classmethod
    def of(cls, law: PixelLaw, nodes: Float64Array) -> ByQuantiles:
        """Look-ups at gain·x + offset for every node, kind and state."""
        at = np.maximum(law.gains * nodes[:, None, None] + law.offsets, 0.0)
        gained = law.gains * nodes[:, None, None] if np.any(law.gains) else at
        share = np.divide(gained, at, out=np.ones(at.shape), where=at > 0)
        return cls(law, interpolation(nodes, at.ravel()), nodes.size, np.clip(share, 0.0, 1.0).reshape(-1, 1))

    def averaged(
        self, values: Float64Array, modes: Float64Array | None = None, of_dark: Float64Array | None = None
    ) -> Float64Array:
        """What is fixed is shared by all states of a pixel."""
        weights, states = self.law.weights, self.law.states
        if not self.has_states:
            return self._of_one_state(values, of_dark)
        at = self.matrix @ values.reshape(self.nodes, -1)
        if of_dark is not None:
            at = self.light * at + (1 - self.light) * (self.matrix @ of_dark.reshape(self.nodes, -1))
        found = at.reshape(self.nodes, weights.size, states.size, -1, 3)
        mean, temporal, spatial = (found[..., k] for k in range(3))
        own = np.einsum("nkst,s->nkt", mean, states)
        flicker = np.einsum("nkst,s->nkt", temporal + (mean - own[:, :, None]) ** 2, states)
        spatial = np.maximum(spatial, 0.0)
        sigma = np.sqrt(spatial)
        shared = np.einsum("nkst,s->nkt", sigma, states) ** 2
        if modes is not None:
            seen = (self.matrix @ modes).reshape(self.nodes, weights.size, states.size, -1)
            seen /= np.maximum(np.sqrt(np.einsum("nksj,nksj->nks", seen, seen)), 1e-150)[..., None]
            together = np.einsum("nksj,nks,s->nkj", seen, sigma[..., -1], states)
            shared[..., -1] = np.minimum(np.einsum("nkj,nkj->nk", together, together), shared[..., -1])
        flicker += np.maximum(np.einsum("nkst,s->nkt", spatial, states) - shared, 0.0)  # steps that offsets change
        average = np.einsum("nkt,k->nt", own, weights)
        spread = np.einsum("nkt,k->nt", shared + (own - average[:, None]) ** 2, weights)
        return np.stack([average, np.einsum("nkt,k->nt", flicker, weights), spread], axis=-1)

    @cached_property
    def _over_kinds(self) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
        """(nodes, nodes): averages over the kinds of pixels, of the share that is light and of the rest."""
        pointers = np.arange(0, self.matrix.shape[0] + 1, self.law.weights.size)
        columns, weights = np.arange(self.matrix.shape[0]), np.tile(self.law.weights, self.nodes)
        shares = self.light[:, 0], 1 - self.light[:, 0]
        of_light, rest = (
            scipy.sparse.csr_array((weights * share, columns, pointers), shape=(self.nodes, columns.size)) @ self.matrix
            for share in shares
        )
        return of_light, rest

    def _of_one_state(self, values: Float64Array, of_dark: Float64Array | None) -> Float64Array:
        """The same where pixels keep their state: all but the squares of the means is linear in the values."""
        of_light, rest = self._over_kinds
        dark = values if of_dark is None else of_dark
        flat, flat_dark = (x.reshape(self.nodes, -1) for x in (values, dark))
        found = (of_light @ flat + rest @ flat_dark).reshape(values.shape)
        mean = self.matrix @ values[..., 0]
        if of_dark is not None:
            mean = self.light * mean + (1 - self.light) * (self.matrix @ of_dark[..., 0])
        off = mean.reshape(self.nodes, self.law.weights.size, -1) - found[:, None, :, 0]
        found[..., 2] = np.maximum(found[..., 2], 0.0) + self.law.weights @ off**2
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class ByDistribution:
    """Integrals over the intervals between the nodes, in each of which the function is a straight line.

    nodes : of mean electrons.  of_gains : whether the law is one of gains, else of offsets.
    mass, first, second : (nodes, intervals), moments 0, 1, 2 of the place in the interval, 0 … 1.
    below, above : (nodes,) share of the pixels below the first and above the last node.
    """

    nodes: Float64Array
    of_gains: bool

    mass: Float64Array
    first: Float64Array
    second: Float64Array
    below: Float64Array
    above: Float64Array
    has_states: ClassVar[bool] = False

    @classmethod
    def of(cls, law: PixelLaw, nodes: Float64Array, of_gains: bool) -> ByDistribution:
        """The distribution is even between the middles of the quantiles."""
        values = (law.gains if of_gains else law.offsets)[:, 0]
        order = np.argsort(values, kind="stable")
        borders, weights = _borders(values[order], law.weights[order])
        x = nodes[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            edges = np.where(x > 0, nodes / x, np.where(nodes > 0, np.inf, 0.0)) if of_gains else nodes - x
            partial = _partial_moments(edges, borders, weights)
            mass, one, two = (np.diff(part, axis=1) for part in partial)
            start, width = edges[:, :-1], np.diff(edges, axis=1)
            first = np.where(mass > 0, (one - start * mass) / width, 0.0)
            second = np.where(mass > 0, (two - 2 * start * one + start**2 * mass) / width**2, 0.0)
        first = np.clip(np.nan_to_num(first), 0.0, mass)
        second = np.clip(np.nan_to_num(second), 0.0, first)
        above = np.where(edges[:, -1] >= borders[-1], 0.0, 1 - partial[0][:, -1])  # no rounding error far above the end
        return cls(nodes, of_gains, mass, first, second, partial[0][:, 0], above)

    @cached_property
    def _weights(self) -> tuple[scipy.sparse.csr_array, ...]:
        """Of both ends of the intervals in a mean; of their squares and product in a mean square. Most are zero."""
        mass, first, second = self.mass, self.first, self.second
        weights = mass - first, first, mass - 2 * first + second, 2 * (first - second), second
        return tuple(scipy.sparse.csr_array(x) for x in weights)

    def averaged(
        self, values: Float64Array, modes: Float64Array | None = None, of_dark: Float64Array | None = None
    ) -> Float64Array:
        """Mean and variances in front of the stage: linear in the light at a sum of light and dark."""
        base, per_light = values, np.zeros(values.shape)
        apart = of_dark is not None and not self.of_gains
        if of_dark is not None and apart:
            base = of_dark
            np.divide(values - of_dark, self.nodes[:, None, None], out=per_light, where=self.nodes[:, None, None] > 0)
        x: Float64Array = self.nodes[:, None]
        result: NumpyArray = self._mean(base) + (x[..., None] * self._mean(per_light) if apart else 0.0)
        reference = result[result.shape[0] // 2, :, 0]
        fixed, more = base[:, :, 0] - reference, per_light[:, :, 0]
        square = self._product(fixed, fixed)
        if apart:
            square += 2 * x * self._product(fixed, more) + x**2 * self._product(more, more)
        result[:, :, 2] += np.maximum(square - (result[:, :, 0] - reference) ** 2, 0.0)
        return result

    def _mean(self, values: Float64Array) -> Float64Array:
        """Of a function that is a straight line between the nodes, (nodes, …)."""
        flat = values.reshape(values.shape[0], -1)
        lower, upper, *_ = self._weights
        found = lower @ flat[:-1] + upper @ flat[1:]
        found += self.below[:, None] * flat[0] + self.above[:, None] * flat[-1]
        return np.asarray(found.reshape(values.shape))

    def _product(self, one: Float64Array, other: Float64Array) -> Float64Array:
        """Mean of the product of two such functions, (nodes, stages)."""
        *_, below, both, above = self._weights
        (a, b), (c, d) = (one[:-1], one[1:]), (other[:-1], other[1:])
        found = below @ (a * c) + both @ (0.5 * (a * d + b * c)) + above @ (b * d)
        found += self.below[:, None] * one[0] * other[0] + self.above[:, None] * one[-1] * other[-1]
        return np.asarray(found)


def _borders(values: Float64Array, weights: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Borders of the intervals of rising quantiles, and their weights.

    Equal values at the lower end are pixels that a law has cut to it; what is next to them begins half a step below.
    """
    borders = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    cut = int(np.searchsorted(values, values[0], side="right"))
    if cut < 2 or cut > values.size - 2:
        return borders, weights
    start = max(values[0], 1.5 * values[cut] - 0.5 * values[cut + 1])
    borders = np.concatenate([borders[:cut], [values[0], start], borders[cut + 1 :]])
    return borders, np.insert(weights, cut, 0.0)


def _partial_moments(at: Float64Array, borders: Float64Array, weights: Float64Array) -> tuple[Float64Array, ...]:
    """Moments 0, 1, 2 of all that lies below each place, for a law that is even between its borders."""
    low, high = borders[:-1], borders[1:]
    sums = [weights, weights * (low + high) / 2, weights * (low**2 + low * high + high**2) / 3]
    whole = [np.concatenate([[0.0], np.cumsum(part)]) for part in sums]
    beyond = at >= borders[-1]
    found = tuple(np.where(beyond, part[-1], 0.0) for part in whole)
    within = (at >= borders[0]) & ~beyond  # all of an atom at the first border lies at it, not below
    place = at[within]
    j = np.clip(np.searchsorted(borders, place, side="right") - 1, 0, weights.size - 1)
    width = high[j] - low[j]
    part = weights[j] * np.where(width > 0, (place - low[j]) / np.where(width > 0, width, 1.0), 1.0)
    found[0][within] = whole[0][j] + part
    found[1][within] = whole[1][j] + part * (low[j] + place) / 2
    found[2][within] = whole[2][j] + part * (low[j] ** 2 + low[j] * place + place**2) / 3
    return found
