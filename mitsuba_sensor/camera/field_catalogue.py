"""The keys of a camera file with unit, range, default and meaning; its tables as Markdown, its values as TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..core.printable import printable_toml
from .datasheet_errors import inner_table, usual_of

TYPES = {"boolean": "true or false", "string": "a text", "object": "a table"}
LIMITS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
}
SMALLEST, LARGEST = 1e-30, 1e30
"""Limits that only say above zero and finite."""


class Entry(NamedTuple):
    """One key.  unit : empty for what has none.  usual : range of existing cameras, if it is declared."""

    name: str
    unit: str
    allowed: str
    usual: str
    default: str
    meaning: str
    example: Any

    @property
    def explained(self) -> str:
        """Meaning, unit, range, usual range and default in one line."""
        unit = f" [{self.unit}]" if self.unit else ""
        usual = f"usual {self.usual}" if self.usual else ""
        default = self.default
        if default not in ("required", ""):
            default = f"default {default}"
        return "; ".join(filter(None, (f"{self.meaning}{unit}", self.allowed, usual, default)))


class Table(NamedTuple):
    """One table of the file.  path : dotted; empty for the top of the file.  of_list : each one of a list of tables."""

    path: str
    of_list: bool
    meaning: str
    entries: tuple[Entry, ...]
    model: type[BaseModel]

    @property
    def header(self) -> str:
        """``[pixel]`` or ``[[dark_current.components]]``."""
        return f"[[{self.path}]]" if self.of_list else f"[{self.path}]"


def tables(model: type[BaseModel], path: str = "", of_list: bool = False) -> Iterator[Table]:
    """The tables of a kind of file, each before those inside of it."""
    schemas = model.model_json_schema()["properties"]
    entries, inside = list[Entry](), list[Iterator[Table]]()
    for name, info in model.model_fields.items():
        table, container = inner_table(info.annotation)
        if table:
            inside.append(tables(table, f"{path}.{name}".lstrip("."), container is tuple))
        if not table or container or info.default is None:  # else it is only a table
            entries.append(entry(name, info, schemas[name]))
    yield Table(path, of_list, (model.__doc__ or "").partition("\n")[0], tuple(entries), model)
    for one in inside:
        yield from one


def entry(name: str, info: FieldInfo, schema: dict[str, Any]) -> Entry:
    """One key from its declaration and its JSON Schema."""
    text, usual = info.description or "", usual_of(info)
    before, unit, after = (*re.split(r" \[([^\]]+)\]", text, maxsplit=1), "", "")[:3]
    default = "required"
    if not info.is_required():
        value = info.get_default(call_default_factory=True)
        default = "" if value in (None, (), {}) else toml_of(value)
    example = info.examples[0] if info.examples else None
    allowed, usual_text = _allowed(schema), usual.text if usual else ""
    return Entry(name, unit, allowed, usual_text, default, before + after, example)


def markdown(model: type[BaseModel]) -> str:
    """The tables as Markdown."""
    parts = []
    for one in tables(model):
        head = f"### `{one.header}`\n\n{one.meaning}" if one.path else "### Top of the file"
        parts.append(f"{head}\n\n{markdown_rows(one.entries)}")
    return "\n\n".join(parts)


def markdown_rows(entries: Iterable[Entry]) -> str:
    """Keys as one table of Markdown."""
    lines = [
        "| key | unit | allowed | usual | default | what it does |",
        "|---|---|---|---|---|---|",
    ]
    for x in entries:
        default = x.default if x.default in ("required", "") else f"`{x.default}`"
        cells = (f"`{x.name}`", x.unit, x.allowed, x.usual, default, x.meaning)
        row = " | ".join(cell.replace("|", "\\|") or "–" for cell in cells)
        lines.append(f"| {row} |")
    return "\n".join(lines)


def _allowed(schema: dict[str, Any]) -> str:
    """The range of a JSON Schema as text: ``above 0, at most 1``; ``"cmos" or "ccd"``; ``list, each a text``."""
    if "anyOf" in schema:
        kinds = (one for one in schema["anyOf"] if one.get("type") != "null")
        return " or ".join(map(_allowed, kinds))
    if "$ref" in schema:
        return "a table"
    if "enum" in schema:
        return " or ".join(map(toml_of, schema["enum"]))
    kind = schema["type"]
    if kind in ("number", "integer"):
        rules = ["whole number"] if kind == "integer" else []
        for name, phrase in LIMITS.items():
            limit = schema.get(name)
            if limit == SMALLEST:
                rules.append("above 0")
            elif limit is not None and abs(limit) != LARGEST:
                rules.append(f"{phrase} {limit:.10g}")
        return ", ".join(rules) or "any number"
    if "prefixItems" in schema:
        items = dict.fromkeys(map(_allowed, schema["prefixItems"]))
        return f"{len(schema['prefixItems'])} numbers: {'; '.join(items)}"
    if kind == "array":
        least = schema.get("minItems", 0)
        return f"list{f' of at least {least}' if least > 1 else ''}, each {_allowed(schema['items'])}"
    inner = schema.get("additionalProperties")
    return f"for each name {_allowed(inner)}" if isinstance(inner, dict) else TYPES[kind]


LONGEST = 110
"""Characters of a list on one line."""


def toml_of(value: Any) -> str:
    """A number, text, list or table on one line; every float reads again as the same one."""
    if isinstance(value, str):
        return printable_toml(json.dumps(value, ensure_ascii=False))
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e7:
        return f"{value:.0f}"
    if isinstance(value, Mapping):
        inside = (f"{key_of(key)} = {toml_of(x)}" for key, x in value.items() if x is not None)
        return f"{{ {', '.join(inside)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_of, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


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
