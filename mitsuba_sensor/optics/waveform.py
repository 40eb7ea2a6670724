"""Waveforms of light sources: light of mean 1 versus time, and its mean during a row's exposure, in closed form.

w(t) = 1 + p(t), where p is periodic with mean 0. With the periodic P(t) = ∫₀ᵗ p dt, the mean of w over [t, t + T] is
1 + (P(t + T) − P(t))/T. Time is not sampled, and P keeps its precision at any t.

A text also describes a waveform: ``2 pwm(100, 0.5)`` is a level and a waveform, ``0.2`` a constant level.
"""

from __future__ import annotations

import re
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import Float64Array, InputError, nearest, require
from ..core.csv_rows import named_column, rows_of
from ..files.texts import text_of_file

if TYPE_CHECKING:
    from .shutter import Shutter

FIRST = ("time", "t")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LIMITS = {
    "level": (0.0, 1e9, "a number, e.g. 0.5"),
    "frequency_hz": (1e-9, 1e12, "hertz, e.g. 100"),
    "duty": (1e-9, 1.0, "the lit fraction of a period, e.g. 0.5"),
    "depth": (0.0, 1.0, "a number from 0 to 1, e.g. 0.3"),
    "phase": (-1e6, 1e6, "in periods, e.g. 0.25"),
}
"""Parameter of a waveform → smallest and largest value, and its meaning."""
EXAMPLE = "e.g. 0.2, 'pwm(100, 0.5)' or '2 sine(100, 0.3)'"
CALL = re.compile(r"\s*(?P<level>[^\s(]*)\s*\b(?P<kind>[a-z]\w*)\s*\((?P<arguments>.*)\)\s*")


@dataclass(frozen=True, repr=False)
class Waveform:
    """Light versus time, relative to the render; this base class is constant.

    level : mean, as a factor on the rendered light.
    """

    level: float = field(default=1.0, kw_only=True)

    def __post_init__(self) -> None:
        for name, limits in LIMITS.items():
            if hasattr(self, name):
                object.__setattr__(self, name, require(name, getattr(self, name), *limits))

    @property
    def flickers(self) -> bool:
        """Return True if the light changes in time."""
        return type(self) is not Waveform

    def __repr__(self) -> str:
        """Return the text that :func:`waveform_of` reads: ``2 pwm(100, 0.5)``."""
        if not self.flickers:
            return f"{self.level:g}"
        values = (getattr(self, parameter.name) for parameter in _parameters(type(self)))
        texts = (value if isinstance(value, str) else f"{value:.10g}" for value in values)
        level = "" if self.level == 1 else f"{self.level:g} "
        return f"{level}{type(self).__name__}({', '.join(texts)})"

    def mean_over(self, start_s: ArrayLike, open_s: float) -> Float64Array:
        """Return the mean of level·w(t) from each start for ``open_s``, shape (H,); level·w(t) for 0 s."""
        starts = np.asarray(start_s, dtype=np.float64)
        ends = starts + open_s
        mean = self.integral(starts, ends) / open_s if open_s > 0 else self.value_at(starts)
        return np.asarray(self.level * np.maximum(mean, 0.0))

    def weights(self, shutter: Shutter, rows: tuple[int, int]) -> Float64Array:
        """Return the factors on the rendered light of the rows [first, last) of a frame, shape (rows,)."""
        return self.mean_over(shutter.start_s(np.arange(*rows)), shutter.open_s)

    def shares(self, start_s: ArrayLike, open_s: float, parts: int) -> Float64Array:
        """Return the fraction of each row's light in equal parts of its exposure, shape (H, parts).

        It is 1/parts for dark rows and for exposures of 0 s.
        """
        starts = np.asarray(start_s, dtype=np.float64)[:, None]
        edges = starts + open_s * np.arange(parts + 1) / parts
        light = np.maximum(self.integral(edges[:, :-1], edges[:, 1:]), 0.0)
        total = light.sum(axis=1, keepdims=True)
        shares = np.full(light.shape, 1 / parts)
        return np.asarray(np.divide(light, total, out=shares, where=total > 0))

    def integral(self, start_s: Float64Array, stop_s: Float64Array) -> Float64Array:
        """Return ∫ w dt from start to stop [s]."""
        return stop_s - start_s + self.departure(stop_s) - self.departure(start_s)

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Return w(t), with mean 1."""
        return np.ones_like(time_s)

    def departure(self, time_s: Float64Array) -> Float64Array:
        """Return P(t) = ∫₀ᵗ (w − 1) dt [s], up to a constant."""
        return np.zeros_like(time_s)


@dataclass(frozen=True, repr=False)
class _Cycles(Waveform):
    """A periodic waveform; the phase is the elapsed fraction of a period at time 0."""

    frequency_hz: float

    def _share(self, time_s: Float64Array, frequency_hz: float) -> Float64Array:
        """Return the elapsed fraction of the period, 0 to 1."""
        cycles = time_s * frequency_hz + getattr(self, "phase", 0.0)
        return np.asarray(cycles - np.floor(cycles))


@dataclass(frozen=True, repr=False)
class pwm(_Cycles):
    """Pulse-width modulation: w = 1/duty during the first ``duty`` of every period, and 0 after that.

    ::

        lamp = ms.pwm(100, 0.5, level=2.0)  # "2 pwm(100, 0.5)"
        lamp.mean_over([0.0, 0.004], 0.002)  # [4, 2]: two rows with 2 ms exposure

    frequency_hz : pulses per second.  duty : lit fraction of a period, up to 1.  phase : in periods at time 0.
    """

    duty: float
    phase: float = 0.0

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Return 1/duty while lit, else 0."""
        return np.where(self._share(time_s, self.frequency_hz) < self.duty, 1 / self.duty, 0.0)

    def integral(self, start_s: Float64Array, stop_s: Float64Array) -> Float64Array:
        """Return lit time over duty: whole periods and min(u, d)/f of the last period; exactly 0 in the dark."""
        begin, end = (time_s * self.frequency_hz + self.phase for time_s in (start_s, stop_s))
        whole = np.floor(end) - np.floor(begin)
        rest = np.minimum(end % 1, self.duty) - np.minimum(begin % 1, self.duty)
        return np.asarray((whole * self.duty + rest) / (self.duty * self.frequency_hz))


@dataclass(frozen=True, repr=False)
class sine(_Cycles):
    """w = 1 + depth·sin(2π(f·t + phase)).

    ::

        ms.sine(100, 0.3).mean_over([0.0, 0.005], 0.005)  # [1.19, 0.81]

    frequency_hz : periods per second.  depth : 0 to 1.  phase : in periods at time 0.
    """

    depth: float
    phase: float = 0.0

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Return 1 + m·sin(2πu)."""
        return 1 + self.depth * np.sin(2 * np.pi * self._share(time_s, self.frequency_hz))

    def departure(self, time_s: Float64Array) -> Float64Array:
        """Return −m·cos(2πu)/(2πf)."""
        cosine = np.cos(2 * np.pi * self._share(time_s, self.frequency_hz))
        return -self.depth * cosine / (2 * np.pi * self.frequency_hz)


@dataclass(frozen=True, repr=False)
class mains(_Cycles):
    """A lamp on rectified mains: w = (π/2)·|sin(2πft)|, periodic at twice the mains frequency.

    ::

        ms.mains(50).mean_over([0.0, 0.0025], 0.01)  # [1, 1]: a whole period

    frequency_hz : mains frequency, 50 or 60.
    """

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Return (π/2)·sin(πv), with the elapsed fraction v of half a mains period."""
        return np.pi / 2 * np.sin(np.pi * self._share(time_s, 2 * self.frequency_hz))

    def departure(self, time_s: Float64Array) -> Float64Array:
        """Return ((1 − cos(πv))/2 − v)/(2f)."""
        share = self._share(time_s, 2 * self.frequency_hz)
        return ((1 - np.cos(np.pi * share)) / 2 - share) / (2 * self.frequency_hz)


@dataclass(frozen=True, repr=False)
class table(Waveform):
    """A measured periodic waveform: a CSV of time and value, linear between its rows.

    Times are in seconds, or in the unit of a header: time_ms, time_us or time_ns. Values are divided by their mean. The
    last time is one period after the first.  file : its path.
    """

    file: str
    times_s: tuple[float, ...] = field(default=(), init=False)
    values: tuple[float, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "file", str(self.file))
        times, values = _read_table(self.file)
        mean = np.trapezoid(values, times) / (times[-1] - times[0])
        if not mean > 0:
            raise InputError(
                f"the waveform {self.file!r} is 0 everywhere; give at least one positive value."
            )
        object.__setattr__(self, "times_s", tuple(times.tolist()))
        object.__setattr__(self, "values", tuple((values / mean).tolist()))

    def _within(self, time_s: Float64Array) -> Float64Array:
        """Return the time since the first row, without whole periods [s]."""
        since = time_s - self.times_s[0]
        return np.asarray(np.mod(since, self.times_s[-1] - self.times_s[0]))

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Return the value interpolated between rows."""
        return np.interp(self._within(time_s) + self.times_s[0], self.times_s, self.values)

    def departure(self, time_s: Float64Array) -> Float64Array:
        """Return the sum of trapezoids up to t."""
        times, values = np.array(self.times_s) - self.times_s[0], np.array(self.values)
        steps, slopes = np.diff(times), np.diff(values) / np.diff(times)
        sums = np.concatenate([[0.0], np.cumsum(steps * (values[:-1] + values[1:]) / 2)])
        now = self._within(time_s)
        row = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(steps) - 1)
        since = now - times[row]
        return np.asarray(sums[row] + since * (values[row] + slopes[row] * since / 2) - now)


FROM_FILE = "table("
KINDS: dict[str, type[Waveform]] = {x.__name__: x for x in (pwm, sine, mains, table)}


def _parameters(kind: type[Waveform]) -> list[Field[Any]]:
    """Return the parameters in the brackets of a text of this kind."""
    return [x for x in fields(kind) if x.init and x.name != "level"]


def waveform_of(name: str, given: object) -> Waveform:
    """Return a level, a waveform or a text as a :class:`Waveform`.  name : of the light. Raises InputError."""
    if isinstance(given, Waveform):
        return given
    whole = CALL.fullmatch(given) if isinstance(given, str) else None
    if whole is None:
        level = None if isinstance(given, bool) else _number(given)
        if level is None:
            raise InputError(
                f"the light of {name} is {given!r}; it must be a level or a waveform, {EXAMPLE}."
            )
        return Waveform(level=require(f"the level of {name}", level, *LIMITS["level"]))
    kind, text = whole["kind"], whole["level"].rstrip("*")
    if kind not in KINDS:
        raise InputError(
            f"the light of {name} is {given!r}; the waveform must be {', '.join(KINDS)}.{nearest(kind, KINDS)}"
        )
    level = waveform_of(name, text).level if text else 1.0
    if kind == "table":
        return table(whole["arguments"].strip().strip("'\""), level=level)
    parameters = _parameters(KINDS[kind])
    numbers = [_number(text) for text in whole["arguments"].split(",") if text.strip()]
    needed = sum(x.default is MISSING for x in parameters)
    if None in numbers or not needed <= len(numbers) <= len(parameters):
        names = ", ".join(x.name for x in parameters)
        raise InputError(
            f"the light of {name} is {given!r}; {kind} takes the numbers {names}, {EXAMPLE}."
        )
    return KINDS[kind](*numbers, level=level)


def _number(given: object) -> float | None:
    """Return the given number, or None."""
    try:
        return float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None


def _read_table(path: str) -> tuple[Float64Array, Float64Array]:
    """Return times [s] and values of a CSV; a header may give the unit of time. Raises InputError."""
    what = "two columns: increasing times and values of at least 0"
    header, *rows = rows_of(text_of_file(Path(path), f"give a CSV of {what}"), FIRST) or [[]]
    unit_s = 1.0
    if header and _number(header[0]) is None:
        try:
            unit_s = SECONDS[named_column(1, header[0], SECONDS, FIRST)[1]]
        except ValueError as error:
            raise InputError(f"{path}: {error}.") from None
    else:
        rows = [header, *rows]
    try:
        times, values = np.array([list(map(float, row)) for row in rows]).T
    except ValueError:  # a text, or another number of columns
        times, values = np.zeros((2, 1))
    is_finite = np.isfinite([times, values]).all()
    if len(times) < 2 or not ((np.diff(times) > 0).all() and values.min() >= 0 and is_finite):
        raise InputError(f"the waveform {path!r} must have at least two rows of {what}.")
    return times * unit_s, values
