"""Share of the values of a stack that the ADC or the full well clips, and the sentence that results then carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .stack import Stack

NOTED = 1e-3
"""Share of clipped values from which on a result says so: a normal signal 3.1 σ from its limit has as many."""
COARSE_DN = 0.4
"""Temporal noise [DN] below which rounding hides differences between pixels: the mean of rounded normal values is
off by exp(−2π²σ²)/π at most, 0.014 DN there and 0.14 DN at half of it."""

ROUNDING_DN2 = 1 / 12
"""Variance that rounding to whole numbers adds [DN²]."""


@dataclass(frozen=True)
class Clipping:
    """Shares of the values at the ends of the range.

    black : of values 0 in frames without negative values.  saturated : of values at the largest code.
    lowest, largest : values that occur [DN].
    """

    black: float
    saturated: float
    lowest: float
    largest: float

    @property
    def usable(self) -> bool:
        """Whether more than half of the values are inside of the range, and they are not all the same."""
        return self.black < 0.5 and self.saturated < 0.5 and self.lowest < self.largest

    @property
    def note(self) -> str:
        """What to say of a result; nothing where hardly any value is clipped."""
        if self.lowest == self.largest:
            return f"every value is {self.lowest:g} DN"
        black = f"{self.black:.2%} of the values are 0: the black level is too low" if self.black > NOTED else ""
        top = f"{self.saturated:.2%} of the values are at the largest code {self.largest:g}"
        return "; ".join(filter(None, (black, top if self.saturated > NOTED else "")))


def clipping_of(frames: NDArray[Any], bits: int | None) -> Clipping:
    """Of frames, (N, H, W). Without ``bits`` the largest value is the largest code if so many values pile up there that
    they are not the tail of a distribution: more than 20, and 5 standard errors more than at the value below, of 16
    codes or more.
    """
    lowest, largest = float(frames.min()), float(frames.max())
    black, at_top, below = (
        sum(int(np.count_nonzero(frame == value)) for frame in frames) for value in (0, largest, largest - 1)
    )
    whole = frames.dtype.kind != "f"
    if bits is not None:
        clipped = largest >= 2**bits - 1
    else:
        clipped = at_top > max(20.0, below + 5 * below**0.5 if whole else 0.0) and not (whole and largest - lowest < 16)
    shares = (black if lowest == 0 else 0) / frames.size, (at_top if clipped else 0) / frames.size
    return Clipping(*shares, lowest, largest)


def temporal_note(stack: Stack) -> str:
    """What a stack is short of for its temporal noise to be removed: frames, or a noise that rounding does not hide."""
    if len(stack) == 1:
        return "one frame: temporal noise is not told from spatial, pass at least 2"
    temporal_dn = max(0.0, float(stack.variance.mean()) - ROUNDING_DN2) ** 0.5
    if stack.frames.dtype.kind != "f" and temporal_dn < COARSE_DN:
        return f"temporal noise is {temporal_dn:.2g} DN: rounding hides differences below 1 DN"
    return ""
