"""A camera that is put together from a foreign file: what the file says, what is assumed, and the sources."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...core import InputError
from ...sensor.camera import Camera
from ...sensor.camera_file import camera_from
from ...sensor.gains import volts_per_electron

USER = "set by the user"
MOST = 1e12
"""No gain, noise or number of electrons of a camera is larger."""


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
        if self.like.sources.get(dotted) != USER:
            self.changes[dotted], self.sources[dotted] = _rounded(value), f"assumed: {why}"

    def number(self, name: str, value: object, low: float = 0.0, high: float = MOST) -> float:
        """A number of the file, as a float above ``low``. Raises InputError with the value and the range."""
        try:
            found = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            found = math.nan
        if not low < found <= high:
            raise InputError(
                f"{self.file}: {name} is {value!r}; it must be a number above {low:g}, at most {high:g}. Mend the "
                "file, or leave the setting out."
            )
        return found

    def set_gain(self, dn_per_e: float, how: str) -> None:
        """The overall system gain K, as the full scale of the converter."""
        volts = volts_per_electron(self.like)
        self.says("adc.full_scale_v", volts * 2.0**self.bits / dn_per_e, f"{how} = {dn_per_e:.5g} DN/e-, as full scale")

    def set_gains(self, settings: Sequence[Mapping[str, float]], how: str) -> None:
        """Several gain settings as the ladder of the camera, with the numbers that all of them have."""
        if len(settings) > 1:
            shared = set.intersection(*(set(one) for one in settings))
            gains = [{name: _rounded(x) for name, x in one.items() if name in shared} for one in settings]
            self.says("gains", gains, how)

    def set_clip(self, dn_per_e: float, black_dn: float) -> None:
        """The full well where the converter ends, for a file that has none."""
        why = "the file has no full well; the converter is full first"
        self.assume("pixel.full_well_e", (2.0**self.bits - 1 - black_dn) / dn_per_e, why)

    @property
    def bits(self) -> int:
        """Of the converter."""
        return int(self.changes.get("adc.bits", self.like.adc.bits))

    def camera(self) -> Camera:
        """Checked. What the file does not say is "assumed: as" the camera that it is like. Raises InputError."""
        found = self.like.replace(**{"gains": None, "gain": None, **self.changes})
        same = {
            key: text if text == USER else f"assumed: as {self.like.name}: {text}"
            for key, text in self.like.sources.items()
            if key in found.sources
        }
        data = found.model_dump()
        data |= {"name": self.name or found.name, "description": self.description}
        data["sources"] = {**same, **self.sources}
        return camera_from(data, self.file)


def _rounded(value: Any) -> Any:
    """To six digits, which no measurement exceeds."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(x) for x in value] if isinstance(value, list) else value
