"""Measure tasks alternately, compute medians of ratios, run functions in child processes, print nested results.

Tasks run alternately so that other load on the machine affects all of them. A ratio is the median of the ratios of
single turns, because the two times of one turn were measured one after the other.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mitsuba_sensor.lab.statistics.estimators import ratio
from mitsuba_sensor.study.kit import time_in_turns

__all__ = ["alternate", "in_child", "lines", "ratio", "speeds"]

HERE = Path(__file__).resolve().parent


def alternate(tasks: Mapping[str, Callable[[], object]], turns: int) -> dict[str, list[float]]:
    """Return the seconds of every task in every turn after an uncounted one, divided by ``task.runs`` if set."""

    def counted(task: Callable[[], object]) -> int:
        task()
        return getattr(task, "runs", 1)

    return time_in_turns({name: partial(counted, task) for name, task in tasks.items()}, turns)


def speeds(
    seconds: Mapping[str, list[float]], pixels: int, base: str
) -> dict[str, dict[str, float]]:
    """Return median seconds, Mpx/s, and the speed relative to ``base`` of every task."""
    return {
        name: {
            "seconds": statistics.median(those),
            "mpx_per_s": pixels / statistics.median(those) / 1e6,
            f"ratio_to_{base}": ratio(seconds[base], those),
        }
        for name, those in seconds.items()
    }


def in_child(module: str, function: str, *arguments: Any, home: str | None = None) -> Any:
    """Run a function of a benchmark in a child process; return its value.

    home : the folder to use as ~, in which Dr.Jit stores compiled kernels.
    """
    code = f"import json, sys, {module}; print(json.dumps({module}.{function}(*json.loads(sys.argv[1]))))"
    environment = os.environ | ({"HOME": home} if home else {})
    command = [sys.executable, "-c", code, json.dumps(arguments)]
    done = subprocess.run(command, cwd=HERE, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{module}.{function} failed in its child process:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def lines(tree: Any, path: str = "") -> Iterator[str]:
    """Yield nested results as text: one line per group of values, after its keys."""
    if isinstance(tree, list):
        for row in tree:
            yield from lines(row, path)
        return
    here = {key: value for key, value in tree.items() if not isinstance(value, dict | list)}
    if here:
        yield f"{path}{'  '.join(f'{key} {_short(value)}' for key, value in here.items())}"
    for key, value in tree.items():
        if isinstance(value, dict | list):
            yield from lines(value, f"{path}{key}  " if isinstance(value, dict) else path)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
