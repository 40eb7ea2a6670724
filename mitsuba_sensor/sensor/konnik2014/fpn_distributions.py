"""FPN in the released code of Konnik & Welsh 2014: distributions of its maps X, and the stage that multiplies by 1 + X.

Its parameter files call them Janesick-Gaussian, LogNormal (0, 0.4), Wald 2 and AR [1 0.5]; the mean of some is not 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from scipy import special

from ...core import Array, Float64Array, Frame, Moments, SensorWindow
from ...core.backend import normals
from ..stage import Stage

FpnName = Literal["gaussian", "lognormal", "wald", "ar"]
PER_UNIT = 2048  # nodes of the Wald's quantile function


@dataclass(frozen=True)
class PublishedFpnDistribution:
    """Distribution of X, by name, and its one parameter.

    gaussian : standard normal.  lognormal : exp(parameter·z), median 1.
    wald : inverse Gaussian of mean 1 and shape χ = parameter, plus a uniform on (0, 1). The uniform is in no text; the
        records show it: for χ = 2 mean 1.4996 and σ 0.7636 (1.5 and √(7/12) here).
    ar : x_j = z_j − parameter·x_{j−1} along a row: the recursive filter 1/[1, parameter], |parameter| ≤ 0.5. The
        records determine only its σ, 1/√(1 − c²); the sign is that of MATLAB's ``filter`` (48 : 1 in favour of it from
        the six sample means of the records).
    """

    name: FpnName
    parameter: float = 0.0

    @property
    def margin(self) -> int:
        """Columns of normals that X needs to the left of its own."""
        return 63 if self.name == "ar" else 0

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W + margin) standard normals → (H, W) values of X."""
        x = normals
        if self.name == "lognormal":
            return np.exp(self.parameter * x)
        if self.name == "wald":  # through the quantile function of the sum
            points, hazard = _wald_and_uniform(self.parameter)
            return np.asarray(np.interp(-special.log_ndtr(-x), hazard, points))
        for step in (1, 2, 4, 8, 16, 32) if self.name == "ar" else ():  # 64 terms, summed by doubling, exact in float64
            x = x[:, step:] + (-self.parameter) ** step * x[:, :-step]
        return x

    @property
    def mean(self) -> float:
        """Mean of X; 1.083 for the log-normal (0, 0.4)."""
        return {"lognormal": math.exp(self.parameter**2 / 2), "wald": 1.5}.get(self.name, 0.0)

    @property
    def variance(self) -> float:
        """Variance of X."""
        square = self.parameter**2
        if self.name == "lognormal":
            return math.exp(square) * math.expm1(square)
        if self.name == "wald":
            return 1 / self.parameter + 1 / 12
        return 1 / (1 - square) if self.name == "ar" else 1.0


def _wald_and_uniform(chi: float) -> tuple[Float64Array, Float64Array]:
    """x and −ln P(X > x); P is the mean of the survival function of the Wald distribution over [x − 1, x]."""
    x = np.arange(0, (3 + 60 / chi) * PER_UNIT + 1) / PER_UNIT
    with np.errstate(divide="ignore", invalid="ignore"):  # P(Wald > x): Φ(−√(χ/x)(x − 1)) − e^(2χ)·Φ(−√(χ/x)(x + 1))
        root = np.sqrt(chi / x)
        tail = special.ndtr(-root * (x - 1)) - np.exp(2 * chi + special.log_ndtr(-root * (x + 1)))
    survival = np.where(x > 0, tail, 1.0)
    steps = 0.5 * (survival[1:] + survival[:-1]) / PER_UNIT
    integral = np.concatenate([[0.0], np.cumsum(steps[::-1])])[::-1]
    before = np.concatenate([integral[0] + x[1 : PER_UNIT + 1][::-1], integral[:-PER_UNIT]])
    return x, -np.log(np.maximum(before - integral, 1e-300))


def fpn_map(window: SensorWindow, source: str, distribution: PublishedFpnDistribution) -> Float64Array:
    """FPN map X of ``source``, the same in every frame of a camera: (H, W), or (1, W) for the columns."""

    def make() -> Float64Array:
        (rows, columns), (top, left) = window.shape, window.origin
        wide = SensorWindow(window.serial, (rows, columns + distribution.margin), (top, left - distribution.margin))
        return distribution(wide.line_map(source, 0.0) if source == "dsnu_col" else wide.fixed_map(source, normals))

    return window.cached((source, distribution), make)


@dataclass(frozen=True)
class PublishedFpn(Stage):
    """The *noisy* signal times 1 + factor·X, not clipped at 0.  factor : dimensionless.  distribution : of X."""

    factor: float
    distribution: PublishedFpnDistribution
    source: ClassVar[str]

    def sample(self, signal: Array, frame: Frame) -> Array:
        """The signal times the gain map of the camera, (H, W)."""
        return signal * (1 + self.factor * fpn_map(frame.window, self.source, self.distribution))

    def moments(self, m: Moments) -> Moments:
        """Product with an independent gain map."""
        gain, variance = 1 + self.factor * self.distribution.mean, self.factor**2 * self.distribution.variance
        squared = gain**2 + variance
        return Moments(m.mean * gain, m.temporal * squared, m.spatial * squared + m.mean**2 * variance, m.frame)
