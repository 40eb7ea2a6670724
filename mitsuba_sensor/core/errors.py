"""InputError, which every wrong input raises, and range checks that raise it.

A message gives the value, the allowed values and what to do. The command line prints it and exits with code 2.
"""

import math
import operator
import reprlib
from pathlib import Path
from typing import NoReturn

from .number_text import number_hint
from .printable import printable

HEAD_CHARACTERS, END_CHARACTERS = 900, 450
"""What remains of a longer message; the end says what to do."""
SEED_END = 2**64
"""Seeds are 64-bit keys of the random number generator."""


class InputError(ValueError):
    """Wrong input: the message gives the value, the allowed values and what to pass instead.

    ::

        try:
            ms.load_camera("bayer_2pm")
        except ms.InputError as error:
            print(error)

    The message is one line of printable text. A very long message is cut in the middle.
    """

    def __str__(self) -> str:
        return self.sentence(super().__str__())

    @staticmethod
    def sentence(message: str) -> str:
        """Return a message as one printable line of bounded length."""
        message = printable(message)
        if len(message) <= HEAD_CHARACTERS + END_CHARACTERS:
            return message
        return f"{message[:HEAD_CHARACTERS]} … {message[-END_CHARACTERS:]}"


class DiskFull(InputError):
    """No space is left for a file.  path : the file.  size : bytes to write, None if unknown.  why : the reason."""

    def __init__(self, path: Path, size: int | None, why: str) -> None:
        super().__init__(path, size, why)
        self.path, self.size, self.why = path, size, why

    def __str__(self) -> str:
        needed = "" if self.size is None else f" (it needs {self.size} bytes)"
        return self.sentence(
            f"cannot write {self.path}{needed}: {self.why}; free some space, or choose another folder."
        )


class _ShortRepr(reprlib.Repr):
    """The repr of values from files, with bounded length, depth and time."""

    maxlevel, maxdict, maxlist, maxtuple, maxset = 3, 4, 6, 6, 6
    maxstring = maxlong = maxother = 80

    def repr_int(self, x: int, level: int) -> str:
        """Describe very long whole numbers, which Python refuses to print."""
        if x.bit_length() > 8 * self.maxlong:
            return f"a whole number of {x.bit_length()} bits"
        return super().repr_int(x, level)


def shown(value: object) -> str:
    """Return a value as messages show it: its repr, with ``...`` for omitted parts."""
    return _ShortRepr().repr(value)


def require(name: str, value: float, low: float, high: float, remedy: str) -> float:
    """Return ``value`` if it is a number in [low, high]; else raise InputError.  remedy : unit and example."""
    try:
        boolean = (
            isinstance(value, bool) or getattr(getattr(value, "dtype", 0), "kind", "") == "b"
        )
        number = float("" if boolean else value + 0)  # refuses a string such as "0.1"
    except (TypeError, ValueError, OverflowError):
        refuse_number(name, value, f"a number ({remedy})")
    if math.isnan(number) or not low <= number <= high:
        raise InputError(f"{name} is {shown(value)}; it must be {span(low, high)} ({remedy}).")
    return number


def refuse_number(name: str, value: object, allowed: str) -> NoReturn:
    """Raise InputError for a value that is not the number it should be; say how to write it if that is known."""
    hint = number_hint(name, value)
    raise InputError(f"{name} is {shown(value)}; it must be {allowed}{hint and f'; {hint}'}.")


def require_count(name: str, value: int, low: int, high: int, example: int) -> int:
    """Return ``value`` if it is a whole number in [low, high]; else raise InputError."""
    try:
        number = operator.index(value)
    except TypeError:
        number = low - 1
    if isinstance(value, bool) or not low <= number <= high:
        refuse_number(name, value, f"a whole number {span(low, high)}, e.g. {example}")
    return number


def require_seed(name: str, value: int) -> int:
    """Return ``value`` if it is a whole number from 0 to 2^64 - 1; else raise InputError."""
    try:
        number = -1 if isinstance(value, bool) else operator.index(value)
    except TypeError:  # a fraction, or an array
        number = -1
    if not 0 <= number < SEED_END:
        refuse_number(name, value, "a whole number from 0 to 2^64 - 1, e.g. 1")
    return number


def span(low: float, high: float) -> str:
    """Return the allowed range as text."""
    if math.isinf(high):
        return "a finite number" if math.isinf(low) else f"at least {low:.10g}"
    return f"at most {high:.10g}" if math.isinf(low) else f"from {low:.10g} to {high:.10g}"
