"""The parts of the documentation that are made of the package: command line, API, stages, camera files.

    python docs/generated.py

writes the tables that GitHub shows, too, between two comments of their page: ``<!-- table: NAME, … -->`` and
``<!-- end of NAME -->``. What only the site has stands in a page as ``<!-- generated: NAME -->``; conf.py puts it
there when the site is built.
It also writes examples/tutorial.ipynb from tutorial.md.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import typer
from pydantic import BaseModel
from rich.text import Text

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera import Camera
from mitsuba_sensor.camera.emva_sheet import COMPARED, KEYS, EmvaSheet
from mitsuba_sensor.camera.field_catalogue import Entry, markdown_rows, tables
from mitsuba_sensor.cli.app import app, commands_below
from mitsuba_sensor.render.scene.asked import materials
from mitsuba_sensor.render.scene.motion import KeyPose, RigidMotion
from mitsuba_sensor.render.scene.plugin_parameters import (
    FILM_PARAMETERS,
    PASSED_ON_PARAMETERS,
    SENSOR_PARAMETERS,
    PluginParameter,
)
from mitsuba_sensor.stages.chain import ORDER, what_it_does
from mitsuba_sensor.stages.stage import UNITS, Stage

MARK = re.compile(r"^<!-- generated: (\w+) -->$", re.M)
TABLE = re.compile(
    r"(?<=^<!-- table: )(\w+)(.*? -->\n).*?(?=^<!-- end of \1 -->$)", re.M | re.S
)
NAMES = r"\w+(?:, \w+)*"
DESCRIBED = re.compile(rf"(?=(?:^|  ){NAMES} : )")
"""Where the description of a parameter begins, as ``name : meaning`` or ``one, other : meaning``."""
CHECKED = re.compile(r"\bAnnotated\[([\w\[\], .]+), AfterValidator[^)]*\)\]")
MODULES = re.compile(r"\b(?!np\.)(?:\w+\.)+(?=\w)")
"""What a signature is easier to read without: the checks of tables of a camera file, and names of modules."""

ANNOTATIONS = {
    "Array": "Annotation of pixel values (H, W): an array of NumPy or Dr.Jit, or a number."
}
LINK = re.compile(r"\]\((?!\w+:|\.\./|#)")
"""Where a link to another page or picture of docs begins."""
TABLES = tuple(tables(Camera))
MOTION_TABLES: dict[str, type[BaseModel]] = {
    "`[camera]`, `[objects.ID]`": RigidMotion,
    "`[[camera.keys]]`, `[[objects.ID.keys]]`": KeyPose,
}
SHOWN_NM = (850, 1000, 1550)
"""Wavelengths of the table of measured materials."""
SHORT = (
    (r"whole number, ", "integer "),
    (r"at least (\S+), at most (\S+)", r"\1 to \2"),
    (r"above (\S+), at most (\S+)", r"> \1, ≤ \2"),
    (r"at least (\S+), below (\S+)", r"≥ \1, < \2"),
    (r"above (\S+), below (\S+)", r"> \1, < \2"),
    (r"\bat least -?1e-06\b", "≥ 1e-6"),
    (r"\bat least ", "≥ "),
    (r"\bat most ", "≤ "),
    (r"\babove ", "> "),
    (r"\bbelow ", "< "),
    (r"list of ≥ 2, each", "list of"),
    (r"list, each a table", "list of tables"),
    (r"list, each", "list of"),
    (r"true or false", "boolean"),
    (r"\ba (text|table)\b", r"\1"),
    (r"any number", "number"),
    (r"for each name", "by name:"),
)
"""How the table of camera keys shortens a range."""
WITHOUT_KEY = dict.fromkeys(COMPARED, "none; only checked")
WITHOUT_KEY["linearity_percent"] = "none; see `adc.ile`"


def with_generated_parts(page: str) -> str:
    """A page with each of its marks replaced."""
    return MARK.sub(lambda mark: PARTS[mark.group(1)](), page)


def with_tables(page: str) -> str:
    """A page with the tables between its comments as the package has them now."""

    def written(table: re.Match[str]) -> str:
        name, rest_of_comment = table.groups()
        return f"{name}{rest_of_comment}\n{IN_PAGES[name]()}\n\n"

    return TABLE.sub(written, page)


def pages_of(index: str) -> dict[str, list[str]]:
    """The pages that an index links to, by its headings."""
    sections = re.split(r"^## (.+)$", index, flags=re.M)
    return {
        title: re.findall(r"\]\(([\w/-]+)\.md\)", text)
        for title, text in zip(sections[1::2], sections[2::2], strict=True)
    }


def commands() -> str:
    """Every command with its help; an option that several commands share is explained once, on top."""
    program = typer.main.get_command(app)
    found = dict(commands_below(program))
    uses = Counter(_option(one) for command in found.values() for one in _options(command))
    shared: dict[str, str] = {}
    for row, count in uses.most_common():
        if count > 1:
            shared.setdefault(row.split("`")[1], row)
    rows = sorted(shared.values(), key=lambda row: row.strip("| `-").lower())
    head = ["| option | what it does |", "|---|---|"]
    parts = ["\n".join([*head, *rows])]
    for path, command in found.items():
        parts.append(_command(path, command, set(rows)))
    return "\n\n".join(parts)


def _options(command: Any) -> list[Any]:
    return [one for one in command.params if one.param_type_name == "option"]


def _command(path: str, command: Any, shared: set[str]) -> str:
    """The help of one command, a row for each of its own options, and the names of the shared ones."""
    values = [one for one in command.params if one.param_type_name == "argument"]
    names = [str(one.metavar or one.name.upper()) for one in values]
    named = [
        (name if one.required else f"[{name}]") + "..." * (one.nargs < 0)
        for name, one in zip(names, values, strict=True)
    ]
    usage = " ".join(["mitsuba-sensor", path, *named])
    rows = [row for one in _options(command) if (row := _option(one)) not in shared]
    others = ", ".join(_names(one) for one in _options(command) if _option(one) in shared)
    text = textwrap.dedent(command.help or "").strip().partition("\n\n")[0]
    parts = [f"## {path}", f"`{usage}`", _plain(text)]
    if rows:
        parts.append("\n".join(["| option | what it does |", "|---|---|", *rows]))
    if others:
        parts.append(f"Shared options: {others}.")
    return "\n\n".join(parts)


def _names(one: Any) -> str:
    return ", ".join(f"`{name}`" for name in (*one.opts, *one.secondary_opts))


def _option(one: Any) -> str:
    value = (
        "" if one.is_flag else f" `{one.metavar or one.type.name.upper()}`".replace("|", "\\|")
    )
    return f"| {_names(one)}{value} | {_plain(one.help or '')} |"


def _plain(markup: str) -> str:
    """Help without the markup of the terminal; what would end a cell or begin an element is written out."""
    return Text.from_markup(markup).plain.replace("|", "\\|").replace("<", "&lt;")


def public_names() -> str:
    """Every public name and the first sentence about it; names of the laboratory are in its own pages."""
    lines = ["| name | what it is |", "|---|---|"]
    for name in sorted(ms.__all__, key=str.lower):
        lines.append(f"| `ms.{name}` | {_first_sentence(getattr(ms, name), name)} |")
    return "\n".join(lines)


def _first_sentence(value: object, name: str) -> str:
    if value is Any:
        return ANNOTATIONS[name]
    text = " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
    sentence = re.split(r"(?<=\.)\s", text)[0].rstrip(":;")
    return _plain(sentence.replace("``", "`")).replace(":class:`", "`").replace(":func:`", "`")


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


def camera_file() -> str:
    """The tables of all keys of a camera file, without lens prescriptions."""
    parts = []
    for one in TABLES:
        if not one.path.startswith("lens.prescription"):
            title = f"`{one.header}`\n\n{one.meaning}" if one.path else "Top of the file"
            rows = "\n".join(map(_key, one.entries))
            head = "| key | range | default | meaning |\n|---|---|---|---|"
            parts.append(f"### {title}\n\n{head}\n{rows}")
    return "\n\n".join(parts)


def _key(entry: Entry) -> str:
    allowed = entry.allowed
    for pattern, short in SHORT:
        allowed = re.sub(pattern, short, allowed)
    allowed = f"{allowed} {entry.unit}".strip()
    default = entry.default if entry.default in ("required", "") else f"`{entry.default}`"
    cells = (f"`{entry.name}`", allowed, default, entry.meaning)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def noise_sources() -> str:
    """The names of the stages that can be switched off."""
    return ", ".join(f"`{stage.key()}`" for stage in ORDER if not stage.no_noise)


def stage_table() -> str:
    """Every stage in the order of the chain: its key, what it computes, its names in the literature, its table."""
    lines = [
        "| stage | what it computes | names | keys in |",
        "|---|---|---|---|",
    ]
    for stage in ORDER:
        cells = (f"`{stage.key()}`", what_it_does(stage), stage.terms, f"`[{stage.table}]`")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def emva_sheet() -> str:
    """The rows of an EMVA 1288 summary sheet, their keys, and an example of each."""
    lines = [
        "| EMVA 1288 sheet | line of the file | key of the camera file |",
        "|---|---|---|",
    ]
    for name, info in EmvaSheet.model_fields.items():
        keys = ", ".join(f"`{key}`" for key in KEYS.get(name, ()))
        keys = keys or WITHOUT_KEY[name]
        example = f"{name} = {json.dumps((info.examples or [''])[0])}"
        lines.append(f"| {info.description} | `{example}` | {keys} |")
    return "\n".join(lines)


def motion_file() -> str:
    """Every field of a motion file, table by table."""
    lines = ["| table | field | meaning | example |", "|---|---|---|---|"]
    for where, model in MOTION_TABLES.items():
        for name, info in model.model_fields.items():
            example = json.dumps(info.examples[0]) if info.examples else ""
            lines.append(f"| {where} | `{name}` | {info.description} | `{example}` |")
            where = ""
    return "\n".join(lines)


PARTS = {one.__name__: one for one in (api, stages)}
"""What only the site has."""


def infrared_materials() -> str:
    """Measured reflectances beyond 700 nm, at a few wavelengths."""
    columns = " | ".join(f"{nm} nm" for nm in SHOWN_NM)
    lines = [f"| name | {columns} |", "|---|" + "---|" * len(SHOWN_NM)]
    for material in materials().values():
        values = " | ".join(f"{value:.2f}" for value in material.at(np.array(SHOWN_NM)))
        lines.append(f"| `{material.name}` | {values} |")
    return "\n".join(lines)


IN_PAGES = {
    one.__name__: one
    for one in (
        stage_table,
        camera_file,
        noise_sources,
        emva_sheet,
        motion_file,
        infrared_materials,
        film,
        sensor,
        commands,
        public_names,
    )
}
"""What the pages themselves have."""


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


def notebook(page: str) -> str:
    """A page as a notebook beside it, in examples/: Python blocks are cells of code, what is between them is text."""
    cells: list[dict[str, Any]] = []
    for text, code in re.findall(r"(.*?)(?:^```python\n(.*?)^```\n|\Z)", page, re.M | re.S):
        linked = LINK.sub("](../docs/", text).strip("\n")
        if linked:
            cells.append({"cell_type": "markdown", "metadata": {}, "source": linked})
        if code:
            cell = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": []}
            cells.append({**cell, "source": code.rstrip("\n")})
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
        cell["source"] = cell["source"].splitlines(keepends=True)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    made = {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(made, ensure_ascii=False, indent=1) + "\n"


def _stage(stage: type[Stage]) -> str:
    domain: Any = stage.domain
    unit, file = UNITS[domain], _file_of(stage)
    facts = f"Behind it: {domain} [{unit}]. Source: `{file}`."
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


def _file_of(kind: type) -> str:
    return f"{kind.__module__.removeprefix('mitsuba_sensor.').replace('.', '/')}.py"


def _parameters(parameters: Iterable[PluginParameter]) -> str:
    lines = ["| parameter | unit | default | what it is | XML |", "|---|---|---|---|---|"]
    for one in parameters:
        lines.append(
            f"| `{one.name}` | {one.unit or '–'} | {one.default} | {one.meaning} | `{one.xml}` |"
        )
    return "\n".join(lines)


def main() -> None:
    """Write the tables into the pages, name each page that changed, and write the notebook."""
    docs = Path(__file__).parent
    for path in sorted(docs.glob("*.md")):
        page = path.read_text(encoding="utf-8")
        written = with_tables(page)
        if written != page:
            path.write_text(written, encoding="utf-8")
            print(path.name)
    page = (docs / "tutorial.md").read_text(encoding="utf-8")
    path = docs.parent / "examples/tutorial.ipynb"
    path.write_text(notebook(page), encoding="utf-8")


if __name__ == "__main__":
    main()
