"""Limits on kind, size and depth of a file, checked before it is parsed or unpacked."""

import errno
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError

BYTES_MAX = 2**22  # of a file that people write: camera, lens, curves, motion
DEPTH_MAX = 32  # nested tables and lists; parts of a dotted key
BITS_MAX = 14_000  # of a whole number: Python writes at most 4300 digits
TOO_DEEP = f"tables or lists are nested more than {DEPTH_MAX} deep"

UNPACKED_BYTES_FREE = 2**28
"""Any file may unpack to this many bytes."""
UNPACKED_RATIO_MAX = 200
"""Unpacked over stored bytes: frames with noise reach 20, deflate 1032."""

STRING_OR_COMMENT = re.compile(
    r'"""(?>[^"\\]+|\\.|"(?!""))*+"{3,5}'  # up to two quotes may precede the closing three
    r"|'''(?>[^']+|'(?!''))*+'{3,5}"
    r'|"(?>[^"\\\n]+|\\.)*+"'
    r"|'[^'\n]*+'"
    r"|\#[^\n]*+",
    re.DOTALL,
)
LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEPTH_MAX},}}")


def require_small(path: Path, what: str, most_bytes: int = BYTES_MAX) -> None:
    """Raise InputError if the file is not regular or has more bytes; OSError if it does not exist.

    what : name of the file in the message: ``the camera file``.
    """
    size = require_regular(path, what)
    if size > most_bytes:
        raise InputError(f"{what} {path} has {size} bytes; it must have at most {most_bytes}.")


def require_regular(path: str | os.PathLike[str], what: str = "the file") -> int:
    """Return the size of a file [byte].  what : name of the file in the message.

    Raises InputError for a pipe or a device, whose reader may wait forever, and OSError if the file does not exist.
    """
    try:
        status = os.stat(path)
    except ValueError:  # a NUL in the name
        raise FileNotFoundError(errno.ENOENT, "No such file", os.fspath(path)) from None
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(
        status.st_mode
    ):  # readers reject it
        raise InputError(
            f"{what} {os.fspath(path)} is not a regular file; give the path of one."
        )
    return status.st_size


def require_plausible(path: Path, unpacked_bytes: int) -> None:
    """Raise InputError if the file is too small for the pixels that its header announces."""
    require_plausible_ratio(str(path), path.stat().st_size, unpacked_bytes)


def require_plausible_ratio(place: str, stored_bytes: int, unpacked_bytes: int) -> None:
    """Raise InputError if too few bytes are stored to be unpacked.  place : name of the file in the message."""
    if unpacked_bytes > max(UNPACKED_BYTES_FREE, UNPACKED_RATIO_MAX * stored_bytes):
        raise InputError(
            f"{place} has {stored_bytes} bytes but announces {unpacked_bytes} unpacked bytes; at most "
            f"{UNPACKED_RATIO_MAX} times as many are read. It may be damaged; write it again, without compression."
        )


def toml_tables(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text; the parser's time grows with the square of a key's parts.

    Raises TOMLDecodeError for invalid TOML, more than 4 MB, excessive nesting, and numbers of thousands of digits.
    """
    if len(text) > BYTES_MAX:
        raise tomllib.TOMLDecodeError(
            f"it has {len(text)} characters; it must have at most {BYTES_MAX}"
        )
    blanked = STRING_OR_COMMENT.sub(lambda found: " " if found[0][0] == "#" else "s", text)
    if LONG_KEY.search(blanked):
        raise tomllib.TOMLDecodeError(f"a key has more than {DEPTH_MAX} parts")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError(TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # Python's limit for the digits of a number
        raise tomllib.TOMLDecodeError(str(error).partition(";")[0]) from None
    if reason := beyond_limits(tables):
        raise tomllib.TOMLDecodeError(reason)
    return tables


def json_value(text: str | bytes) -> Any:
    """Return the value of a JSON text. Raises ValueError for invalid JSON or excessive nesting."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except ValueError as error:  # Python adds how to lift its limit of digits
        raise ValueError(str(error).partition("; use")[0]) from None
    if reason := beyond_limits(value):
        raise ValueError(reason)
    return value


def beyond_limits(value: object) -> str:
    """Return why nested tables and lists exceed the limits; empty if they do not.

    The search proceeds by level, so it needs no recursion, and visits shared values once.
    """
    level: list[object] = [value]
    for _ in range(DEPTH_MAX):
        inner: dict[int, object] = {}
        for outer in level:
            if isinstance(outer, dict | list):
                parts = outer.values() if isinstance(outer, dict) else outer
                inner.update((id(part), part) for part in parts)
            elif (
                isinstance(outer, int) and outer.bit_length() > BITS_MAX
            ):  # Python cannot print it
                return f"a whole number has {outer.bit_length()} bits; it must have at most {BITS_MAX}"
        level = list(inner.values())
        if not level:
            return ""
    return TOO_DEEP
