"""All errors and warnings of a camera file, with line numbers."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from ..core import InputError
from ..core.printable import printable
from ..core.small_files import toml_tables
from ..optics.traced_lens import cardinal_points
from .camera import Camera
from .camera_file import CameraText, camera_text, plain_tables
from .datasheet_errors import Loc, dotted, doubts, faults

STATEMENT = re.compile(
    r"\s*(?:(?P<header>\[\[?)\s*(?P<table>[^\[\],]+)\]+\s*(?:#.*)?$|(?P<key>[^=\[\]{}#,]+)=)"
)
PART = re.compile(r"""("[^"]*"|'[^']*'|[^.\s]+)""")


@dataclass(frozen=True)
class CameraFinding:
    """One error or warning of a camera file.

    level : a file with an error cannot be loaded, or its lens cannot be traced; a warning is a value that is allowed
        and probably not meant.
    field : dotted name, or empty for the whole file.  line : from 1; None for a field that is in no line.
    text : value, allowed or usual range, and how to fix it.
    """

    level: Literal["error", "warning"]
    file: str
    line: int | None
    field: str
    text: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return printable(f"{place}: {self.level}: {self.text}")

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def check_camera(name: str | Path | Mapping[str, Any]) -> tuple[CameraFinding, ...]:
    """All errors of a camera file at once, then its warnings; nothing for a file that is right. Renders nothing.

    ::

        for finding in ms.check_camera("my.toml"):
            print(finding.line, finding.level, finding.text)

    name : path of a camera file, a shipped camera, a text or a dict, as for :func:`load_camera`. Fields of one table
        are compared with each other once each of them is right by itself.
    Raises InputError if there is no such file.
    """
    if isinstance(name, Mapping):
        source, data = CameraText("", "the dict"), plain_tables(name)
    else:
        source = camera_text(name)
        try:
            data = toml_tables(source.text)
        except tomllib.TOMLDecodeError as error:
            line = re.search(r"at line (\d+)", str(error))
            text = f"not valid TOML: {error}; the rest is checked when this is right."
            return (
                CameraFinding("error", source.where, int(line[1]) if line else None, "", text),
            )
    lines = toml_lines(source.text)

    def finding(level: Literal["error", "warning"], loc: Loc, text: str) -> CameraFinding:
        line = next((lines[loc[:n]] for n in range(len(loc), 0, -1) if loc[:n] in lines), None)
        return CameraFinding(level, source.where, line, dotted(loc), text)

    try:
        camera = Camera.model_validate(data, context={"folder": source.folder})
    except ValidationError as error:
        errors = [finding("error", one.loc, one.text) for one in faults(error, Camera)]
        notes = doubts(data, Camera)
    else:
        errors = [finding("error", ("lens", "prescription"), x) for x in _lens_faults(camera)]
        notes = [(note.split()[0].rstrip(":"), note) for note in camera.notes]
    wrong = [f"{one.field}." for one in errors]
    warnings = [
        finding("warning", tuple(field.split(".")), f"{text}.")
        for field, text in notes
        if not any(one.startswith(f"{field}.") for one in wrong)
    ]
    ordered = (sorted(found, key=lambda one: one.line or 0) for found in (errors, warnings))
    return tuple(one for found in ordered for one in found)


def _lens_faults(camera: Camera) -> list[str]:
    """What a render refuses in a prescription: an f-number that it does not open to, a negative focal length."""
    try:
        if camera.lens.prescription is not None:
            cardinal_points(camera.lens)
    except InputError as error:
        return [str(error)]
    return []


def toml_lines(text: str) -> dict[Loc, int]:
    """The first line, from 1, of each table and key of a TOML text; inline tables have that of their key."""
    lines: dict[Loc, int] = {}
    table: Loc = ()
    lengths = Counter[Loc]()  # of the lists of tables
    for number, row in enumerate(text.split("\n"), start=1):
        statement = STATEMENT.match(row)
        if statement is None:
            continue
        header = statement["header"]
        place = () if header else table
        path = [
            part.strip("\"'") for part in PART.findall(statement["table"] or statement["key"])
        ]
        for position, part in enumerate(path, start=1):
            place = (*place, part)
            lines.setdefault(place, number)
            if header == "[[" and position == len(path):
                lengths[place] += 1
            if header and place in lengths:
                place = (*place, lengths[place] - 1)
                lines.setdefault(place, number)
        if header:
            table = place
    return lines
