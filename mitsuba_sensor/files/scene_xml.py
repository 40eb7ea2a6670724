"""Elements of a Mitsuba scene file that name files, parsed by the standard library; limits of size and depth."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ..core import InputError, nearest_file
from ..core.small_files import require_small
from .shipped_scenes import SCENE, names_of_scenes

SCENE_BYTES_MAX = 2**27
DEPTH_MAX = 24  # each `twosided` in another one doubles the memory
INCLUDE_DEPTH_MAX = 15  # as in Mitsuba
INCLUDES_MAX = 1000
ADDED_CHARACTERS_MAX = 2**22  # characters that parameters may add to the texts of a scene
LONGEST_NAME = 255  # characters of a file name in most file systems


class Element(NamedTuple):
    """An element that may name a file.

    kind : default, include, path, file, text or type.  name : name of a default or text.
    value : value before its parameters are replaced.  line : line in the file.
    """

    kind: str
    name: str
    value: str
    line: int


class Expansion:
    """The parameters of a scene, and the number of characters that they may still add.

    A parameter that names another one twice doubles its length, so lengths are counted before a text is replaced.
    used : names of the parameters that were replaced.
    """

    def __init__(self, values: Mapping[str, str]) -> None:
        self.values, self._left, self._files = dict(values), ADDED_CHARACTERS_MAX, 0
        self.used = set[str]()

    def include(self, file: Path, depth: int) -> None:
        """Count an included file. Raises InputError if there are too many, or if they are nested too deeply."""
        self._files += 1
        if depth > INCLUDE_DEPTH_MAX or self._files > INCLUDES_MAX:
            raise InputError(
                f"{file} exceeds {INCLUDES_MAX} included files or {INCLUDE_DEPTH_MAX} levels; flatten the scene."
            )

    def put_in(self, value: str, where: str) -> str:
        """Return a text with its parameters replaced, longer names first, as in Mitsuba."""
        if "$" not in value:
            return value
        for name in sorted(self.values, key=lambda name: (-len(name), name)):
            if not (times := value.count(f"${name}")):
                continue
            self.used.add(name)
            self._left -= max(times * (len(self.values[name]) - len(name) - 1), 0)
            if self._left < 0:
                raise InputError(
                    f"{where}: parameters add more than {ADDED_CHARACTERS_MAX} characters to the scene; give each "
                    "parameter a plain value, which names no other parameter."
                )
            value = value.replace(f"${name}", self.values[name])
        return value


def elements_of(path: Path) -> tuple[Element, ...]:
    """Return the elements of a scene file. Raises InputError for invalid, large or deep XML, and for entities."""
    require_small(path, "the scene file", SCENE_BYTES_MAX)
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"the scene file {path} is not UTF-8 text; save it in UTF-8."
        ) from None
    elements = list[Element]()
    _parse(text, path, lambda *tag: elements.extend(_of_tag(*tag)), strict=True)
    return tuple(elements)


def require_scene_file(name: str) -> None:
    """Raise InputError for a missing or too large file, and for a name that Mitsuba cannot open."""
    path = Path(name)
    if not os.path.isfile(name):
        what = f"there is no file {name!r}"
        if os.path.exists(name):
            what = f"{name!r} is a folder or a special file"
        elif near := nearest_file(name, SCENE):
            raise InputError(f"{what}.{near}")
        raise InputError(
            f"{what}; give the path of a Mitsuba 3 scene in XML, or {names_of_scenes(name)}"
        )
    try:
        str(path.absolute()).encode()
    except UnicodeEncodeError:
        raise InputError(
            f"scene {name!r} has a path that is not UTF-8, which Mitsuba cannot open; rename it."
        ) from None
    require_small(path, "the scene file", SCENE_BYTES_MAX)


def require_bounded(
    text: str, path: Path, values: Mapping[str, str], resolve: Callable[[str], str]
) -> None:
    """Raise InputError for a scene that is nested too deeply, or that parameters and includes make too large.

    values : values of the given parameters.  resolve : function that finds an included file as Mitsuba does.
    """
    expansion, folders = Expansion(values), [path.resolve().parent]

    def follow(text: str, file: Path, depth: int) -> None:
        expansion.include(file, depth)
        has_parameters = "$" in text

        def tell(tag: str, attributes: Mapping[str, str], line: int) -> None:
            if has_parameters:
                where = f"{file}, line {line}"
                attributes = {
                    name: expansion.put_in(x, where) for name, x in attributes.items()
                }
            if tag == "default":
                name, value = attributes.get("name", ""), attributes.get("value", "")
                expansion.values.setdefault(name, value)
            elif tag == "path":
                folders.append(folders[0] / attributes.get("value", ""))
            elif tag == "include":
                name = attributes.get("filename", "")
                places = [Path(resolve(name)), *(folder / name for folder in folders)]
                inner = next((place for place in places if place.is_file()), None)
                if inner is not None:  # else Mitsuba reports it
                    require_small(inner, "the scene file", SCENE_BYTES_MAX)
                    follow(inner.read_text("utf-8", "replace"), inner, depth + 1)

        _parse(text, file, tell, strict=False)

    follow(text, path, 0)


def _parse(
    text: str, path: Path, tell: Callable[[str, Mapping[str, str], int], None], strict: bool
) -> None:
    """Call ``tell`` for every element.  strict : raise InputError for invalid XML."""
    parser, depth = expat.ParserCreate("utf-8"), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH_MAX:
            line = parser.CurrentLineNumber
            raise InputError(
                f"{path}, line {line}: elements are nested more than {DEPTH_MAX} deep; flatten the scene."
            )
        tell(tag, attributes, parser.CurrentLineNumber)

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def document_type(*_: object) -> None:
        raise InputError(
            f"{path} has a <!DOCTYPE>, which Mitsuba rejects; remove it and its entities."
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(text.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        if strict:
            raise InputError(f"{path} is not valid XML: {error}; correct it.") from None


def _of_tag(tag: str, attributes: Mapping[str, str], line: int) -> list[Element]:
    """Return what one XML element says about files."""
    name, value = attributes.get("name", ""), attributes.get("value", "")
    if tag == "default":
        return [Element("default", name, value, line)]
    if tag == "include":
        return [Element("include", "", attributes.get("filename", ""), line)]
    if tag == "path":
        return [Element("path", "", value, line)]
    elements = list[Element]()
    if "filename" in attributes:
        elements.append(Element("file", "", attributes["filename"], line))
    if tag == "string" and value:
        if name == "filename":
            elements.append(Element("file", name, value, line))
        elif len(value) <= LONGEST_NAME and "\n" not in value:
            elements.append(Element("text", name, value, line))
    if "type" in attributes:
        elements.append(Element("type", "", attributes["type"], line))
    return elements
