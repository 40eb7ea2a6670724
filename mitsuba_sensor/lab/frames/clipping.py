"""Fraction of values that the ADC or the full well clips, and the marks that clipping and rounding leave on figures.

If more than a thousandth of the values are clipped, a figure has no value and its note gives the reason. A smaller
fraction widens the interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from ...core import InputError
from ...core.types import Float64Array, NumpyArray
from ..quantity import Quantity

if TYPE_CHECKING:
    from .stack import Stack

CLIPPED_MAX = 1e-3
"""Fraction of clipped values above which figures have no value: a normal signal 3.1 σ below its limit, whose standard
deviation becomes 0.09 % too small."""
CODES_MIN = 16
"""Number of codes between the ends below which many values at one end mean a quiet camera."""
PILED_MIN = 20.0
"""Number of values at one end up to which none counts as clipped, except at code 0 and at the full-scale code."""
SAMPLED_VALUES = 2**14
"""Number of values of a frame that show the step between codes."""
HIDDEN_MAX, HIDDEN_NOTED = 0.2, 0.02
"""Fractions of a variance that rounding or flicker may change: the largest one (a tenth of the standard deviation), and
the one from which on a note reports it."""
ROUNDING_MIN_DN = 1e-3
"""Smaller shifts by rounding are ignored [DN]."""
JUMPS_MIN = 0.05
"""Fraction of the pixels at an end that jump from it to the next frame; of unclipped noise of 1 DN, 1 % do."""


class ClippedError(InputError):
    """Error for frames that cannot show a figure because their values are clipped."""


@dataclass(frozen=True)
class Clipping:
    """Fractions of values at the ends of the range.

    black : fraction at code 0, in frames without negative values, or at another smallest code that clips.
    saturated : fraction at the full-scale code.  lowest, largest : extreme values of the frames [DN].
    """

    black: float
    saturated: float
    lowest: float
    largest: float

    @property
    def clipped(self) -> bool:
        """Return True if more values are clipped than figures allow."""
        return max(self.black, self.saturated) > CLIPPED_MAX

    @property
    def usable(self) -> bool:
        """Return True if figures may use these values: they are not clipped and not all equal."""
        return not self.clipped and self.lowest < self.largest

    @property
    def share(self) -> float:
        """Fraction of clipped values at both ends.

        It bounds the relative error of the standard deviation of normal values, and the shift of their mean in standard
        deviations.
        """
        return self.black + self.saturated

    @property
    def note(self) -> str:
        """Reason why these values show no figure, or an empty text."""
        if self.lowest == self.largest:
            return f"every value is {self.lowest:g} DN"
        notes = []
        if self.black > CLIPPED_MAX:
            notes.append(
                f"{100 * self.black:.2f} % of the values are {self.lowest:g}: the black level is too low"
            )
        if self.saturated > CLIPPED_MAX:
            notes.append(
                f"{100 * self.saturated:.2f} % of the values are at the largest code {self.largest:g}"
            )
        return "; ".join(notes)

    @classmethod
    def measure(cls, frames: NumpyArray, bits: int | None) -> Self:
        """Return the fractions of clipped values of frames (N, H, W).  bits : of the ADC, or None.

        The largest value clips if it is the full-scale code, the smallest if it is 0. Any other value clips if more
        values pile up there than in the tail of a distribution.
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
        """Return the fraction of the frames (N, H, W) in which each pixel is clipped, shape (H, W)."""
        count = np.zeros(frames.shape[1:])
        for frame in frames:
            if self.black > 0:
                count += frame == self.lowest
            if self.saturated > 0:
                count += frame == self.largest
        return count / len(frames)


def _piles_up(frames: NumpyArray, end: float, other_end: float) -> bool:
    """Return True if an end of the range has more values than a tail that continues the next two codes.

    Quiet frames also have many equal values at their ends, so pixels must often jump from there by 3 codes or more to
    the next frame, unless the end is a code like 4095.
    """
    values = np.unique(frames[0].ravel()[:SAMPLED_VALUES]).astype(np.float64)
    step = float(np.diff(values).min(initial=np.inf))  # 16 for 12 bits shifted to 16
    at_end = _count_values(frames, end)
    if not math.isfinite(step) or abs(end - other_end) < CODES_MIN * step:
        return False
    is_last_code = end > max(other_end, 0) and math.log2(end + 1).is_integer()
    if at_end <= PILED_MIN or not (is_last_code or _jumps_from(frames, end, step)):
        return False
    inward = math.copysign(step, other_end - end)
    first, second = (_count_values(frames, end + k * inward) for k in (1, 2))
    tail = first * min(1.0, first / max(second, 1))
    return at_end > max(PILED_MIN, tail + 5 * math.sqrt(first))


def _count_values(frames: NumpyArray, value: float) -> int:
    """Count the values of the frames that equal this one, frame by frame to save memory."""
    return sum(int(np.count_nonzero(frame == value)) for frame in frames)


def _jumps_from(frames: NumpyArray, end: float, step: float) -> bool:
    """Return True if pixels at an end in one of the first two frames are often 3 codes away from it in the other."""
    touching = (frames[:2] == end).any(axis=0)
    if len(frames) < 2 or not touching.any():
        return False
    first, second = (frame[touching].astype(np.float64) for frame in frames[:2])
    return bool(np.mean(np.abs(second - first) > 2.5 * step) > JUMPS_MIN)


def mark_clipped(figure: Quantity, *stacks: Stack) -> Quantity:
    """Return the figure, without a value and with the reason if one of its stacks is clipped or constant."""
    for stack in stacks:
        clipping = stack.clipping
        if not clipping.usable:
            figure = figure.without_value(clipped=clipping.clipped)
        figure = figure.noted(clipping.note)
    return figure


def mark_clipped_sigma(figure: Quantity, *stacks: Stack) -> Quantity:
    """Return a standard deviation marked by :func:`mark_clipped`, with an interval widened by the clipped fraction."""
    hidden = sum(stack.clipping.share for stack in stacks)
    wider = replace(figure, low=figure.low * (1 - hidden), high=figure.high * (1 + hidden))
    return mark_clipped(wider, *stacks)


def mark_coarse(figure: Quantity, *stacks: Stack) -> Quantity:
    """Return a temporal figure, without a value and with the reason if rounding hides the noise of a stack."""
    for stack in stacks:
        if stack.coarse:
            figure = figure.without_value()
        figure = figure.noted(stack.temporal_note)
    return figure


class Pattern(NamedTuple):
    """Standard deviation of rows, columns, pixels or all of a stack [DN].

    pixels : standard deviation of its pixels, which spreads rows and columns between codes; None for other parts.
    """

    stack: Stack
    sigma: Quantity
    pixels: Quantity | None = None

    def hidden_dn2(self) -> float:
        """Return how far rounding may change the variance of this part [DN²], for a normal pattern."""
        shift = self.stack.rounding_shift_dn
        if self.pixels is not None:
            shift *= math.exp(-2 * math.pi**2 * _least_dn2(shift, self.pixels))
        most_dn = _high(self.sigma)
        # Twice the covariance of a normal pattern with its rounding, at the worst place between codes.
        blurred = (
            math.sqrt(12) * shift * math.exp(-2 * math.pi**2 * _least_dn2(shift, self.sigma))
        )
        return shift**2 + min(2 * shift * most_dn, 4 * most_dn**2 * blurred)


def _high(sigma: Quantity) -> float:
    return sigma.high if math.isfinite(sigma.high) else 0.0


def _least_dn2(shift: float, sigma: Quantity) -> float:
    """Return the smallest true variance of a pattern that rounding shifts by this much [DN²]."""
    low = sigma.low if math.isfinite(sigma.low) else 0.0
    return max(low**2 - shift * (shift + 2 * _high(sigma)), 0.0)


def mark_rounding(figure: Quantity, *patterns: Pattern, per_dn: float = 1.0) -> Quantity:
    """Return a standard deviation with an interval that includes rounding, or without a value if rounding is too large.

    patterns : of the stacks that the figure is from.  per_dn : unit of the figure over DN.
    """
    shift = sum(pattern.stack.rounding_shift_dn for pattern in patterns)
    if not shift or not math.isfinite(figure.high):
        return figure
    hidden = sum(pattern.hidden_dn2() for pattern in patterns) * per_dn**2
    if shift < ROUNDING_MIN_DN:
        return figure
    note = f"rounding may add or hide {shift:.2g} DN of a normal pattern"
    return with_hidden(figure, hidden, note)


def with_hidden(figure: Quantity, hidden: float, note: str) -> Quantity:
    """Return a standard deviation whose variance may be off by this much: widened or, if too wide, without a value."""
    if hidden > HIDDEN_MAX * figure.high**2:
        return figure.without_value(f"not measurable: {note}")
    if hidden > HIDDEN_NOTED * figure.high**2:
        figure = figure.noted(f"interval widened: {note}")
    low, high = math.sqrt(max(figure.low**2 - hidden, 0.0)), math.sqrt(figure.high**2 + hidden)
    return replace(figure, low=low, high=high)


def note_left_out(clipped: str) -> str:
    """Return a note on clipped levels that are left out of a fit, or an empty text.  clipped : the reason."""
    return f"levels with clipped values are left out ({clipped})" if clipped else ""
