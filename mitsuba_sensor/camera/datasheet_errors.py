"""Sentences from a failed check of a camera or motion file: file, field, value, range, and the way out."""

import sys
import types
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, wraps
from typing import Any, NamedTuple, TypeAlias, TypeGuard, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..core import InputError, closest
from ..core.errors import shown, span
from ..core.number_text import number_hint
from ..stages.usual_range import Usual
from .field_terms import MEANT, did_you_mean, key_of_term

Loc: TypeAlias = tuple[str | int, ...]

KEY = "[key]"  # where pydantic's errors name a key of a table instead of its value
# Pydantic's kinds of error → what such a file calls the thing that was expected.
PLAIN = {
    "model_type": "a table",
    "dict_type": "a table",
    "tuple_type": "a list",
    "string_type": "a text in quotes",
}


NOT_A_NUMBER = ("float_type", "int_type")
"""Errors of a value that is no number."""

NUMBER_NOUNS = {"float_type": "a number", "int_type": "a whole number"}

LIMITS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
"""The ends of a range as pydantic's metadata call them, and as a sentence says them."""


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
    return (
        get_args(annotation)
        if get_origin(annotation) in (Union, types.UnionType)
        else (annotation,)
    )


class Fault(NamedTuple):
    """One thing that is wrong.  loc : where in the file.  text : field, value, range and the way out.

    unknown : there is no such field.  meant : the missing field of which it is a misspelling.
    of_table : the fields of one table do not fit together.
    """

    loc: Loc
    text: str
    unknown: bool
    meant: str
    of_table: bool


def faults(error: ValidationError, model: type[BaseModel], kind: str = "camera") -> list[Fault]:
    """Everything that is wrong; a misspelt field that is missing under its right name counts once."""
    found = [
        (tuple(x for x in one["loc"] if x != KEY), one)
        for one in error.errors(include_url=False)
    ]
    missing = {_dotted(loc) for loc, one in found if one["type"] == "missing"}
    meant = {
        loc: _meant(loc, missing) for loc, one in found if one["type"] == "extra_forbidden"
    }
    return [
        Fault(
            loc, _text(loc, one, model, kind), loc in meant, meant.get(loc, ""), _of_table(one)
        )
        for loc, one in found
        if one["type"] != "missing" or _dotted(loc) not in meant.values()
    ]


def sentence(
    error: ValidationError, model: type[BaseModel], where: str, kind: str = "camera"
) -> str:
    """The first thing that is wrong, in one sentence.  kind : of the file."""
    return f"{where}: {faults(error, model, kind)[0].text}"


def _of_table(one: ErrorDetails) -> bool:
    """Whether fields of one table do not fit together."""
    return one["type"] == "value_error" and bool(one["loc"]) and KEY not in one["loc"]


def _text(loc: Loc, one: ErrorDetails, model: type[BaseModel], kind: str) -> str:
    """One error without the name of the file."""
    path, what, value = _dotted(loc), one["type"], shown(one["input"])
    field, names = _field(loc, model)
    if what == "extra_forbidden":
        known = [
            name for name in (*fields_of(model), *names) if not path.startswith(f"{name}.")
        ]
        meant = did_you_mean(path, known)
        if not meant and isinstance(one["input"], Mapping):  # a table that there is not
            inside = [did_you_mean(f"{path}.{key}", known) for key in one["input"]]
            meant = next(filter(None, inside), "")
        return f"{path} is not a field of a {kind} file.{meant}"
    if what == "missing":
        return f"{path} is missing; {_way_out(path, field)}"
    if what == "value_error":
        said = str(one["ctx"]["error"]).removesuffix(".")
        return f"{path or f'the {kind}'}: {said}{'' if said.endswith('?') else '.'}"
    if what in ("model_type", "dict_type") and path in MEANT:
        return f"{path} is {value}; add the table [{path}]. Did you mean {MEANT[path]!r}?"
    if what == "string_type" and path in MEANT:
        return f"{path} is {value}, and it is a text. Did you mean {MEANT[path]!r}?"
    said = one["msg"].removeprefix("Input should be ").removeprefix("Input ")
    rule = PLAIN.get(what) or _limit_rule(one) or _number_rule(what, field) or said
    if what in ("too_short", "too_long"):
        least, most = (one["ctx"].get(f"{end}_length") for end in ("min", "max"))
        rule = f"at most {most} long" if least is None else f"at least {least} long"
    value = value if len(value) <= 60 else value[:57] + "..."
    return f"{path} is {value}; it must be {rule} ({_way_out(path, field)[:-1]}{_meaning(path, one, field)})."


def _limit_rule(one: ErrorDetails) -> str:
    """The end of its range that a number is beyond; empty for other kinds of error."""
    for end, limit in one.get("ctx", {}).items():
        if end in LIMITS:
            return f"{LIMITS[end]} {limit!r}".removesuffix(".0")
    return ""


def _number_rule(what: str, field: FieldInfo | None) -> str:
    """What a number of this field must be, with its range where it has one; empty for other kinds of error."""
    if what not in NUMBER_NOUNS:
        return ""
    limits = dict[str, float]()
    for one in field.metadata if field else ():
        limits |= {name: getattr(one, name) for name in LIMITS if hasattr(one, name)}
    if limits.keys() == {"ge", "le"}:
        allowed = [span(limits["ge"], limits["le"])]
    else:
        allowed = [f"{LIMITS[name]} {limit:.10g}" for name, limit in limits.items()]
    return " ".join([NUMBER_NOUNS[what], " and ".join(allowed)]).strip()


def _dotted(loc: Loc) -> str:
    return ".".join(map(str, loc))


def _meant(loc: Loc, missing: Collection[str]) -> str:
    """The missing field of which this one is a misspelling, or an empty text."""
    alike = {name.rpartition(".")[2]: name for name in missing}
    name = closest(str(loc[-1]), alike, cutoff=0.6)
    return key_of_term(_dotted(loc), missing) or (alike[name] if name else "")


def _meaning(path: str, one: ErrorDetails, field: FieldInfo | None) -> str:
    """What may be meant by a text in place of a number, or by a number that is a usual one in another unit."""
    value = one["input"]
    if one["type"] in NOT_A_NUMBER:
        hint = number_hint(path, value)
        return hint and f"; {hint}"
    usual = usual_of(field) if field else None
    hint = usual.right(value) if usual and _is_number(value) else ""
    return hint and f"; {hint}"


def doubts(data: Mapping[str, Any], model: type[BaseModel]) -> list[tuple[str, str]]:
    """Field and sentence for every number of a file, of nested tables, that is outside of its usual range."""
    found = []
    for name, field in fields_of(model).items():
        usual = usual_of(field)
        unusual = (
            [x for x in _numbers(_value_at(data, name)) if not usual.includes(x)]
            if usual
            else []
        )
        verb = "is" if isinstance(_value_at(data, name), int | float) else "has"
        found += [(name, usual.doubt(name, x, verb)) for x in unusual[:1] if usual]
    return found


def _value_at(data: object, dotted: str) -> object:
    """The value of a field, None where there is none."""
    for part in dotted.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _numbers(value: object) -> Iterator[float]:
    """The numbers in a value, which may be a list or a table of them."""
    inner = (
        value.values()
        if isinstance(value, Mapping)
        else value
        if isinstance(value, list | tuple)
        else ()
    )
    for one in inner:
        yield from _numbers(one)
    if _is_number(value):
        yield value


def _is_number(value: object) -> TypeGuard[float]:
    """Whether it is a number that a float can hold."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def usual_of(field: FieldInfo) -> Usual | None:
    """The usual range of a number of a camera file, where it is declared."""
    return next((one for one in field.metadata if isinstance(one, Usual)), None)


def _field(loc: Loc, model: type[BaseModel]) -> tuple[FieldInfo | None, list[str]]:
    """The last declared field on the way to a value, and the dotted names of the fields beside the value."""
    field, table, is_key = (
        None,
        model,
        False,
    )  # is_key : an index of a list, or a name that the file chooses
    for part in loc:
        if not is_key:
            if part not in table.model_fields:
                break
            field = table.model_fields[str(part)]
            kinds = _kinds(field.annotation)
            inside = [
                kind
                for outer in kinds
                for kind in (outer, *get_args(outer))
                if isinstance(kind, type)
            ]
            table = next((kind for kind in inside if issubclass(kind, BaseModel)), table)
        is_key = not is_key and any(get_origin(kind) in (tuple, dict) for kind in kinds)
    return field, [".".join(map(str, (*loc[:-1], name))) for name in table.model_fields]


def _way_out(path: str, field: FieldInfo | None) -> str:
    if field is None or not field.description:
        return f"add the table [{path}]."
    example = f", e.g. {field.examples[0]!r}" if field.examples else ""
    return f"{field.description}{example}."


def init_in_a_sentence(model: type[BaseModel]) -> Callable[..., None]:
    """What makes an object of a model, with one sentence in place of pydantic's list of errors."""
    make = model.__init__

    @wraps(make)
    def checked(self: BaseModel, **values: object) -> None:
        try:
            make(self, **values)
        except ValidationError as error:
            first = min(faults(error, model), key=lambda fault: not fault.unknown)
            raise InputError(f"{model.__name__}: {first.text}") from None

    return checked
