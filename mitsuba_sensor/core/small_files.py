"""Limits of what is read, which hold before it is parsed or unpacked: kind, size and depth of a file."""

import errno
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError

MOST_BYTES = 2**22  # of a file that people write: camera, lens, curves, motion
DEEPEST = 32  # tables and lists inside of one another; parts of a dotted key
MOST_BITS = 14_000  # of a whole number: Python writes at most 4300 digits
TOO_DEEP = f"tables or lists are nested more than {DEEPEST} deep"

ALWAYS_BYTES = 2**28
"""May come out of any file."""
MOST_RATIO = 200
"""Of unpacked over stored bytes: frames with noise reach 20, deflate ends at 1032."""

STRING_OR_COMMENT = re.compile(
    r'"""(?>[^"\\]+|\\.|"(?!""))*+"{3,5}'  # up to two quotes may stand before the closing three
    r"|'''(?>[^']+|'(?!''))*+'{3,5}"
    r'|"(?>[^"\\\n]+|\\.)*+"'
    r"|'[^'\n]*+'"
    r"|\#[^\n]*+",
    re.DOTALL,
)
LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST},}}")


def require_small(path: Path, what: str, most_bytes: int = MOST_BYTES) -> None:
    """Raise InputError for what is no regular file, or has more bytes; OSError where there is none.

    what : the file is, for the message: ``the camera file``.
    """
    size = require_regular(path, what)
    if size > most_bytes:
        raise InputError(f"{what} {path} has {size} bytes; it may have {most_bytes} at most.")


def require_regular(path: str | os.PathLike[str], what: str = "the file") -> int:
    """Return the size of a file [byte]. Raise InputError for a pipe or a device, whose reader may wait for ever, and
    OSError where there is no file.

    what : the file is, for the message.
    """
    try:
        found = os.stat(path)
    except ValueError:  # a NUL in the name
        raise FileNotFoundError(errno.ENOENT, "No such file", os.fspath(path)) from None
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):  # readers refuse it
        raise InputError(f"{what} {os.fspath(path)} is no regular file; give the path of one.")
    return found.st_size


def require_plausible(path: Path, unpacked_bytes: int) -> None:
    """Raise InputError where the pixels that a header announces cannot be in the file, before memory is taken."""
    require_plausible_ratio(str(path), path.stat().st_size, unpacked_bytes)


def require_plausible_ratio(place: str, stored_bytes: int, unpacked_bytes: int) -> None:
    """Raise InputError where they cannot be in so many bytes.  place : what has them, for the message."""
    if unpacked_bytes > max(ALWAYS_BYTES, MOST_RATIO * stored_bytes):
        raise InputError(
            f"{place} has {stored_bytes} bytes and says that {unpacked_bytes} come out of them, {MOST_RATIO} times "
            "as many at most are read; it is damaged, or made to fill the memory: write it again, uncompressed if it "
            "is right."
        )


def toml_tables(text: str) -> dict[str, Any]:
    """The tables of a TOML text; the only call of the parser, whose time grows with the square of a key's parts.

    Raises TOMLDecodeError for whatever is wrong with the text: also one of more than 4 MB, tables, lists or keys that
    are nested too deep, and numbers of thousands of digits.
    """
    if len(text) > MOST_BYTES:
        raise tomllib.TOMLDecodeError(
            f"it has {len(text)} characters; it may have {MOST_BYTES} at most"
        )
    if LONG_KEY.search(without_strings(text)):
        raise tomllib.TOMLDecodeError(f"a key has more than {DEEPEST} parts")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        tables = None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # Python's limit for the digits of a number
        raise tomllib.TOMLDecodeError(str(error).partition(";")[0]) from None
    if tables is None:
        wrong = TOO_DEEP
    else:
        wrong = beyond_limits(tables)
    if wrong:
        raise tomllib.TOMLDecodeError(wrong)
    return tables or {}


def without_strings(text: str) -> str:
    """A TOML text of equal length, with letters in the place of strings and blanks in that of comments."""

    def fill(match: re.Match[str]) -> str:
        return (" " if match[0].startswith("#") else "s") * len(match[0])

    return STRING_OR_COMMENT.sub(fill, text)


def json_value(text: str | bytes) -> Any:
    """The value of a JSON text. Raises ValueError for what is none or nested too deep."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except ValueError as error:  # Python adds how a program lifts its limit of digits
        raise ValueError(str(error).partition("; use")[0]) from None
    if wrong := beyond_limits(value):
        raise ValueError(wrong)
    return value


def beyond_limits(value: object) -> str:
    """What is wrong with a value of tables and lists: they are too deep, or a number is too long; else an empty text.

    Goes level by level, because going into depth may be what is too deep, and meets everything once, because one value
    may stand in many places.
    """
    level: list[object] = [value]
    for _ in range(DEEPEST):
        inner: dict[int, object] = {}
        for outer in level:
            if isinstance(outer, dict | list):
                parts = outer.values() if isinstance(outer, dict) else outer
                inner.update((id(part), part) for part in parts)
            elif (
                isinstance(outer, int) and outer.bit_length() > MOST_BITS
            ):  # hexadecimal: Python cannot print it
                return f"a whole number has {outer.bit_length()} bits; it may have {MOST_BITS} at most"
        level = list(inner.values())
        if not level:
            return ""
    return TOO_DEEP
