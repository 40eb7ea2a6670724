"""A measured quantity: value with its 95 % interval, unit, symbol and the section of the standard that defines it."""

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
"""Symbols of ratios that EMVA 1288 R4 also prints in dB."""

TWO_SIDED = NormalDist().inv_cdf((1 + LEVEL) / 2)
"""Half the interval of a normal value [standard errors]: 1.96."""


@dataclass(frozen=True)
class Quantity:
    """Value that an instrument measured, with its 95 % interval.

    ::

        gain = ms.lab.Quantity("K", "gain", 0.25, 0.24, 0.26, "DN/e-", "EMVA 1288 R4 6.6")
        print(gain, gain.covers(0.245))

    symbol, name : those of EMVA 1288 R4 or of the source (``K``, ``overall system gain``).
    value, low, high : value and ends of the 95 % interval, in ``unit``; NaN if nothing could be measured. An upper
        bound has no value and a finite ``high``; a lower bound has an infinite ``high`` and ``value`` equal to ``low``.
    section : place of the definition (``EMVA 1288 R4 6.6``).
    note : what restricts the value (quantisation, few frames, saturation), or an empty text.
    clipped : True if there is no value because values of the frames are clipped.
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
        """``K = 0.1241 DN/e- (0.1239 to 0.1243; EMVA 1288 R4 6.6)``, ``σ_d < 3.2 e- (…)``, ``K not measurable (…)``."""
        remarks = "; ".join(filter(None, (self.section, self.note)))
        if math.isnan(self.value) or self.is_lower_bound:
            return f"{self.symbol} {self.shown} ({remarks})"
        return f"{self.symbol} = {self.shown} ({self.low:.4g} to {self.high:.4g}; {remarks})"

    @property
    def shown(self) -> str:
        """Text of the value with its unit: ``0.1241 DN/e-``, ``< 3.2 e-``, ``≥ 900 = 59.1 dB``, ``not measurable``."""
        number, sign = (self.high, "< ") if self.is_bound else (self.value, "")
        sign = "≥ " if self.is_lower_bound else sign
        if math.isnan(number):
            return "not measurable"
        text = f"{sign}{number:.4g} {self.unit}".rstrip()
        if self.symbol in IN_DECIBELS and number > 0 and not self.unit:
            text += f" = {20 * math.log10(number):.1f} dB"
        return text

    @property
    def standard_error(self) -> float:
        """Standard error of a normal value with this interval."""
        return (self.high - self.low) / (2 * TWO_SIDED)

    @property
    def is_bound(self) -> bool:
        """Return True if only an upper bound is known: no value, but a finite ``high``."""
        return math.isnan(self.value) and math.isfinite(self.high)

    @property
    def is_lower_bound(self) -> bool:
        """Return True if only a lower bound is known: ``value`` and ``low`` are that bound, ``high`` is infinite."""
        return self.value == self.low and math.isinf(self.high)

    def covers(self, value: float) -> bool:
        """Return True if the interval contains this value. Raises InputError unless it is one number."""
        number = numbers("value", value, "a number, e.g. 0.125")
        if number.ndim:
            raise InputError(
                f"value has shape {number.shape}; pass one number, or call covers for each value."
            )
        return self.low <= float(number) <= self.high

    def noted(self, note: str) -> Self:
        """Return this quantity with a sentence added to its note, unless the note contains it."""
        if note in self.note:
            return self
        return replace(self, note="; ".join(filter(None, (self.note, note))))

    def with_interval(self, interval: tuple[float, float, float]) -> Self:
        """Return this quantity with another (value, low, high)."""
        value, low, high = interval
        return replace(self, value=value, low=low, high=high)

    def without_value(self, note: str = "", clipped: bool = False) -> Self:
        """Return this quantity without a value, with the reason in its note.  clipped : True if clipping is it."""
        nothing = self.with_interval((math.nan,) * 3).noted(note)
        return replace(nothing, clipped=self.clipped or clipped)

    def with_width(self) -> Self:
        """Return this quantity, without its value if the interval has no width: no measurement is exact."""
        if not self.low == self.value == self.high:
            return self
        return self.without_value(f"the values do not scatter about {self.value:.4g}")

    def extended(self, other: Self) -> Self:
        """Return this quantity with an interval that also contains that of another one, if both have a value."""
        if math.isnan(self.value) or math.isnan(other.value):
            return self
        return replace(self, low=min(self.low, other.low), high=max(self.high, other.high))

    def mapped(self, function: Callable[[float], float], **changes: Any) -> Self:
        """Return a rising function of this quantity, with other fields changed."""
        value, low, high = map(function, (self.value, self.low, self.high))
        return replace(self, value=value, low=low, high=high, **changes)

    def scaled(self, factor: float, unit: str) -> Self:
        """Return this quantity times an exact positive factor, in another unit."""
        return self.mapped(lambda x: x * factor, unit=unit)

    def divided(self, by: Self | float, unit: str) -> Self:
        """Return this quantity divided by an independent positive one or by an exact number.

        The distances to the ends of the two intervals add in quadrature, each relative to its value. The end of a
        quotient that is farther from 0 comes from the smaller divisor.
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
        """Return a figure in DN, DN/s or DN²/s divided by K [DN/e-] or by K²; other figures unchanged."""
        power, _, per = self.unit.partition("/")
        unit = f"e-/{per}" if per else "e-"
        if power == "DN²":
            square = gain.mapped(lambda x: x**2) if isinstance(gain, Quantity) else gain**2
            return self.divided(square, unit)
        return self.divided(gain, unit) if power == "DN" else self

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


def no_value(symbol: str, name: str, unit: str, section: str, note: str = "") -> Quantity:
    """Return a quantity that was not measured (yet)."""
    return Quantity(symbol, name, math.nan, math.nan, math.nan, unit, section, note)


def normal_interval(value: float, standard_error: float) -> tuple[float, float, float]:
    """Return (value, low, high) of an estimate with a normal distribution about the true value."""
    half = TWO_SIDED * standard_error
    return value, value - half, value + half


def student_interval(
    value: float, standard_error: float, freedom: float
) -> tuple[float, float, float]:
    """Return (value, low, high) of an estimate whose standard error has this many degrees of freedom."""
    half = float(scipy.special.stdtrit(freedom, (1 + LEVEL) / 2)) * standard_error
    return value, value - half, value + half


def share_interval(share: float, cases: float) -> tuple[float, float, float]:
    """Return (value, low, high) of a probability by Jeffreys' beta distribution; 0 and 1 stay ends of the interval.

    share : fraction of the cases.  cases : number of independent cases, not necessarily a whole number.
    """
    tail = (1 - LEVEL) / 2
    hits, misses = share * cases + 0.5, (1 - share) * cases + 0.5
    low, high = (float(scipy.special.betaincinv(hits, misses, p)) for p in (tail, 1 - tail))
    if hits < 1:
        low = 0.0
    if misses < 1:
        high = 1.0
    return share, min(low, share), max(high, share)


def quotient(above: Quantity, below: Quantity, like: Quantity) -> Quantity:
    """Return above / below with the other fields of ``like`` and the notes of all three quantities.

    The quotient is a bound if one of them is a bound, and has no value if one of them is not positive.
    """
    sentences = [text for figure in (like, above, below) for text in figure.note.split("; ")]
    notes = "; ".join(filter(None, dict.fromkeys(sentences)))
    if any(figure.is_bound or figure.is_lower_bound for figure in (above, below)):
        low = above.low / below.high
        high = above.high / below.low if below.low > 0 and not below.is_bound else math.inf
        value = low if math.isinf(high) else math.nan
        if math.isfinite(high) or low > 0:
            return replace(like, value=value, low=low, high=high, note=notes)
    if not (above.value > 0 and below.value > 0 and below.low > 0):
        notes = notes or f"{above.symbol} or {below.symbol} is not known"
        return replace(like, note=notes).without_value(clipped=above.clipped or below.clipped)
    ratio = above.divided(below, like.unit)
    return replace(like, value=ratio.value, low=ratio.low, high=ratio.high, note=notes)


def product(first: Quantity, second: Quantity, like: Quantity) -> Quantity:
    """Return first · second with the other fields of ``like`` and the notes of all three, as :func:`quotient` does."""
    if second.low > 0:
        second = replace(
            second, value=1 / second.value, low=1 / second.high, high=1 / second.low
        )
    return quotient(first, second, like)


class Figures:
    """Base of a result of an instrument, a dataclass with quantities among its fields."""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All quantities in the order of the fields, including the items of fields that are tuples."""
        items = [
            item
            for value in vars(self).values()
            for item in (value if isinstance(value, tuple) else (value,))
        ]
        return tuple(item for item in items if isinstance(item, Quantity))
