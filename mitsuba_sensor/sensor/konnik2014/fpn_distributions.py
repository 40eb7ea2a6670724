"""Families of fixed patterns X as the released code of Konnik & Welsh 2014 draws them: their mean is not always 0.

Its parameter files call them Janesick-Gaussian, LogNormal (0, 0.4), Wald 2 and AR [1 0.5].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy import special

from ...core.backend import normals
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow


@dataclass(frozen=True)
class White:
    """Standard normal."""

    margin: ClassVar[int] = 0
    mean: ClassVar[float] = 0.0
    variance: ClassVar[float] = 1.0

    def __call__(self, normals: Any) -> Any:
        """(H, W) standard normals → (H, W) values of X."""
        return normals


@dataclass(frozen=True)
class LogNormal:
    """exp(sigma·z): median 1, mean exp(σ²/2).  sigma : of the logarithm, 0.4 in the released parameters."""

    sigma: float
    margin: ClassVar[int] = 0

    def __call__(self, normals: Any) -> Any:
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
class WaldPlusUniform:
    """Inverse Gaussian of mean 1 and shape chi, plus a uniform on (0, 1).

    The uniform is in no text; it is what the records show: for χ = 2 mean 1.4996 and σ 0.7636 (1.5 and √(7/12) here).
    """

    chi: float
    margin: ClassVar[int] = 0
    mean: ClassVar[float] = 1.5

    def __call__(self, normals: Any) -> Any:
        """(H, W) standard normals → (H, W) values of X, through the quantile function of the sum."""
        points, hazard = self._table()
        return np.interp(-special.log_ndtr(-normals), hazard, points)

    @property
    def variance(self) -> float:
        """1/χ of the Wald and 1/12 of the uniform."""
        return 1 / self.chi + 1 / 12

    def _table(self) -> tuple[Any, Any]:
        """x and −ln P(X > x), the latter as the mean of the Wald's survival over [x − 1, x]."""
        per_unit = 2048
        x = np.arange(0, (3 + 60 / self.chi) * per_unit + 1) / per_unit
        steps = 0.5 * (self._survival(x[1:]) + self._survival(x[:-1])) / per_unit
        integral = np.concatenate([[0.0], np.cumsum(steps[::-1])])[::-1]
        before = np.concatenate([integral[0] + x[1 : per_unit + 1][::-1], integral[:-per_unit]])
        return x, -np.log(np.maximum(before - integral, 1e-300))

    def _survival(self, x: Any) -> Any:
        """P(Wald > x): Φ(−√(χ/x)(x − 1)) − e^(2χ)·Φ(−√(χ/x)(x + 1))."""
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(self.chi / x)
            tail = special.ndtr(-root * (x - 1)) - np.exp(2 * self.chi + special.log_ndtr(-root * (x + 1)))
        return np.where(x > 0, tail, 1.0)


@dataclass(frozen=True)
class Autoregressive:
    """x_j = z_j − coefficient·x_{j−1} along a row: the recursive filter 1/[1, coefficient], |coefficient| ≤ 0.5.

    Only its σ, 1/√(1 − c²), is fixed by the records; the sign is that of MATLAB's ``filter`` (48 : 1 in its favour from
    the six sample means of the records).
    """

    coefficient: float
    margin: ClassVar[int] = 63
    mean: ClassVar[float] = 0.0

    def __call__(self, normals: Any) -> Any:
        """(H, W + 63) standard normals → (H, W) values of X: 64 terms, summed by doubling, are all of float64."""
        x = normals
        for step in (1, 2, 4, 8, 16, 32):
            x = x[:, step:] + (-self.coefficient) ** step * x[:, :-step]
        return x

    @property
    def variance(self) -> float:
        """1/(1 − c²)."""
        return 1 / (1 - self.coefficient**2)


Family = White | LogNormal | WaldPlusUniform | Autoregressive

FAMILIES = {"gaussian": White, "lognormal": LogNormal, "wald": WaldPlusUniform, "ar": Autoregressive}
"""What a pattern may be called; all but the Gaussian take one number."""


def fixed(window: SensorWindow, source: str, family: Family) -> Any:
    """X of ``source``, once per camera: (H, W), or (1, W) for the columns. A crop sees the pattern of the crop."""

    def make() -> Any:
        (rows, columns), (top, left) = window.shape, window.origin
        wide = SensorWindow(window.serial, (rows, columns + family.margin), (top, left - family.margin))
        return family(wide.line_map(source, 0.0) if source == "dsnu_col" else wide.fixed_map(source, normals))

    return window.once((source, family), make)


def times_pattern(m: Moments, factor: float, family: Family) -> Moments:
    """Moments of (1 + factor·X)·signal, X a fixed pattern independent of the signal."""
    gain, variance = 1 + factor * family.mean, factor**2 * family.variance
    squared = gain**2 + variance
    return Moments(m.mean * gain, m.temporal * squared, m.spatial * squared + m.mean**2 * variance, m.frame)
