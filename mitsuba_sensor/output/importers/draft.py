"""The camera that a foreign file describes, while it is put together: values, assumptions and their sources."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...camera.camera import SET_BY_USER, Camera
from ...camera.camera_file import camera_from
from ...camera.field_catalogue import COPIED
from ...core import InputError, nearest
from ...core.errors import shown
from ...core.printable import printable
from ...stages.gains import volts_per_electron

LARGEST = 1e12
"""Largest gain, noise or number of electrons of any camera."""


@dataclass
class Draft:
    """Changes of a camera, and their sources.

    file : name for sources and messages.  like : the camera that gives every value that the file lacks.
    """

    file: str
    like: Camera
    name: str = ""
    description: str = ""
    changes: dict[str, Any] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.file = printable(self.file)

    def says(self, dotted: str, value: Any, how: str) -> None:
        """Set a field from the file.  how : the value's name in the file, and how it was converted."""
        self.changes[dotted], self.sources[dotted] = _rounded(value), f"{self.file}: {how}"

    def assume(self, dotted: str, value: Any, why: str) -> None:
        """Set a field that the file lacks, unless the user has set it."""
        if self.like.sources.get(dotted) != SET_BY_USER:
            self.changes[dotted], self.sources[dotted] = _rounded(value), f"assumed: {why}"

    def number(
        self, name: str, value: object, low: float = 0.0, high: float = LARGEST
    ) -> float:
        """Return a number of the file above ``low``, at most ``high``. Raises InputError."""
        number = number_of(value)
        if number is None or not low < number <= high:
            raise self.wrong(name, value, f"a number above {low:g}, at most {high:g}")
        return number

    def count(self, name: str, value: object, high: float) -> int:
        """Return a whole number of the file, from 1 to ``high``. Raises InputError."""
        number = number_of(value)
        if number is None or not (1 <= number <= high and number.is_integer()):
            raise self.wrong(name, value, f"a whole number from 1 to {high:.10g}")
        return int(number)

    def numbers(
        self, name: str, value: object, low: float = 0.0, high: float = LARGEST
    ) -> list[float]:
        """Return a list of numbers of the file. Raises InputError."""
        if not isinstance(value, list | tuple):
            raise self.wrong(name, value, "a list of numbers")
        return [self.number(name, item, low, high) for item in value]

    def table(self, name: str, value: object) -> dict[str, Any]:
        """Return a table of names and values of the file. Raises InputError."""
        if not isinstance(value, dict):
            raise self.wrong(name, value, "a table of names and values")
        return value

    def tables(self, name: str, value: object) -> list[dict[str, Any]]:
        """Return a list of tables of the file. Raises InputError."""
        if not isinstance(value, list):
            raise self.wrong(name, value, "a list of tables")
        return [self.table(name, item) for item in value]

    def choice(self, name: str, value: object, allowed: Sequence[str]) -> str:
        """Return a text of the file that is one of the ``allowed``. Raises InputError."""
        if not isinstance(value, str) or value not in allowed:
            raise self.wrong(name, value, f"one of {', '.join(allowed)}")
        return value

    def wrong(self, name: str, value: object, wanted: str) -> InputError:
        """Return the error of a value of the file.  wanted : what the value must be."""
        given = shown(value) if number_of(value) is None else value  # no quotes around "-1.0"
        return InputError(
            f"{self.file}: {name} is {given}; it must be {wanted}. Correct the file, or remove the setting."
        )

    def refuse_misspelled(self, given: Mapping[str, object], known: Iterable[str]) -> None:
        """Raise InputError for a key that is close to a known key that the file lacks."""
        known = set(known)
        for key in given.keys() - known:
            if near := nearest(key, known - given.keys()):
                raise InputError(f"{self.file}: unknown key {shown(key)}.{near}")

    def set_gain(self, dn_per_e: float, how: str) -> None:
        """Set the overall system gain K by the full scale of the ADC."""
        full_scale_v = volts_per_electron(self.like) * 2.0**self.bits / dn_per_e
        self.says(
            "adc.full_scale_v", full_scale_v, f"{how} = {dn_per_e:.5g} DN/e-, as full scale"
        )

    def set_gains(self, settings: Sequence[Mapping[str, float]], how: str) -> None:
        """Set the gain settings, with the values that all of them have; one setting needs no ladder."""
        if len(settings) > 1:
            shared = set.intersection(*map(set, settings))
            self.says(
                "gains",
                [
                    {name: _rounded(x) for name, x in one.items() if name in shared}
                    for one in settings
                ],
                how,
            )

    def set_clip(self, dn_per_e: float, black_dn: float) -> None:
        """Assume the full well at which the ADC saturates, for a file that has none."""
        why = "the file has no full well; the ADC saturates first"
        self.assume("pixel.full_well_e", (2.0**self.bits - 1 - black_dn) / dn_per_e, why)

    @property
    def bits(self) -> int:
        """Bits of the ADC."""
        return int(self.changes.get("adc.bits", self.like.adc.bits))

    def camera(self) -> Camera:
        """Return the checked camera; its other fields are "assumed: as" those of ``like``. Raises InputError."""
        camera = self.like.replace(**{"gains": None, "gain": None, **self.changes})
        as_like = f"assumed: as {self.like.name}"
        sources = {
            name: text if text == SET_BY_USER else f"{as_like}: {COPIED.sub('', text)}"
            for name, text in self.like.sources.items()
            if name in camera.sources
        }
        data = camera.model_dump()
        data["name"] = printable(self.name) or camera.name
        data["description"] = printable(self.description)
        data["sources"] = {**sources, **self.sources}
        return camera_from(data, self.file)


def number_of(value: object) -> float | None:
    """Return the finite number that a value or a text is, else None; a boolean is no number."""
    if isinstance(value, bool) or not isinstance(
        value, str | int | float | np.integer | np.floating
    ):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _rounded(value: Any) -> Any:
    """Round a float, or the floats of a list, to six digits, which no measurement exceeds."""
    if isinstance(value, list):
        return [_rounded(x) for x in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
