"""Families of fixed maps of mean 1: how much more than the average pixel a pixel has, for ever."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..engine import arrays, draws
from ..engine.moments import rectified_normal


@dataclass(frozen=True)
class GaussianMap:
    """max(0, 1 + cv·z)/E[…]: normal, cut at zero, and of mean 1 for every cv (model of Janesick 2001)."""

    cv: float

    def __call__(self, words: Any) -> Any:
        """(H, W) words → (H, W) factors ≥ 0."""
        mean, _ = rectified_normal(self.cv)
        return arrays.maximum(1 + self.cv * draws.normal(words), 0.0) / mean

    @property
    def variance(self) -> float:
        """Variance of the factor: cv² as long as nothing is cut."""
        mean, variance = rectified_normal(self.cv)
        return variance / mean**2


@dataclass(frozen=True)
class LogNormalMap:
    """exp(σz − σ²/2) with σ² = ln(1 + cv²): the long tail of hot pixels (paper eq. 18, made unit-mean)."""

    cv: float

    def __call__(self, words: Any) -> Any:
        """(H, W) words → (H, W) factors > 0."""
        return draws.lognormal(words, self.cv)

    @property
    def variance(self) -> float:
        """Variance of the factor, cv²."""
        return self.cv**2
