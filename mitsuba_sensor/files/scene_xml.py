"""Elements of a Mitsuba scene file that say which files it reads, found by the XML parser of the standard library."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ..core import InputError
from ..core.small_files import require_small
from .shipped_scenes import names_of_scenes

MOST_BYTES = 2**27  # of a scene file
DEEPEST = 24  # elements inside of one another: each `twosided` in another doubles the memory
DEEPEST_INCLUDE = 15  # as in Mitsuba
MOST_INCLUDED = 1000  # files, each as often as it is included
MOST_ADDED = 2**22  # characters by which parameters may make the texts of a scene longer
LONGEST_NAME = 255  # of a file, in most file systems


class Element(NamedTuple):
    """What matters of an element.  kind : default, include, path, file, text or type.  name : of a default.
    value : with its parameters not yet put in.  line : in the file."""

    kind: str
    name: str
    value: str
    line: int


class Expansion:
    """The parameters of a scene, and how much longer they may still make its texts.

    A parameter whose value names another one twice doubles it, so lengths are counted before anything is put in.
    used : names of those that were put in.
    """

    def __init__(self, values: Mapping[str, str]) -> None:
        self.values, self._left, self._files = dict(values), MOST_ADDED, 0
        self.used = set[str]()

    def include(self, file: Path, depth: int) -> None:
        """Count one more file. Raises InputError for too many, or too deep, ones."""
        self._files += 1
        if depth > DEEPEST_INCLUDE or self._files > MOST_INCLUDED:
            raise InputError(
                f"{file} is included more than {DEEPEST_INCLUDE} deep, or more than {MOST_INCLUDED} times with other "
                "files; flatten the scene."
            )

    def put_in(self, value: str, where: str) -> str:
        """Return a text with the parameters in place: longer names first, as Mitsuba puts them in."""
        if "$" not in value:
            return value
        for name in sorted(self.values, key=lambda name: (-len(name), name)):
            if not (times := value.count(f"${name}")):
                continue
            self.used.add(name)
            self._left -= max(times * (len(self.values[name]) - len(name) - 1), 0)
            if self._left < 0:
                raise InputError(
                    f"{where}: parameters make the texts of the scene more than {MOST_ADDED} characters longer; "
                    "give each parameter a plain value, which names no other parameter."
                )
            value = value.replace(f"${name}", self.values[name])
        return value


def elements_of(path: Path) -> tuple[Element, ...]:
    """Of a scene file, in its order. Raises InputError for what is no XML, too large, too deep, or has entities."""
    require_small(path, "the scene file", MOST_BYTES)
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"the scene file {path} is not UTF-8 text; save it in UTF-8."
        ) from None
    found: list[Element] = []
    _parse(
        text,
        path,
        lambda tag, attributes, line: found.extend(_of_tag(tag, attributes, line)),
        strict=True,
    )
    return tuple(found)


def require_scene_file(name: str) -> None:
    """Raise InputError where there is no such file, a larger one, or one whose name Mitsuba cannot take."""
    path = Path(name)
    if not os.path.isfile(name):
        what = f"there is no file {name!r}"
        if os.path.exists(name):
            what = f"{name!r} is a folder, or no plain file"
        raise InputError(
            f"{what}; give the path of a Mitsuba 3 scene in XML, or {names_of_scenes(name)}"
        )
    try:
        str(path.absolute()).encode()
    except UnicodeEncodeError:
        way_out = "Mitsuba opens no such file; rename it"
        raise InputError(
            f"scene {name!r} has a name, or a folder, that is not UTF-8; {way_out}."
        ) from None
    require_small(path, "the scene file", MOST_BYTES)


def require_bounded(
    text: str, path: Path, values: Mapping[str, str], resolve: Callable[[str], str]
) -> None:
    """Raise InputError for a scene that is nested too deep, or becomes too large by its parameters and includes.

    values : of the parameters that are given.  resolve : finds an included file, as Mitsuba does.
    """
    expansion, folders = Expansion(values), [path.resolve().parent]

    def follow(text: str, file: Path, depth: int) -> None:
        expansion.include(file, depth)
        has_parameters = "$" in text

        def tell(tag: str, attributes: Mapping[str, str], line: int) -> None:
            put_in = attributes
            if has_parameters:
                where = f"{file}, line {line}"
                put_in = {name: expansion.put_in(x, where) for name, x in attributes.items()}
            if tag == "default":
                expansion.values.setdefault(put_in.get("name", ""), put_in.get("value", ""))
            elif tag == "path":
                folders.append(folders[0] / put_in.get("value", ""))
            elif tag == "include":
                name = put_in.get("filename", "")
                places = [Path(resolve(name)), *(folder / name for folder in folders)]
                inner = next((place for place in places if place.is_file()), None)
                if inner is not None:  # else Mitsuba says so
                    require_small(inner, "the scene file", MOST_BYTES)
                    follow(
                        inner.read_text(encoding="utf-8", errors="replace"), inner, depth + 1
                    )

        _parse(text, file, tell, strict=False)

    follow(text, path, 0)


def _parse(
    text: str, path: Path, tell: Callable[[str, Mapping[str, str], int], None], strict: bool
) -> None:
    """Call ``tell`` for every element.  strict : whether what is no XML raises InputError."""
    parser, depth = expat.ParserCreate("utf-8"), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            line = parser.CurrentLineNumber
            raise InputError(
                f"{path}, line {line}: elements are nested more than {DEEPEST} deep; flatten the scene."
            )
        tell(tag, attributes, parser.CurrentLineNumber)

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def document_type(*_: object) -> None:
        raise InputError(
            f"{path} has a <!DOCTYPE>, which Mitsuba does not read; remove it and its entities."
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(text.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        if strict:
            raise InputError(f"{path} is no valid XML: {error}; correct it.") from None


def _of_tag(tag: str, attributes: Mapping[str, str], line: int) -> list[Element]:
    """What matters of one element."""
    value, named = attributes.get("value", ""), attributes.get("filename")
    if tag == "default":
        return [Element("default", attributes.get("name", ""), value, line)]
    if tag == "include":
        return [Element("include", "", named or "", line)]
    if tag == "path":
        return [Element("path", "", value, line)]
    if named is None:
        found = []
    else:
        found = [Element("file", "", named, line)]
    if tag == "string" and value:
        kind = "text"
        if attributes.get("name") == "filename":
            kind = "file"
        short = kind == "file" or (len(value) <= LONGEST_NAME and "\n" not in value)
        found += [Element(kind, attributes.get("name", ""), value, line)] if short else []
    if "type" in attributes:
        found.append(Element("type", "", attributes["type"], line))
    return found
