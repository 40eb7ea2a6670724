"""The parts of the documentation that are made of the package: command line, API, stages, plugin parameters.

A page holds ``<!-- generated: NAME -->`` where a part belongs; conf.py puts it there when the site is built.
"""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Iterable
from types import ModuleType
from typing import Any

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera import Camera
from mitsuba_sensor.camera.field_catalogue import markdown_rows, tables
from mitsuba_sensor.render.scene.plugin_parameters import (
    FILM_PARAMETERS,
    PASSED_ON_PARAMETERS,
    SENSOR_PARAMETERS,
    PluginParameter,
)
from mitsuba_sensor.stages.chain import ORDER
from mitsuba_sensor.stages.stage import UNITS, Stage

MARK = re.compile(r"^<!-- generated: (\w+) -->$", re.M)
NAMES = r"\w+(?:, \w+)*"
DESCRIBED = re.compile(rf"(?=(?:^|  ){NAMES} : )")
"""Where the description of a parameter begins, as ``name : meaning`` or ``one, other : meaning``."""
TABLES = tuple(tables(Camera))


def with_generated_parts(page: str) -> str:
    """A page with each of its marks replaced."""
    return MARK.sub(lambda mark: PARTS[mark.group(1)](), page)


def pages_of(index: str) -> dict[str, list[str]]:
    """The pages that an index links to, by its headings."""
    sections = re.split(r"^## (.+)$", index, flags=re.M)
    return {
        title: re.findall(r"\]\(([\w/-]+)\.md\)", text)
        for title, text in zip(sections[1::2], sections[2::2], strict=True)
    }


def command_line() -> str:
    """Every command with all its options, by typer's own generator; without the title, which the page has."""
    arguments = [
        sys.executable,
        "-m",
        "typer",
        "mitsuba_sensor.cli",
        "utils",
        "docs",
        "--name",
        "mitsuba-sensor",
    ]
    made = subprocess.run(
        arguments, capture_output=True, text=True, check=True, encoding="utf-8"
    ).stdout
    return made.partition("\n")[2]


def api() -> str:
    """Every public name, functions first."""
    names = sorted(ms.__all__, key=str.lower)
    functions = [name for name in names if inspect.isfunction(getattr(ms, name))]
    parts = {
        "Functions": functions,
        "Classes": [name for name in names if name not in functions],
    }
    return "\n\n".join(
        f"## {title}\n\n"
        + "\n\n".join(f"### {name}\n\n{documented(ms, name)}" for name in those)
        for title, those in parts.items()
    )


def stages() -> str:
    """Every stage in the order of the chain: what it computes, its theory, its keys of a camera file."""
    return "\n\n".join(map(_stage, ORDER))


def film() -> str:
    """The parameters of <film type="photosensor">."""
    return _parameters(FILM_PARAMETERS)


def sensor() -> str:
    """The parameters of <sensor type="camera">."""
    return _parameters((*SENSOR_PARAMETERS, *PASSED_ON_PARAMETERS))


PARTS = {one.__name__: one for one in (command_line, api, stages, film, sensor)}


def documented(module: ModuleType, name: str) -> str:
    """A block for autodoc: a function, a class with its members, or an annotation."""
    value, kind, more = getattr(module, name), "data", ""
    if inspect.isfunction(value):
        kind = "function"
    elif inspect.isclass(value):
        kind, more = "class", "\n   :members:"
    return f"```{{eval-rst}}\n.. auto{kind}:: {module.__name__}.{name}{more}\n```"


def with_bullets(docstring: Iterable[str]) -> list[str]:
    """The lines of a docstring with each ``name : meaning`` as a bullet, and no bar as markup."""
    made: list[str] = []
    inside: int | None = None  # the indentation of the bullets that the last line belongs to
    for line in docstring:
        indent = len(line) - len(line.lstrip())
        parts = [one.strip() for one in DESCRIBED.split(line.strip()) if one.strip()]
        items = [re.sub(rf"^({NAMES}) : ", r"* ``\1``: ", one) for one in parts]
        if items != parts:
            made += [""] * (inside is None) + [" " * indent + one for one in items]
            inside = indent
        elif inside is not None and line.strip() and indent <= inside:
            made += ["", line]
            inside = None
        elif inside is not None and line.strip():
            made.append(" " * (inside + 2) + line.strip())
        else:
            made.append(line)
    return [re.sub(r"(?<!\\)\|", r"\\|", line) for line in made]


def _stage(stage: type[Stage]) -> str:
    where = f"`{stage.__module__.removeprefix('mitsuba_sensor.').replace('.', '/')}.py`"
    domain: Any = stage.domain
    facts = f"Behind it: {domain} [{UNITS[domain]}]. Paper: {stage.paper}. Source: {where}."
    directive = documented(sys.modules[stage.__module__], stage.__name__)
    names = set(stage.fields.model_fields) if stage.fields else set()
    entries = [
        x for one in TABLES if one.path == stage.table for x in one.entries if x.name in names
    ]
    keys = (
        f"\n\nKeys of a camera file in `[{stage.table}]`:\n\n{markdown_rows(entries)}"
        if entries
        else ""
    )
    title = stage.label[:1].upper() + stage.label[1:]
    return f"## {title}\n\n{facts}\n\n{directive}{keys}"


def _parameters(parameters: Iterable[PluginParameter]) -> str:
    lines = ["| parameter | unit | default | what it is | XML |", "|---|---|---|---|---|"]
    for one in parameters:
        lines.append(
            f"| `{one.name}` | {one.unit or '–'} | {one.default} | {one.meaning} | `{one.xml}` |"
        )
    return "\n".join(lines)
