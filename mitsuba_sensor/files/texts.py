"""Small text files: readers of text, JSON, TOML and XML, and writers of text, strict JSON and YAML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from ..core import InputError, nearest_file
from ..core.printable import printable_json
from ..core.small_files import DEPTH_MAX, json_value, require_small, toml_tables
from .appearing import write_drawing

Facts: TypeAlias = dict[str, Any]
XML_CHARACTERS_MAX = 2**23  # three characters may be an element, which takes 100 bytes


def text_of_file(
    path: Path, remedy: str, most_bytes: int = 2**30, newline: str | None = None
) -> str:
    """Return the text of a file. Raises InputError with the remedy for an unreadable or larger file.

    newline : "" keeps the ends of lines unchanged, as in open.
    """
    try:
        require_small(path, "the file", most_bytes)
        with path.open(encoding="utf-8", newline=newline) as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not UTF-8 text"
        near = (
            nearest_file(str(path), path.suffix) if isinstance(error, FileNotFoundError) else ""
        )
        raise InputError(f"{path} cannot be read: {why}; {remedy}.{near}") from None


def read_json(path: Path, remedy: str) -> Facts:
    """Return the object in a JSON file. Raises InputError with the remedy."""
    return json_object(text_of_file(path, remedy), str(path), remedy)


def json_object(text: str | bytes, place: str, remedy: str) -> Facts:
    """Return the object in a JSON text. Raises InputError with the remedy.  place : name of the text for messages."""
    try:
        value = json_value(text)
    except ValueError:
        value = None
    if not isinstance(value, dict):
        raise InputError(f"{place} is not a JSON object; {remedy}.")
    return value


def xml_tree(text: str, file: str, remedy: str) -> ElementTree.Element:
    """Return the root of an XML text. Raises InputError with the remedy, also for entities, which expand to any size.

    file : name for messages.
    """
    if len(text) > XML_CHARACTERS_MAX:
        raise InputError(
            f"{file} has {len(text)} characters; XML may have {XML_CHARACTERS_MAX} at most. {remedy}."
        )
    parser = ElementTree.XMLParser(target=_ShallowTree(file))
    try:
        parser.feed(text)
        root: ElementTree.Element = parser.close()
    except ElementTree.ParseError as error:
        raise InputError(f"{file} is not valid XML: {error}. {remedy}.") from None
    return root


class _ShallowTree(ElementTree.TreeBuilder):
    """Builder of a tree without document type and deep nesting.  file : name for messages."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self._file, self._depth = file, 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ElementTree.Element:
        """Start an element."""
        self._depth += 1
        if self._depth > DEPTH_MAX:
            raise InputError(
                f"{self._file}: its elements are nested more than {DEPTH_MAX} deep."
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_: object) -> None:
        """Reject a document type, which is the only place of entities."""
        raise InputError(f"{self._file} has a <!DOCTYPE>; remove it and its entities.")


def write_page(path: Path, text: str) -> None:
    """Write text in UTF-8, e.g. an HTML page."""
    write_drawing(path, text.encode())


def write_json(path: Path, report: dict[str, Any]) -> None:
    """Write a report as strict JSON; see :func:`to_json`."""
    write_page(path, to_json(report) + "\n")


def to_json(report: Any) -> str:
    """Return indented strict JSON; NumPy values become plain values, and NaN and ±inf become null."""
    return printable_json(
        json.dumps(plain_values(report), indent=2, ensure_ascii=False, allow_nan=False)
    )


def short_json(report: object) -> str:
    """Return the same JSON without indents, in a quarter of the time."""
    try:
        text = json.dumps(report, ensure_ascii=False, allow_nan=False, default=_plain_value)
    except ValueError:  # NaN or infinity
        text = json.dumps(plain_values(report), ensure_ascii=False, allow_nan=False)
    return printable_json(text)


def _plain_value(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray | Path):
        return plain_values(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


def yaml_text(values: Mapping[str, object]) -> str:
    """Return plain values as YAML 1.1, each list on one line with its texts in quotes, as OpenCV requires; an array
    (rows, columns) becomes a matrix of OpenCV."""
    import yaml

    class Dumper(yaml.SafeDumper):  # type: ignore[misc]
        def ignore_aliases(self, data: object) -> bool:
            return True

    def matrix(dumper: Any, array: np.ndarray) -> Any:
        rows, columns = array.shape
        entries = {"rows": rows, "cols": columns, "dt": "d", "data": array.ravel().tolist()}
        return dumper.represent_mapping("tag:yaml.org,2002:opencv-matrix", entries)

    def sequence(dumper: Any, items: list[object]) -> Any:
        node = dumper.represent_list(items)
        for item in node.value:
            if item.tag == "tag:yaml.org,2002:str":
                item.style = '"'
        return node

    Dumper.add_representer(np.ndarray, matrix)
    Dumper.add_representer(list, sequence)
    text = yaml.dump(
        dict(values),
        Dumper=Dumper,
        width=1e9,
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
    )
    return str(text)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file. Raises OSError, UnicodeDecodeError or TOMLDecodeError."""
    require_small(path, "the file")
    return toml_tables(path.read_text("utf-8"))


def plain_values(value: Any, finite: bool = True) -> Any:
    """Return ``value`` in the six types of JSON; if ``finite``, NaN and ±inf become null."""
    if isinstance(value, dict):
        return {str(key): plain_values(item, finite) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain_values(item, finite) for item in value]
    if isinstance(value, np.generic):
        return plain_values(value.item(), finite)
    if isinstance(value, float):
        return value if np.isfinite(value) or not finite else None
    return str(value) if isinstance(value, Path) else value
