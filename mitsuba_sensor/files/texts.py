"""Small text files: reads text, JSON, TOML and XML, and writes text and strict JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from ..core import InputError
from ..core.printable import printable_json
from ..core.small_files import DEPTH_MAX, json_value, require_small, toml_tables
from .appearing import write_drawing

Facts: TypeAlias = dict[str, Any]
MOST_XML = 2**23  # characters; each may be a third of an element, which takes 100 bytes


def text_of_file(
    path: Path, remedy: str, most_bytes: int = 2**30, newline: str | None = None
) -> str:
    """The text of a file. Raises InputError with the remedy where it cannot be read, or has more bytes.

    newline : an empty text keeps the ends of lines as they are, as in open.
    """
    try:
        require_small(path, "the file", most_bytes)
        with path.open(encoding="utf-8", newline=newline) as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise InputError(f"{path} cannot be read: {why}; {remedy}.") from None


def read_json(path: Path, remedy: str) -> Facts:
    """The object in a JSON file. Raises InputError with the remedy."""
    return json_object(text_of_file(path, remedy), str(path), remedy)


def json_object(text: str | bytes, place: str, remedy: str) -> Facts:
    """The object in a JSON text. Raises InputError with the remedy.  place : of the text, for the message."""
    try:
        found = json_value(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise InputError(f"{place} holds no JSON object; {remedy}.")
    return found


def xml_tree(text: str, file: str, remedy: str) -> ElementTree.Element:
    """The root of an XML text. Raises InputError with the remedy; also for entities, which may expand to any size.

    file : for messages.
    """
    if len(text) > MOST_XML:
        raise InputError(
            f"{file} has {len(text)} characters; XML may have {MOST_XML} at most. {remedy}."
        )
    parser = ElementTree.XMLParser(target=_ShallowTree(file))
    try:
        parser.feed(text)
        root: ElementTree.Element = parser.close()
    except ElementTree.ParseError as error:
        raise InputError(f"{file} is no XML: {error}. {remedy}.") from None
    return root


class _ShallowTree(ElementTree.TreeBuilder):
    """Builds a tree that has no document type and is not deep.  file : for messages."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self._file, self._depth = file, 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ElementTree.Element:
        """An element begins."""
        self._depth += 1
        if self._depth > DEPTH_MAX:
            raise InputError(
                f"{self._file}: its elements are nested more than {DEPTH_MAX} deep."
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        """An element ends."""
        self._depth -= 1
        return super().end(tag)

    def doctype(self, *_: object) -> None:
        """A document type begins, the only place of entities."""
        raise InputError(f"{self._file} has a <!DOCTYPE>; remove it and its entities.")


def write_page(path: Path, text: str) -> None:
    """Text in UTF-8, an HTML page for example."""
    write_drawing(path, text.encode())


def write_json(path: Path, report: dict[str, Any]) -> None:
    """A report as strict JSON (see :func:`to_json`)."""
    write_page(path, to_json(report) + "\n")


def to_json(report: Any) -> str:
    """Indented strict JSON: NumPy values become plain ones, NaN and ±inf, which JSON does not have, become null."""
    return printable_json(
        json.dumps(plain_values(report), indent=2, ensure_ascii=False, allow_nan=False)
    )


def short_json(report: object) -> str:
    """The same without indents, which takes a quarter of the time."""
    try:
        text = json.dumps(report, ensure_ascii=False, allow_nan=False, default=_plain_value)
    except ValueError:  # NaN or infinity
        text = json.dumps(plain_values(report), ensure_ascii=False, allow_nan=False)
    return printable_json(text)


def _plain_value(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray | Path):
        return plain_values(value)
    raise TypeError(f"{type(value).__name__} is no value of JSON")


def yaml_text(values: Mapping[str, object]) -> str:
    """Plain values as YAML 1.1, each list on one line with its texts in quotes, as OpenCV needs them; an array (rows,
    columns) is a matrix of OpenCV."""
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
    form: dict[str, Any] = {
        "sort_keys": False,
        "default_flow_style": None,
        "allow_unicode": True,
    }
    return str(yaml.dump(dict(values), Dumper=Dumper, width=1e9, **form))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises OSError, UnicodeDecodeError or TOMLDecodeError."""
    require_small(path, "the file")
    return toml_tables(path.read_text("utf-8"))


def plain_values(value: Any, finite: bool = True) -> Any:
    """``value`` in the six types of JSON; NaN and ±inf are null where they must be ``finite``."""
    if isinstance(value, dict):
        return {str(key): plain_values(item, finite) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain_values(item, finite) for item in value]
    if isinstance(value, np.generic):
        return plain_values(value.item(), finite)
    if isinstance(value, float):
        if np.isfinite(value) or not finite:
            return value
        return None
    if isinstance(value, Path):
        return str(value)
    return value
