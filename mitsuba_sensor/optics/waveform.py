"""Waveforms of lamps: how a light of mean 1 goes up and down in time, and its mean while a row is open, in closed form.

w(t) = 1 + p(t), where p is periodic with the mean 0. With P(t) = ∫₀ᵗ p dt, which is periodic too, the mean of w over
[t, t + T] is 1 + (P(t + T) − P(t))/T. Nothing is sampled in time, and P keeps its precision at any t.

A text says the same: ``2 pwm(100, 0.5)`` is a level and a waveform, ``0.2`` a level alone.
"""

from __future__ import annotations

import ast
import re
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import Float64Array, InputError, nearest, require
from ..core.csv_rows import named_column, rows_of
from ..files.texts import text_of_file

if TYPE_CHECKING:
    from .shutter import Shutter

FIRST = ("time", "t")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
HIGHEST_LEVEL = 1e9
HIGHEST_HZ = 1e12
EXAMPLE = "e.g. 0.2, 'pwm(100, 0.5)' or '2 sine(100, 0.3)'"
CALL = re.compile(r"\s*(?P<level>[^\s(]*)\s*\b(?P<kind>[a-z]\w*)\s*\((?P<arguments>.*)\)\s*")


def checked_level(name: str, level: float) -> float:
    """A level of light, over that of the render. Raises InputError."""
    return require(name, level, 0.0, HIGHEST_LEVEL, "a number, e.g. 0.5")


@dataclass(frozen=True, repr=False)
class Waveform:
    """Light over time, of mean ``level`` over that of the render; the shape has the mean 1. This one is constant.

    level : factor on the light, over that of the render.
    """

    level: float = field(default=1.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", checked_level("level", self.level))

    @property
    def flickers(self) -> bool:
        """Whether it is more than a level."""
        return type(self) is not Waveform

    def __repr__(self) -> str:
        """As :func:`waveform_of` reads it: ``2 pwm(100, 0.5)``."""
        shape = [getattr(self, one.name) for one in fields(self) if one.name != "level"]
        if not self.flickers:
            return f"{self.level:g}"
        numbers = ", ".join(f"{value:.10g}" for value in shape)
        level = "" if self.level == 1 else f"{self.level:g} "
        return f"{level}{type(self).__name__}({numbers})"

    def mean_over(self, start_s: ArrayLike, open_s: float) -> Float64Array:
        """Mean of level·w(t) from each start on, (H,), while a row is open; level·w itself where it is open for 0 s."""
        starts = np.asarray(start_s, dtype=np.float64)
        if open_s > 0:
            mean = self.integral(starts, starts + open_s) / open_s
        else:
            mean = self.value_at(starts)
        return np.asarray(self.level * np.maximum(mean, 0.0))

    def weights(self, shutter: Shutter, rows: tuple[int, int]) -> Float64Array:
        """What the rows [first, last) of a frame get of the light of the render, (rows,)."""
        return self.mean_over(shutter.start_s(np.arange(*rows)), shutter.open_s)

    def shares(self, start_s: ArrayLike, open_s: float, parts: int) -> Float64Array:
        """Share of the light of each row in each of so many equal parts of its exposure, (H, parts); of rows that are
        dark all the time, and of those that are open for 0 s, 1/parts."""
        starts = np.asarray(start_s, dtype=np.float64)[:, None]
        edges = starts + open_s * np.arange(parts + 1) / parts
        light = np.maximum(self.integral(edges[:, :-1], edges[:, 1:]), 0.0)
        total = light.sum(axis=1, keepdims=True)
        shares = np.full(light.shape, 1 / parts)
        return np.asarray(np.divide(light, total, out=shares, where=total > 0))

    def integral(self, start_s: Float64Array, stop_s: Float64Array) -> Float64Array:
        """∫ w dt from start to stop [s]."""
        return stop_s - start_s + self.departure(stop_s) - self.departure(start_s)

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """w(t), of mean 1."""
        return np.ones_like(time_s)

    def departure(self, time_s: Float64Array) -> Float64Array:
        """P(t) = ∫₀ᵗ (w − 1) dt [s], up to a constant."""
        return np.zeros_like(time_s)


@dataclass(frozen=True, repr=False)
class _Cycles(Waveform):
    """A waveform that repeats; the phase is the share of a period that has passed at time 0."""

    frequency_hz: float

    def __post_init__(self) -> None:
        super().__post_init__()
        hertz = require("frequency_hz", self.frequency_hz, 1e-9, HIGHEST_HZ, "hertz, e.g. 100")
        object.__setattr__(self, "frequency_hz", hertz)
        for name in ("duty", "depth", "phase"):
            if hasattr(self, name):
                object.__setattr__(self, name, _checked_share(name, getattr(self, name)))

    def _share(self, time_s: Float64Array, frequency_hz: float) -> Float64Array:
        """Share of the period that has passed, 0 to 1."""
        cycles = time_s * frequency_hz + getattr(self, "phase", 0.0)
        return np.asarray(cycles - np.floor(cycles))


def _checked_share(name: str, value: float) -> float:
    """Duty, depth or phase. Raises InputError."""
    if name == "duty":
        return require(name, value, 1e-9, 1.0, "the share of a period that is lit, e.g. 0.5")
    if name == "depth":
        return require(name, value, 0.0, 1.0, "a number from 0 to 1, e.g. 0.3")
    return require(name, value, -1e6, 1e6, "in periods, e.g. 0.25")


@dataclass(frozen=True, repr=False)
class pwm(_Cycles):
    """Pulse-width modulation: w = 1/duty during the first ``duty`` of every period, and 0 after that.

    ::

        lamp = ms.pwm(100, 0.5, level=2.0)  # "2 pwm(100, 0.5)"
        lamp.mean_over([0.0, 0.004], 0.002)  # [4, 2]: of two rows that are open for 2 ms

    frequency_hz : pulses per second.  duty : lit share of a period, above 0 to 1.  phase : in periods at time 0.
    """

    duty: float
    phase: float = 0.0

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """1/duty while it is lit."""
        return np.where(self._share(time_s, self.frequency_hz) < self.duty, 1 / self.duty, 0.0)

    def integral(self, start_s: Float64Array, stop_s: Float64Array) -> Float64Array:
        """Lit time over the duty: whole periods and min(u, d)/f of the last one, exactly 0 where it is dark."""
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
        """1 + m·sin(2πu)."""
        return 1 + self.depth * np.sin(2 * np.pi * self._share(time_s, self.frequency_hz))

    def departure(self, time_s: Float64Array) -> Float64Array:
        """P = −m·cos(2πu)/(2πf)."""
        cosine = np.cos(2 * np.pi * self._share(time_s, self.frequency_hz))
        return -self.depth * cosine / (2 * np.pi * self.frequency_hz)


@dataclass(frozen=True, repr=False)
class mains(_Cycles):
    """A lamp on rectified mains: w = (π/2)·|sin(2πft)|, which repeats at twice the frequency of the mains.

    ::

        ms.mains(50).mean_over([0.0, 0.0025], 0.01)  # [1, 1]: a whole period

    frequency_hz : of the mains, 50 or 60.
    """

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """(π/2)·sin(πv), v the share of half a period that has passed."""
        return np.pi / 2 * np.sin(np.pi * self._share(time_s, 2 * self.frequency_hz))

    def departure(self, time_s: Float64Array) -> Float64Array:
        """P = ((1 − cos(πv))/2 − v)/(2f)."""
        share = self._share(time_s, 2 * self.frequency_hz)
        return ((1 - np.cos(np.pi * share)) / 2 - share) / (2 * self.frequency_hz)


@dataclass(frozen=True, repr=False)
class table(Waveform):
    """A measured waveform: a CSV of time and value, straight between its rows, which repeats behind the last row.

    Times are in seconds, or in the unit that a header names: time_ms, time_us or time_ns. The values
    are divided by their mean. The last time is one period behind the first.  file : its path.
    """

    file: str
    times_s: tuple[float, ...] = field(default=(), init=False)
    values: tuple[float, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        times, values = _read_table(str(self.file))
        mean = np.trapezoid(values, times) / (times[-1] - times[0])
        if not mean > 0:
            raise InputError(
                f"the waveform {self.file!r} is 0 all the time; give one with light."
            )
        object.__setattr__(self, "times_s", tuple(times.tolist()))
        object.__setattr__(self, "values", tuple((values / mean).tolist()))

    def __repr__(self) -> str:
        """``table(FILE)``."""
        level = "" if self.level == 1 else f"{self.level:g} "
        return f"{level}table({self.file})"

    def _within(self, time_s: Float64Array) -> Float64Array:
        """Time since the first row, without whole periods [s]."""
        since = time_s - self.times_s[0]
        return np.asarray(np.mod(since, self.times_s[-1] - self.times_s[0]))

    def value_at(self, time_s: Float64Array) -> Float64Array:
        """Straight between the rows."""
        return np.interp(self._within(time_s) + self.times_s[0], self.times_s, self.values)

    def departure(self, time_s: Float64Array) -> Float64Array:
        """Sum of the trapezoids before, and the part of the one that t is in."""
        times, values = np.array(self.times_s) - self.times_s[0], np.array(self.values)
        steps, slopes = np.diff(times), np.diff(values) / np.diff(times)
        sums = np.concatenate([[0.0], np.cumsum(steps * (values[:-1] + values[1:]) / 2)])
        now = self._within(time_s)
        row = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(steps) - 1)
        since = now - times[row]
        return np.asarray(sums[row] + since * (values[row] + slopes[row] * since / 2) - now)


FROM_FILE = "table("
KINDS: dict[str, type[Waveform]] = {one.__name__: one for one in (pwm, sine, mains, table)}


def waveform_of(name: str, given: object) -> Waveform:
    """A level, a waveform or a text of both, as :class:`Waveform`.  name : of what shines. Raises InputError."""
    if isinstance(given, Waveform):
        return given
    whole = CALL.fullmatch(given) if isinstance(given, str) else None
    if whole is None:
        return Waveform(level=_level(name, given))
    kind = whole["kind"]
    if kind not in KINDS:
        known = ", ".join(KINDS)
        raise InputError(
            f"the light of {name} is {given!r}, and there is no waveform {kind!r}; there are {known}."
            f"{nearest(kind, KINDS)}"
        )
    level = 1.0 if not whole["level"] else _level(name, whole["level"].rstrip("*"))
    shape = [one for one in fields(KINDS[kind]) if one.init and one.name != "level"]
    texts = [text.strip() for text in whole["arguments"].split(",") if text.strip()]
    needed = [one.name for one in shape if one.default is MISSING]
    if kind == "table":
        return table(whole["arguments"].strip().strip("'\""), level=level)
    if not len(needed) <= len(texts) <= len(shape):
        numbers = ", ".join(one.name for one in shape)
        raise InputError(
            f"the light of {name} is {given!r}; the numbers of {kind} are {numbers}, {EXAMPLE}."
        )
    return KINDS[kind](*(_number(name, given, text) for text in texts), level=level)


def _level(name: str, given: object) -> float:
    level = None
    if not isinstance(given, bool):
        with suppress(TypeError, ValueError):
            level = float(given)  # type: ignore[arg-type]
    if level is None:
        raise InputError(
            f"the light of {name} is {given!r}, which is neither a level nor a waveform; {EXAMPLE}."
        )
    return checked_level(f"the level of {name}", level)


def _number(name: str, given: object, text: str) -> float:
    try:
        return float(ast.literal_eval(text))
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InputError(
            f"the light of {name} is {given!r}, where {text!r} is no number; {EXAMPLE}."
        ) from None


def _read_table(path: str) -> tuple[Float64Array, Float64Array]:
    """Times [s] and values of a CSV, in seconds unless a header has another unit. Raises InputError."""
    what = "two columns, rising times and values that are not negative"
    rows = rows_of(text_of_file(Path(path), f"give a CSV of {what}"), FIRST)
    numbers, unit_s = [], 1.0
    for number, row in enumerate(rows, start=1):
        try:
            numbers.append([float(cell) for cell in row])
        except ValueError:
            if number > 1:
                raise InputError(
                    f"row {number} of {path} is {row}; it must have {what}."
                ) from None
            unit_s = _unit_s(path, row[0])
    if len(numbers) < 2 or any(len(row) != 2 for row in numbers):
        raise InputError(f"the waveform {path!r} needs two rows or more of {what}.")
    times, values = np.array(numbers).T
    if (
        not (np.diff(times) > 0).all()
        or not (values >= 0).all()
        or not np.isfinite(numbers).all()
    ):
        raise InputError(f"the waveform {path!r} must have {what}.")
    return times * unit_s, values


def _unit_s(path: str, title: str) -> float:
    """The unit of times with this title [s]. Raises InputError."""
    try:
        return SECONDS[named_column(1, title, SECONDS, FIRST)[1]]
    except ValueError as error:
        raise InputError(f"{path}: {error}.") from None
