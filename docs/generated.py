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
CHECKED = re.compile(r"\bAnnotated\[([\w\[\], .]+), AfterValidator[^)]*\)\]")
MODULES = re.compile(r"\b(?!np\.)(?:\w+\.)+(?=\w)")
"""What a signature is easier to read without: the checks of tables of a camera file, and names of modules."""

ANNOTATIONS = {
    "Array": "Annotation of pixel values (H, W): an array of NumPy or Dr.Jit, or a number."
}
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
    """Every public name: functions, classes, and those of the laboratory."""
    names = sorted(ms.__all__, key=str.lower)
    names.remove("lab")
    functions = [name for name in names if inspect.isfunction(getattr(ms, name))]
    classes = [name for name in names if name not in functions]
    laboratory = sorted(ms.lab.__all__, key=str.lower)
    return "\n\n".join(
        [
            "## Functions",
            *(f"### {name}\n\n{documented(ms, name)}" for name in functions),
            "## Classes",
            *(f"### {name}\n\n{documented(ms, name)}" for name in classes),
            "## Laboratory",
            directive("automodule", ms.lab.__name__),
            *(f"### lab.{name}\n\n{documented(ms.lab, name)}" for name in laboratory),
        ]
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
    """A block for autodoc: a function, or a class with its members; and an annotation with what is said of it."""
    value, full_name = getattr(module, name), f"{module.__name__}.{name}"
    if value is Any:
        return directive("py:data", full_name, "", ANNOTATIONS[name])
    if inspect.isfunction(value):
        return directive("autofunction", full_name)
    return directive("autoclass", full_name, ":members:")


def directive(kind: str, full_name: str, *inside: str) -> str:
    """One directive of Sphinx in a page of Markdown."""
    lines = [f".. {kind}:: {full_name}", *(f"   {line}" for line in inside)]
    return "\n".join(["```{eval-rst}", *lines, "```"])


class AsWritten(str):
    """An annotation as it stands in the source: without quotes around it."""

    __repr__ = str.__str__


def signature(value: Any) -> tuple[str, str] | None:
    """Parameters of a function or a class, with their types, and type of the result; None where it has none."""
    try:
        found = inspect.signature(value)
    except (TypeError, ValueError):
        return None
    shown = []
    for parameter in found.parameters.values():
        if parameter.name == "self" or parameter.name.startswith("_"):
            continue
        if kind := type_text(parameter.annotation):
            parameter = parameter.replace(annotation=AsWritten(kind))
        if str(parameter.default) == "<factory>":
            parameter = parameter.replace(default=AsWritten("..."))
        shown.append(parameter)
    result = "" if inspect.isclass(value) else type_text(found.return_annotation)
    return str(found.replace(parameters=shown, return_annotation=found.empty)), result


def type_text(annotation: Any) -> str:
    """A type as a reader of the source sees it: no modules and no checks; nothing where there is none."""
    if annotation is inspect.Parameter.empty:
        return ""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    return CHECKED.sub(r"\1", MODULES.sub("", text))


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
    described = documented(sys.modules[stage.__module__], stage.__name__)
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
    return f"## {title}\n\n{facts}\n\n{described}{keys}"


def _parameters(parameters: Iterable[PluginParameter]) -> str:
    lines = ["| parameter | unit | default | what it is | XML |", "|---|---|---|---|---|"]
    for one in parameters:
        lines.append(
            f"| `{one.name}` | {one.unit or '–'} | {one.default} | {one.meaning} | `{one.xml}` |"
        )
    return "\n".join(lines)
