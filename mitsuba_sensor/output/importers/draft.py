"""A camera that is put together from a foreign file: what the file says, what is assumed, and the sources."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...camera.camera import SET_BY_USER, Camera
from ...camera.camera_file import camera_from
from ...core import InputError
from ...core.errors import shown
from ...core.printable import printable
from ...stages.gains import volts_per_electron

MOST = 1e12
"""No gain, noise or number of electrons of a camera is larger."""
MAY_BE_NUMBERS = (str, int, float, np.integer, np.floating)


@dataclass
class Draft:
    """Changes of a camera, and their sources.

    file : for sources and messages.  like : the camera whose numbers hold where the file says nothing.
    """

    file: str
    like: Camera
    name: str = ""
    description: str = ""
    changes: dict[str, Any] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)

    def says(self, dotted: str, value: Any, how: str) -> None:
        """A number of the file.  how : the name that it has there, and how it was converted."""
        self.changes[dotted], self.sources[dotted] = _rounded(value), f"{self.file}: {how}"

    def assume(self, dotted: str, value: Any, why: str) -> None:
        """A number that the file does not have; one that the user has set stays."""
        if self.like.sources.get(dotted) != SET_BY_USER:
            self.changes[dotted], self.sources[dotted] = _rounded(value), f"assumed: {why}"

    def number(self, name: str, value: object, low: float = 0.0, high: float = MOST) -> float:
        """A number of the file, as a float above ``low``. Raises InputError with the value and the range."""
        number = number_of(value)
        if number is None or not low < number <= high:
            raise self._wrong(name, value, f"a number above {low:g}, at most {high:g}")
        return number

    def count(self, name: str, value: object, high: float) -> int:
        """A whole number of the file, 1 … high. Raises InputError."""
        number = number_of(value)
        if number is None or not (1 <= number <= high and number == int(number)):
            raise self._wrong(name, value, f"a whole number from 1 to {high:.10g}")
        return int(number)

    def numbers(
        self, name: str, value: object, low: float = 0.0, high: float = MOST
    ) -> list[float]:
        """A list of numbers of the file. Raises InputError."""
        if not isinstance(value, list | tuple):
            raise self._wrong(name, value, "a list of numbers")
        return [self.number(name, item, low, high) for item in value]

    def table(self, name: str, value: object) -> dict[str, Any]:
        """A table of the file: names and values. Raises InputError."""
        if not isinstance(value, dict):
            raise self._wrong(name, value, "a table of names and values")
        return value

    def tables(self, name: str, value: object) -> list[dict[str, Any]]:
        """A list of tables of the file. Raises InputError."""
        if not isinstance(value, list):
            raise self._wrong(name, value, "a list of tables")
        return [self.table(name, item) for item in value]

    def choice(self, name: str, value: object, allowed: Sequence[str]) -> str:
        """A text of the file, one of some. Raises InputError."""
        if not isinstance(value, str) or value not in allowed:
            raise self._wrong(name, value, f"one of {', '.join(allowed)}")
        return value

    def _wrong(self, name: str, value: object, wanted: str) -> InputError:
        """The error of a value of the file.  wanted : what it must be."""
        actual = value  # texts of YAML, XML and CSV that are numbers stand as they are
        if number_of(value) is None:
            actual = shown(value)
        return InputError(
            f"{self.file}: {name} is {actual}; it must be {wanted}. Mend the file, or leave the setting out."
        )

    def set_gain(self, dn_per_e: float, how: str) -> None:
        """The overall system gain K, as the full scale of the converter."""
        full_scale_v = volts_per_electron(self.like) * 2.0**self.bits / dn_per_e
        source = f"{how} = {dn_per_e:.5g} DN/e-, as full scale"
        self.says("adc.full_scale_v", full_scale_v, source)

    def set_gains(self, settings: Sequence[Mapping[str, float]], how: str) -> None:
        """Several gain settings as the ladder of the camera, with the numbers that all of them have."""
        if len(settings) < 2:
            return
        shared = set.intersection(*map(set, settings))
        gains: list[dict[str, float]] = []
        for setting in settings:
            gains.append({name: _rounded(x) for name, x in setting.items() if name in shared})
        self.says("gains", gains, how)

    def set_clip(self, dn_per_e: float, black_dn: float) -> None:
        """The full well where the converter ends, for a file that has none."""
        why = "the file has no full well; the converter is full first"
        self.assume("pixel.full_well_e", (2.0**self.bits - 1 - black_dn) / dn_per_e, why)

    def __post_init__(self) -> None:
        self.file = printable(self.file)

    @property
    def bits(self) -> int:
        """Bits of the converter."""
        return int(self.changes.get("adc.bits", self.like.adc.bits))

    def camera(self) -> Camera:
        """The checked camera. Raises InputError.

        What the file does not say is "assumed: as" the camera that it is like.
        """
        camera = self.like.replace(**{"gains": None, "gain": None, **self.changes})
        sources: dict[str, str] = {}
        for field_name, text in self.like.sources.items():
            if field_name in camera.sources:
                sources[field_name] = f"assumed: as {self.like.name}: {text}"
                if text == SET_BY_USER:
                    sources[field_name] = text
        data = camera.model_dump()
        data["name"] = printable(self.name) or camera.name
        data["description"] = printable(self.description)
        data["sources"] = {**sources, **self.sources}
        return camera_from(data, self.file)


def number_of(value: object) -> float | None:
    """The number that a value or a text of a file is; None for booleans, and for what is no finite number."""
    if isinstance(value, bool) or not isinstance(value, MAY_BE_NUMBERS):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    if math.isfinite(number):
        return number
    return None


def _rounded(value: Any) -> Any:
    """A number or the numbers of a list to six digits, which no measurement exceeds; other values as they are."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list):
        return [_rounded(x) for x in value]
    return value
