"""Measured numbers beside closed forms: by how much they may differ, and whether they do not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.pages.page import Table, table

WIDER = 2.5
"""Half widths of a 95 % interval that a number may be off, 4.9 standard errors: chance exceeds it once in a million."""


class Check(NamedTuple):
    """One number that a closed form gives; allowed is how far the measured one may be from it."""

    name: str
    unit: str
    expected: float
    measured: float
    allowed: float

    @property
    def holds(self) -> bool:
        """NaN does not."""
        return abs(self.measured - self.expected) <= self.allowed


def within_interval(name: str, expected: float, found: Quantity, more: float = 0.0) -> Check:
    """A quantity whose interval tells how far it may be off.  more : that is allowed besides, in its unit."""
    half = found.high - found.value if expected > found.value else found.value - found.low
    return Check(name, found.unit or "1", expected, found.value, WIDER * half + more)


def check_table(title: str, checks: Sequence[Check], note: str = "") -> Table:
    """What must hold, row by row."""
    rows = [
        ("good" if c.holds else "bad", (*c, "holds" if c.holds else "fails")) for c in checks
    ]
    return table(
        title, "what | unit | closed form | measured | may differ by | verdict", rows, note
    )  # type: ignore[arg-type]


def all_hold(checks: Sequence[Check]) -> bool:
    """Every one of them."""
    return all(c.holds for c in checks)


def c4(frames: int) -> float:
    """Mean of the standard deviation of so many normal values over σ; 0.996040 for 64."""
    n = frames / 2
    return math.sqrt(1 / (n - 0.5)) * math.exp(math.lgamma(n) - math.lgamma(n - 0.5))
