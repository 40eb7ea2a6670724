"""Families of distributions of dark signal: density, distribution function and maximum-likelihood fit of each."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import scipy

from ...core.types import Float64Array

Parameters = tuple[float, ...]
NEWTON_STEPS = 50


class Family(ABC):
    """Distributions with two parameters, of values x with weights w (how many pixels have them).

    names, in_dn : symbols of the parameters, and whether these have the unit of the values.  positive : above 0.
    """

    name: ClassVar[str]
    names: ClassVar[tuple[str, ...]]
    in_dn: ClassVar[tuple[bool, ...]]
    positive: ClassVar[bool] = True

    @abstractmethod
    def log_density(self, x: Float64Array, p: Parameters) -> Float64Array:
        """Logarithm of the probability density [1/DN]."""

    @abstractmethod
    def below(self, x: Float64Array, p: Parameters) -> Float64Array:
        """Share of the values up to x."""

    @abstractmethod
    def fit(self, x: Float64Array, w: Float64Array) -> Parameters:
        """The parameters of maximum likelihood."""

    @abstractmethod
    def errors(self, p: Parameters, count: float) -> Parameters:
        """Standard errors of that fit to so many values, from Fisher's information."""


def moments(x: Float64Array, w: Float64Array) -> tuple[float, float]:
    """Weighted mean and standard deviation, at least a millionth of the range: equal values have no density."""
    total = float(w.sum())
    mean = float(w @ x) / total
    return mean, max(math.sqrt(float(w @ np.square(x - mean)) / total), 1e-6 * float(np.ptp(x)))


class Normal(Family):
    """exp(−(x − µ)²/2σ²)/(σ√2π)."""

    name, names, in_dn, positive = "normal", ("µ", "σ"), (True, True), False

    def log_density(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        return np.asarray(
            -0.5 * np.square((x - p[0]) / p[1]) - math.log(p[1] * math.sqrt(2 * math.pi))
        )

    def below(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        return np.asarray(scipy.special.ndtr((x - p[0]) / p[1]))

    def fit(self, x: Float64Array, w: Float64Array) -> Parameters:
        """See :class:`Family`."""
        return moments(x, w)

    def errors(self, p: Parameters, count: float) -> Parameters:
        """See :class:`Family`."""
        return p[1] / math.sqrt(count), p[1] / math.sqrt(2 * count)


class LogNormal(Family):
    """A normal distribution of ln x with µ and σ."""

    name, names, in_dn = "log-normal", ("µ", "σ"), (False, False)
    normal = Normal()

    def log_density(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        return self.normal.log_density(np.log(x), p) - np.log(x)

    def below(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        return self.normal.below(np.log(x), p)

    def fit(self, x: Float64Array, w: Float64Array) -> Parameters:
        """See :class:`Family`."""
        return moments(np.log(x), w)

    def errors(self, p: Parameters, count: float) -> Parameters:
        """See :class:`Family`."""
        return self.normal.errors(p, count)


class Gamma(Family):
    """x^(a−1)·exp(−x/b)/(b^a·Γ(a))."""

    name, names, in_dn = "gamma", ("a", "b"), (False, True)

    def log_density(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        a, b = p
        return np.asarray((a - 1) * np.log(x) - x / b - a * math.log(b) - math.lgamma(a))

    def below(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        return np.asarray(scipy.special.gammainc(p[0], x / p[1]))

    def fit(self, x: Float64Array, w: Float64Array) -> Parameters:
        """ln a − ψ(a) = ln(mean x) − mean ln x, by Newton's method from Minka's start."""
        mean, _ = moments(x, w)
        s = max(math.log(mean) - float(w @ np.log(x)) / float(w.sum()), 1e-12)
        a = (3 - s + math.sqrt((s - 3) ** 2 + 24 * s)) / (12 * s)
        for _ in range(NEWTON_STEPS):
            off = math.log(a) - float(scipy.special.digamma(a)) - s
            step = off / (1 / a - float(scipy.special.polygamma(1, a)))
            a = max(a - step, a / 2)
            if abs(step) < 1e-9 * a:
                break
        return a, mean / a

    def errors(self, p: Parameters, count: float) -> Parameters:
        """See :class:`Family`."""
        a, b = p
        trigamma = float(scipy.special.polygamma(1, a))
        information = count * (a * trigamma - 1)
        return math.sqrt(a / information), b * math.sqrt(trigamma / information)


class InverseGaussian(Family):
    """√(λ/2πx³)·exp(−λ(x − µ)²/2µ²x)."""

    name, names, in_dn = "inverse Gaussian", ("µ", "λ"), (True, True)

    def log_density(self, x: Float64Array, p: Parameters) -> Float64Array:
        """See :class:`Family`."""
        mean, shape = p
        power = shape * np.square(x / mean - 1) / x
        return np.asarray(0.5 * (math.log(shape / (2 * math.pi)) - 3 * np.log(x) - power))

    def below(self, x: Float64Array, p: Parameters) -> Float64Array:
        """Φ(√(λ/x)·(x/µ − 1)) + e^(2λ/µ)·Φ(−√(λ/x)·(x/µ + 1))."""
        mean, shape = p
        root = np.sqrt(shape / x)
        second = np.exp(2 * shape / mean + scipy.special.log_ndtr(-root * (x / mean + 1)))
        return np.asarray(scipy.special.ndtr(root * (x / mean - 1)) + second)

    def fit(self, x: Float64Array, w: Float64Array) -> Parameters:
        """λ from 1/λ = mean(1/x) − 1/µ, written as a mean of squares, which is never negative."""
        mean, _ = moments(x, w)
        inverse = float(w @ (np.square(x - mean) / x)) / float(w.sum()) / mean**2
        return mean, 1 / max(inverse, 1e-300)

    def errors(self, p: Parameters, count: float) -> Parameters:
        """See :class:`Family`."""
        return math.sqrt(p[0] ** 3 / (p[1] * count)), p[1] * math.sqrt(2 / count)


FAMILIES: dict[str, Family] = {
    family.name: family for family in (Normal(), LogNormal(), Gamma(), InverseGaussian())
}
"""All families by their names."""
