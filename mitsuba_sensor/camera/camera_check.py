"""Everything that is wrong or unusual in a camera file, with line numbers: what to mend before it is used."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from pydantic import ValidationError

from ..core import InputError, closest
from ..core.printable import printable
from ..core.small_files import toml_tables, without_strings
from ..optics.paraxial import cardinal_points
from .camera import Camera
from .camera_file import CameraText, camera_text, plain_tables
from .datasheet_errors import Fault, Loc, doubts, faults, fields_of
from .field_terms import key_of_term

AT_LINE = "(at line "  # in the parser's messages
MOST_BROKEN = 20  # lines that are no TOML; the text is parsed again for each


@dataclass(frozen=True)
class CameraFinding:
    """One error or warning of a camera file.

    level : a file with an error cannot be loaded, or its lens cannot be traced; a warning is a value that is allowed
        and probably not meant.
    field : dotted name, or empty for the whole file.  line : from 1; None for what stands nowhere.
    text : value, allowed or usual range, and the way out.
    """

    level: Literal["error", "warning"]
    file: str
    line: int | None
    field: str
    text: str

    def __str__(self) -> str:
        if self.line is None:
            place = self.file
        else:
            place = f"{self.file}:{self.line}"
        return printable(f"{place}: {self.level}: {self.text}")

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def check_camera(name: str | Path | Mapping[str, Any]) -> tuple[CameraFinding, ...]:
    """All errors of a camera file at once, then its warnings; nothing for a file that is right. Renders nothing.

    ::

        for finding in ms.check_camera("my.toml"):
            print(finding.line, finding.level, finding.text)

    name : path of a camera file, a shipped camera, a text or a dict, as for :func:`load_camera`. A misspelt field is
        read as the one that was meant, so that its value is checked too. Fields of one table are compared with each
        other once each of them is right by itself.
    Raises InputError if there is no such file.
    """
    if isinstance(name, Mapping):
        return _findings(plain_tables(name), CameraText("", "the dict"), [])
    text, file, folder = camera_text(name)
    readable, broken = _readable(text)
    unread = [
        CameraFinding("error", file, line, "", f"not valid TOML: {said}.")
        for line, said in broken
    ]
    if readable is None:
        return tuple(unread)
    return _findings(toml_tables(readable), CameraText(readable, file, folder), unread)


def _findings(
    data: dict[str, Any], source: CameraText, unread: list[CameraFinding]
) -> tuple[CameraFinding, ...]:
    """Errors and warnings of these tables.  source : where they stand.  unread : the lines that are no TOML."""
    lines, file = TomlLines(source.text), source.where
    found, notes = _all_faults(data, source.folder, lines)
    errors = [
        CameraFinding("error", file, lines(one.loc), _field(one.loc), one.text) for one in found
    ]
    wrong = {one.field for one in errors}
    warnings = [
        CameraFinding("warning", file, lines(tuple(field.split("."))), field, f"{said}.")
        for field, said in notes
        if not any(f"{one}.".startswith(f"{field}.") for one in wrong)
    ]
    said_already = {one.line for one in unread}
    errors = [*unread, *(one for one in errors if one.line not in said_already)]
    return (*sorted(errors, key=_place), *sorted(warnings, key=_place))


def _readable(text: str) -> tuple[str | None, list[tuple[int | None, str]]]:
    """The text with ``key = "?"`` for each line whose value is no TOML, and line and sentence of each.

    None for the text where the mistake is not in a single line: a bracket that is not closed, a key given twice.
    """
    rows, broken = text.split("\n"), list[tuple[int | None, str]]()
    while True:
        try:
            toml_tables("\n".join(rows))
        except tomllib.TOMLDecodeError as error:
            line = str(error).partition(AT_LINE)[2].partition(",")[0]
            if line.isdecimal():
                number = int(line)
            else:
                number = None
            row = ""
            if number:
                row = rows[number - 1]
            key, _, value = row.partition("=")
            said = re.sub(r" \(at line \d+, (column \d+)\)", r" in \1", str(error))
            mended = f'{key}= "?"'
            too_many = len(broken) == MOST_BROKEN
            if not number or too_many or _is_toml(row) or not _is_toml(mended):
                return None, [
                    *broken,
                    (number, f"{said}; the rest is checked when this is right"),
                ]
            broken.append((number, f"{said}{_toml_hint(value)}"))
            rows[number - 1] = mended
        else:
            return "\n".join(rows), broken


def _is_toml(row: str) -> bool:
    try:
        toml_tables(row)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _toml_hint(value: str) -> str:
    """What is probably meant by a value that is no TOML."""
    bare = value.partition("#")[0].strip()
    if re.fullmatch(r"[+-]?\d+,\d+", bare):
        return f"; a number has a decimal point, write {bare.replace(',', '.')}"
    if re.fullmatch(r"[+-]?\.\d+|[+-]?\d+\.", bare):
        return f"; a decimal point has digits on both sides, write {float(bare)}"
    if re.fullmatch(r"[^\W\d][\w -]*", bare):
        return f'; a text needs quotes, write "{bare}"'
    return ""


def _place(finding: CameraFinding) -> int:
    return finding.line or 0


def _all_faults(
    data: dict[str, Any], folder: str, lines: TomlLines
) -> tuple[list[Fault], list[tuple[str, str]]]:
    """What is wrong, with misspelt fields renamed until nothing new is found; and the notes, by field."""
    found: dict[tuple[Loc, str], Fault] = {}
    while True:
        try:
            camera = Camera.model_validate(data, context={"folder": folder})
        except ValidationError as error:
            new = [one for one in faults(error, Camera) if (one.loc, one.text) not in found]
            found |= {(one.loc, one.text): one for one in new}
            data, unknown = _renamed(data, new, lines)
            if not unknown:
                return list(found.values()), doubts(data, Camera)
        else:
            notes = [(note.split()[0], note) for note in camera.notes]
            return [*found.values(), *_lens_faults(camera)], notes


def _lens_faults(camera: Camera) -> list[Fault]:
    """What a render refuses in a prescription: an f-number that it does not open to, a negative focal length."""
    if camera.lens.prescription is None:
        return []
    try:
        cardinal_points(camera.lens)
    except InputError as error:
        return [Fault(("lens", "prescription"), str(error), False, "", True)]
    return []


def _renamed(
    data: dict[str, Any], found: list[Fault], lines: TomlLines
) -> tuple[dict[str, Any], bool]:
    """The data with misspelt fields under the names that were meant, and other unknown ones left out; whether any."""
    data, changed = copy.deepcopy(data), False
    for one in found:
        if one.unknown:
            changed = True
            value = _table(data, one.loc[:-1]).pop(one.loc[-1])
            meant = (
                one.meant or key_of_term(_field(one.loc), fields_of(Camera)) or _beside(one.loc)
            )
            *path, last = meant.split(".") if meant else [""]
            if meant:
                table = _table(data, tuple(path))
            else:
                table = None
            if isinstance(table, dict) and last not in table:
                table[last] = value
                lines.rename(one.loc, (*path, last))
    return data, changed


def _beside(loc: Loc) -> str | None:
    """The field of the same table whose name is very close."""
    table = "".join(f"{part}." for part in loc[:-1])
    names = [name.removeprefix(table) for name in fields_of(Camera) if name.startswith(table)]
    name = closest(str(loc[-1]), (name for name in names if "." not in name), cutoff=0.75)
    return name and f"{table}{name}"


def _table(data: Any, path: Loc) -> Any:
    """The table at a path, made where a table of this name is meant and not there."""
    for part in path:
        if isinstance(data, dict):
            data = data.setdefault(part, {})
        else:
            data = data[
                int(part)
            ]  # of a list, counted from 0; a path that was split has it as text
    return data


def _field(loc: Loc) -> str:
    return ".".join(map(str, loc))


KeyPath: TypeAlias = tuple[str | int, ...]


class TomlLines:
    """Where the tables and keys of a valid TOML text stand: the number of the first line of each, from 1."""

    def __init__(self, text: str) -> None:
        self._lines: dict[KeyPath, int] = {}
        self._lengths: dict[KeyPath, int] = {}  # of the lists of tables
        table: KeyPath = ()
        for number, statement in _statements(text):
            paths = list(_paths(toml_tables(statement)))
            if statement.lstrip().startswith("["):
                table = self._header(paths[-1], of_list=statement.lstrip().startswith("[["))
                paths = [()]
            for path in paths:
                for end in range(len(table) + len(path)):
                    self._lines.setdefault((*table, *path)[: end + 1], number)

    def __call__(self, path: KeyPath) -> int | None:
        """The line of a key, or of the innermost table or list around it that has one."""
        return next(
            (
                self._lines[path[:end]]
                for end in range(len(path), 0, -1)
                if path[:end] in self._lines
            ),
            None,
        )

    def rename(self, old: KeyPath, new: KeyPath) -> None:
        """Find what has one name under another one too."""
        for path, number in list(self._lines.items()):
            if path[: len(old)] == old:
                self._lines[(*new, *path[len(old) :])] = number

    def _header(self, keys: KeyPath, of_list: bool) -> KeyPath:
        """The path of the table that a header begins; one of a list has its number behind the list's name."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if of_list and len(path) - sum(isinstance(x, int) for x in path) == len(keys):
                self._lengths[path] = self._lengths.get(path, 0) + 1
            if path in self._lengths:
                path = (*path, self._lengths[path] - 1)
        return path


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Headers and assignments, each with the number of its first line; one goes on while a bracket is open."""
    start, first, number, open_brackets = 0, 1, 1, 0
    position = 0
    for line in without_strings(text).split(
        "\n"
    ):  # a string of several lines is in one of these
        end = position + len(line)
        number += text.count("\n", position, end) + 1
        open_brackets += sum(map(line.count, "[{")) - sum(map(line.count, "]}"))
        position = end + 1
        if open_brackets:
            continue
        if line.strip():
            yield first, text[start:end]
        start, first = position, number


def _paths(data: dict[str, Any], path: KeyPath = ()) -> Iterator[KeyPath]:
    """The keys of nested tables, each behind the tables around it."""
    for key, value in data.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _paths(value, (*path, key))
