"""How a study measures: one key after the other, looked up before it is measured; what is timed takes turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from typing import Any

from .page import Progress


@dataclass(frozen=True)
class Step:
    """One measurement. key : under which it is kept.  seconds : expected.  measure : gives what JSON can hold."""

    key: str
    seconds: float
    words: str
    measure: Callable[[], Any]


def take_steps(steps: Sequence[Step], done: MutableMapping[str, Any], progress: Progress) -> None:
    """Every step that is not in ``done`` yet, in order; its result goes there.

    What is left is expected to take as much longer or shorter as the steps so far did.
    """
    left = [step for step in steps if step.key not in done]
    started, pace, hoped = time.perf_counter(), 1.0, 0.0
    for number, step in enumerate(left):
        spent = time.perf_counter() - started
        progress(spent, spent + pace * sum(one.seconds for one in left[number:]), step.words)
        done[step.key] = step.measure()
        hoped += step.seconds
        pace = (time.perf_counter() - started) / hoped
    spent = time.perf_counter() - started
    progress(spent, spent, "done")


def one_turn(tasks: Mapping[str, Callable[[], int]]) -> dict[str, float]:
    """Seconds of every task, one after the other; a task returns how many times it did its work, which divides them.

    A machine that slows down then slows all tasks alike.
    """
    seconds = {}
    for name, task in tasks.items():
        start = time.perf_counter()
        runs = task()
        seconds[name] = (time.perf_counter() - start) / runs
    return seconds


@dataclass(frozen=True)
class Spread:
    """Median of what several turns gave, and the quartiles."""

    median: float
    low: float
    high: float


def spread(values: Iterable[float]) -> Spread:
    """Of two values or more."""
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return Spread(middle, low, high)
