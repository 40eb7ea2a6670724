"""Values of flags, read from the texts that are typed; the options check them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from ..core import InputError
from ..core.number_text import number_hint
from ..core.options import Declared

Flag: TypeAlias = Any  # the value of one flag; its type is that of the option
SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}


def pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """["a=1", …] → {"a": "1", …}"""
    found = [[part.strip() for part in text.partition("=")] for text in texts]
    for text, (name, equals, _) in zip(texts, found, strict=True):
        if not name or not equals:
            raise InputError(
                f"{option} {text!r} has no name and value; write {option} NAME=VALUE."
            )
    return {name: value for name, _, value in found}


def number(text: str, kind: type = float) -> Flag:
    """The number in a text; a text that is none as it is, for the check of the option."""
    try:
        return kind(text)
    except ValueError:
        return text


def _seconds(text: str) -> float:
    """The number in the text. Raises InputError, with the seconds where a time is given in another unit."""
    if not isinstance(value := number(text), str):
        return float(value)
    parts = re.fullmatch(r"\s*([\d.,]+(?:e-?\d+)?)\s*(?:/\s*(\d+)|([a-zµ]*))\s*", text)
    meant = text
    if parts:
        meant = number(parts[1].replace(",", "."))
    if parts and parts[2] != "0":
        factor = 1 / int(parts[2]) if parts[2] else SECONDS.get(parts[3])
    else:
        factor = None
    example = "0.01"
    if factor is not None and not isinstance(meant, str):
        example = f"{meant * factor:.4g}"
    if parts:
        hint = ""
    else:
        hint = number_hint("exposure_s", text)
    more = hint and f"; {hint}"
    raise InputError(
        f"--exposure-s {text!r} is no number of seconds; give seconds, e.g. {example}, or auto{more}."
    )


def _read_maps(file: str) -> Flag:
    from ..files.npz import read_fpn_maps

    return read_fpn_maps(Path(file))


def flag_value(one: Declared, value: Flag) -> Flag:
    """The value of a flag, not yet checked, from what typer read."""
    if value is None or value == one.option.default:
        return value
    if one.name in READERS:
        return READERS[one.name](value)
    if one.kinds in ((int,), (float,)):
        return number(value, one.kinds[0])
    return value


READERS: dict[
    str, Callable[[Flag], Flag]
] = {  # how the text of an option becomes its value, where typer does not know
    "parameters": lambda texts: pairs("-D", texts),
    "settings": lambda texts: pairs("--set", texts),
    "traverse": lambda texts: {
        k: [number(x) for x in v.split(",")] for k, v in pairs("--traverse", texts).items()
    },
    "exposure_s": lambda text: text if text == "auto" else _seconds(text),
    "maps": _read_maps,
}
