"""Sentences from a failed check of a camera or motion file: field, value, allowed range, meaning and example."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeAlias, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..core.errors import shown
from ..core.number_text import number_hint
from ..stages.usual_range import Usual
from .field_terms import MEANT, key_meant, proposal

Loc: TypeAlias = tuple[str | int, ...]

KEY = "[key]"  # where pydantic's errors name a key of a table instead of its value
NUMBER_TYPES = ("float_type", "int_type")
EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "model_type": "a table",
    "dict_type": "a table",
    "tuple_type": "a list",
}
"""Pydantic's kinds of error → what a file calls the expected value."""

LIMITS = {
    "ge": "at least {}",
    "gt": "above {}",
    "le": "at most {}",
    "lt": "below {}",
    "min_length": "at least {} long",
    "max_length": "at most {} long",
}
"""Limits in the context of pydantic's errors, as text."""


def inner_table(annotation: Any) -> tuple[type[BaseModel] | None, Any]:
    """Return the table inside an annotation, and tuple or dict if there are several of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, None
    for part in get_args(annotation):
        table, container = inner_table(part)
        if table:
            origin = get_origin(annotation)
            return table, origin if origin in (tuple, dict) else container
    return None, None


@cache
def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return every field of a model and of the tables below it, by dotted name."""
    fields = {}
    for name, info in model.model_fields.items():
        fields[name] = info
        table, container = inner_table(info.annotation)
        if table and not container:
            fields |= {f"{name}.{below}": x for below, x in fields_of(table).items()}
    return fields


class Fault(NamedTuple):
    """One error.  loc : its place in the file.  kind : pydantic's name of the error."""

    loc: Loc
    text: str
    kind: str


def faults(error: ValidationError, model: type[BaseModel], kind: str = "camera") -> list[Fault]:
    """Return all errors; an unknown field in place of a missing one counts once.  kind : of the file."""
    found = [
        (tuple(part for part in one["loc"] if part != KEY), one["type"], one)
        for one in error.errors(include_url=False)
    ]
    missing = {dotted(loc) for loc, what, _ in found if what == "missing"}
    meant = {
        loc: _meant(loc, one["input"], model, missing)
        for loc, what, one in found
        if what == "extra_forbidden"
    }
    return [
        Fault(loc, _text(loc, one, model, kind, meant.get(loc)), what)
        for loc, what, one in found
        if what != "missing" or dotted(loc) not in meant.values()
    ]


def sentence(
    error: ValidationError, model: type[BaseModel], where: str, kind: str = "camera"
) -> str:
    """Return the first error as one sentence.  kind : of the file."""
    return f"{where}: {faults(error, model, kind)[0].text}"


def dotted(loc: Loc) -> str:
    """Return the place of a value as one name."""
    return ".".join(map(str, loc))


def _meant(loc: Loc, value: object, model: type[BaseModel], missing: set[str]) -> str | None:
    """Return the field that an unknown one probably means, first among the missing ones; for an unknown table, the
    field that one of its keys means."""
    path = dotted(loc)
    _, table = _declared(loc, model)
    known = [*fields_of(model), *(dotted((*loc[:-1], name)) for name in table.model_fields)]
    names = [path]
    if isinstance(value, Mapping):
        names += [f"{path}.{key}" for key in value]
    meant = (key_meant(name, keys) for name in names for keys in (missing, known))
    return next(filter(None, meant), None)


def _text(
    loc: Loc, one: ErrorDetails, model: type[BaseModel], kind: str, meant: str | None
) -> str:
    """Return the sentence of an error.  meant : the field that an unknown one means."""
    path, what, value = dotted(loc), one["type"], one["input"]
    if what == "extra_forbidden":
        return f"{path} is not a field of a {kind} file.{proposal(path, meant)}"
    if what == "value_error":
        said = str(one["ctx"]["error"]).removesuffix(".")
        return f"{path or f'the {kind}'}: {said}{'' if said.endswith('?') else '.'}"
    field, _ = _declared(loc, model)
    about = f"add the table [{path}]"
    if field and field.description:
        example = f", e.g. {field.examples[0]!r}" if field.examples else ""
        about = f"{field.description}{example}"
    if what == "missing":
        return f"{path} is missing; {about}."
    rule = re.sub(r"^\w+ should ", "", one["msg"])
    if what in EXPECTED:
        rule = f"be {EXPECTED[what]}"
    for name, limit in one.get("ctx", {}).items():
        if name in LIMITS and limit is not None:
            rule = f"be {LIMITS[name].format(f'{limit:.10g}')}"
    hint = ""
    if what in NUMBER_TYPES:
        limits = {
            LIMITS[name]: getattr(rule_of_field, name)
            for rule_of_field in (field.metadata if field else ())
            for name in LIMITS
            if hasattr(rule_of_field, name) and not name.endswith("_length")
        }
        rule += "".join(f", {text.format(f'{limit:.10g}')}" for text, limit in limits.items())
        hint = number_hint(path, value)
    elif field and (usual := usual_of(field)):
        hint = next((usual.right(number) for number in _numbers(value)), "")
    text = f"{path} is {shown(value)[:60]}; it must {rule} ({about}{hint and f'; {hint}'})."
    if what not in NUMBER_TYPES and path in MEANT:
        text += proposal(path, MEANT[path])
    return text


def _declared(loc: Loc, model: type[BaseModel]) -> tuple[FieldInfo | None, type[BaseModel]]:
    """Return the last declared field on the way to a value, and the innermost table around the value."""
    field, table, parts = None, model, iter(loc)
    for part in parts:
        if part not in table.model_fields:
            break
        field = table.model_fields[str(part)]
        inner, container = inner_table(field.annotation)
        if inner is None:
            break
        table = inner
        if container:
            next(parts, None)  # the index in a list, or a name that the file chooses
    return field, table


def doubts(data: Mapping[str, Any], model: type[BaseModel]) -> list[tuple[str, str]]:
    """Return field and sentence for every number of a file that is outside its usual range."""
    found = []
    for name, field in fields_of(model).items():
        usual, value = usual_of(field), _value_at(data, name)
        unusual = next((x for x in _numbers(value) if usual and not usual.includes(x)), None)
        if usual and unusual is not None:
            verb = "is" if isinstance(value, int | float) else "has"
            found.append((name, usual.doubt(name, unusual, verb)))
    return found


def _value_at(data: object, name: str) -> object:
    """Return the value of a field, None if it is not set."""
    for part in name.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _numbers(value: object) -> Iterator[float]:
    """Yield the numbers in a value, which may be a list or a table, that a float can hold."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for one in value:
            yield from _numbers(one)
    elif type(value) in (int, float) and abs(value) <= sys.float_info.max:  # type: ignore[arg-type]
        yield value  # type: ignore[misc]


def usual_of(field: FieldInfo) -> Usual | None:
    """Return the usual range of a number of a camera file, if it is declared."""
    return next((one for one in field.metadata if isinstance(one, Usual)), None)
