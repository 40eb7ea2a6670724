"""Reads small text files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeAlias

from ..core import InputError

Facts: TypeAlias = dict[str, Any]


def text_of_file(path: Path, remedy: str, most_bytes: int = 2**30, newline: str | None = None) -> str:
    """The text of a file. Raises InputError with the remedy where it cannot be read, or has more bytes.

    newline : an empty text keeps the ends of lines as they are, as in open.
    """
    try:
        if path.is_fifo():  # whose writer may never come
            raise InputError(f"{path} is a pipe and no file; {remedy}.")
        if path.stat().st_size > most_bytes:
            raise InputError(f"{path} has more than {most_bytes} bytes; {remedy}.")
        with path.open(encoding="utf-8", newline=newline) as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise InputError(f"{path} cannot be read: {why}; {remedy}.") from None


def read_json(path: Path, remedy: str) -> Facts:
    """The object in a JSON file. Raises InputError with the remedy."""
    try:
        found = json.loads(text_of_file(path, remedy))
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(f"{path} holds no JSON object; {remedy}.")
    return found
