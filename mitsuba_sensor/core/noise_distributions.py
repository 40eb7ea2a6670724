"""Distributions of temporal noise beside the normal one: Tukey's lambda and Student's t, of mean 0 and variance 1.

Each is given by its quantile function. Drawn numbers have 32 random bits, so the variance is that of the 2³² numbers
that can be drawn: of λ = −0.45 a tenth of the variance lies further out than any of them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from .distributions import sum_over_upper_half
from .types import Float64Array

REACH, TERMS = 6.5, 16
"""|z| at the end of the Chebyshev series in z², beyond the largest normal that can be drawn, and its terms, which hold
a quantile to 6e-7 of itself."""


@dataclass(frozen=True)
class NoiseDistribution(ABC):
    """A symmetric distribution of mean 0 and variance 1; subclasses give its quantile function up to a factor."""

    shape: float

    @abstractmethod
    def unscaled(self, survival: Float64Array) -> Float64Array:
        """The value that is exceeded with this probability, up to a factor."""

    def quantile(self, survival: Float64Array) -> Float64Array:
        """The value that is exceeded with this probability."""
        return self.unscaled(survival) / self._sigma

    @cached_property
    def series(self) -> tuple[float, ...]:
        """Chebyshev coefficients of ln(x/z) in z²/REACH², x the quantile where a standard normal has z."""
        at = (np.cos(np.pi * (np.arange(4 * TERMS) + 0.5) / (4 * TERMS)) + 1) / 2
        z = REACH * np.sqrt(at)
        ratio = np.log(self.quantile(scipy.special.ndtr(-z)) / z)
        return tuple(map(float, np.polynomial.chebyshev.chebfit(2 * at - 1, ratio, TERMS - 1)))

    @cached_property
    def _sigma(self) -> float:
        """Of the numbers that can be drawn, before they are scaled."""
        return math.sqrt(2 * sum_over_upper_half(lambda s: self.unscaled(s) ** 2))


@dataclass(frozen=True)
class TukeyLambda(NoiseDistribution):
    """Quantile (u^λ − (1 − u)^λ)/λ, shape λ: 0 logistic, 0.14 nearly normal, negative heavy tails (Tukey 1962)."""

    def unscaled(self, survival: Float64Array) -> Float64Array:
        """By expm1, so that no small λ cancels."""
        above, below = np.log(survival), np.log1p(-survival)
        if self.shape == 0:
            return np.asarray(below - above)
        return np.asarray(
            (np.expm1(self.shape * below) - np.expm1(self.shape * above)) / self.shape
        )


@dataclass(frozen=True)
class StudentT(NoiseDistribution):
    """Student's t, shape ν: its degrees of freedom."""

    def unscaled(self, survival: Float64Array) -> Float64Array:
        """From the nearer tail."""
        size = -scipy.special.stdtrit(self.shape, np.minimum(survival, 1 - survival))
        return np.asarray(np.where(survival < 0.5, size, -size), dtype=np.float64)
