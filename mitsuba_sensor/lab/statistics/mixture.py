"""Maximum likelihood of a main distribution with uniform and normal distributions superimposed, with their weights."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...core.types import Float64Array
from .families import FAMILIES, Family, Normal, Parameters

STEPS, STEPS_OF_AN_EDGE, STEPS_AT_THE_END = 60, 6, 300
"""Steps of expectation and maximisation: before the edges of the uniform part, for each candidate edge, and after."""
CANDIDATES, CLOSER, BISECTIONS = 12, 4, 14
"""Edges of the uniform part that are tried at a time, how often ever closer to the best one, and for an interval."""
NARROWEST = 0.01
"""Width of the uniform part over the range, below which its edges stay: narrow ones have any likelihood."""
NORMAL = Normal()


@dataclass(frozen=True)
class Mixture:
    """(1 − Σw)·main + w_uniform·U[low, high] + w_normal·N(µ, σ); a weight of None leaves a part out.

    main : its family and parameters.  uniform, normal : weight and parameters of the superimposed parts.
    """

    family: Family
    main: Parameters
    uniform: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None

    @property
    def main_weight(self) -> float:
        """The weight that is left for the main distribution."""
        return 1 - sum(part[0] for part in (self.uniform, self.normal) if part)

    def densities(self, x: Float64Array) -> Float64Array:
        """Densities of main, uniform and normal part, each times its weight, (parts, n) [1/DN]."""
        rows = [self.main_weight * np.exp(self.family.log_density(x, self.main))]
        if self.uniform:
            weight, low, high = self.uniform
            rows.append(np.where((x >= low) & (x <= high), weight / (high - low), 0.0))
        if self.normal:
            rows.append(self.normal[0] * np.exp(NORMAL.log_density(x, self.normal[1:])))
        return np.array(rows)

    def density(self, x: Float64Array) -> Float64Array:
        """Density of the whole mixture [1/DN]."""
        return np.asarray(self.densities(x).sum(axis=0))

    def below(self, x: Float64Array) -> Float64Array:
        """Share of the values up to x."""
        share = self.main_weight * self.family.below(x, self.main)
        if self.uniform:
            weight, low, high = self.uniform
            share = share + weight * np.clip((x - low) / (high - low), 0, 1)
        if self.normal:
            share = share + self.normal[0] * NORMAL.below(x, self.normal[1:])
        return np.asarray(share)

    def log_likelihood(self, x: Float64Array, w: Float64Array) -> float:
        """Logarithm of the likelihood of values x, each of which occurs w times."""
        return float(w @ np.log(np.maximum(self.density(x), 1e-300)))

    @property
    def values(self) -> list[float]:
        """All parameters: main, then weight, low, high and weight, µ, σ of the superimposed parts."""
        return [*self.main, *(self.uniform or ()), *(self.normal or ())]

    def with_values(self, values: list[float]) -> Mixture:
        """The same parts with these parameters."""
        uniform, normal = self.uniform, self.normal
        begin = len(self.main)
        main = tuple(values[:begin])
        if uniform:
            uniform = (values[begin], values[begin + 1], values[begin + 2])
            begin += 3
        if normal:
            normal = (values[begin], values[begin + 1], values[begin + 2])
        return replace(self, main=main, uniform=uniform, normal=normal)


def improved(mixture: Mixture, x: Float64Array, w: Float64Array, steps: int) -> Mixture:
    """The mixture after so many steps of expectation and maximisation; the edges of the uniform part stay."""
    total, before = float(w.sum()), -math.inf
    for _ in range(steps):
        parts = mixture.densities(x)
        whole = np.maximum(parts.sum(axis=0), 1e-300)
        likelihood = float(w @ np.log(whole))
        if likelihood - before < 1e-4:
            break
        before = likelihood
        shares = iter(parts / whole * w)
        main = mixture.family.fit(x, next(shares))
        uniform, normal = mixture.uniform, mixture.normal
        if uniform:
            uniform = (float(next(shares).sum()) / total, *uniform[1:])
        if normal:
            share = next(shares)
            weight = float(share.sum())
            centre, sigma = normal[1:]
            if weight > 1e-9 * total:
                centre, sigma = NORMAL.fit(x, share)
            normal = (weight / total, centre, sigma)
        mixture = replace(mixture, main=main, uniform=uniform, normal=normal)
    return mixture


def fitted_mixture(
    name: str, parts: tuple[str, ...], x: Float64Array, w: Float64Array
) -> Mixture:
    """The mixture of maximum likelihood.

    name : of the main family.  parts : of "uniform" and "normal".  x : sorted.
    """
    mixture = improved(_start(FAMILIES[name], parts, x, w), x, w, STEPS)
    if mixture.uniform:
        for edge in (1, 2, 1, 2):
            mixture = _move_edge(mixture, edge, x, w)
    return improved(mixture, x, w, STEPS_AT_THE_END)


def edge_interval(
    mixture: Mixture, edge: int, x: Float64Array, w: Float64Array
) -> tuple[float, float]:
    """Where the likelihood is more than 5 % of its largest: 95 % for an edge, at which the density jumps.

    edge : 1 for the lower one of the uniform part, 2 for the upper one.
    """
    assert mixture.uniform
    weight, low, high = mixture.uniform
    limit = mixture.log_likelihood(x, w) + math.log(0.05)
    beyond = 10 * (high - low) / max(weight * float(w.sum()), 10.0)
    farthest = (x[0] - beyond, high)
    if edge == 2:
        farthest = (low, x[-1] + beyond)
    ends = []
    for outside in farthest:
        inside = mixture.uniform[edge]
        for _ in range(BISECTIONS):
            middle = 0.5 * (inside + outside)
            moved = improved(_with_edge(mixture, edge, middle), x, w, STEPS_OF_AN_EDGE)
            if moved.log_likelihood(x, w) > limit:
                inside = middle
            else:
                outside = middle
        ends.append(float(outside))
    return ends[0], ends[1]


def _with_edge(mixture: Mixture, edge: int, value: float) -> Mixture:
    assert mixture.uniform
    uniform = list(mixture.uniform)
    uniform[edge] = float(value)
    return replace(mixture, uniform=(uniform[0], uniform[1], uniform[2]))


def _start(family: Family, parts: tuple[str, ...], x: Float64Array, w: Float64Array) -> Mixture:
    """Main from the middle of the values, the normal part where those outside are densest, the uniform all over."""
    order = np.cumsum(w) / w.sum()
    low, median, high = np.interp((0.25, 0.5, 0.75), order, x)
    sigma = max((high - low) / 1.349, 1e-9)
    inside = np.abs(x - median) < 4 * sigma
    outside = ~inside
    share = max(float(w[outside].sum() / w.sum()), 1e-6) / max(len(parts), 1)
    uniform = normal = None
    if "normal" in parts:
        begin, end = low, high
        if outside.any():
            counts, edges = np.histogram(x[outside], bins=64, weights=w[outside])
            densest = int(np.argmax(counts))
            begin, end = edges[densest], edges[densest + 1]
        normal = (share, 0.5 * float(begin + end), max(float(end - begin), sigma))
    if "uniform" in parts:
        uniform = (share, float(x[0]), float(x[-1]))
    return Mixture(family, family.fit(x[inside], w[inside]), uniform, normal)


def _move_edge(mixture: Mixture, edge: int, x: Float64Array, w: Float64Array) -> Mixture:
    """With the lower (1) or upper (2) edge of the uniform part that is likeliest, among ever closer candidates."""
    assert mixture.uniform
    first, last = x[0], mixture.uniform[2]
    if edge == 2:
        first, last = mixture.uniform[1], x[-1]
    step = (last - first) / CANDIDATES
    if last - first < NARROWEST * (x[-1] - x[0]):
        return mixture
    lowest, highest = first, last - step
    if edge == 2:
        lowest, highest = first + step, last
    low, high = lowest, highest
    best, likelihood, place = mixture, mixture.log_likelihood(x, w), mixture.uniform[edge]
    for _ in range(CLOSER):
        for candidate in np.linspace(low, high, CANDIDATES):
            moved = improved(_with_edge(best, edge, candidate), x, w, STEPS_OF_AN_EDGE)
            likelihood_there = moved.log_likelihood(x, w)
            if likelihood_there > likelihood:
                best, likelihood, place = moved, likelihood_there, float(candidate)
        low, high = max(lowest, place - step), min(highest, place + step)
        step = 2 * step / (CANDIDATES - 1)
    return best
