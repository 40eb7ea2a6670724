"""Small inputs on which strangers found the product wrong, each with its right value or the sentence that it gets.

tests/data/cases has the inputs; README.md there and README in each folder tell what happened and what is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from helpers import DATA

CASES = DATA / "cases"
Check = Callable[[], None]
CHECKS: dict[str, Check] = {}
"""Name of a case, the beginning of its file's or folder's name → what must hold."""

PENDING = {
    *("01", "02", "03", "04", "05", "07", "09", "11", "12", "13"),
    *("2026-11-29_01", "2026-11-29_03", "2026-11-29_04", "2026-11-29_05", "2026-11-29_06"),
    *("2026-11-29_08", "2026-11-29_09", "2026-11-29_10", "2026-11-29_11", "2026-11-29_12"),
    *("2026-11-29_14", "2026-11-29_16"),
}
"""Cases that have no row yet."""


def case(name: str) -> Callable[[Check], Check]:
    """Enter the decorated check into the table."""

    def enter(check: Check) -> Check:
        CHECKS[name] = check
        return check

    return enter


def names_of_inputs() -> set[str]:
    """The numbers that inputs begin with: 01, 2026-11-29_01."""
    names = (re.match(r"(2026-11-29_)?\d\d(?=_)", path.name) for path in CASES.iterdir())
    return {name.group() for name in names if name}


def test_each_input_has_a_row() -> None:
    assert {*CHECKS} | PENDING == names_of_inputs()


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_case(name: str) -> None:
    CHECKS[name]()
