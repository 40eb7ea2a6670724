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
        where values pile up there more than in the tail of a distribution. Quiet frames have many equal values at their
        ends, too: pixels must jump from there, unless it is a code like 4095.
        """
        lowest, largest = float(frames.min()), float(frames.max())
        many_codes = largest - lowest >= FEWEST_CODES * _step_dn(frames)
        saturates = bits is not None and largest >= 2**bits - 1
        if not saturates and many_codes:
            saturates = _piles_up_at_top(frames, largest)
        black_clips = lowest == 0
        if not black_clips and many_codes:
            black_clips = _piles_up_at_bottom(frames, lowest)
        black = saturated = 0.0
        if black_clips:
            black = _count_values(frames, lowest) / frames.size
        if saturates:
            saturated = _count_values(frames, largest) / frames.size
        return cls(black, saturated, lowest, largest)

    def shares_of_pixels(self, frames: NumpyArray) -> Float64Array:
        """Share of the frames in which each pixel is clipped, (N, H, W) → (H, W)."""
        count = np.zeros(frames.shape[1:])
        for frame in frames:
            if self.black > 0:
                count += frame == self.lowest
            if self.saturated > 0:
                count += frame == self.largest
        return count / len(frames)


def _piles_up_at_top(frames: NumpyArray, largest: float) -> bool:
    """Whether there are more than 20 values at the largest code, and 5 standard errors more than at the next one."""
    all_bits_set = largest > 0 and math.log2(largest + 1).is_integer()
    at_largest = _count_values(frames, largest)
    if at_largest <= FEWEST_PILED:
        return False
    if not (all_bits_set or len(frames) == 1 or _jumps_from(frames, largest)):
        return False
    next_code = lowest = float(frames.min())
    for frame in frames:
        next_code = max(next_code, float(np.max(frame, where=frame < largest, initial=lowest)))
    at_next = _count_values(frames, next_code)
    return at_largest > max(FEWEST_PILED, at_next + 5 * math.sqrt(at_next))


def _piles_up_at_bottom(frames: NumpyArray, lowest: float) -> bool:
    """Whether there are more values at the smallest code than the two codes above it let a tail have."""
    at_lowest = _count_values(frames, lowest)
    if at_lowest <= FEWEST_PILED or not _jumps_from(frames, lowest):
        return False
    step = _step_dn(frames)
    first, second = (
        _count_values(frames, lowest + step),
        _count_values(frames, lowest + 2 * step),
    )
    tail = first * min(1.0, first / max(second, 1))
    return at_lowest > max(FEWEST_PILED, tail + 5 * math.sqrt(first))


def _count_values(frames: NumpyArray, value: float) -> int:
    """How many values of the frames equal this one, frame by frame to save memory."""
    return sum(int(np.count_nonzero(frame == value)) for frame in frames)


def _step_dn(frames: NumpyArray) -> float:
    """Smallest distance of two values of the first frame [DN]: 16 of codes of 12 bits that lie in 16."""
    distances = np.diff(np.unique(frames[0].ravel()[:MOST_VALUES]).astype(np.float64))
    if distances.size:
        return float(distances.min())
    return 1.0


def _jumps_from(frames: NumpyArray, end: float) -> bool:
    """Whether pixels at an end of the range in one frame are often 3 codes or more from it in the next one.

    Then noise is of a code or more, and no value piles up unless it is clipped.
    """
    if len(frames) < 2:
        return False
    touching = (frames[0] == end) | (frames[1] == end)
    if not touching.any():
        return False
    first, second = (frame[touching].astype(np.float64) for frame in frames[:2])
    jumps = np.abs(second - first) > 2.5 * _step_dn(frames)
    return bool(np.mean(jumps) > OFTEN)


def mark_clipped(figure: Quantity, *stacks: Stack) -> Quantity:
    """The figure of these stacks: without a value, and with the reason, where they are clipped or constant."""
    for stack in stacks:
        clipping = stack.clipping
        if not clipping.usable:
            clipped = figure.clipped or clipping.clipped
            figure = replace(
                figure, value=math.nan, low=math.nan, high=math.nan, clipped=clipped
            )
        figure = figure.noted(clipping.note)
    return figure


def mark_clipped_sigma(figure: Quantity, *stacks: Stack) -> Quantity:
    """The figure marked as by mark_clipped, with an interval that holds what a small share of clipped values hides."""
    hidden = sum(stack.clipping.share for stack in stacks)
    wider = replace(figure, low=figure.low * (1 - hidden), high=figure.high * (1 + hidden))
    return mark_clipped(wider, *stacks)


def mark_temporal_sigma(figure: Quantity, *stacks: Stack) -> Quantity:
    """A standard deviation of temporal noise [DN] marked as by mark_clipped_sigma, and with what rounding hides."""
    figure = mark_rounding(mark_clipped_sigma(figure, *stacks), *stacks)
    return mark_coarse(figure, *stacks)


def mark_coarse(figure: Quantity, *stacks: Stack) -> Quantity:
    """A temporal figure of these stacks: without a value, and with the reason, where rounding hides the noise."""
    for stack in stacks:
        if stack.coarse:
            figure = replace(figure, value=math.nan, low=math.nan, high=math.nan)
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
        nothing = replace(figure, value=math.nan, low=math.nan, high=math.nan)
        return nothing.noted(f"not measurable: rounding may add or hide {shift:.2g} DN")
    low = math.sqrt(max(figure.low**2 - hidden, 0.0))
    return replace(figure, low=low, high=math.sqrt(figure.high**2 + hidden))


def note_left_out(clipped: str) -> str:
    """A note about clipped levels that are left out of a fit, or nothing.  clipped : why they are clipped."""
    if clipped:
        return f"levels with clipped values are left out ({clipped})"
    return ""
