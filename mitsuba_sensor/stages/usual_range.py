"""Usual ranges of the numbers of a camera file, and units by which numbers outside may have been mistaken."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..core import Doubt, warn_of


class Mistake(NamedTuple):
    """A number given in another unit: value · factor + offset is in the unit of the field."""

    unit: str
    factor: float = 1.0
    offset: float = 0.0

    def corrected(self, value: float) -> float:
        """Return the number in the unit of the field."""
        return value * self.factor + self.offset

    def sentence(self, value: float) -> str:
        """Return the remedy."""
        return f"if {value:.10g} is in {self.unit}, write {self.corrected(value):.10g}"


PERCENT, CELSIUS = Mistake("percent", 1e-2), Mistake("°C", offset=273.15)
METRES_TO_UM, MM_TO_UM, NM_TO_UM = (
    Mistake("metres", 1e6),
    Mistake("millimetres", 1e3),
    Mistake("nanometres", 1e-3),
)
UM_TO_NM, METRES_TO_NM = Mistake("micrometres", 1e3), Mistake("metres", 1e9)
METRES_TO_MM = Mistake("metres", 1e3)
VOLTS_TO_UV, MV_TO_V, VOLTS_TO_NV = (
    Mistake("volts", 1e6),
    Mistake("millivolts", 1e-3),
    Mistake("volts", 1e9),
)
SECONDS_TO_US, MS_TO_US, NS_TO_US = (
    Mistake("seconds", 1e6),
    Mistake("milliseconds", 1e3),
    Mistake("nanoseconds", 1e-3),
)
US_TO_SECONDS, NS_TO_SECONDS = Mistake("microseconds", 1e-6), Mistake("nanoseconds", 1e-9)
THOUSANDS = Mistake("thousands", 1e3)
AMPERES_TO_NA, PA_TO_NA = Mistake("amperes", 1e9), Mistake("picoamperes", 1e-3)


@dataclass(frozen=True)
class Usual:
    """The range of real cameras; a number outside is allowed, with a note. 0 gives no note.

    low, high : in the unit of the field, both included.  mistakes : other units, tried in this order.
    """

    low: float
    high: float
    mistakes: tuple[Mistake, ...] = ()

    @classmethod
    def of(cls, low: float, high: float, *mistakes: Mistake) -> Usual:
        """Return a range with these mistakes."""
        return cls(low, high, mistakes)

    @property
    def text(self) -> str:
        """``0.3 to 200``."""
        return f"{self.low:g} to {self.high:g}".replace("e+0", "e").replace("e-0", "e-")

    def includes(self, value: float) -> bool:
        """Whether the value is usual."""
        return value == 0 or self.low <= value <= self.high

    def right(self, value: float) -> str:
        """Return ``if 25 is in °C, write 298.15`` for the first unit that makes the number usual, else ""."""
        return next(
            (
                one.sentence(value)
                for one in self.mistakes
                if self.low <= one.corrected(value) <= self.high
            ),
            "",
        )

    def doubt(self, field: str, value: float, verb: str = "is") -> str:
        """Return a note on an unusual value of a field, with the remedy.  verb : has, for one value of several."""
        remedy = self.right(value) or (
            self.mistakes[0].sentence(value) if self.mistakes else "check its unit"
        )
        return f"{field} {verb} {value:.10g}; {self.text} is usual: {remedy}"


COOLED_TO_HOT_K = Usual.of(70.0, 400.0, CELSIUS)
"""From liquid nitrogen to the highest specified temperature of silicon sensors."""


def temperature_note(temperature_k: float) -> tuple[str, ...]:
    """Return a note on a sensor temperature that is probably a mistake."""
    usual = temperature_k > 0 and COOLED_TO_HOT_K.includes(temperature_k)
    if usual:
        return ()
    return (Doubt(COOLED_TO_HOT_K.doubt("temperature_k", temperature_k)),)


def warn_of_temperature(temperature_k: float) -> None:
    """Warn of a sensor temperature that is probably a mistake."""
    warn_of(temperature_note(temperature_k))
