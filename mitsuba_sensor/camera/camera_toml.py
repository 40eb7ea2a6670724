"""The text of a camera file: every key with unit, range and meaning, those that are set and those that are not."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic.fields import FieldInfo

from ..core import InputError
from .field_catalogue import assignment, key_of, tables, toml_of

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
