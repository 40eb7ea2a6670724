"""A measured quantity: value with its 95 % interval, unit, symbol, and the section of the standard that defines it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from statistics import NormalDist
from typing import Any, Self

import scipy

from ..core import InputError, numbers

LEVEL = 0.95
"""Coverage of every interval in this package."""

IN_DECIBELS = "DR", "SNR_max"
"""Ratios that EMVA 1288 R4 prints in dB, too."""

TWO_SIDED = NormalDist().inv_cdf((1 + LEVEL) / 2)
"""Half the interval of a normal value [standard errors]: 1.96."""


@dataclass(frozen=True)
class Quantity:
    """What an instrument measured.

    ::

        gain = ms.lab.Quantity("K", "gain", 0.25, 0.24, 0.26, "DN/e-", "EMVA 1288 R4 6.6")
        print(gain, gain.covers(0.245))

    symbol, name : those of EMVA 1288 R4 or of the source (``K``, ``overall system gain``).
    value, low, high : in ``unit``, low and high the ends of the 95 % interval; NaN where nothing could be measured.
        A bound has low and high, but no value.
    section : where the definition stands (``EMVA 1288 R4 6.6``).
    note : what restricts the value (quantisation, too few frames, saturation), or nothing.
    clipped : whether there is no value because values of the frames are clipped.
    """

    symbol: str
    name: str
    value: float
    low: float
    high: float
    unit: str
    section: str
    note: str = ""
    clipped: bool = False

    def __post_init__(self) -> None:
        if not (math.isnan(self.value) or self.low <= self.value <= self.high):
            raise InputError(
                f"{self.symbol}: {self.value!r} is outside of its interval {self.low!r} to {self.high!r}."
            )

    def __str__(self) -> str:
        """``K = 0.1241 DN/e- (0.1239 to 0.1243; EMVA 1288 R4 6.6)``, or ``σ_d < 3.2 e- (…)`` for a bound."""
        remarks = "; ".join(filter(None, (self.section, self.note)))
        if self.is_bound:
            return f"{self.symbol} < {self.high:.4g} {self.unit}".rstrip() + f" ({remarks})"
        value = f"{self.value:.4g} {self.unit}".rstrip()
        if self.symbol in IN_DECIBELS and self.value > 0 and not self.unit:
            value += f" = {20 * math.log10(self.value):.1f} dB"
        return f"{self.symbol} = {value} ({self.low:.4g} to {self.high:.4g}; {remarks})"

    @property
    def standard_error(self) -> float:
        """Standard error of a normal value that has this interval."""
        return (self.high - self.low) / (2 * TWO_SIDED)

    @property
    def is_bound(self) -> bool:
        """Whether only an upper bound is known."""
        return math.isnan(self.value) and math.isfinite(self.high)

    def covers(self, value: float) -> bool:
        """Whether the interval contains this value. Raises InputError for what is no number."""
        number = numbers("value", value, "a number, e.g. 0.125")
        if number.ndim:
            raise InputError(
                f"value has shape {number.shape}; pass one number, and call covers of each of several."
            )
        return self.low <= float(number) <= self.high

    def noted(self, note: str) -> Self:
        """This quantity with one more sentence in its note, unless the sentence is empty or already there."""
        if note in self.note:
            return self
        if not self.note:
            return replace(self, note=note)
        return replace(self, note=f"{self.note}; {note}")

    def with_interval(self, interval: tuple[float, float, float]) -> Self:
        """This quantity with another (value, low, high)."""
        value, low, high = interval
        return replace(self, value=value, low=low, high=high)

    def without_value(self, note: str = "", clipped: bool = False) -> Self:
        """This quantity without a value, and one more sentence in its note.  clipped : whether clipping is why."""
        nothing = self.with_interval((math.nan,) * 3).noted(note)
        return replace(nothing, clipped=self.clipped or clipped)

    def with_width(self) -> Self:
        """This quantity, without a value where its interval has no width: no measurement is exact."""
        if not self.low == self.value == self.high:
            return self
        return self.without_value(f"the values do not scatter about {self.value:.4g}")

    def extended(self, other: Self) -> Self:
        """This quantity with an interval that holds that of another one too, if that has a value."""
        if math.isnan(self.value) or math.isnan(other.value):
            return self
        return replace(self, low=min(self.low, other.low), high=max(self.high, other.high))

    def mapped(self, function: Callable[[float], float], **changes: Any) -> Self:
        """A rising function of this quantity, with other fields changed."""
        value, low, high = map(function, (self.value, self.low, self.high))
        return replace(self, value=value, low=low, high=high, **changes)

    def scaled(self, factor: float, unit: str) -> Self:
        """This quantity times a positive factor that is known exactly, in another unit."""
        return self.mapped(lambda x: x * factor, unit=unit)

    def divided(self, by: Self | float, unit: str) -> Self:
        """This quantity divided by an independent positive one or by an exact number.

        The distances to the ends of the two intervals add in quadrature, each relative to its value. The end of a
        quotient that is farther from 0 is that of the smaller divisor.
        """
        if not isinstance(by, Quantity):
            return self.scaled(1 / by, unit)
        nearer, farther = 1 - by.value / by.high, by.value / by.low - 1
        if self.value < 0:
            nearer, farther = farther, nearer
        down = math.hypot(self.value - self.low, self.value * nearer)
        up = math.hypot(self.high - self.value, self.value * farther)
        low, high = self.value - down, self.value + up
        if self.low >= 0:
            low = max(0.0, low)
        return replace(self, low=low, high=high).scaled(1 / by.value, unit)

    def in_electrons(self, gain: Self | float) -> Self:
        """A figure in DN, DN/s or DN²/s divided by K [DN/e-], or by its square; others as they are."""
        power, _, per = self.unit.partition("/")
        unit = f"e-/{per}" if per else "e-"
        if power == "DN²":
            if not isinstance(gain, Quantity):
                return self.divided(gain**2, unit)
            return self.divided(gain.mapped(lambda x: x**2), unit)
        return self.divided(gain, unit) if power == "DN" else self

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)


def no_value(symbol: str, name: str, unit: str, section: str, note: str = "") -> Quantity:
    """A quantity that was not measured (yet)."""
    return Quantity(symbol, name, math.nan, math.nan, math.nan, unit, section, note)


def normal_interval(value: float, standard_error: float) -> tuple[float, float, float]:
    """(value, low, high) of an estimate that is normal about the true value."""
    half = TWO_SIDED * standard_error
    return value, value - half, value + half


def student_interval(
    value: float, standard_error: float, freedom: float
) -> tuple[float, float, float]:
    """(value, low, high) of an estimate whose standard error comes from a sample with so many degrees of freedom."""
    half = float(scipy.special.stdtrit(freedom, (1 + LEVEL) / 2)) * standard_error
    return value, value - half, value + half


def share_interval(share: float, cases: float) -> tuple[float, float, float]:
    """(value, low, high) of a probability by the beta law of Jeffreys; 0 and 1 stay ends.

    share : how often it happened.  cases : of so many independent ones, which need not be whole.
    """
    tail = (1 - LEVEL) / 2
    hits, misses = share * cases + 0.5, (1 - share) * cases + 0.5
    low, high = (float(scipy.special.betaincinv(hits, misses, p)) for p in (tail, 1 - tail))
    if hits < 1:
        low = 0.0
    if misses < 1:
        high = 1.0
    return share, min(low, share), max(high, share)


def unknown(like: Quantity, note: str, clipped: bool = False) -> Quantity:
    """A quantity like this one, but without a value, and the reason in its note.  clipped : whether clipping is why."""
    return replace(like, note="").without_value(note, clipped)


def upper_bound(like: Quantity, high: float, note: str) -> Quantity:
    """A quantity like this one of which only a bound is known, and the reason in its note."""
    return replace(like, value=math.nan, low=0.0, high=high, note=note)


def quotient(above: Quantity, below: Quantity, like: Quantity) -> Quantity:
    """above / below, with the other fields of ``like`` and the notes of all three; unknown if one is not positive."""
    sentences = [part for one in (like, above, below) for part in one.note.split("; ")]
    notes = "; ".join(filter(None, dict.fromkeys(sentences)))
    if above.is_bound and below.low > 0:
        return replace(
            upper_bound(like, above.high / below.low, notes), low=above.low / below.high
        )
    if not (above.value > 0 and below.value > 0 and below.low > 0):
        notes = notes or f"{above.symbol} or {below.symbol} is not known"
        return unknown(like, notes, above.clipped or below.clipped)
    ratio = above.divided(below, like.unit)
    return replace(like, value=ratio.value, low=ratio.low, high=ratio.high, note=notes)


def product(first: Quantity, second: Quantity, like: Quantity) -> Quantity:
    """first · second, with the other fields of ``like`` and the notes of all three; unknown if one is not positive."""
    if second.low > 0:
        second = replace(
            second, value=1 / second.value, low=1 / second.high, high=1 / second.low
        )
    return quotient(first, second, like)


class Figures:
    """A result of an instrument, a dataclass among whose fields are figures."""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All figures, in the order of the fields; of a field that is a tuple, those in it."""
        found: list[Quantity] = []
        for value in vars(self).values():
            some = value if isinstance(value, tuple) else (value,)
            found += [one for one in some if isinstance(one, Quantity)]
        return tuple(found)
