"""One sentence in place of Python's TypeError where a public class is called with a name that is no field of it."""

from __future__ import annotations

import functools
import inspect
from typing import TypeVar

from .errors import InputError, nearest

Class = TypeVar("Class", bound=type)

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


def tells_of_names(kind: Class) -> Class:
    """A dataclass that raises InputError for an unknown name, a missing value or too many of them."""
    make = kind.__init__  # type: ignore[misc]
    signature = inspect.signature(make)
    fields = [name for name in signature.parameters if name != "self"]

    @functools.wraps(make)
    def checked(self: object, *values: object, **named: object) -> None:
        try:
            signature.bind(self, *values, **named)
        except TypeError as error:
            raise InputError(_sentence(kind.__name__, fields, named, str(error))) from None
        make(self, *values, **named)

    setattr(kind, "__init__", checked)  # noqa: B010
    return kind


def _sentence(kind: str, fields: list[str], named: dict[str, object], error: str) -> str:
    """What to write in place of these names."""
    known = ", ".join(fields)
    for name in named:
        if name not in fields and IN_EXPOSURE.get(name) in fields:
            return f"{name!r} is not a field of {kind}; it is called {IN_EXPOSURE[name]} here."
        if name not in fields:
            return f"{name!r} is not a field of {kind}; its fields are {known}.{nearest(name, fields)}"
    return f"{kind} does not fit: {error}; its fields are {known}."
