"""Options declared once: signature, check, command-line flag and metadata entry follow from one TypedDict.

A module of options declares type, meaning, default and range of each one (without ``from __future__ import
annotations``, so that the declarations are there at run time):

    class RenderOptions(TypedDict, total=False):
        spp: Annotated[int | None, Option("Light paths per pixel.", low=1, high=2**24, example="256")]

A function takes them as ``**options: Unpack[RenderOptions]``, which mypy checks; ``@documents(RenderOptions)`` shows
them in ``help()``; ``complete(RenderOptions, options)`` checks them and fills in the defaults.
"""

import inspect
import numbers
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from math import inf
from pathlib import PurePath
from typing import Any, ForwardRef, Literal, TypeVar, Union, cast, get_args, get_origin

from .errors import InputError, require
from .near_names import nearest
from .number_text import number_hint

Options = TypeVar("Options")
Function = TypeVar("Function", bound=Callable[..., object])
NAMES = {bool: "True or False", str: "a text"}
CALLED_OTHERWISE = {
    **{"iso": "gain", "samples": "spp", "samples_per_pixel": "spp", "columns": "width"},
    **{"resolution": "width", "n_frames": "frames", "num_frames": "frames", "count": "frames"},
    **{"wavelength": "wavelength_nm", "wavelengths": "wavelengths_nm"},
    **{"tolerance": "tolerance_dn", "serial_number": "serial"},
}
"""Names in other programs → options."""
IN_EXPOSURE = {"exposure_s", "exposure_time", "exposure_time_s", "integration_time", "time_s"}
IN_EXPOSURE |= {"temperature_k", "temperature"}
"""Names in other programs for what an exposure holds."""
KIND_NAMES = {"Buffer": "array", "_Buffer": "array", "PathLike": "path", "Mapping": "dict"}


@dataclass(frozen=True)
class Option:
    """What is to be known of one option beside its name and its type."""

    help: str  # what it does, with the unit; shown by help() and --help
    default: Any = (
        None  # the value of an option that is not given; None means "not given" everywhere
    )
    low: float = -inf  # the allowed range of a number, both ends included
    high: float = inf
    example: str = ""  # a good value, for the error's remedy
    check: Callable[[str, Any], object] | None = (
        None  # of name and value, instead of type and range; the value to use
    )
    flag: str | None = ""  # on the command line, where it is not --name; None where it has none
    metavar: str | None = None  # what stands for its value in --help
    panel: str | None = (
        None  # title above it in --help, where it is not that of all options declared with it
    )
    text: Any = None  # its type on the command line, where it is read from a text there: Path for a file's name


@dataclass(frozen=True)
class Declared:
    """One option as it was declared: its name, its type and its :class:`Option`."""

    name: str
    type: Any
    option: Option

    @cached_property
    def kinds(self) -> tuple[Any, ...]:
        """The types that it may have, without None."""
        union = get_origin(self.type) in (Union, types.UnionType)
        return tuple(
            kind
            for kind in (get_args(self.type) if union else (self.type,))
            if kind is not types.NoneType
        )

    @cached_property
    def choices(self) -> tuple[Any, ...]:
        """The values that a Literal allows; none for another type."""
        return tuple(
            value
            for kind in self.kinds
            if get_origin(kind) is Literal
            for value in get_args(kind)
        )

    def checked(self, value: Any) -> Any:
        """The value to use. Raises InputError with the value, what is allowed, and an example."""
        if value is None and self.option.default is None:
            return None
        if self.option.check is not None:
            return self.option.check(self.name, value)
        if self.choices and not (isinstance(value, str) and value in self.choices):
            allowed = (
                ", ".join(map(str, self.choices)) + f".{nearest(str(value), self.choices)}"
            )
            raise InputError(f"{self.name} is {value!r}; it must be one of {allowed}")
        example = self.option.example and f" (e.g. {self.option.example})"
        if self.kinds in ((int,), (float,)):
            return self._number(value, example)
        if (
            len(self.kinds) == 1
            and self.kinds[0] in NAMES
            and not isinstance(value, self.kinds[0])
        ):
            raise InputError(
                f"{self.name} is {value!r}; it must be {NAMES[self.kinds[0]]}{example}."
            )
        return value

    def _number(self, value: Any, example: str) -> float:
        """A number in the range; a whole one, however it is stored, where the type is int."""
        whole = self.kinds == (int,)
        noun = "a number"
        if whole:
            noun = "a whole number"
        numeric = isinstance(value, numbers.Real) and not isinstance(value, bool)
        if not numeric or (whole and value == value and value % 1):
            hint = number_hint(self.name, value)
            more = hint and f"; {hint}"
            raise InputError(f"{self.name} is {value!r}; it must be {noun}{example}{more}.")
        remedy = noun + (example and f", e.g. {self.option.example}")
        number = require(self.name, value, self.option.low, self.option.high, remedy)
        if whole:
            return int(value)
        return number


def _declared(kind: Any) -> tuple[Declared, ...]:
    """The options of a TypedDict in their order, those of its bases first."""
    found = []
    for name, annotation in kind.__annotations__.items():
        if not isinstance(getattr(annotation, "__metadata__", (None,))[0], Option):
            raise TypeError(
                f"{kind.__name__}.{name} must be declared as Annotated[type, Option(...)]"
            )
        found.append(Declared(name, annotation.__origin__, annotation.__metadata__[0]))
    return tuple(found)


declared: Callable[[Any], tuple[Declared, ...]] = cache(_declared)


def complete(kind: type[Options], given: Mapping[str, object]) -> Options:
    """All options of this kind: those given, checked, and the default of every other one. Raises InputError."""
    refuse_unknown(given, kind)
    found = {
        one.name: one.checked(given.get(one.name, one.option.default)) for one in declared(kind)
    }
    return cast(Options, found)


def refuse_unknown(given: Iterable[str], kind: type) -> None:
    """Raise InputError for a name that is no option of this kind."""
    names = [one.name for one in declared(kind)]
    for name in given:
        if name in names:
            continue
        if CALLED_OTHERWISE.get(name) in names:
            remedy = f"it is called {CALLED_OTHERWISE[name]} here"
        elif name in IN_EXPOSURE:
            remedy = "pass exposure=Exposure(time_s=0.1, temperature_k=298.15)"
        else:
            remedy = f"the options are {', '.join(names)}"
        raise InputError(f"{name!r} is not an option; {remedy}.{nearest(name, names)}")


def part_of(kind: type[Options], options: Mapping[str, Any]) -> Options:
    """Those of the options that this kind has: what to pass on to a function that takes fewer of them."""
    return cast(
        Options, {one.name: options[one.name] for one in declared(kind) if one.name in options}
    )


def used(kind: type, options: Mapping[str, object]) -> dict[str, object]:
    """The options by name as plain values for a file of metadata; arrays by their names alone."""
    return {
        one.name: _plain(options.get(one.name, one.option.default)) for one in declared(kind)
    }


def documents(*kinds: type) -> Callable[[Function], Function]:
    """Show the options behind a function's ``**options`` in its signature and its docstring."""

    options = {one.name: one for kind in kinds for one in declared(kind)}

    def with_options(function: Function) -> Function:
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        keyword = inspect.Parameter.KEYWORD_ONLY
        behind = [
            inspect.Parameter(one.name, keyword, default=one.option.default)
            for one in options.values()
        ]
        shown = signature.replace(parameters=[*own, *behind])
        function.__signature__ = shown  # type: ignore[attr-defined]
        lines = "\n".join(map(_described, options.values()))
        function.__doc__ = f"{inspect.cleandoc(function.__doc__ or '')}\n\nOptions:\n{lines}"
        return function

    return with_options


def _described(one: Declared) -> str:
    """A line of a docstring: name, type, default and meaning of an option."""
    kinds = " or ".join(map(_kind_name, one.kinds))
    if one.option.default in (None, ()):
        default = ""
    else:
        default = f", default {one.option.default!r}"
    return f"    {one.name} : {kinds}{default}. {one.option.help}"


def _kind_name(kind: object) -> str:
    """A type as a reader calls it."""
    if isinstance(kind, ForwardRef):
        return kind.__forward_arg__.removesuffix(" | None")
    if get_origin(kind) is Literal:
        return ", ".join(repr(value) for value in get_args(kind))
    plain = get_origin(kind) or kind
    name = getattr(plain, "__name__", str(plain))
    return KIND_NAMES.get(name, name)


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        arrays = any(hasattr(item, "shape") for item in value.values())
        if arrays:
            return sorted(value)
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int | float | None):
        return value
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    return repr(value)
