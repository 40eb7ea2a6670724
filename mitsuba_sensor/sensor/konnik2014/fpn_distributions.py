"""Distributions of FPN maps X in the released code of Konnik & Welsh 2014; the mean of some is not 0.

Its parameter files call them Janesick-Gaussian, PublishedLogNormal (0, 0.4), Wald 2 and AR [1 0.5].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from scipy import special

from ...core.backend import normals
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.types import Float64Array


@dataclass(frozen=True)
class PublishedNormal:
    """Standard normal."""

    margin: ClassVar[int] = 0
    mean: ClassVar[float] = 0.0
    variance: ClassVar[float] = 1.0

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W) standard normals → (H, W) values of X."""
        return normals


@dataclass(frozen=True)
class PublishedLogNormal:
    """exp(sigma·z): median 1, mean exp(σ²/2).  sigma : of the logarithm, 0.4 in the released parameters."""

    sigma: float
    margin: ClassVar[int] = 0

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W) standard normals → (H, W) values of X."""
        return np.exp(self.sigma * normals)

    @property
    def mean(self) -> float:
        """exp(σ²/2); 1.083 for 0.4."""
        return math.exp(self.sigma**2 / 2)

    @property
    def variance(self) -> float:
        """exp(σ²)·(exp(σ²) − 1)."""
        return math.exp(self.sigma**2) * math.expm1(self.sigma**2)


@dataclass(frozen=True)
class PublishedWald:
    """Inverse Gaussian of mean 1 and shape chi, plus a uniform on (0, 1).

    The uniform is in no text; the records show it: for χ = 2 mean 1.4996 and σ 0.7636 (1.5 and √(7/12) here).
    """

    chi: float
    margin: ClassVar[int] = 0
    mean: ClassVar[float] = 1.5

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W) standard normals → (H, W) values of X, through the quantile function of the sum."""
        points, hazard = self._table()
        x: Float64Array = np.interp(-special.log_ndtr(-normals), hazard, points)
        return x

    @property
    def variance(self) -> float:
        """1/χ of the Wald and 1/12 of the uniform."""
        return 1 / self.chi + 1 / 12

    def _table(self) -> tuple[Float64Array, Float64Array]:
        """x and −ln P(X > x); P is the mean of the survival function of the Wald distribution over [x − 1, x]."""
        per_unit = 2048
        x = np.arange(0, (3 + 60 / self.chi) * per_unit + 1) / per_unit
        steps = 0.5 * (self._survival(x[1:]) + self._survival(x[:-1])) / per_unit
        integral = np.concatenate([[0.0], np.cumsum(steps[::-1])])[::-1]
        before = np.concatenate([integral[0] + x[1 : per_unit + 1][::-1], integral[:-per_unit]])
        return x, -np.log(np.maximum(before - integral, 1e-300))

    def _survival(self, x: Float64Array) -> Float64Array:
        """P(Wald > x): Φ(−√(χ/x)(x − 1)) − e^(2χ)·Φ(−√(χ/x)(x + 1))."""
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(self.chi / x)
            tail = special.ndtr(-root * (x - 1)) - np.exp(2 * self.chi + special.log_ndtr(-root * (x + 1)))
        return np.where(x > 0, tail, 1.0)


@dataclass(frozen=True)
class PublishedAr:
    """x_j = z_j − coefficient·x_{j−1} along a row: the recursive filter 1/[1, coefficient], |coefficient| ≤ 0.5.

    The records determine only its σ, 1/√(1 − c²); the sign is that of MATLAB's ``filter`` (48 : 1 in favour of it from
    the six sample means of the records).
    """

    coefficient: float
    margin: ClassVar[int] = 63
    mean: ClassVar[float] = 0.0

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W + 63) standard normals → (H, W) values of X: 64 terms, summed by doubling, exact in float64."""
        x = normals
        for step in (1, 2, 4, 8, 16, 32):
            x = x[:, step:] + (-self.coefficient) ** step * x[:, :-step]
        return x

    @property
    def variance(self) -> float:
        """1/(1 − c²)."""
        return 1 / (1 - self.coefficient**2)


FpnDistribution: TypeAlias = PublishedNormal | PublishedLogNormal | PublishedWald | PublishedAr

FPN_DISTRIBUTIONS = {
    "gaussian": PublishedNormal,
    "lognormal": PublishedLogNormal,
    "wald": PublishedWald,
    "ar": PublishedAr,
}
"""Name → distribution; all but the Gaussian have one parameter."""


def fpn_map(window: SensorWindow, source: str, distribution: FpnDistribution) -> Float64Array:
    """FPN map X of ``source``, the same in every frame of a camera: (H, W), or (1, W) for the columns."""

    def make() -> Float64Array:
        (rows, columns), (top, left) = window.shape, window.origin
        wide = SensorWindow(window.serial, (rows, columns + distribution.margin), (top, left - distribution.margin))
        return distribution(wide.line_map(source, 0.0) if source == "dsnu_col" else wide.fixed_map(source, normals))

    return window.cached((source, distribution), make)


def times_fpn(m: Moments, factor: float, distribution: FpnDistribution) -> Moments:
    """Moments of (1 + factor·X)·signal, X an FPN map independent of the signal."""
    gain, variance = 1 + factor * distribution.mean, factor**2 * distribution.variance
    squared = gain**2 + variance
    return Moments(m.mean * gain, m.temporal * squared, m.spatial * squared + m.mean**2 * variance, m.frame)
