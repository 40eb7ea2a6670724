"""What rounding to whole codes hides in the figures of a stack, and figures that it hides altogether.

Noise of 0.6 DN or more makes rounding a source of noise of its own, 1/12 DN². Less noise leaves a pattern that no
average removes: the mean of rounded normal values of mean m and standard deviation σ is m − exp(−2π²σ²)·sin(2πm)/π, and
their variance σ² + 1/12 + (4σ² + 1/π²)·exp(−2π²σ²)·cos(2πm), in the first order of exp(−2π²σ²).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from ..quantity import Quantity

if TYPE_CHECKING:
    from .stack import Stack

ROUNDING_DN2 = 1 / 12
"""Variance of rounding to whole codes, EMVA 1288 R4 2.2."""
COARSE_DN = 0.4
"""Temporal noise [DN] below which rounding hides differences between pixels: the mean of rounded normal values is
off by exp(−2π²σ²)/π at most, 0.014 DN there and 0.14 DN at half of it."""
HIDING_DN = 0.6
"""Temporal noise [DN] above which rounding changes no variance by more than 0.4 %."""
HIDING_SHARE = 0.02
"""Share of a figure's variance that rounding may have: 1 % of the standard deviation."""
LEAST_DN2 = 1e-6
"""What rounding may hide [DN²] without a figure losing its value, however small that is."""
STEPS = 400
"""Of the search for the least variance."""


@dataclass(frozen=True)
class Rounding:
    """What rounding may do to the figures of frames of whole codes.

    least_dn2 : the smallest temporal variance without rounding that the frames allow [DN²].
    alike : 1 where all pixels lie at one place between two codes, 0 where their places are uniform.
    """

    least_dn2: float
    alike: float

    @classmethod
    def measure(cls, stack: Stack) -> Self:
        """Of frames whose rounding matters; pixels with 3 DN² of variance or more have none."""
        measured_dn2 = float(stack.variance.mean())
        turned = complex(np.exp(2j * math.pi * stack.mean).mean())

        def alike(variance_dn2: float) -> float:
            return _alike(turned, variance_dn2, len(stack))

        least_dn2 = _least(measured_dn2, alike)
        return cls(least_dn2, alike(least_dn2))

    @property
    def pattern_dn2(self) -> float:
        """Variance of the pattern that rounding adds to means over frames or over lines [DN²]."""
        return (_decay(self.least_dn2) / math.pi) ** 2 / 2

    def of_means(self, variance_dn2: float) -> float:
        """By how much rounding may change the variance of means, of so much variance [DN²].

        Rounding moves no mean by more than half a code.
        """
        first_order = self.pattern_dn2 + 4 * variance_dn2 * _decay(self.least_dn2) * self.alike
        return min(first_order, math.sqrt(variance_dn2) + 0.25)

    @property
    def of_pixel_noise(self) -> float:
        """By how much the variance that rounding adds to the noise of pixels may differ from 1/12 DN² [DN²]."""
        return _added(self.least_dn2) * self.alike


def shift_of_mean_dn(variance_dn2: float) -> float:
    """Standard deviation of what rounding may add to the mean of codes of this variance [DN]: that of a uniform place
    between two codes, 1/√12 DN without noise, times exp(−2π²σ²)."""
    if variance_dn2 > 3:
        return 0.0
    return _decay(_least(variance_dn2, lambda _: 1.0)) * math.sqrt(ROUNDING_DN2)


def _least(measured_dn2: float, alike: Callable[[float], float]) -> float:
    """The smallest variance without rounding that a measured one allows [DN²]."""
    for least_dn2 in np.linspace(0, measured_dn2, STEPS).tolist():
        if least_dn2 + ROUNDING_DN2 + _added(least_dn2) * alike(least_dn2) >= measured_dn2:
            break
    return float(least_dn2)


def _decay(variance_dn2: float) -> float:
    return math.exp(-2 * math.pi**2 * variance_dn2)


def _added(variance_dn2: float) -> float:
    """Largest difference of the variance of rounding from 1/12 DN²."""
    return (4 * variance_dn2 + 1 / math.pi**2) * _decay(variance_dn2)


def _alike(turned: complex, variance_dn2: float, frames: int) -> float:
    """How alike the places of the pixels between two codes are: |mean of exp(2πim)| of their means m.

    turned : the same of the measured means, in which averaging leaves some of the temporal noise and which rounding
    pulls to whole codes.
    """
    noise_left = min(2 * math.pi**2 * variance_dn2 / frames, 50.0)
    return min(1.0, abs(turned * math.exp(noise_left) - _decay(variance_dn2)))


def has_whole_codes(stack: Stack) -> bool:
    """Whether no value of the frames has a fraction."""
    if stack.frames.dtype.kind in "ui":
        return True
    return bool((stack.frames == np.round(stack.frames)).all())


def is_rounded(stack: Stack) -> bool:
    """Whether the frames are codes whose rounding can matter: whole ones, of 2 frames or more, of little noise."""
    return len(stack) > 1 and stack.variance.mean() < 3 and has_whole_codes(stack)


def temporal_note(stack: Stack) -> str:
    """What a stack is short of for its temporal noise to be removed: frames, or a noise that rounding does not hide."""
    if len(stack) == 1:
        return "one frame: temporal noise is not told from spatial, pass at least 2"
    temporal_dn = max(0.0, float(stack.variance.mean()) - ROUNDING_DN2) ** 0.5
    if stack.frames.dtype.kind != "f" and temporal_dn < COARSE_DN:
        return f"temporal noise is {temporal_dn:.2g} DN: rounding hides differences below 1 DN"
    return ""


def mark_rounding(figure: Quantity, hidden_dn2: float, per_dn: float = 1.0) -> Quantity:
    """A standard deviation with an interval that holds what rounding hides; no value where that is too much.

    hidden_dn2 : by how much rounding may change its variance [DN²].  per_dn : the figure's unit over DN.
    """
    hidden = hidden_dn2 * per_dn**2
    if not math.isfinite(figure.value) or not hidden:
        return figure
    if hidden_dn2 > LEAST_DN2 and hidden > HIDING_SHARE * figure.high**2:
        nothing = replace(figure, value=math.nan, low=math.nan, high=math.nan)
        return nothing.noted(
            f"not measurable: below {HIDING_DN:g} DN of temporal noise rounding makes a pattern, here of up to "
            f"{hidden_dn2**0.5:.2g} DN"
        )
    low, high = (
        math.sqrt(max(0.0, figure.low**2 - hidden)),
        math.sqrt(figure.high**2 + hidden),
    )
    return replace(figure, low=low, high=high)
