"""Mean and variance of the code of a normal signal on Dr.Jit arrays, and weights that give them their derivatives.

With x ~ Normal(m, σ²) and transition levels T_k, E[code] = Σ_k Φ((m − T_k)/σ) over all levels, so both clips are in it,
and E[code²] = Σ_k (2k − 1)·Φ((m − T_k)/σ). A derivative of the code by m that has the right mean and, times 2·code, the
derivative of E[code²] as its mean, is a + b·(code − E[code])/Var[code] with

    a = Σ_k φ((T_k − m)/σ)/σ        b = Σ_k (k − ½ − E[code])·φ((T_k − m)/σ)/σ

and by σ the same with the factor (T_k − m)/σ in every term.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import arrays
from .types import Array, DrJitModule, Float64Array

LARGEST_DN = 1.0
"""σ [DN] up to which the levels next to a signal are enough: for larger noise the slope at the sample is right."""

LEAST_DN = 0.02
"""A smaller σ [DN] is set to this in the sums a and b, which are infinite at a level without noise."""

SURE = 1e-7
"""Var[code] [DN²] below which it is 0 in float32."""

REACH = 6
"""Levels on each side of a signal that count: six σ of the largest noise."""


@dataclass(frozen=True, eq=False)
class ExpectedCode:
    """E[code] near each pixel.  highest : the largest code.  inl_lsb : (highest,) T_k = k − ½ + INL_k; None: equal."""

    dr: DrJitModule
    highest: int
    inl_lsb: Float64Array | None = None

    def code(self, signal: Array) -> Array:
        """The code of a signal without noise."""
        if self.inl_lsb is not None:
            return arrays.count_at_or_below(
                np.arange(1, self.highest + 1) - 0.5 + self.inl_lsb, signal
            )
        return arrays.minimum(
            arrays.maximum(arrays.floor(signal + 0.5), 0.0), float(self.highest)
        )

    def moments(self, code: Array, signal: Array, sigma: Array) -> tuple[Array, Array]:
        """E[code] − ``code``, the code of the signal without noise, and Var[code]."""
        mean, square = self.dr.zeros(type(signal), 1), self.dr.zeros(type(signal), 1)
        scale = math.sqrt(0.5) / self.dr.maximum(sigma, 1e-30)
        for place, exists, level in self._levels(code):
            apart, sign, away = (
                (signal - level, 1.0, place) if place > 0 else (level - signal, -1.0, 1 - place)
            )
            if place > 0:
                sure = apart >= 0
            else:
                sure = apart > 0
            chance = self.dr.select(
                sigma > 0,
                0.5 + 0.5 * self.dr.erf(apart * scale),
                self.dr.select(sure, 1.0, 0.0),
            )
            chance = self.dr.select(exists, chance, 0.0)
            mean, square = mean + sign * chance, square + (2.0 * away - 1.0) * chance
        return mean, self.dr.maximum(square - mean * mean, 0.0)

    def weights(
        self, code: Array, signal: Array, sigma: Array, off: Array
    ) -> tuple[Array, Array]:
        """Derivatives of the code by m and by σ.  off : the code less that of the signal without noise."""
        mean, variance = self.moments(code, signal, sigma)
        per_sigma = 1.0 / self.dr.maximum(sigma, LEAST_DN)
        first, second = (
            [self.dr.zeros(type(signal), 1)] * 2,
            [self.dr.zeros(type(signal), 1)] * 2,
        )
        for place, exists, level in self._levels(code):
            u = (level - signal) * per_sigma
            density = self.dr.select(
                exists, self.dr.exp(-0.5 * u * u) * per_sigma / math.sqrt(2 * math.pi), 0.0
            )
            for k, term in enumerate((density, density * u)):
                first[k], second[k] = first[k] + term, second[k] + (place - 0.5 - mean) * term
        share = per_variance(self.dr, off - mean, variance)
        return first[0] + share * second[0], first[1] + share * second[1]

    def _levels(self, code: Array) -> Iterator[tuple[int, Array, Array]]:
        """(place, whether it exists, T_k) of the levels k = code + place."""
        dr, index = self.dr, self.dr.uint32_array_t(type(code))
        if self.inl_lsb is None:
            table = None
        else:
            table = type(code)(self.inl_lsb)
        for place in range(1 - REACH, REACH + 1):
            number = code + float(place)
            exists = (number >= 1) & (number <= self.highest)
            level = number - 0.5
            if table is not None:
                level = level + dr.gather(
                    type(code), table, index(dr.maximum(number, 1.0)) - 1, exists
                )
            yield place, exists, level


def per_variance(dr: DrJitModule, deviation: Array, variance: Array) -> Array:
    """(code − E[code])/Var[code]; 0 where the code is sure."""
    return dr.select(variance > SURE, deviation / dr.maximum(variance, SURE), 0.0)
