"""Distributions of temporal noise beside the normal one: Tukey's lambda and Student's t, of mean 0 and variance 1.

Each is given by its quantile function. Drawn numbers have 32 random bits, so the variance is that of the 2³² numbers
that can be drawn: of λ = −0.45 a tenth of the variance lies further out than any of them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from .distributions import sum_over_upper_half
from .types import Float64Array

REACH, TERMS = 6.5, 16
"""|z| at the end of the Chebyshev series in z², beyond the largest normal that can be drawn, and its terms, which hold
a quantile to 6e-7 of itself."""

HEAVY = 1.04
"""A quantile at 4 σ that is so much farther out than a normal's needs normals of several widths, a nearer one several
places."""

NARROWEST, RATIO = 0.15, 1.6
"""σ of the narrowest normal of a mixture, and that of each further one over the one before."""

WIDTH, APART, FARTHEST = 0.6, 0.4, 3.6
"""σ of the normals of a mixture for light tails, the distance of their places, and the last place [σ]."""

KEEPING = 10.0
"""Weight of the sum and of the variance of a mixture beside its distances from the quantiles."""


class Mixture(NamedTuple):
    """Normals that make up a distribution of mean 0 and variance 1.

    weights, means, variances : (T,).
    """

    weights: Float64Array
    means: Float64Array
    variances: Float64Array


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
    def mixture(self) -> Mixture:
        """Normals whose cumulative probabilities are those of the distribution to 3e-4, and whose variance is 1.

        Non-negative least squares over normals of several widths, or of one width at several places.
        """
        z = np.linspace(0.05, 6.3, 126)
        above = scipy.special.ndtr(-z)
        x = self.quantile(above)
        places, widths = self._normals(float(x[-1]))
        chances = 0.5 * sum(
            scipy.special.ndtr((sign * places - x[:, None]) / widths) for sign in (-1, 1)
        )
        rows = np.vstack(
            [
                chances / above[:, None] ** 0.25,
                KEEPING + 0 * widths,
                KEEPING * (places**2 + widths**2),
            ]
        )
        found, _ = scipy.optimize.nnls(
            rows, np.array([*above**0.75, KEEPING, KEEPING]), maxiter=5000
        )
        weights, means = np.concatenate([found, found]) / 2, np.concatenate([places, -places])
        used = weights > 0
        weights, means, variances = weights[used], means[used], np.tile(widths**2, 2)[used]
        weights = weights / weights.sum()
        whole = weights @ (means**2 + variances)
        return _merged(Mixture(weights, means / math.sqrt(whole), variances / whole))

    def _normals(self, farthest: float) -> tuple[Float64Array, Float64Array]:
        """Places and widths of the normals that a mixture may have.  farthest : a quantile."""
        if self.quantile(scipy.special.ndtr(np.array([-4.0])))[0] < 4 * HEAVY:
            places = np.arange(0.0, FARTHEST + APART, APART)
            return places, np.full(places.size, WIDTH)
        number = math.ceil(math.log(farthest / 3 / NARROWEST) / math.log(RATIO)) + 1
        return np.zeros(number), np.asarray(
            NARROWEST * RATIO ** np.arange(number), dtype=np.float64
        )

    @cached_property
    def _sigma(self) -> float:
        """Of the numbers that can be drawn, before they are scaled."""
        return math.sqrt(2 * sum_over_upper_half(lambda s: self.unscaled(s) ** 2))


def _merged(parts: Mixture) -> Mixture:
    """The two normals at place 0 as one."""
    middle = parts.means == 0
    half = np.flatnonzero(middle)[: middle.sum() // 2]
    kept = np.concatenate([half, np.flatnonzero(~middle)])
    return Mixture(
        parts.weights[kept] * np.where(middle[kept], 2, 1),
        parts.means[kept],
        parts.variances[kept],
    )


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
