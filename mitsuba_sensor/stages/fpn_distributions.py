"""Distributions of FPN factors: log-normal, gamma, Wald, normal, logistic and autoregressive maps of mean 1.

Each has mean 1 for any coefficient of variation, unlike the paper's 1 + lnN(0, …).
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..core import Array, SensorWindow, arrays, distributions
from ..core.backend import Backend, normals, uniforms

NARROW = 1.0
"""cv of a log-normal below which less than 1e-6 of its variance lies above the largest random number."""


def require_drawable(
    field: str, cv: float, distribution: type["FpnDistribution"], name: str
) -> None:
    """Raise ValueError for a coefficient of variation that 32 random bits cannot represent."""
    if cv > distribution.largest_cv:
        raise ValueError(
            f"{field} is {cv:g}; with distribution {name} it must be at most {distribution.largest_cv:g}, because 32 "
            f"random bits miss the mean above; use another distribution, or write {cv / 100:g} if {cv:g} is in percent"
        )


@dataclass(frozen=True)
class FpnDistribution:
    """A distribution of mean 1; subclasses turn random bits into factors.

    largest_cv : largest cv for which factors from 32 random bits have the mean within 0.1 %, also in float32.
    """

    cv: float
    largest_cv: ClassVar[float] = math.inf

    def map_of(self, window: SensorWindow, source: str) -> Any:
        """Return the camera's map, shape (H, W)."""
        return window.fixed_map(source, self.from_bits)

    def from_bits(self, backend: Backend, bits: Any) -> Any:
        """Return factors from random bits, shape (H, W)."""
        raise TypeError(f"{type(self).__name__} is not a distribution by itself")


@dataclass(frozen=True)
class LogNormal(FpnDistribution):
    """exp(σz − σ²/2), σ² = ln(1 + cv²): the long tail of hot pixels (paper eq. 18, made unit-mean).

    z ends at 6.3, where random numbers of 32 bits end: the standard deviation is 0.6 % smaller at cv = 10, and 17 % at
    cv = 100.
    """

    largest_cv = 100.0

    def from_bits(self, backend: Backend, bits: Any) -> Any:
        """Return factors > 0, shape (H, W)."""
        return backend.lognormal(bits, self.cv)

    @property
    def drawn_cv(self) -> float:
        """Coefficient of variation of the factors from 32 random bits."""
        if self.cv <= NARROW:
            return self.cv
        mean, square = (distributions.lognormal_moment(self.cv, power) for power in (1, 2))
        return math.sqrt(square - mean**2)


@dataclass(frozen=True)
class Gamma(FpnDistribution):
    """Gamma of shape k = cv⁻² and scale cv² (paper, long integration times)."""

    largest_cv = 50.0

    def from_bits(self, backend: Backend, bits: Any) -> Any:
        """Return factors ≥ 0, shape (H, W)."""
        return backend.gamma(bits, self.cv)


@dataclass(frozen=True)
class Wald(FpnDistribution):
    """Inverse Gaussian (Wald) of shape χ = cv⁻² (paper, higher temperatures)."""

    largest_cv = 1000.0

    def map_of(self, window: SensorWindow, source: str) -> Any:
        """Return the camera's map, shape (H, W): two roots of a χ² number, and a second number that picks one."""

        def make() -> Any:
            z, pick = (
                window.fixed_map(source, normals),
                window.fixed_map(f"{source}_pick", uniforms),
            )
            return window.backend.wald(z, pick, self.cv)

        return window.cached((source, self), make)


@dataclass(frozen=True)
class Gaussian(FpnDistribution):
    """max(0, 1 + cv·z)/E[…]: normal, cut at zero, and of mean 1 for every cv."""

    def from_bits(self, backend: Backend, bits: Any) -> Any:
        """Return factors ≥ 0, shape (H, W)."""
        return self.of_normal(backend, backend.normal(bits))

    def of_normal(self, backend: Backend, z: Any) -> Any:
        """Return the factor for a standard normal."""
        return arrays.maximum(1 + backend.number(self.cv) * z, 0.0) * backend.number(
            1 / distributions.rectified_normal_mean(self.cv)
        )


@dataclass(frozen=True)
class Rectified(Gaussian):
    """max(0, 1 + cv·z): the paper's PRNU (eq. 15), whose mean rises when it cuts, by 8 % at cv = 1."""

    def of_normal(self, backend: Backend, z: Any) -> Any:
        """Return the factor for a standard normal."""
        return arrays.maximum(1 + backend.number(self.cv) * z, 0.0)


@dataclass(frozen=True)
class Logistic(FpnDistribution):
    """max(0, 1 + s·ln((1−p)/p))/E[…], s = √3·cv/π: heavier tails than a normal (paper, 25 °C)."""

    def from_bits(self, backend: Backend, bits: Any) -> Any:
        """Return factors ≥ 0, shape (H, W)."""
        factor = arrays.maximum(1 + backend.number(self._scale) * backend.logistic(bits), 0.0)
        return factor * backend.number(1 / distributions.rectified_logistic_mean(self._scale))

    @property
    def _scale(self) -> float:
        return math.sqrt(3) * self.cv / math.pi


@dataclass(frozen=True)
class Autoregressive(Gaussian):
    """Normal, separable isotropic AR along rows and columns, ρ₁ = 2·coupling (El Gamal et al. 1998)."""

    coupling: float = 0.0

    def map_of(self, window: SensorWindow, source: str) -> Any:
        """Return the camera's map, shape (H, W)."""
        return self.of_normal(window.backend, window.correlated(source, self.coupling))


@dataclass(frozen=True)
class AutoregressiveRectified(Rectified, Autoregressive):
    """:class:`Autoregressive` for the PRNU: max(0, 1 + cv·x), x separable isotropic AR."""


@dataclass(frozen=True)
class Sites:
    """Random bits to ``inside`` for this fraction of the pixels, to ``outside`` for the others."""

    fraction: float
    inside: float = 1.0
    outside: float = 0.0

    def __call__(self, backend: Backend, bits: Array) -> Array:
        """Return the values of the pixels."""
        values = backend.number(self.inside), backend.number(self.outside)
        return arrays.where(backend.uniform(bits) < backend.number(self.fraction), *values)


def site_map(window: SensorWindow, name: str, fraction: float) -> dict[str, Array]:
    """Return the map ``name``: 1 for a random fraction of the pixels, else 0, or as measured."""
    return {name: window.measured_or(name, lambda: window.fixed_map(name, Sites(fraction)))}
