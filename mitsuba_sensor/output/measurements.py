"""Measurements that outlive the process that made them: a file each, kept apart by all that decides their values."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from ..camera.camera import Camera
from ..camera.camera_file import camera_from
from ..core import InputError
from ..files.appearing import appearing
from ..files.disk_errors import disk_sentences
from ..files.durable import make_lasting
from ..files.npz import read_arrays
from ..files.texts import plain_values

TEXT = "json"  # name of the array that holds the JSON; the others are named by their number
Classes = Mapping[str, type]


class Measurements(dict[str, Any]):
    """A dict of measurements by name whose values are also files; a study that was stopped finds there what it had.

    folder : of the files; made with the first measurement.  force : forget what there is for this question.
    question : all that decides what is measured, as plain values. The files of each question lie in a folder of their
        own, so that measurements of another camera, scene, version or machine are never read.
    records : dataclasses and named tuples that measurements consist of; no other class is made from a file.
    """

    def __init__(
        self,
        folder: Path,
        question: object,
        force: bool = False,
        records: tuple[type, ...] = (),
    ) -> None:
        super().__init__()
        text = json.dumps(plain_values(question, finite=False), sort_keys=True)
        self.folder = folder / hashlib.sha256(text.encode()).hexdigest()[:16]
        if force:
            shutil.rmtree(self.folder, ignore_errors=True)
        classes = classes_of(*records)
        for path in sorted(self.folder.glob("*.npz")):
            # One that was cut short is measured again.
            with suppress(InputError, OSError, ValueError, TypeError):
                pair = read_value(path, classes)
                if isinstance(pair, tuple) and len(pair) == 2:
                    self.update([pair])

    def __setitem__(self, name: str, value: Any) -> None:
        super().__setitem__(name, value)
        with disk_sentences(self.folder):
            make_lasting(self.folder)
        file_name = f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.npz"
        with appearing(self.folder / file_name) as path:
            write_value(path, (name, value))


def classes_of(*roots: type) -> dict[str, type]:
    """These classes, and all dataclasses and named tuples in the types of their fields, by name."""
    classes: dict[str, type] = {}
    waiting = list[object](roots)
    while waiting:
        kind = waiting.pop()
        waiting += get_args(kind)
        if not isinstance(kind, type) or _name(kind) in classes:
            continue
        if kind in roots or _has_fields(kind):
            classes[_name(kind)] = kind
            waiting += get_type_hints(kind).values()
    return classes


def write_value(path: Path, value: object) -> None:
    """Write a value. Raises OSError, and TypeError for what has no place in JSON and arrays.

    value : None, numbers, texts, arrays of numbers, a Camera; lists, tuples and dicts of these, and
        dataclasses and named tuples whose fields are these.
    """
    arrays: list[np.ndarray] = []
    text = json.dumps(_plain(value, arrays))
    named = {str(number): array for number, array in enumerate(arrays)}
    content = np.frombuffer(text.encode(), np.uint8)
    with path.open("wb") as file:
        np.savez(file, **{TEXT: content, **named})  # type: ignore[arg-type]


def read_value(path: Path, classes: Classes) -> object:
    """The value that :func:`write_value` wrote. Raises InputError, OSError or ValueError for anything else.

    classes : that may be made, as :func:`classes_of` gives them.
    """
    arrays = read_arrays(path)
    try:
        return _value(json.loads(arrays[TEXT].tobytes()), arrays, classes)
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path} holds no measurement: {error}") from error


def _plain(value: object, arrays: list[np.ndarray]) -> object:
    """A value as JSON. A list is a list; everything else that holds others is a dict with one key."""
    match value:
        case np.ndarray() | np.generic():
            array = np.asarray(value)
            if array.dtype.hasobject:
                raise TypeError("an array of objects cannot be kept; keep numbers.")
            arrays.append(array)
            kind = "scalar"
            if isinstance(value, np.ndarray):
                kind = "array"
            return {kind: len(arrays) - 1}
        case None | bool() | int() | float() | str():
            return value
        case list():
            return [_plain(item, arrays) for item in value]
        case Mapping():
            pairs = [[_plain(key, arrays), _plain(x, arrays)] for key, x in value.items()]
            return {"dict": pairs}
        case Camera():
            return {"camera": _plain(value.model_dump(), arrays)}
        case tuple() if not hasattr(value, "_fields"):
            return {"tuple": [_plain(item, arrays) for item in value]}
    fields = {name: _plain(x, arrays) for name, x in _fields(value).items()}
    return {"class": [_name(type(value)), fields]}


def _value(plain: object, arrays: Mapping[str, np.ndarray], classes: Classes) -> object:
    """The value that :func:`_plain` made this of."""

    def inner(part: object) -> object:
        return _value(part, arrays, classes)

    if isinstance(plain, list):
        return [inner(item) for item in plain]
    if not isinstance(plain, dict):
        return plain
    ((kind, content),) = plain.items()
    match kind:
        case "array":
            return arrays[str(content)]
        case "scalar":
            return arrays[str(content)][()]
        case "tuple":
            return tuple(inner(item) for item in content)
        case "dict":
            return {inner(key): inner(x) for key, x in content}
        case "camera":
            tables = inner(content)
            if isinstance(tables, dict):
                return camera_from(tables, "the measurement")
        case "class":
            name, fields = content
            return classes[name](**{key: inner(x) for key, x in fields.items()})
    raise ValueError(f"a measurement has no {kind!r}")


def _fields(value: object) -> dict[str, object]:
    """The fields of a dataclass or named tuple, and none of an object without state."""
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return dict(value._asdict())
    if getattr(value, "__dict__", None) == {}:
        return {}
    raise TypeError(f"a value of type {type(value).__name__} cannot be kept.")


def _has_fields(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) or (
        issubclass(kind, tuple) and hasattr(kind, "_fields")
    )


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
