"""InputError, the one error that wrong input raises, and range checks that raise it.

A message is one sentence with the value, the allowed range and the remedy; the command line prints it and exits 2.
"""

import math
import operator
import reprlib
from pathlib import Path

from .number_text import number_hint
from .printable import printable

LONGEST_HEAD, LONGEST_END = (
    900,
    450,
)  # characters of a sentence, of which the end says the way out


class InputError(ValueError):
    """Wrong input: the message says what was given, why it cannot be computed, and what to pass instead.

    ::

        try:
            ms.load_camera("bayer_2pm")
        except ms.InputError as error:
            print(error)

    It is one line of printable text, whatever is quoted in it, and cut in the middle where that has no end.
    """

    def __str__(self) -> str:
        return self.sentence(super().__str__())

    @staticmethod
    def sentence(message: str) -> str:
        """A message as it is shown."""
        message = printable(message)
        if len(message) <= LONGEST_HEAD + LONGEST_END:
            return message
        return f"{message[:LONGEST_HEAD]} … {message[-LONGEST_END:]}"


class DiskFull(InputError):
    """A disk that has no place for a file.  path : of the file.  size : bytes that were to be written, if known."""

    def __init__(self, path: Path, size: int | None, why: str) -> None:
        super().__init__(path, size, why)
        self.path, self.size, self.why = path, size, why

    def __str__(self) -> str:
        if self.size is None:
            wanted = ""
        else:
            wanted = f"{self.size} bytes were to be written; "
        return self.sentence(
            f"cannot write {self.path}: {self.why}; {wanted}make space there, or give another place."
        )


class _ShortRepr(reprlib.Repr):
    """The repr of values from files, of bounded length and depth, and taken in bounded time."""

    maxlevel, maxdict, maxlist, maxtuple, maxset = 3, 4, 6, 6, 6
    maxstring = maxlong = maxother = 80

    def repr_int(self, x: int, level: int) -> str:
        """Python refuses to write a whole number of thousands of digits."""
        if x.bit_length() > 8 * self.maxlong:
            return f"a whole number of {x.bit_length()} bits"
        return super().repr_int(x, level)


def shown(value: object) -> str:
    """A value as a sentence shows it, whatever its size: repr, with ``...`` for what is left out."""
    return _ShortRepr().repr(value)


def require(name: str, value: float, low: float, high: float, remedy: str) -> float:
    """``value`` if it is a number in [low, high], else InputError.  name : with the unit.  remedy : what to pass."""
    try:
        boolean = (
            isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b"
        )
        number = float("" if boolean else value + 0)  # refuses a string such as "0.1"
    except (TypeError, ValueError, OverflowError):
        hint = number_hint(name, value)
        more = hint and f"; {hint}"
        raise InputError(
            f"{name} is {shown(value)}; it must be a number ({remedy}{more})."
        ) from None
    if math.isnan(number) or not low <= number <= high:
        raise InputError(f"{name} is {shown(value)}; it must be {span(low, high)} ({remedy}).")
    return number


def require_count(name: str, value: int, low: int, high: int, example: int) -> int:
    """``value`` if it is a whole number in [low, high], else InputError."""
    remedy = f"a whole number, e.g. {example}"
    require(name, value, low, high, remedy)
    try:
        return operator.index(value)
    except TypeError:
        raise InputError(
            f"{name} is {shown(value)}; it must be a whole number {span(low, high)} (e.g. {example})."
        ) from None


def require_seed(name: str, value: int) -> int:
    """Return ``value`` if it is a whole number that fits the 64-bit key of the random number generator."""
    try:
        if isinstance(value, bool):
            number = -1
        else:
            number = operator.index(value)
    except TypeError:  # no whole number, or an array of them
        number = -1
    if not 0 <= number < 2**64:
        raise InputError(
            f"{name} is {shown(value)}; it must be a whole number from 0 to 2^64 - 1 (e.g. 1)."
        )
    return number


def span(low: float, high: float) -> str:
    """The allowed range as text."""
    if math.isinf(high):
        if math.isinf(low):
            return "a finite number"
        return f"at least {low:.10g}"
    if math.isinf(low):
        return f"at most {high:.10g}"
    return f"from {low:.10g} to {high:.10g}"
