"""One sentence from a failed check of a camera or motion file: file, field, value, range, and the way out."""

import types
from functools import cache
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from ..core import nearest

# Pydantic's kinds of error → what such a file calls the thing that was expected.
PLAIN = {"model_type": "a table", "dict_type": "a table", "tuple_type": "a list", "string_type": "a text in quotes"}


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


def sentence(error: ValidationError, model: type[BaseModel], where: str, kind: str = "camera") -> str:
    """The first thing that is wrong, in one sentence.  kind : of the file."""
    first = error.errors(include_url=False)[0]
    path = ".".join(str(part) for part in first["loc"])
    field, names = _field(first["loc"], model)
    what, value = first["type"], repr(first["input"])
    if what == "extra_forbidden":
        return f"{where}: {path} is not a field of a {kind} file.{nearest(path, [*fields_of(model), *names])}"
    if what == "missing":
        return f"{where}: {path} is missing; {_way_out(path, field)}"
    if what == "value_error":
        return f"{where}: {path or f'the {kind}'}: {first['ctx']['error']}."
    rule = PLAIN.get(what) or first["msg"].removeprefix("Input should be ").removeprefix("Input ")
    if what in ("too_short", "too_long"):
        least, most = (first["ctx"].get(f"{end}_length") for end in ("min", "max"))
        rule = f"at most {most} long" if least is None else f"at least {least} long"
    value = value if len(value) <= 60 else value[:57] + "..."
    return f"{where}: {path} is {value}; it must be {rule} ({_way_out(path, field)[:-1]})."


def _field(loc: tuple[str | int, ...], model: type[BaseModel]) -> tuple[FieldInfo | None, list[str]]:
    """The last declared field on the way to a value, and the dotted names of the fields beside the value."""
    field, table, is_key = None, model, False  # is_key : an index of a list, or a name that the file chooses
    for part in loc:
        if not is_key:
            if part not in table.model_fields:
                break
            field = table.model_fields[str(part)]
            kinds = _kinds(field.annotation)
            inside = [kind for outer in kinds for kind in (outer, *get_args(outer)) if isinstance(kind, type)]
            table = next((kind for kind in inside if issubclass(kind, BaseModel)), table)
        is_key = not is_key and any(get_origin(kind) in (tuple, dict) for kind in kinds)
    return field, [".".join(map(str, (*loc[:-1], name))) for name in table.model_fields]


def _way_out(path: str, field: FieldInfo | None) -> str:
    if field is None or not field.description:
        return f"add the table [{path}]."
    example = f", e.g. {field.examples[0]!r}" if field.examples else ""
    return f"{field.description}{example}."
