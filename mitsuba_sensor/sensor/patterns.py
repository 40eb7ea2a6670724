"""Families of fixed maps: how much more than the average pixel a pixel has, for ever.

Every family is given by its coefficient of variation and has mean 1, whatever that is (the paper's 1 + lnN(0, …) has
not); a map's mean and variance are its theory, ``map_of`` is its sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine import arrays, draws
from ..engine.frame import Device
from ..engine.lanes import Lanes, normals, uniforms
from ..engine.moments import rectified_normal


@dataclass(frozen=True)
class Pattern:
    """A family of mean 1. Subclasses turn words into factors; this one says how that becomes a map."""

    cv: float
    mean: ClassVar[float] = 1.0

    def map_of(self, device: Device, source: str) -> Any:
        """The camera's map, (H, W)."""
        return device.pattern(source, self.of_words)

    def of_words(self, lanes: Lanes, words: Any) -> Any:
        """(H, W) words → (H, W) factors."""
        raise TypeError(f"{type(self).__name__} is not a family by itself")

    @property
    def variance(self) -> float:
        """Variance of the factor."""
        return self.cv**2


@dataclass(frozen=True)
class LogNormal(Pattern):
    """exp(σz − σ²/2), σ² = ln(1 + cv²): the long tail of hot pixels (paper eq. 18, made unit-mean)."""

    def of_words(self, lanes: Lanes, words: Any) -> Any:
        """(H, W) words → (H, W) factors > 0."""
        return lanes.lognormal(words, self.cv)


@dataclass(frozen=True)
class Gamma(Pattern):
    """Gamma of shape k = cv⁻² and scale cv² (paper, long integration times)."""

    def of_words(self, lanes: Lanes, words: Any) -> Any:
        """(H, W) words → (H, W) factors ≥ 0."""
        return lanes.gamma(words, self.cv)


@dataclass(frozen=True)
class Wald(Pattern):
    """Inverse Gaussian (Wald) of shape χ = cv⁻² (paper, higher temperatures)."""

    def map_of(self, device: Device, source: str) -> Any:
        """The camera's map, (H, W): the two roots of a χ² draw, and a second word that picks one."""
        return device.once((source, self), lambda: self._from(device, source))

    def _from(self, device: Device, source: str) -> Any:
        z, pick = device.pattern(source, normals), device.pattern(f"{source}_pick", uniforms)
        return device.lanes.wald(z, pick, self.cv)


@dataclass(frozen=True)
class Gaussian(Pattern):
    """max(0, 1 + cv·z)/E[…]: normal, cut at zero, and of mean 1 for every cv."""

    def of_words(self, lanes: Lanes, words: Any) -> Any:
        """(H, W) words → (H, W) factors ≥ 0."""
        return self.of_normal(lanes, lanes.normal(words))

    def of_normal(self, lanes: Lanes, z: Any) -> Any:
        """The factor of a standard normal."""
        return arrays.maximum(1 + lanes.number(self.cv) * z, 0.0) * lanes.number(1 / rectified_normal(self.cv)[0])

    @property
    def variance(self) -> float:
        """cv² as long as nothing is cut."""
        mean, variance = rectified_normal(self.cv)
        return variance / mean**2


@dataclass(frozen=True)
class Rectified(Gaussian):
    """max(0, 1 + cv·z): the paper's PRNU (eq. 15), whose mean rises when it cuts, by 8 % at cv = 1."""

    def of_normal(self, lanes: Lanes, z: Any) -> Any:
        """The factor of a standard normal."""
        return arrays.maximum(1 + lanes.number(self.cv) * z, 0.0)

    @property
    def mean(self) -> float:  # type: ignore[override]
        """Above 1 as soon as anything is cut."""
        return rectified_normal(self.cv)[0]

    @property
    def variance(self) -> float:
        """cv² as long as nothing is cut."""
        return rectified_normal(self.cv)[1]


@dataclass(frozen=True)
class Logistic(Pattern):
    """max(0, 1 + s·ln((1−p)/p))/E[…], s = √3·cv/π: heavier tails than a normal (paper, 25 °C)."""

    def of_words(self, lanes: Lanes, words: Any) -> Any:
        """(H, W) words → (H, W) factors ≥ 0."""
        factor = arrays.maximum(1 + lanes.number(self._scale) * lanes.logistic(words), 0.0)
        return factor * lanes.number(1 / self._raw[0])

    @property
    def variance(self) -> float:
        """cv² as long as nothing is cut."""
        mean, variance = self._raw
        return variance / mean**2

    @property
    def _scale(self) -> float:
        return math.sqrt(3) * self.cv / math.pi

    @property
    def _raw(self) -> tuple[float, float]:
        """Mean and variance of max(0, 1 + s·L)."""
        return draws.rectified_logistic(self._scale)


@dataclass(frozen=True)
class Autoregressive(Gaussian):
    """A normal map whose neighbours are alike: separable isotropic AR, ρ₁ = 2·coupling along rows and columns.

    (El Gamal et al. 1998, the pixel component.)  coupling : 0 … 0.45.
    """

    coupling: float = 0.0

    def map_of(self, device: Device, source: str) -> Any:
        """The camera's map, (H, W)."""
        return self.of_normal(device.lanes, device.correlated(source, self.coupling))


@dataclass(frozen=True)
class AutoregressiveRectified(Rectified):
    """:class:`Autoregressive` for the PRNU: max(0, 1 + cv·x), x separable isotropic AR."""

    coupling: float = 0.0

    def map_of(self, device: Device, source: str) -> Any:
        """The camera's map, (H, W)."""
        return self.of_normal(device.lanes, device.correlated(source, self.coupling))
