"""Non-normal distributions of temporal noise, Tukey's lambda and Student's t, with mean 0 and variance 1.

Each is given by its quantile function. The variance refers to the 2³² numbers that can be drawn; for λ = −0.45, a tenth
of the variance lies further out.
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

Z_MAX, TERMS = 6.5, 16
"""Range of |z| and number of terms of the Chebyshev series in z², to a relative error of 6e-7; drawn |z| end at 6.3."""


@dataclass(frozen=True)
class NoiseDistribution(ABC):
    """A symmetric distribution of mean 0 and variance 1; subclasses give the quantile function up to a factor."""

    shape: float

    @abstractmethod
    def unscaled(self, survival: Float64Array) -> Float64Array:
        """Return the value exceeded with this probability, up to a factor."""

    def quantile(self, survival: Float64Array) -> Float64Array:
        """Return the value exceeded with this probability."""
        return self.unscaled(survival) / self._sigma

    @cached_property
    def series(self) -> tuple[float, ...]:
        """Chebyshev coefficients of ln(x/z) in z²/Z_MAX², for the quantile x where a standard normal has z."""
        at = (np.cos(np.pi * (np.arange(4 * TERMS) + 0.5) / (4 * TERMS)) + 1) / 2
        z = Z_MAX * np.sqrt(at)
        ratio = np.log(self.quantile(scipy.special.ndtr(-z)) / z)
        return tuple(map(float, np.polynomial.chebyshev.chebfit(2 * at - 1, ratio, TERMS - 1)))

    @cached_property
    def _sigma(self) -> float:
        """Standard deviation of the numbers that can be drawn, before scaling."""
        return math.sqrt(2 * sum_over_upper_half(lambda s: self.unscaled(s) ** 2))


@dataclass(frozen=True)
class TukeyLambda(NoiseDistribution):
    """Quantile (u^λ − (1 − u)^λ)/λ, shape λ: 0 logistic, 0.14 nearly normal, negative heavy tails (Tukey 1962)."""

    def unscaled(self, survival: Float64Array) -> Float64Array:
        """Use expm1 to avoid cancellation for small λ."""
        above, below = np.log(survival), np.log1p(-survival)
        if self.shape == 0:
            return np.asarray(below - above)
        return np.asarray(
            (np.expm1(self.shape * below) - np.expm1(self.shape * above)) / self.shape
        )


@dataclass(frozen=True)
class StudentT(NoiseDistribution):
    """Student's t with ν degrees of freedom, the shape."""

    def unscaled(self, survival: Float64Array) -> Float64Array:
        """Use the nearer tail."""
        size = -scipy.special.stdtrit(self.shape, np.minimum(survival, 1 - survival))
        return np.asarray(np.where(survival < 0.5, size, -size), dtype=np.float64)
