"""Values as TOML, which the standard library reads and does not write."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from ..core.printable import printable_toml

LONGEST = 110
"""Characters of a list on one line."""


def toml_of(value: Any) -> str:
    """A number, text, list or table on one line; every float reads again as the same one."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return printable_toml(json.dumps(value, ensure_ascii=False))
    if isinstance(value, float):
        return f"{value:.0f}" if value.is_integer() and abs(value) < 1e7 else repr(value)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{key_of(key)} = {toml_of(x)}" for key, x in value.items() if x is not None)
        return f"{{ {inside} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_of, value))}]"
    return str(value)


def key_of(name: str) -> str:
    """A key, in quotes where TOML needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_of(name)


def assignment(key: str, value: Any) -> str:
    """``key = value``; a long list goes over several lines."""
    line = f"{key} = {toml_of(value)}"
    if len(line) <= LONGEST or not isinstance(value, list | tuple):
        return line
    lines = [""]
    for one in map(toml_of, value):
        if len(lines[-1]) + len(one) > LONGEST - 6:
            lines.append("")
        lines[-1] += f"{one}, "
    return "\n".join((f"{key} = [", *(f"    {one.rstrip()}" for one in lines), "]"))
