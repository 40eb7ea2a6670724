"""Rules of the tests: none reads a clock, none makes a dataset of a scene of the checkout, every module has quick ones.

On a busy machine a test that reads a clock fails. Forecasts run on a test's own clock; speeds belong to benchmarks.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
MODULES = sorted(TESTS.rglob("test_*.py"))
WAITS = TESTS / "helpers" / "waiting.py"
"""Waits for other processes end with a failure instead of never, and need a clock for that."""

CLOCKS = {
    "monotonic",
    "perf_counter",
    "process_time",
    "thread_time",
    "clock_gettime",
    "ru_utime",
    "ru_stime",
}
CLOCKS |= {f"{name}_ns" for name in CLOCKS if "ru_" not in name}
CLOCKS_OF_MODULES = {
    ("time", "time"),
    ("time", "time_ns"),
    ("os", "times"),
    ("datetime", "now"),
}
MODULES_WITH_CLOCKS = {"timeit", "cProfile", "profile"}


A_CLOCK = re.compile(
    rf"import time|from time|datetime|\.times\b|{'|'.join(CLOCKS | MODULES_WITH_CLOCKS)}"
)
"""What stands in a module that may read a clock: the others are not parsed."""


def clock_reads(tree: ast.Module) -> Iterator[str]:
    """Each clock that a module imports or calls, with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = {alias.name for alias in node.names} & MODULES_WITH_CLOCKS
        elif isinstance(node, ast.ImportFrom):
            imported = {alias.name for alias in node.names}
            names = {
                name
                for name in imported
                if name in CLOCKS or (node.module, name) in CLOCKS_OF_MODULES
            }
            names |= {node.module or ""} & MODULES_WITH_CLOCKS
        elif isinstance(node, ast.Attribute):
            owner = getattr(node.value, "attr", getattr(node.value, "id", ""))
            is_clock = node.attr in CLOCKS or (owner, node.attr) in CLOCKS_OF_MODULES
            names = {node.attr} if is_clock else set()
        else:
            continue
        for name in names:
            yield f"{name} in line {node.lineno}"


def test_no_test_reads_a_clock() -> None:
    reads = {
        path.relative_to(TESTS).as_posix(): found
        for path in (*MODULES, *TESTS.rglob("helpers/*.py"), TESTS / "conftest.py")
        if path != WAITS
        and A_CLOCK.search(text := path.read_text(encoding="utf-8"))
        and (found := list(clock_reads(ast.parse(text))))
    }
    assert not reads, reads


def test_every_module_has_quick_tests() -> None:
    without = []
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        if text.count("pytest.mark.exhaustive") < text.count("def test_"):
            continue
        tree = ast.parse(text)
        tests = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
        ]
        marks = [{ast.unparse(mark) for mark in test.decorator_list} for test in tests]
        if all("pytest.mark.exhaustive" in names for names in marks) and tests:
            without.append(path.relative_to(TESTS).as_posix())
    assert not without, without


OF_CHECKOUT = re.compile(
    r"""\bfile["']?\s*[=:]\s*["'](\./|\.\./)*scenes/|helpers\.scenes import .*\bSCENES\b|ROOT / ["']scenes"""
)
"""How a test would name a scene of the checkout for a dataset."""


def test_datasets_of_tests_are_of_scenes_of_the_package() -> None:
    """Where the package is installed, a scene of the checkout is another file, with another name in the record."""
    paths = [*TESTS.glob("dataset/*.py"), *TESTS.glob("helpers/*datasets.py")]
    assert len(paths) > 15
    named = [path.name for path in paths if OF_CHECKOUT.search(path.read_text("utf-8"))]
    assert not named, named
