"""What is to be known of every key of a camera file: unit, range, default, meaning; and its tables as Markdown."""

from __future__ import annotations

import json
import re
import types
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..core.printable import printable_toml
from .datasheet_errors import usual_of

TYPES = {"boolean": "true or false", "string": "a text", "object": "a table"}
SMALLEST, LARGEST = 1e-30, 1e30
"""Bounds that say no more than above zero and finite."""


class Entry(NamedTuple):
    """One key.  unit : empty for what has none.  usual : range of the cameras that there are, where it is declared."""

    name: str
    unit: str
    allowed: str
    usual: str
    default: str
    meaning: str
    example: Any


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
        if self.of_list:
            return f"[[{self.path}]]"
        return f"[{self.path}]"


def tables(model: type[BaseModel], path: str = "", of_list: bool = False) -> Iterator[Table]:
    """The tables of a kind of file, each before those inside of it."""
    schema = model.model_json_schema()
    inner = {
        name: found
        for name, info in model.model_fields.items()
        if (found := _inner(info.annotation))
    }
    sections = {
        name
        for name, (_, many) in inner.items()
        if not many and not _optional(model.model_fields[name])
    }
    entries = tuple(
        entry(name, info, schema["properties"][name])
        for name, info in model.model_fields.items()
        if name not in sections
    )
    yield Table(path, of_list, (model.__doc__ or "").partition("\n")[0], entries, model)
    for name, (kind, many) in inner.items():
        yield from tables(kind, f"{path}.{name}".lstrip("."), many)


def entry(name: str, info: FieldInfo, schema: dict[str, Any]) -> Entry:
    """One key from its declaration and its JSON Schema."""
    text, usual = info.description or "", usual_of(info)
    unit = re.search(r" \[([^\]]+)\]", text)
    if info.is_required():
        default = "required"
    else:
        default = _default(info)
    meaning = text
    if unit:
        meaning = text.replace(unit.group(), "")
    if info.examples:
        example = info.examples[0]
    else:
        example = None
    return Entry(
        name,
        unit.group(1) if unit else "",
        _allowed(schema),
        usual.text if usual else "",
        default,
        meaning,
        example,
    )


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
        if x.default in ("required", ""):
            default = x.default
        else:
            default = f"`{x.default}`"
        cells = (f"`{x.name}`", x.unit, x.allowed, x.usual, default, x.meaning)
        lines.append(
            "| " + " | ".join(cell.replace("|", "\\|") or "–" for cell in cells) + " |"
        )
    return "\n".join(lines)


def _inner(annotation: Any) -> tuple[type[BaseModel], bool] | None:
    """The table, or the table of a list, that a field holds; and whether it is a list of them."""
    if get_origin(annotation) in (Union, types.UnionType):
        kinds = get_args(annotation)
    else:
        kinds = (annotation,)
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind, False
        for part in get_args(kind) if get_origin(kind) is tuple else ():
            if isinstance(part, type) and issubclass(part, BaseModel):
                return part, True
    return None


def _optional(info: FieldInfo) -> bool:
    """Whether the table may be missing, so that it is a key too."""
    return info.default is None


def _default(info: FieldInfo) -> str:
    value = info.get_default(call_default_factory=True)
    if value is None or value == () or value == {}:
        return ""
    return toml_of(value)


def _allowed(schema: dict[str, Any]) -> str:
    """The range as text: ``above 0, at most 1``; ``"cmos" or "ccd"``; ``list of numbers, each 0 to 1``."""
    kinds = [one for one in schema.get("anyOf", (schema,)) if one.get("type") != "null"]
    return " or ".join(_kind(one) for one in kinds)


def _kind(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return "a table"
    if "enum" in schema:
        return " or ".join(toml_of(one) for one in schema["enum"])
    if schema["type"] in ("number", "integer"):
        return ", ".join(
            filter(
                None, ("whole number" if schema["type"] == "integer" else "", _range(schema))
            )
        )
    if schema["type"] == "array":
        return _array(schema)
    inner = schema.get("additionalProperties")
    if isinstance(inner, dict):
        return f"for each name {_kind(inner)}"
    return TYPES[schema["type"]]


def _array(schema: dict[str, Any]) -> str:
    """``list of at least 2, each above 0``; ``list of lists, each a text``; ``2 numbers: 0 or more; above 0``."""
    items = [_kind(one) for one in schema.get("prefixItems", ())]
    if items:
        return f"{len(items)} numbers: {'; '.join(dict.fromkeys(items))}"
    least = ""
    if schema.get("minItems", 0) > 1:
        least = f" of at least {schema['minItems']}"
    inner = _kind(schema["items"])
    if inner.startswith("list"):
        return f"list of {inner.replace('list', 'lists', 1)}"
    return f"list{least}, each {inner}"


def _range(schema: dict[str, Any]) -> str:
    low, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    high, below = schema.get("maximum"), schema.get("exclusiveMaximum")
    ends = []
    if above is not None or low == SMALLEST:
        ends.append(f"above {above or 0:g}")
    elif low not in (None, -LARGEST):
        ends.append(
            f"{low:g} or more" if high in (None, LARGEST) and below is None else f"from {low:g}"
        )
    if below is not None:
        ends.append(f"below {below:.4g}")
    elif high not in (None, LARGEST):
        ends.append(
            f"to {high:.10g}" if ends and ends[0].startswith("from") else f"at most {high:.10g}"
        )
    if ends[-1:] and ends[-1].startswith("to "):
        return " ".join(ends)
    return ", ".join(ends) or "any number"


LONGEST = 110
"""Characters of a list on one line."""


def toml_of(value: Any) -> str:
    """A number, text, list or table on one line; every float reads again as the same one."""
    if isinstance(value, bool):
        if value:
            return "true"
        return "false"
    if isinstance(value, str):
        return printable_toml(json.dumps(value, ensure_ascii=False))
    if isinstance(value, float):
        if value.is_integer() and abs(value) < 1e7:
            return f"{value:.0f}"
        return repr(value)
    if isinstance(value, Mapping):
        inside = ", ".join(
            f"{key_of(key)} = {toml_of(x)}" for key, x in value.items() if x is not None
        )
        return f"{{ {inside} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_of, value))}]"
    return str(value)


def key_of(name: str) -> str:
    """A key, in quotes where TOML needs them."""
    if re.fullmatch(r"[A-Za-z0-9_-]+", name):
        return name
    return toml_of(name)


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
