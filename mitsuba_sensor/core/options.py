"""Options declared once: signature, check, command-line flag and metadata entry follow from one TypedDict.

A module of options declares type, meaning, default and range of each option (without ``from __future__ import
annotations``, so that the declarations exist at run time):

    class RenderOptions(TypedDict, total=False):
        spp: Annotated[int | None, Option("Light paths per pixel.", low=1, high=2**24, example="256")]

A function takes them as ``**options: Unpack[RenderOptions]``, which mypy checks. ``@documents(RenderOptions)`` shows
them in ``help()``. ``complete(RenderOptions, options)`` checks them and fills in the defaults.
"""

import inspect
import numbers
import re
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from math import inf, isinf, nan
from pathlib import PurePath
from typing import Any, ForwardRef, Literal, TypeVar, Union, cast, get_args, get_origin

from .errors import InputError, refuse_number, shown, span
from .near_names import nearest

Options = TypeVar("Options")
Function = TypeVar("Function", bound=Callable[..., object])
TYPE_NAMES = {bool: "True or False", str: "a text"}
FOREIGN_NAMES = {
    **{"iso": "gain", "samples": "spp", "samples_per_pixel": "spp", "columns": "width"},
    **{"resolution": "width", "n_frames": "frames", "num_frames": "frames", "count": "frames"},
    **{"wavelength": "wavelength_nm", "wavelengths": "wavelengths_nm"},
    **{"tolerance": "tolerance_dn", "serial_number": "serial"},
}
"""Option names in other programs → ours."""
EXPOSURE_NAMES = {
    "exposure_s",
    "exposure_time",
    "exposure_time_s",
    "integration_time",
    "time_s",
}
EXPOSURE_NAMES |= {"temperature_k", "temperature"}
"""Names of what an Exposure holds, here and in other programs."""
FLAG, ON_THE_COMMAND_LINE = (
    re.compile(r"--([a-z][a-z-]*)"),
    re.compile(r" Repeatable\.| \(repeatable\)"),
)
KIND_NAMES = {"Buffer": "array", "_Buffer": "array", "PathLike": "path", "Mapping": "dict"}


@dataclass(frozen=True)
class Option:
    """Meaning, default, range and command-line form of an option."""

    help: str  # what it does, with the unit; shown by help() and --help
    default: Any = None  # None means "not given" everywhere
    low: float = -inf  # the allowed range of a number, both ends included
    high: float = inf
    example: str = ""  # a good value, for errors
    check: Callable[[str, Any], object] | None = None
    """Takes name and value, and returns the value to use; replaces the checks of type and range."""
    flag: str | None = ""  # on the command line, if it is not --name; None if it has none
    metavar: str | None = None  # stands for the value in --help
    # Title above it in --help, if it differs from that of its TypedDict.
    panel: str | None = None
    # Type on the command line, if the value is read from a text: Path for a file name.
    text: Any = None


@dataclass(frozen=True)
class Declared:
    """A declared option: name, type and :class:`Option`."""

    name: str
    type: Any
    option: Option

    @cached_property
    def kinds(self) -> tuple[Any, ...]:
        """The allowed types except None."""
        union = get_origin(self.type) in (Union, types.UnionType)
        members = get_args(self.type) if union else (self.type,)
        return tuple(kind for kind in members if kind is not types.NoneType)

    @cached_property
    def choices(self) -> tuple[Any, ...]:
        """The values that a Literal allows; empty for other types."""
        literals = (kind for kind in self.kinds if get_origin(kind) is Literal)
        return tuple(value for kind in literals for value in get_args(kind))

    def checked(self, value: Any) -> Any:
        """Return the value to use. Raises InputError with the value, the allowed values and an example."""
        if value is None and self.option.default is None:
            return None
        if self.option.check is not None:
            return self.option.check(self.name, value)
        if self.kinds in ((int,), (float,)):
            return self._checked_number(value)
        if self.choices and not (isinstance(value, str) and value in self.choices):
            meant = nearest(str(value), self.choices)
            self._refuse(value, f"one of {', '.join(map(str, self.choices))}.{meant}")
        for kind, name in TYPE_NAMES.items():
            if self.kinds == (kind,) and not isinstance(value, kind):
                self._refuse(value, f"{name}{self._example}.")
        return value

    @property
    def _example(self) -> str:
        return self.option.example and f", e.g. {self.option.example}"

    def _refuse(self, value: object, allowed: str) -> None:
        raise InputError(f"{self.name} is {shown(value)}; it must be {allowed}")

    def _checked_number(self, value: Any) -> float:
        """Return a number in the range, as int if the type is int."""
        whole, low, high = self.kinds == (int,), self.option.low, self.option.high
        limits = "" if isinf(low) and isinf(high) else f" {span(low, high)}"
        allowed = f"a {'whole ' * whole}number{limits}{self._example}"
        try:
            is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
            number = float(value) if is_number else nan
        except OverflowError:  # a whole number of hundreds of digits
            number = nan
        if not low <= number <= high or (whole and value % 1):
            refuse_number(self.name, value, allowed)
        return int(value) if whole else number


@cache
def _declared(kind: Any) -> tuple[Declared, ...]:
    """Return the options of a TypedDict in their order, options of its bases first."""
    options = []
    for name, annotation in kind.__annotations__.items():
        if not isinstance(getattr(annotation, "__metadata__", (None,))[0], Option):
            raise TypeError(
                f"{kind.__name__}.{name} must be declared as Annotated[type, Option(...)]"
            )
        options.append(Declared(name, annotation.__origin__, annotation.__metadata__[0]))
    return tuple(options)


declared: Callable[[Any], tuple[Declared, ...]] = _declared


def complete(kind: type[Options], given: Mapping[str, object]) -> Options:
    """Return all options of this kind: the given values, checked, and the other defaults. Raises InputError."""
    refuse_unknown(given, kind)
    options = {x.name: x.checked(given.get(x.name, x.option.default)) for x in declared(kind)}
    return cast(Options, options)


def refuse_unknown(given: Iterable[str], kind: type) -> None:
    """Raise InputError for a name that is not an option of this kind."""
    names = [option.name for option in declared(kind)]
    for name in given:
        if name in names:
            continue
        remedy = nearest(name, names).strip() or f"The options are {', '.join(names)}."
        if FOREIGN_NAMES.get(name) in names:
            remedy = f"Use {FOREIGN_NAMES[name]}."
        elif name in EXPOSURE_NAMES:
            remedy = "Pass exposure=Exposure(time_s=0.1, temperature_k=298.15)."
        raise InputError(f"{name!r} is not an option. {remedy}")


def part_of(kind: type[Options], options: Mapping[str, Any]) -> Options:
    """Return the options that this kind has, for a function that takes fewer of them."""
    return cast(Options, {x.name: options[x.name] for x in declared(kind) if x.name in options})


def used(kind: type, options: Mapping[str, object]) -> dict[str, object]:
    """Return the options by name as plain values for metadata; of dicts of arrays, only the keys."""
    return {x.name: _plain(options.get(x.name, x.option.default)) for x in declared(kind)}


def documents(*kinds: type) -> Callable[[Function], Function]:
    """Show the options of a function's ``**options`` in its signature and its docstring."""

    options = {option.name: option for kind in kinds for option in declared(kind)}

    def with_options(function: Function) -> Function:
        signature = inspect.signature(function)
        named = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        keyword = inspect.Parameter.KEYWORD_ONLY
        named += [
            inspect.Parameter(x.name, keyword, default=x.option.default)
            for x in options.values()
        ]
        function.__signature__ = signature.replace(parameters=named)  # type: ignore[attr-defined]
        lines = "\n".join(map(_described, options.values()))
        function.__doc__ = f"{inspect.cleandoc(function.__doc__ or '')}\n\nOptions:\n{lines}"
        return function

    return with_options


def _described(declaration: Declared) -> str:
    """Return a line of a docstring: name, type, default and meaning of an option; flags become arguments."""
    kinds, default = " or ".join(map(_kind_name, declaration.kinds)), declaration.option.default
    shown_default = "" if default in (None, ()) else f", default {default!r}"
    meaning = FLAG.sub(lambda flag: flag[1].replace("-", "_"), declaration.option.help)
    meaning = ON_THE_COMMAND_LINE.sub("", meaning)
    return f"    {declaration.name} : {kinds}{shown_default}. {meaning}"


def _kind_name(kind: object) -> str:
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
        return sorted(value) if arrays else {str(key): _plain(x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    return value if isinstance(value, str | bool | int | float | None) else repr(value)
