"""Share of the values of a stack that the ADC or the full well clips, and what that does to a figure of them.

Where the share is larger than a thousandth, a figure has no value, and its note says why. A smaller share widens it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from ...core import InputError
from ...core.types import Float64Array, NumpyArray
from ..quantity import Quantity

if TYPE_CHECKING:
    from .stack import Stack

LARGEST_SHARE = 1e-3
"""Share of clipped values above which they show no figure: a normal signal 3.1 σ from its limit has as many, which
makes its standard deviation 0.09 % too small."""
FEWEST_CODES = 16
"""Between the smallest and the largest value, below which many values at one of them are a quiet camera's."""
FEWEST_PILED = 20.0
"""Values at one end of the range up to which none is said to be clipped there, but at 0 and at the largest code."""
MOST_VALUES = 2**14
"""Values of a frame that show the distance of two codes."""
MOST_ROUNDING = 0.2
"""Share of a figure's variance, at most, that rounding may have: a tenth of the standard deviation."""
LEAST_DN = 1e-3
"""Rounding that adds less than this is no reason for a figure without a value [DN]."""
OFTEN = 0.05
"""Share of the pixels at the smallest code that jump from there: of unclipped noise of 1 DN, one in a hundred."""


class ClippedError(InputError):
    """Frames that cannot show a figure because their values are clipped."""


@dataclass(frozen=True)
class Clipping:
    """Shares of the values at the ends of the range.

    black : of values 0 in frames without negative values, or at another smallest code that clips.
    saturated : of values at the largest code.
    lowest, largest : values that occur [DN].
    """

    black: float
    saturated: float
    lowest: float
    largest: float

    @property
    def clipped(self) -> bool:
        """Whether more values are clipped than figures allow."""
        return max(self.black, self.saturated) > LARGEST_SHARE

    @property
    def usable(self) -> bool:
        """Whether figures may rest on these values: they are not clipped and not all the same."""
        return not self.clipped and self.lowest < self.largest

    @property
    def share(self) -> float:
        """Share of clipped values at both ends.

        It bounds by how much clipping makes the standard deviation of normal values too small, relatively, and by how
        much it moves their mean [standard deviations].
        """
        return self.black + self.saturated

    @property
    def note(self) -> str:
        """Why these values show no figure; nothing where hardly any value is clipped."""
        if self.lowest == self.largest:
            return f"every value is {self.lowest:g} DN"
        notes = []
        if self.black > LARGEST_SHARE:
            notes.append(
                f"{self.black:.2%} of the values are {self.lowest:g}: the black level is too low"
            )
        if self.saturated > LARGEST_SHARE:
            notes.append(
                f"{self.saturated:.2%} of the values are at the largest code {self.largest:g}"
            )
        return "; ".join(notes)

    @classmethod
    def measure(cls, frames: NumpyArray, bits: int | None) -> Self:
        """Shares of the clipped values of frames, (N, H, W), of an ADC with so many bits, if these are known.

        The largest value is a limit where it is the largest code of so many bits, the smallest where it is 0; any other
        where values pile up there more than in the tail of a distribution.
        """
        lowest, largest = float(frames.min()), float(frames.max())
        saturates = bits is not None and largest >= 2**bits - 1
        saturates = saturates or _piles_up(frames, largest, lowest)
        black_clips = lowest == 0 or _piles_up(frames, lowest, largest)
        return cls(
            _count_values(frames, lowest) / frames.size if black_clips else 0.0,
            _count_values(frames, largest) / frames.size if saturates else 0.0,
            lowest,
            largest,
        )

    def shares_of_pixels(self, frames: NumpyArray) -> Float64Array:
        """Share of the frames in which each pixel is clipped, (N, H, W) → (H, W)."""
        count = np.zeros(frames.shape[1:])
        for frame in frames:
            if self.black > 0:
                count += frame == self.lowest
            if self.saturated > 0:
                count += frame == self.largest
        return count / len(frames)


def _piles_up(frames: NumpyArray, end: float, other_end: float) -> bool:
    """Whether there are more values at an end of the range than the two codes next to it let a tail have.

    Quiet frames have many equal values at their ends, too: pixels must often jump by 3 codes or more from there to the
    next frame, unless the end is a code like 4095.
    """
    values = np.unique(frames[0].ravel()[:MOST_VALUES]).astype(np.float64)
    step = float(np.diff(values).min(initial=np.inf))  # 16 of codes of 12 bits that lie in 16
    at_end = _count_values(frames, end)
    if not math.isfinite(step) or abs(end - other_end) < FEWEST_CODES * step:
        return False
    is_last_code = end > max(other_end, 0) and math.log2(end + 1).is_integer()
    if at_end <= FEWEST_PILED or not (is_last_code or _jumps_from(frames, end, step)):
        return False
    inward = math.copysign(step, other_end - end)
    first, second = (_count_values(frames, end + k * inward) for k in (1, 2))
    tail = first * min(1.0, first / max(second, 1))
    return at_end > max(FEWEST_PILED, tail + 5 * math.sqrt(first))


def _count_values(frames: NumpyArray, value: float) -> int:
    """How many values of the frames equal this one, frame by frame to save memory."""
    return sum(int(np.count_nonzero(frame == value)) for frame in frames)


def _jumps_from(frames: NumpyArray, end: float, step: float) -> bool:
    """Whether pixels at an end in one of the first two frames are often 3 codes or more from it in the other."""
    touching = (frames[:2] == end).any(axis=0)
    if len(frames) < 2 or not touching.any():
        return False
    first, second = (frame[touching].astype(np.float64) for frame in frames[:2])
    return bool(np.mean(np.abs(second - first) > 2.5 * step) > OFTEN)


def mark_clipped(figure: Quantity, *stacks: Stack) -> Quantity:
    """The figure of these stacks: without a value, and with the reason, where they are clipped or constant."""
    for stack in stacks:
        clipping = stack.clipping
        if not clipping.usable:
            figure = figure.without_value(clipped=clipping.clipped)
        figure = figure.noted(clipping.note)
    return figure


def mark_clipped_sigma(figure: Quantity, *stacks: Stack) -> Quantity:
    """The figure marked as by mark_clipped, with an interval that holds what a small share of clipped values hides."""
    hidden = sum(stack.clipping.share for stack in stacks)
    wider = replace(figure, low=figure.low * (1 - hidden), high=figure.high * (1 + hidden))
    return mark_clipped(wider, *stacks)


def mark_coarse(figure: Quantity, *stacks: Stack) -> Quantity:
    """A temporal figure of these stacks: without a value, and with the reason, where rounding hides the noise."""
    for stack in stacks:
        if stack.coarse:
            figure = figure.without_value()
        figure = figure.noted(stack.temporal_note)
    return figure


def mark_rounding(figure: Quantity, *stacks: Stack, per_dn: float = 1.0) -> Quantity:
    """A standard deviation with what rounding may add to it or take from it; without a value where that is too much.

    per_dn : the figure's unit over DN.
    """
    shift = sum(stack.rounding_shift_dn for stack in stacks)
    hidden = shift * (shift + 2 * figure.high / per_dn) * per_dn**2
    if not shift or not math.isfinite(hidden):
        return figure
    if hidden > MOST_ROUNDING * figure.high**2 and shift > LEAST_DN:
        return figure.without_value(f"not measurable: rounding may add or hide {shift:.2g} DN")
    low = math.sqrt(max(figure.low**2 - hidden, 0.0))
    return replace(figure, low=low, high=math.sqrt(figure.high**2 + hidden))


def note_left_out(clipped: str) -> str:
    """A note about clipped levels that are left out of a fit, or nothing.  clipped : why they are clipped."""
    return f"levels with clipped values are left out ({clipped})" if clipped else ""
