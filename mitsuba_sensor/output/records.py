"""Values of Python as an .npz of JSON and arrays of numbers, and back.

Reading one runs no code of the file's author. Dataclasses and named tuples keep the name of their
class; only classes that the reader lists, and those that the types of their fields name, are made.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np

from ..files.npz import read_arrays
from ..sensor.camera import Camera
from ..sensor.camera_file import camera_from

TEXT = "json"  # name of the array that holds the JSON; the others are named by their number
Classes = Mapping[str, type]


def classes_of(*roots: type) -> dict[str, type]:
    """These classes, and all dataclasses and named tuples in the types of their fields, by name."""
    classes: dict[str, type] = {}
    waiting = list[object](roots)
    while waiting:
        kind = waiting.pop()
        waiting += get_args(kind)
        if isinstance(kind, type) and (kind in roots or _has_fields(kind)) and _name(kind) not in classes:
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
    """What :func:`write_value` wrote. Raises InputError, OSError or ValueError for anything else.

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
            return {"array" if isinstance(value, np.ndarray) else "scalar": len(arrays) - 1}
        case None | bool() | int() | float() | str():
            return value
        case list():
            return [_plain(item, arrays) for item in value]
        case Mapping():
            return {"dict": [[_plain(key, arrays), _plain(x, arrays)] for key, x in value.items()]}
        case Camera():
            return {"camera": _plain(value.model_dump(), arrays)}
        case tuple() if not hasattr(value, "_fields"):
            return {"tuple": [_plain(item, arrays) for item in value]}
    fields = {name: _plain(x, arrays) for name, x in _fields(value).items()}
    return {"class": [_name(type(value)), fields]}


def _value(plain: object, arrays: Mapping[str, np.ndarray], classes: Classes) -> object:
    """The value that :func:`_plain` made this of."""
    if isinstance(plain, list):
        return [_value(item, arrays, classes) for item in plain]
    if not isinstance(plain, dict):
        return plain
    ((kind, content),) = plain.items()
    match kind:
        case "array":
            return arrays[str(content)]
        case "scalar":
            return arrays[str(content)][()]
        case "tuple":
            return tuple(_value(item, arrays, classes) for item in content)
        case "dict":
            return {_value(key, arrays, classes): _value(x, arrays, classes) for key, x in content}
        case "camera":
            tables = _value(content, arrays, classes)
            if isinstance(tables, dict):
                return camera_from(tables, "the measurement")
        case "class":
            name, fields = content
            return classes[name](**{key: _value(x, arrays, classes) for key, x in fields.items()})
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
    return dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
