"""The keys of a camera file with unit, range, default and meaning: as Markdown, and as the commented text of a file."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..core import InputError
from ..core.printable import printable_toml
from .datasheet_errors import inner_table, usual_of

if TYPE_CHECKING:
    from .camera import Camera

TYPES = {"boolean": "true or false", "string": "a text", "object": "a table"}
LIMITS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
}
SMALLEST, LARGEST = 1e-30, 1e30
"""Limits that only say above zero and finite."""

WIDTH = 116
HEAD = """\
# A camera file of mitsuba_sensor. Every key that there is stands here with its meaning, unit and range.
# A key behind a # is not set: its default holds, and what is written is an example.
# [sources] at the end says where each number comes from; it becomes part of frame.json. Keep it true.
# Check the file: mitsuba-sensor cameras check FILE. Use it: mitsuba-sensor render SCENE --camera FILE -o out/
"""
OF_SOURCES = "# Where each number comes from: data sheet, measurement, paper or assumption."


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


def camera_file(camera: Camera) -> str:
    """The commented file, which loads again to an equal camera. Raises InputError for added stages."""
    if camera.added:
        stages = ", ".join(type(stage).__name__ for stage in camera.added)
        raise InputError(
            f"A camera file cannot hold the stage {stages}; call with_stage again after load_camera."
        )
    data, known = camera.model_dump(), list(tables(type(camera)))
    headers, parts, unsourced = {one.path for one in known}, [HEAD.rstrip()], list[str]()
    for table in known:
        for number, values in enumerate(_filled(table.path, data)):
            lines = [table.header] if table.path else []
            if table.path and number == 0:
                lines = [*_comment(table.meaning, "# "), table.header]
            for one in table.entries:
                name, value = f"{table.path}.{one.name}".lstrip("."), values[one.name]
                if name == "sources" or (name in headers and value):
                    continue
                given = _is_set(table.model.model_fields[one.name], value, name, camera)
                if number == 0:
                    lines += ["", *_comment(one.explained, "#   ")]
                if given:
                    lines += _set(one.name, value)
                elif number == 0:
                    lines.append(f"# {one.name} = {toml_of(one.example)}")
                if given and table.path and not table.of_list and not isinstance(value, str):
                    unsourced += [] if name in camera.sources else [name]
            parts.append("\n".join(lines))
    sources = [f"{toml_of(name)} = {toml_of(text)}" for name, text in camera.sources.items()]
    missing = [f'# {toml_of(name)} = ""' for name in sorted(unsourced)]
    parts.append("\n".join((OF_SOURCES, "[sources]", *sources, *missing)))
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _filled(path: str, data: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The values of a table of the file, of each one of a list, or none where it is not set."""
    found: list[Any] = [data]
    for part in path.split(".") if path else ():
        inner = [one.get(part) for one in found if one]
        found = [x for one in inner for x in (one if isinstance(one, list | tuple) else [one])]
    return [one for one in found if one]


def _comment(text: str, further: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent=further)


def _is_set(info: FieldInfo, value: Any, name: str, camera: Camera) -> bool:
    """Whether a value is not the default, or has a source."""
    if value is None:
        return False
    given = info.is_required() or name in camera.sources
    return given or value != info.get_default(call_default_factory=True)


def _set(name: str, value: Any) -> list[str]:
    """The lines of a key; a table of names has one line for each name."""
    if isinstance(value, Mapping):
        return [assignment(f"{name}.{key_of(key)}", x) for key, x in value.items()]
    return [assignment(name, value)]
