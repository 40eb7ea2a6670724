"""Checks that what is read as a whole is a regular file, and small: no pipe, no gigabytes, no TOML of endless depth."""

import stat
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError

MOST_BYTES = 2**22  # of a file that people write: camera, lens, curves, motion
DEEPEST = 32  # tables and lists inside of one another


def require_small(path: Path, what: str, most_bytes: int = MOST_BYTES) -> None:
    """Raise InputError for what is no regular file, or has more bytes; OSError where there is none.

    what : the file is, for the message: ``the camera file``.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):  # of a folder reading it says so
        raise InputError(f"{what} {path} is no regular file; give the path of one.")
    if found.st_size > most_bytes:
        raise InputError(f"{what} {path} has {found.st_size} bytes; it may have {most_bytes} at most.")


def toml_tables(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises TOMLDecodeError for whatever is wrong with it, tables that are nested too deep
    and numbers of thousands of digits too."""
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        tables = None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # Python's limit for the digits of a number
        raise tomllib.TOMLDecodeError(str(error).partition(";")[0]) from None
    if tables is None or not _is_shallow(tables):
        raise tomllib.TOMLDecodeError(f"tables or lists are nested more than {DEEPEST} deep")
    return tables


def _is_shallow(tables: dict[str, Any]) -> bool:
    """Level by level, because going into depth may be what is too deep."""
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        inner = [x.values() if isinstance(x, dict) else x for x in level if isinstance(x, dict | list)]
        level = [one for values in inner for one in values]
        if not level:
            return True
    return False
