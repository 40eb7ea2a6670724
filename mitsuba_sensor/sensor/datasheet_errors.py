"""One sentence from a failed check of a camera file: file, field, value, range, and the way out."""

from __future__ import annotations

import types
from functools import cache
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from ..core.errors import nearest

PLAIN = {"model_type": "a table", "dict_type": "a table", "tuple_type": "a list", "string_type": "a text in quotes"}
"""Pydantic's kinds of error → what a camera file calls the thing that was expected."""


@cache
def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Every field of a model and of the tables below it, by dotted name."""
    found = {}
    for name, info in model.model_fields.items():
        found[name] = info
        for kind in _kinds(info.annotation):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                found |= {f"{name}.{below}": x for below, x in fields_of(kind).items()}
    return found


def _kinds(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def sentence(error: ValidationError, model: type[BaseModel], where: str) -> str:
    """The first thing that is wrong, in one sentence."""
    first = error.errors(include_url=False)[0]
    known = fields_of(model)
    path = ".".join(str(part) for part in first["loc"])
    field = _field(path, known)
    kind, value = first["type"], first["input"]
    if kind == "extra_forbidden":
        return f"{where}: {path} is not a field of a camera file.{nearest(path, known)}"
    if kind == "missing":
        return f"{where}: {path} is missing; {_way_out(path, field)}"
    if kind == "value_error":
        return f"{where}: {path or 'the camera'}: {first['ctx']['error']}."
    rule = PLAIN.get(kind) or first["msg"].removeprefix("Input should be ").removeprefix("Input ")
    if kind == "too_short":
        rule = f"at least {first['ctx']['min_length']} long"
    return f"{where}: {path} is {_short(value)}; it must be {rule} ({_way_out(path, field)[:-1]})."


def _field(path: str, known: dict[str, FieldInfo]) -> FieldInfo | None:
    """The named field, or the one that an index inside its value belongs to."""
    while path and path not in known:
        path = path.rpartition(".")[0]
    return known.get(path)


def _way_out(path: str, field: FieldInfo | None) -> str:
    if field is None or not field.description:
        return f"add the table [{path}]."
    example = f", e.g. {field.examples[0]!r}" if field.examples else ""
    return f"{field.description}{example}."


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
