"""One sentence in place of Python's TypeError where something public is called with names or values that do not fit."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from typing import Any, NamedTuple, TypeVar, cast

from .errors import InputError
from .near_names import nearest

Called = TypeVar("Called", bound=Callable[..., Any])

IN_EXPOSURE = {
    "exposure_s": "time_s",
    "exposure_time": "time_s",
    "exposure_time_s": "time_s",
    "integration_time": "time_s",
    "time": "time_s",
    "time_s": "time_s",
    "temperature_k": "temperature_k",
    "temperature": "temperature_k",
}
"""What is part of an exposure: as users and the command line call it, and its fields."""

CALLED_OTHERWISE = {
    "iso": "gain",
    "samples": "spp",
    "samples_per_pixel": "spp",
    "columns": "width",
    "resolution": "width",
    "n_frames": "frames",
    "num_frames": "frames",
    "count": "frames",
    "wavelength": "wavelength_nm",
    "wavelengths": "wavelengths_nm",
    "tolerance": "tolerance_dn",
    "serial_number": "serial",
}
"""How users call some options."""

CALLED = {"__init__", "__call__"}
"""Methods that a user calls by the name of the class or of the object."""

OWN = {"self", "cls"}
"""What a method is of, which nobody gives by its name."""


class Names(NamedTuple):
    """What a function or class may be called with.

    called : its name.  noun : what its arguments are called: "option", "field" or "argument".  names : all of them.
    is_open : whether other names are allowed, too.
    """

    called: str
    noun: str
    signature: inspect.Signature
    names: tuple[str, ...]
    is_open: bool

    @classmethod
    def of(cls, called: str, noun: str, signature: inspect.Signature) -> Names:
        """Those of a signature, without the object that a method is of."""
        kinds = inspect.Parameter
        parameters = [one for one in signature.parameters.values() if one.name not in OWN]
        named = [
            one
            for one in parameters
            if one.kind not in (kinds.VAR_KEYWORD, kinds.VAR_POSITIONAL)
        ]
        is_open = any(one.kind is kinds.VAR_KEYWORD for one in parameters)
        return cls(called, noun, signature, tuple(one.name for one in named), is_open)

    @property
    def listed(self) -> str:
        """``its fields are …``, or that there are none."""
        if self.is_open:
            return f"others are given by their names, {self.called}(name=value)"
        if not self.names:
            return "it takes none"
        return f"its {self.noun}s are {', '.join(self.names)}"


def tells_of_names(called: Called) -> Called:
    """A function, or a class with its public methods, that raises InputError for an unknown name, a missing value or
    too many of them."""
    if not isinstance(called, type):
        signature = inspect.signature(called)
        return told(called, Names.of(called.__name__, "argument", signature))
    for name, method in list(vars(called).items()):
        is_public = name in CALLED or not name.startswith("_")
        if inspect.isfunction(method) and is_public:
            setattr(called, name, _told_method(called, name, method))
        elif isinstance(method, classmethod) and not name.startswith("_"):
            function = _told_method(called, name, method.__func__)
            setattr(called, name, classmethod(function))
    return cast(Called, called)


def _told_method(kind: type, name: str, method: Callable[..., object]) -> Callable[..., object]:
    """A method, or what makes an object, that tells."""
    noun = "argument"
    title = f"{kind.__name__}.{name}"
    if name == "__init__":
        title = kind.__name__
        if is_dataclass(kind):
            noun = "field"
    return told(method, Names.of(title, noun, inspect.signature(method)))


def told(function: Called, names: Names) -> Called:
    """The function with one sentence in place of a TypeError about its arguments; other errors are left alone."""
    allowed = {*names.names, *OWN}

    @functools.wraps(function)
    def call(*values: object, **named: object) -> object:
        if not names.is_open and not allowed.issuperset(named):
            unknown = next(name for name in named if name not in allowed)
            raise InputError(_unknown_sentence(names, unknown, named[unknown]))
        try:
            return function(*values, **named)
        except TypeError:
            if problem := _problem(names, values, named):
                raise InputError(problem) from None
            raise

    return cast(Called, call)


def _problem(names: Names, values: Sequence[object], named: Mapping[str, object]) -> str:
    """What does not fit about the arguments; empty where they fit, and the error is another one."""
    try:
        names.signature.bind(*values, **named)
    except TypeError as error:
        said = str(error)
    else:
        return ""
    argument = re.search(r"'(\w+)'", said)
    if "missing" in said and argument:
        return f"{names.called} needs {argument[1]}, which is not given; {names.listed}."
    if "multiple values" in said and argument:
        return f"{names.called} is given {argument[1]} twice; give it once: {names.listed}."
    is_method = not OWN.isdisjoint(names.signature.parameters)
    count = len(values) - is_method
    if isinstance(values[-1], Mapping):
        call = names.called.rpartition(".")[2]
        return f"{names.called} is given a dict; write two stars before it: {call}({'…, ' * (count > 1)}**{{…}})."
    given = f"{count} value{'s' * (count != 1)} without a name"
    return f"{names.called} is given {given}, which are too many; {names.listed}."


def _unknown_sentence(names: Names, name: str, value: object) -> str:
    """What to write in place of a name that there is not."""
    article = "an"
    if names.noun == "field":
        article = "a"
    no_such = f"{name!r} is not {article} {names.noun} of {names.called}"
    known = names.names
    if name in IN_EXPOSURE and IN_EXPOSURE[name] in known:
        return f"{no_such}; it is called {IN_EXPOSURE[name]} here."
    if name in IN_EXPOSURE and "exposure" in known:
        return f"{no_such}; pass exposure=Exposure({_exposure_call(IN_EXPOSURE[name], value)})."
    if CALLED_OTHERWISE.get(name) in known:
        return f"{no_such}; it is called {CALLED_OTHERWISE[name]} here."
    return f"{no_such}; {names.listed}.{nearest(name, known)}"


def _exposure_call(field: str, value: object) -> str:
    """The arguments of an exposure with this value of a field."""
    shown = "…"
    if isinstance(value, int | float):
        shown = repr(value)
    if field == "time_s":
        return f"time_s={shown}"
    return f"time_s=…, {field}={shown}"
