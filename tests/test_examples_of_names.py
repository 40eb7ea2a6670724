"""Every public name has an example in its docstring; the quick ones run here."""

from __future__ import annotations

import inspect
import re
import textwrap
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive

import mitsuba_sensor as ms

NAMES = [name for name in ms.__all__ if name not in ("lab", "stages")]  # modules
NAMES += ["stages.Electrons", "stages.Frame"]
NAMES += [f"lab.{name}" for name in ms.lab.__all__ if name != "INSTRUMENTS"]  # a table

TESTED_ELSEWHERE = re.compile(
    r"ms\.(capture|render|render_frames|check_stage|differentiable|digital|raw_log_likelihood|register_plugins)\("
    r"|my\.toml|bench/|pairs/|irradiance\.exr|picture|scenes"
)
"""What renders, takes seconds, or needs a file of the user's; the pages of docs have the like."""

FEW_PIXELS = np.full((48, 64), 20_000.0)


def examples(docstring: str) -> Iterator[str]:
    """What stands indented behind a line ``::``."""
    for block in re.findall(r"^::\n((?:\n|    .*\n?)+)", docstring, re.M):
        yield textwrap.dedent(block)


@pytest.mark.parametrize("name", [exhaustive(x) if x in ("Plan", "plan") else x for x in NAMES])
def test_a_public_name_has_an_example_that_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All compile; what renders or needs a file of the user's is run by the tests of the pages."""
    found = list(examples(inspect.getdoc(attrgetter(name)(ms)) or ""))
    assert found, f"{name} has no example in its docstring"
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {
        "ms": ms,
        "np": np,
        "dataclass": dataclass,
        "warnings": warnings,
        "camera": ms.load_camera("konnik_table1"),
        "exposure": ms.Exposure(0.1),
        "photons": FEW_PIXELS,
    }
    for example in found:
        code = compile(example, name, "exec")
        if not TESTED_ELSEWHERE.search(example):
            with warnings.catch_warnings():
                exec(code, names)
