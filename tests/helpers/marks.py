"""Which cases of a claim every run of the tests has, and which ones only ``pytest -m exhaustive`` adds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def exhaustive(*values: Any, **options: Any) -> Any:
    """A case of ``parametrize`` that only the exhaustive tests have."""
    return pytest.param(*values, marks=pytest.mark.exhaustive, **options)


def one_in(every: int, cases: Iterable[Any], several: bool = False) -> list[Any]:
    """Cases of a parameter, of which one in ``every`` is in the quick tests; the others are exhaustive.

    several : whether a case is a tuple of the values of several parameters.
    """
    marked = []
    for number, case in enumerate(cases):
        values = case if several else (case,)
        marked.append(exhaustive(*values) if number % every else pytest.param(*values))
    return marked
