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
    """An error or warning about a camera file.

    level : an error prevents loading the file or tracing its lens; a warning is about an unusual value.
    field : dotted name; empty for the whole file.  line : from 1; None for a missing field.
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
        """Return the finding for JSON."""
        return asdict(self)


def check_camera(name: str | Path | Mapping[str, Any] | Camera) -> tuple[CameraFinding, ...]:
    """Return all errors of a camera or its file, then the warnings.

    ::

        for finding in ms.check_camera("my.toml"):
            print(finding.line, finding.level, finding.text)

    name : as for :func:`load_camera`, or a camera. Fields are compared with each other only if each of them is valid.
    Raises InputError if the file does not exist.
    """
    if isinstance(name, Camera):
        source, data = CameraText("", name.name), tomllib.loads(name.to_toml())
    elif isinstance(name, Mapping):
        source, data = CameraText("", "the dict"), plain_tables(name)
    else:
        source = camera_text(name)
        try:
            data = toml_tables(source.text)
        except tomllib.TOMLDecodeError as error:
            line = re.search(r"at line (\d+)", str(error))
            text = f"not valid TOML: {error}; fix this first, then check again."
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
        errors = [finding("error", fault.loc, fault.text) for fault in faults(error, Camera)]
        notes = doubts(data, Camera)
    else:
        errors = [finding("error", ("lens", "prescription"), x) for x in _lens_faults(camera)]
        notes = [(note.split()[0].rstrip(":"), note) for note in camera.notes]
    wrong = [f"{error.field}." for error in errors]
    warnings = [
        finding("warning", tuple(field.split(".")), f"{text}.")
        for field, text in notes
        if not any(name.startswith(f"{field}.") for name in wrong)
    ]
    return (
        *sorted(errors, key=lambda error: error.line or 0),
        *sorted(warnings, key=lambda warning: warning.line or 0),
    )


def _lens_faults(camera: Camera) -> list[str]:
    """Return errors that a render would raise: an f-number beyond the prescription's, a negative focal length."""
    try:
        if camera.lens.prescription is not None:
            cardinal_points(camera.lens)
    except InputError as error:
        return [str(error)]
    return []


def toml_lines(text: str) -> dict[Loc, int]:
    """Return the first line, from 1, of each table and key of a TOML text; an inline table has the line of its key."""
    lines: dict[Loc, int] = {}
    table: Loc = ()
    lengths = Counter[Loc]()  # of lists of tables
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
