"""Text of files, names and other programs as it may be shown: without what a terminal would obey.

Names can hold escape sequences, line breaks, letters that turn the direction of reading, and bytes
that are no text. Sentences (InputError), the terminal and JSON show them escaped.
"""

import json
import unicodedata
from collections.abc import Callable

SPACES = "Zs"  # all kinds of blanks, which Python's isprintable refuses but for one


def printable(text: str, keep: str = "") -> str:
    """The text with ``\\x1b`` in the place of control characters and the like.  keep : those that stay, ``"\\n"``."""
    return _escaped(text, keep, _as_python)


def printable_json(text: str) -> str:
    """A text of JSON, in which the same stand as ``\\u009b``; as JSON it is equal."""
    return _escaped(text, "\n", _as_json)


def printable_toml(text: str) -> str:
    """A text of TOML without line breaks, likewise."""
    return _escaped(text, "", _as_toml)


def _escaped(text: str, keep: str, escape: Callable[[str], str]) -> str:
    if text.isprintable():
        return text
    letters = dict.fromkeys(text)  # each is looked at once
    strange = {
        ord(letter): escape(letter)
        for letter in letters
        if not (
            letter.isprintable() or letter in keep or unicodedata.category(letter) == SPACES
        )
    }
    return text.translate(strange)


def _as_python(letter: str) -> str:
    return repr(letter)[1:-1]


def _as_toml(letter: str) -> str:
    return f"\\U{ord(letter):08x}"


def _as_json(letter: str) -> str:
    return json.dumps(letter)[1:-1]
