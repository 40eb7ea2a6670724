"""Swing of a pixel on its way to the converter: a sum of normals, taken apart in front of a curved stage.

A curved stage turns a normal of narrow noise into another one, by second order. Where the noise is wide beside the
curve it is cut into cells first, each of which is narrow: evenly spaced ones, and some of equal steps of the code.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core import Frame, Moments
from ..core.types import Float64Array
from ..stages.stage import Converter, Stage

STRAIGHT_DN = 0.02
"""A curve that changes the code by less than this within 2σ leaves a normal a normal."""

HUGE_V = 1e60
"""A swing so far beyond every converter that its noise does not matter."""

FARTHEST = 7.0
"""Noise is taken apart up to so many σ from its mean."""

EVEN_CELLS, SEEN_CELLS = 28, 48
"""Cells of equal width between these ends, and cells of equal steps of the code."""

CELLS = EVEN_CELLS + SEEN_CELLS + 1
"""All of them, at most."""

GROWING = np.geomspace(1e-9, 1300.0, 1200)
SEARCHED: Float64Array = np.concatenate([-GROWING[::-1], [0.0], GROWING])
"""Swings, in full scales of the converter, at which the code behind the curve is looked at."""


class Normals(NamedTuple):
    """Normals of which the law of each pixel is the sum.

    chances, means, variances : (M, P) or what broadcasts to it; the chances of a pixel add up to 1.
    """

    chances: Float64Array
    means: Float64Array
    variances: Float64Array


def cells_between(
    edges: Float64Array, mass: Float64Array, first: Float64Array, second: Float64Array
) -> Normals:
    """Chances, means and variances of the cells of a law, (K, P).

    mass, first, second : moments 0, 1 and 2 of the part of it that lies below each edge, (K + 1, P).
    """
    mass, first, second = (np.diff(sums, axis=0) for sums in (mass, first, second))
    mass = np.maximum(mass, 0.0)
    filled = mass > 1e-300
    mean = np.divide(first, mass, out=np.zeros(mass.shape), where=filled)
    square = np.divide(second, mass, out=np.zeros(mass.shape), where=filled)
    mean = np.clip(mean, edges[:-1], edges[1:])
    variance = np.where(filled, np.maximum(square - mean**2, 0.0), 0.0)
    return Normals(mass / mass.sum(axis=0), mean, variance)


def pass_curve(stage: Stage, normals: Normals, frame: Frame) -> Normals:
    """Normals behind a curved stage that changes none of them much.

    Means that leave all numbers are at HUGE_V: noise there changes no code.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        m = stage.moments(Moments(normals.means, normals.variances, 0.0, frame))
    lost = ~(np.abs(m.mean) < HUGE_V)
    means = np.where(lost, np.copysign(HUGE_V, np.nan_to_num(m.mean, nan=1.0)), m.mean)
    variances = np.where(lost, 0.0, m.temporal)
    return Normals(normals.chances, means, variances)


class Curve(NamedTuple):
    """A curved stage and what it leads to.

    later_gain : nominal gain of the stages between it and the converter.
    later_noise_dn : largest σ of the noise that they add [DN].
    """

    stage: Stage
    converter: Converter
    frame: Frame
    later_gain: float
    later_noise_dn: float

    def excess_dn(
        self, means: Float64Array, variances: Float64Array, inside: NDArray[np.bool_]
    ) -> Float64Array:
        """How far the code leaves its tangent within 2σ, where it may show, (P,) [DN]; the most over axis 0.

        inside : where the converter cuts nothing; there a normal may become a parabola of it, whose moments are known.
        """
        sigma = np.sqrt(variances)
        steps = np.array([-FARTHEST, -2.0, -1.0, 0.0, 1.0, 2.0, FARTHEST]).reshape(
            7, *([1] * np.ndim(means))
        )
        with np.errstate(over="ignore", invalid="ignore"):
            dn = np.nan_to_num(
                self._dn(means + steps * sigma), nan=HUGE_V, posinf=HUGE_V, neginf=-HUGE_V
            )
            third = np.abs(dn[5] - 2 * dn[4] + 2 * dn[2] - dn[1])
            second = np.abs(dn[5] - 2 * dn[3] + dn[1]) / 2
            reach = FARTHEST * (
                np.abs(dn[4] - dn[2]) / 2 + second
            )  # of the normal that it would be taken for
        highest = np.maximum(dn.max(axis=0), dn[3] + reach)
        lowest = np.minimum(dn.min(axis=0), dn[3] - reach)
        seen = (highest > -1) & (lowest < self.converter.highest + 1)
        excess = np.where(inside, third, np.maximum(second, third))
        return np.asarray(np.where(seen & (sigma > 0), excess, 0.0).max(axis=0))

    def take_apart(self, normals: Normals) -> Normals:
        """The same law as a sum of narrow normals, one for each cell of the swing."""
        chances, means, variances = np.broadcast_arrays(*normals)
        centre = np.sum(chances * means, axis=0)
        spread = np.sqrt(np.sum(chances * (variances + (means - centre) ** 2), axis=0))
        spread = np.maximum(spread, 1e-300)
        edges = self._edges(centre, spread)
        mass, first, second = (np.zeros(edges.shape) for _ in range(3))
        for chance, mean, variance in zip(
            chances, (means - centre) / spread, variances / spread**2, strict=True
        ):
            below, shifted, squared = _partial_moments(edges, mean, np.sqrt(variance))
            mass += chance * below
            first += chance * shifted
            second += chance * squared
        shares, mean, variance = cells_between(edges, mass, first, second)
        seen = self._is_seen(centre + spread * edges)
        variance = np.where(seen, variance, 0.0)
        return Normals(shares, centre + spread * mean, spread**2 * variance)

    def _edges(self, centre: Float64Array, spread: Float64Array) -> Float64Array:
        """Edges of the cells [σ about the centre], (K + 1, P)."""
        even = np.linspace(-FARTHEST, FARTHEST, EVEN_CELLS + 1)[:, None] + np.zeros(
            centre.shape
        )
        within = (self._seen_edges()[:, None] - centre) / spread
        even = np.concatenate([even, np.clip(within, -FARTHEST, FARTHEST)])
        even = np.sort(even, axis=0)
        even[0], even[-1] = -2 * FARTHEST, 2 * FARTHEST
        return even

    def _is_seen(self, edges: Float64Array) -> NDArray[np.bool_]:
        """Whether the code of a cell depends on where in it the swing is, (K, P): not where both edges are beyond one
        end of the converter."""
        margin = 1 + 6 * self.later_noise_dn  # less than where the last edges are
        with np.errstate(over="ignore", invalid="ignore"):
            dn = np.nan_to_num(self._dn(edges), nan=HUGE_V, posinf=HUGE_V, neginf=-HUGE_V)
        below, above = dn < -margin, dn > self.converter.highest + margin
        return ~((below[1:] & below[:-1]) | (above[1:] & above[:-1]))

    def _seen_edges(self) -> Float64Array:
        """Swings in front of the curve between which the code that the converter gives changes by the same [V]."""
        full_v = self.converter.highest / (self.converter.gain_dn_per_v * self.later_gain)
        swings = full_v * SEARCHED
        margin = 2 + 6 * self.later_noise_dn
        with np.errstate(over="ignore", invalid="ignore"):
            dn = np.nan_to_num(self._dn(swings), nan=0.0)
        seen = np.clip(dn, -margin, self.converter.highest + margin)
        travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(seen)))])
        travelled += np.linspace(
            0.0, 1e-9 * max(travelled[-1], 1.0), travelled.size
        )  # rising everywhere
        return np.interp(np.linspace(0.0, travelled[-1], SEEN_CELLS + 1), travelled, swings)

    def _dn(self, swing: Float64Array) -> Float64Array:
        """About the code that a swing in front of the curve becomes."""
        behind = self.stage.moments(Moments(swing, 0.0, 0.0, self.frame)).mean
        return np.asarray(
            self.converter.black_level_dn
            + self.converter.gain_dn_per_v * self.later_gain * behind
        )


def _partial_moments(
    edges: Float64Array, mean: Float64Array, sigma: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Moments 0, 1 and 2 of the part of a normal that lies below each edge, (K, P)."""
    noisy = sigma > 0
    u = np.where(
        noisy, (edges - mean) / np.where(noisy, sigma, 1.0), np.where(edges > mean, 40.0, -40.0)
    )
    below, density = scipy.special.ndtr(u), np.exp(-0.5 * u * u) / math.sqrt(2 * math.pi)
    first = mean * below - sigma * density
    second = (mean**2 + sigma**2) * below - sigma * (mean + edges) * density
    return below, first, second
