"""Code of a normal signal, on Dr.Jit: its expectation, and the logarithm of the chance of one code; with derivatives.

A signal x of mean m and standard deviation σ [DN] becomes floor(x + ½), clipped to 0 … H. With u_0 = m/σ and
u_H = (m − H)/σ

    E[code] = m·(Φ(u_0) − Φ(u_H)) + σ·(φ(u_0) − φ(u_H)) + H·Φ(u_H) + (φ(u_H) − φ(u_0))/(24σ)

from σ = 1 DN on: the integral over the steps and the first correction of Euler and Maclaurin, at both clips. For less
noise it is a sum over the steps next to the signal (core/code_slope.py). The chance of a code c between the clips is
Φ((c + ½ − m)/σ) − Φ((c − ½ − m)/σ); a clipped code has the tail of the normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ..core.code_slope import LARGEST_DN, ExpectedCode
from ..core.types import Array, DrJitModule

LEAST_DN = 1e-3
"""A smaller σ is set to this, so that nothing is divided by 0 [DN]."""

FAR = 5.0
"""Codes further from the signal than so many σ have the asymptote of their chance, which float32 would round to 0."""


class WithSlopes(NamedTuple):
    """A function of mean and standard deviation of a signal, and its derivatives by the two."""

    value: Array
    by_mean: Array
    by_sigma: Array


@dataclass(frozen=True, eq=False)
class NormalCode:
    """A converter behind normal noise.  highest : the largest code."""

    dr: DrJitModule
    highest: int

    def expected(self, mean: Array, sigma: Array) -> WithSlopes:
        """E[code], its derivatives, of signals without derivatives."""
        wide, narrow = self._wide(mean, sigma), self._narrow(mean, sigma)
        return WithSlopes(
            *(
                self.dr.select(sigma > LARGEST_DN, *both)
                for both in zip(wide, narrow, strict=True)
            )
        )

    def chance(self, codes: Array, mean: Array, sigma: Array) -> WithSlopes:
        """P(code), its derivatives, of signals without derivatives."""
        dr, s = self.dr, self.dr.maximum(sigma, LEAST_DN)
        low, high = (codes - 0.5 - mean) / s, (codes + 0.5 - mean) / s
        at_low, at_high = (self._density(u) for u in (low, high))
        bottom, top = codes <= 0, codes >= self.highest
        at_low, at_high = dr.select(bottom, 0.0, at_low), dr.select(top, 0.0, at_high)
        upper = (
            low + high > 0
        )  # the difference of two small tails is exact, of two near 1 it is not
        below = dr.select(upper, self._tail(low), self._tail(-low))
        above = dr.select(upper, self._tail(high), self._tail(-high))
        inside = dr.abs(below - above)
        chance = dr.select(bottom, self._tail(-high), dr.select(top, self._tail(low), inside))
        by_sigma = dr.select(bottom, 0.0, low * at_low) - dr.select(top, 0.0, high * at_high)
        return WithSlopes(chance, (at_low - at_high) / s, by_sigma / s)

    def log_chance(self, codes: Array, mean: Array, sigma: Array) -> Array:
        """ln P(code), with derivatives by autodiff, also where P is less than any float32."""
        dr = self.dr
        s = dr.maximum(sigma, LEAST_DN)
        nearest = (
            dr.select(
                codes <= 0, 0.5, dr.select(codes >= self.highest, self.highest - 0.5, codes)
            )
            - mean
        ) / s
        clipped = (codes <= 0) | (codes >= self.highest)
        outwards = dr.select(
            codes <= 0, -nearest, nearest
        )  # positive where the code is unlikely
        far = dr.select(clipped, outwards, dr.abs(nearest)) > FAR
        near = self._log_near(codes, mean, s, far)
        u = dr.select(far, nearest, FAR)
        scale = dr.select(clipped, dr.abs(u), s)
        tail = -0.5 * u * u - dr.log(scale * math.sqrt(2 * math.pi))
        return dr.select(far, tail, near)

    def _log_near(self, codes: Array, mean: Array, s: Array, far: Array) -> Array:
        """Within FAR: by the chance and its derivatives."""
        dr = self.dr
        chance, by_mean, by_sigma = self.chance(codes, dr.detach(mean), dr.detach(s))
        chance = dr.select(far, 1.0, dr.maximum(chance, 1e-30))
        line = (by_mean * mean + by_sigma * s) / chance
        return dr.replace_grad(dr.log(chance), dr.select(far, 0.0, line))

    def _wide(self, mean: Array, sigma: Array) -> WithSlopes:
        """For σ of 1 DN and more."""
        s, top = self.dr.maximum(sigma, LARGEST_DN), float(self.highest)
        low, high = mean / s, (mean - top) / s
        below, above = self._tail(-low), self._tail(-high)
        at_low, at_high = self._density(low), self._density(high)
        value = mean * (below - above) + s * (at_low - at_high) + top * above
        value = value + (at_high - at_low) / (24.0 * s)
        by_mean = below - above + (low * at_low - high * at_high) / (24.0 * s * s)
        curvature = (high * high - 1.0) * at_high - (low * low - 1.0) * at_low
        return WithSlopes(value, by_mean, at_low - at_high + curvature / (24.0 * s * s))

    def _narrow(self, mean: Array, sigma: Array) -> WithSlopes:
        """For σ below 1 DN."""
        steps = ExpectedCode(self.dr, self.highest)
        code = steps.code(mean)
        off, _ = steps.moments(code, mean, sigma)
        return WithSlopes(code + off, *steps.weights(code, mean, sigma, off))

    def _tail(self, u: Array) -> Array:
        """P(z > u) of a standard normal."""
        return 0.5 * self._erfc(u * math.sqrt(0.5))

    def _erfc(self, x: Array) -> Array:
        """1 − erf(x), relatively exact for x > 0 (Numerical Recipes, erfccheb: 1.2e-7)."""
        dr, a = self.dr, self.dr.abs(x)
        t = 1.0 / (1.0 + 0.5 * a)
        tail = -1.26551223 + t * (1.00002368 + t * (0.37409196 + t * (0.09678418 + t * (
            -0.18628806 + t * (0.27886807 + t * (-1.13520398 + t * (1.48851587 + t * (
            -0.82215223 + t * 0.17087277))))))))  # fmt: skip
        value = t * dr.exp(-a * a + tail)
        return dr.select(x >= 0, value, 2.0 - value)

    def _density(self, u: Array) -> Array:
        """φ(u)."""
        return self.dr.exp(-0.5 * u * u) * (1.0 / math.sqrt(2 * math.pi))
