"""The keys of a camera file with unit, range, default and meaning, as Markdown and as a commented file."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Mapping
from functools import cache
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
"""Limits that mean above zero and finite."""

WIDTH = 116
HEAD = """\
# A camera file of mitsuba_sensor with every key, its meaning, unit and range.
# A key after a # is unset: its default applies, and the value shown is an example.
# [sources] at the end gives the source of each number and becomes part of frame.json. Keep it up to date.
# Check the file: mitsuba-sensor cameras check FILE. Use it: mitsuba-sensor render SCENE --camera FILE -o out/
"""
SOURCES_COMMENT = "# Source of each number: datasheet, measurement, paper or assumption."
ASSUMED = "assumed"
"""Start of the source of an assumed number."""
COPIED = re.compile(rf"^(?:{ASSUMED}: )?(?:(?:as|of) [^:]+: )?")
"""Start of the source of a number that was copied from another camera."""


def copied_source(source: str, camera: str) -> str:
    """Return the source of a number copied from a camera of this name; assumed only if it was assumed there."""
    origin = f"{ASSUMED}: as {camera}" if source.startswith(ASSUMED) else f"of {camera}"
    return f"{origin}: {COPIED.sub('', source)}"


class Entry(NamedTuple):
    """A key of a camera file.  usual : range of existing cameras, if it is declared."""

    name: str
    unit: str
    allowed: str
    usual: str
    default: str
    meaning: str
    example: Any

    @property
    def explained(self) -> str:
        """Meaning, unit, range, usual range and default on one line."""
        unit = f" [{self.unit}]" if self.unit else ""
        usual = f"usual {self.usual}" if self.usual else ""
        default = self.default
        if default not in ("required", ""):
            default = f"default {default}"
        return "; ".join(filter(None, (f"{self.meaning}{unit}", self.allowed, usual, default)))


class Table(NamedTuple):
    """A table of a camera file.  path : dotted; empty for the top of the file.  of_list : in a list of tables."""

    path: str
    of_list: bool
    meaning: str
    entries: tuple[Entry, ...]
    model: type[BaseModel]

    @property
    def header(self) -> str:
        """``[pixel]`` or ``[[dark_current.components]]``."""
        return f"[[{self.path}]]" if self.of_list else f"[{self.path}]"


@cache
def tables(model: type[BaseModel], path: str = "", of_list: bool = False) -> tuple[Table, ...]:
    """Return the tables of a file, each before its inner tables."""
    schemas = model.model_json_schema()["properties"]
    entries, inside = list[Entry](), list[Table]()
    for name, info in model.model_fields.items():
        table, container = inner_table(info.annotation)
        if table:
            inside += tables(table, f"{path}.{name}".lstrip("."), container is tuple)
        if not table or container or info.default is None:  # otherwise it is only a table
            entries.append(entry(name, info, schemas[name]))
    meaning = (model.__doc__ or "").partition("\n")[0]
    return Table(path, of_list, meaning, tuple(entries), model), *inside


def entry(name: str, info: FieldInfo, schema: dict[str, Any]) -> Entry:
    """Return a key from its declaration and its JSON Schema."""
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
    """Return the tables as Markdown."""
    sections = []
    for table in tables(model):
        title = (
            f"### `{table.header}`\n\n{table.meaning}" if table.path else "### Top of the file"
        )
        sections.append(f"{title}\n\n{markdown_rows(table.entries)}")
    return "\n\n".join(sections)


def markdown_rows(entries: Iterable[Entry]) -> str:
    """Return keys as a Markdown table."""
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
    """Return the range of a JSON Schema: ``above 0, at most 1``; ``"cmos" or "ccd"``; ``list, each a text``."""
    if "anyOf" in schema:
        kinds = (kind for kind in schema["anyOf"] if kind.get("type") != "null")
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


LINE_MAX = 110
"""Characters of a list on one line."""


def toml_of(value: Any) -> str:
    """Return a number, text, list or table as TOML on one line; floats round-trip exactly."""
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
    """Return a key, in quotes if TOML needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_of(name)


def assignment(key: str, value: Any) -> str:
    """Return ``key = value``, with a long list on several lines."""
    line = f"{key} = {toml_of(value)}"
    if len(line) <= LINE_MAX or not isinstance(value, list | tuple):
        return line
    lines = [""]
    for element in map(toml_of, value):
        if len(lines[-1]) + len(element) > LINE_MAX - 6:
            lines.append("")
        lines[-1] += f"{element}, "
    return "\n".join((f"{key} = [", *(f"    {line.rstrip()}" for line in lines), "]"))


def camera_file(camera: Camera) -> str:
    """Return the commented file, which loads as an equal camera. Raises InputError for added stages."""
    if camera.added:
        stages = ", ".join(type(stage).__name__ for stage in camera.added)
        raise InputError(
            f"a camera file cannot hold the added stage {stages}; save the camera without it, and call with_stage "
            "after load_camera."
        )
    data, all_tables = camera.model_dump(), tables(type(camera))
    headers, parts, unsourced = {x.path for x in all_tables}, [HEAD.rstrip()], list[str]()
    for table in all_tables:
        for number, values in enumerate(_filled(table.path, data)):
            lines = [table.header] if table.path else []
            if table.path and number == 0:
                lines = [*_comment(table.meaning, "# "), table.header]
            for key in table.entries:
                name, value = f"{table.path}.{key.name}".lstrip("."), values[key.name]
                if name == "sources" or (name in headers and value):
                    continue
                given = _is_set(table.model.model_fields[key.name], value, name, camera)
                if number == 0:
                    lines += ["", *_comment(key.explained, "#   ")]
                source = camera.sources.get(name, "")
                if given and source.startswith(ASSUMED):
                    lines += _comment(printable_toml(source), "#   ")
                if given:
                    lines += _set(key.name, value)
                elif number == 0:
                    lines.append(f"# {key.name} = {toml_of(key.example)}")
                if given and table.path and not table.of_list and not isinstance(value, str):
                    unsourced += [] if name in camera.sources else [name]
            parts.append("\n".join(lines))
    sources = [f"{toml_of(name)} = {toml_of(text)}" for name, text in camera.sources.items()]
    missing = [f'# {toml_of(name)} = ""' for name in sorted(unsourced)]
    parts.append("\n".join((SOURCES_COMMENT, "[sources]", *sources, *missing)))
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _filled(path: str, data: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the values of a table, or of each element of a list of tables; empty if it is unset."""
    values: list[Any] = [data]
    for part in path.split(".") if path else ():
        inner = [value.get(part) for value in values if value]
        values = [x for y in inner for x in (y if isinstance(y, list | tuple) else [y])]
    return [value for value in values if value]


def _comment(text: str, further: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent=further)


def _is_set(info: FieldInfo, value: Any, name: str, camera: Camera) -> bool:
    """Return True if a value differs from the default or has a source."""
    if value is None:
        return False
    given = info.is_required() or name in camera.sources
    return given or value != info.get_default(call_default_factory=True)


def _set(name: str, value: Any) -> list[str]:
    """Return the lines of a key; a table of names has one line per name."""
    if isinstance(value, Mapping):
        return [assignment(f"{name}.{key_of(key)}", x) for key, x in value.items()]
    return [assignment(name, value)]
