"""Escape control characters in foreign text before it is shown.

Names can hold escape sequences, line breaks, characters that reverse the reading direction, and bytes that are not
text. InputError, the terminal and JSON show them escaped.
"""

import json
import unicodedata
from collections.abc import Callable

SPACES = "Zs"  # blanks; str.isprintable accepts only one of them


def printable(text: str, keep: str = "") -> str:
    """Return the text with control characters as ``\\x1b``.  keep : characters to keep, e.g. ``"\\n"``."""
    return _escaped(text, keep, lambda letter: repr(letter)[1:-1])


def printable_json(text: str) -> str:
    """Return an equal JSON text with control characters as ``\\u009b``."""
    return _escaped(text, "\n", lambda letter: json.dumps(letter)[1:-1])


def printable_toml(text: str) -> str:
    """Return an equal TOML text without line breaks or control characters."""
    return _escaped(text, "", lambda letter: f"\\U{ord(letter):08x}")


def _escaped(text: str, keep: str, escape: Callable[[str], str]) -> str:
    if text.isprintable():
        return text
    escapes = {
        ord(letter): escape(letter)
        for letter in set(text) - set(keep)
        if not (letter.isprintable() or unicodedata.category(letter) == SPACES)
    }
    return text.translate(escapes)
