"""Threads of the host: their number, and work that the calling thread shares with others."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Value = TypeVar("Value")


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def for_each(work: Callable[[Value], object], items: Iterable[Value]) -> None:
    """Call ``work(item)`` for all items, in this thread and in those of other processors."""
    left = deque(items)

    def run() -> None:
        while True:
            try:
                item = left.popleft()
            except IndexError:
                return
            work(item)

    others = [_helpers().submit(run) for _ in range(min(processors(), len(left)) - 1)]
    run()
    for other in others:
        if not other.cancel():  # it has begun
            other.result()


@cache
def _helpers() -> ThreadPoolExecutor:
    """Return the kept threads: starting one takes milliseconds while Dr.Jit's threads wait for a kernel."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(
            after_in_child=_helpers.cache_clear
        )  # a child has none of the threads
    return ThreadPoolExecutor(max(processors() - 1, 1))
