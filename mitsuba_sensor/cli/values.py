"""Values of flags, read from the texts that are typed; the options check them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from ..core import InputError
from ..core.options import Declared

Flag: TypeAlias = Any  # the value of one flag; its type is that of the option


def pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """["a=1", …] → {"a": "1", …}"""
    found = dict[str, str]()
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not name or not equals:
            raise InputError(
                f"{option} {text!r} has no name and value; write {option} NAME=VALUE."
            )
        found[name] = value
    return found


def number(text: str, kind: type = float) -> Flag:
    """The number in a text; a text that is none as it is, for the check of the option."""
    try:
        return kind(text)
    except ValueError:
        return text


def _exposure(text: str) -> Flag:
    """Seconds, or auto. Raises InputError."""
    seconds = number(text)
    if isinstance(seconds, str) and text != "auto":
        raise InputError(
            f"--exposure-s {text!r} is no number of seconds; give seconds, e.g. 0.01, or auto."
        )
    return seconds


def _maps(file: str) -> Flag:
    from ..files.npz import read_fpn_maps

    return read_fpn_maps(Path(file))


def _traverse(texts: Sequence[str]) -> Flag:
    given = pairs("--traverse", texts)
    return {name: [number(x) for x in value.split(",")] for name, value in given.items()}


def flag_value(one: Declared, value: Flag) -> Flag:
    """The value of a flag, not yet checked, from what typer read."""
    if value is None or value == one.option.default:
        return value
    if one.name in READERS:
        return READERS[one.name](value)
    return number(value, one.kinds[0]) if one.kinds in ((int,), (float,)) else value


READERS: dict[str, Callable[[Flag], Flag]] = {
    "parameters": lambda texts: pairs("-D", texts),
    "settings": lambda texts: pairs("--set", texts),
    "traverse": _traverse,
    "exposure_s": _exposure,
    "maps": _maps,
}
"""How the text of an option becomes its value, where typer does not know."""
