"""The text of a camera file: every key with unit, range and meaning, those that are set and those that are not."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..core import InputError
from .field_catalogue import Entry, Table, assignment, key_of, tables, toml_of

if TYPE_CHECKING:
    from .camera import Camera

WIDTH = 116
HEAD = """\
# A camera file of mitsuba_sensor. Every key that there is stands here with its meaning, unit and range.
# A key behind a # is not set: its default holds, and what is written is an example.
# [sources] at the end says where each number comes from; it becomes part of frame.json. Keep it true.
# Check the file: mitsuba-sensor cameras check FILE. Use it: mitsuba-sensor render SCENE --camera FILE -o out/
"""
OF_SOURCES = "# Where each number comes from: data sheet, measurement, paper or assumption."


def camera_file(camera: Camera) -> str:
    """The commented file, which loads again to an equal camera. Raises InputError for added stages."""
    if camera.added:
        stages = ", ".join(type(stage).__name__ for stage in camera.added)
        raise InputError(
            f"A camera file cannot hold the stage {stages}; call with_stage again after load_camera."
        )
    data, known = camera.model_dump(), list(tables(type(camera)))
    headers, parts, names = {one.path for one in known}, [HEAD.rstrip()], list[str]()
    for table in known:
        for number, values in enumerate(_filled(table.path, data)):
            keys = [
                one for one in table.entries if _is_key(table.path, one.name, values, headers)
            ]
            given = {
                one.name
                for one in keys
                if _is_set(table, one, values[one.name], camera.sources)
            }
            parts.append(
                "\n".join((_lines if number == 0 else _short)(table, keys, values, given))
            )
            names += (
                []
                if table.of_list
                else [f"{table.path}.{x}" for x in given if not isinstance(values[x], str)]
            )
    sources = [f"{toml_of(name)} = {toml_of(text)}" for name, text in camera.sources.items()]
    missing = [
        f'# {toml_of(name)} = ""' for name in sorted(names) if name not in camera.sources
    ]
    parts.append("\n".join((OF_SOURCES, "[sources]", *sources, *missing)))
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _filled(path: str, data: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The values of a table of the file, of each one of a list, or none where it is not set."""
    found: list[Any] = [data]
    for part in path.split(".") if path else ():
        inner = [one.get(part) for one in found if one]
        found = [x for one in inner for x in (one if isinstance(one, list | tuple) else [one])]
    return [one for one in found if one]


def _is_key(path: str, name: str, values: Mapping[str, Any], headers: Collection[str]) -> bool:
    """Whether it stands as a key: a table that is set has a header of its own."""
    inside = f"{path}.{name}".lstrip(".")
    return inside != "sources" and not (inside in headers and values[name])


def _lines(
    table: Table, keys: Sequence[Entry], values: Mapping[str, Any], given: Collection[str]
) -> Iterator[str]:
    """A table with its keys, each explained."""
    if table.path:
        yield from textwrap.wrap(
            table.meaning, WIDTH, initial_indent="# ", subsequent_indent="# "
        )
        yield table.header
    for one in keys:
        value = values[one.name]
        yield ""
        yield from textwrap.wrap(
            _explained(one), WIDTH, initial_indent="# ", subsequent_indent="#   "
        )
        yield from (
            _set(one, value)
            if one.name in given
            else [f"# {one.name} = {toml_of(one.example)}"]
        )


def _short(
    table: Table, keys: Sequence[Entry], values: Mapping[str, Any], given: Collection[str]
) -> Iterator[str]:
    """The second table of a list, and every further one: only what is set."""
    yield table.header
    for one in keys:
        if one.name in given:
            yield from _set(one, values[one.name])


def _explained(one: Entry) -> str:
    """Meaning, unit, range, usual range and default in one line."""
    unit = ""
    if one.unit:
        unit = f" [{one.unit}]"
    usual = ""
    if one.usual:
        usual = f"usual {one.usual}"
    if one.default in ("required", ""):
        default = one.default
    else:
        default = f"default {one.default}"
    return "; ".join(filter(None, (f"{one.meaning}{unit}", one.allowed, usual, default)))


def _is_set(table: Table, one: Entry, value: Any, sources: Collection[str]) -> bool:
    """Whether a value is not what holds anyway, or has a source."""
    info = table.model.model_fields[one.name]
    given = info.is_required() or f"{table.path}.{one.name}" in sources
    return value is not None and (given or value != info.get_default(call_default_factory=True))


def _set(one: Entry, value: Any) -> Iterator[str]:
    """The lines of a key; a table of names has one line for each name."""
    if isinstance(value, Mapping):
        yield from (assignment(f"{one.name}.{key_of(key)}", x) for key, x in value.items())
    else:
        yield assignment(one.name, value)
