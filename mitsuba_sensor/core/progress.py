"""Progress of long work without a terminal: a line on stderr every ten seconds.

A thread checks once a second whether a line is due, because a single step may take minutes. Nested work is silent.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

from .errors import InputError

EVERY_S = 10.0
"""Time between two lines, and before the first line."""
TICK_S = 1.0

_told_outside: ContextVar[bool] = ContextVar("told_outside", default=False)


class ProgressLines:
    """A line of progress every ten seconds; shorter work is silent.  write : takes a line."""

    def __init__(
        self,
        write: Callable[[str], object],
        doing: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.clock, self._write = clock, write
        self._began = self._written = clock()
        self.tell(doing)

    def tell(self, doing: str, share: float = math.nan) -> None:
        """Set the current activity and the completed fraction of the work; NaN if unknown."""
        self._doing = f"{doing}: " + ("" if math.isnan(share) else f"{100 * share:.0f} %, ")

    def tick(self) -> None:
        """Write a line if the last line is ten seconds old."""
        now = self.clock()
        if now - self._written >= EVERY_S:
            self._written = now
            self._write(f"{self._doing}{duration(self.seconds)} so far")

    @property
    def seconds(self) -> float:
        """Time since the work began [s]."""
        return self.clock() - self._began


@contextmanager
def automatic_progress(
    name: str, doing: str, thread: bool = True
) -> Iterator[ProgressLines | None]:
    """Report progress on stderr while the block runs; yields None inside other reported work.

    name : of the called function.  doing : first activity.
    thread : also report between calls of ``tell``; False for a generator, which waits for its caller.
    """
    if _told_outside.get():
        yield None
        return
    lines = ProgressLines(lambda line: write_line(f"{name}: {line}"), doing)
    if not thread:
        yield lines
        return
    with told_outside(), ticking(lines.tick):
        yield lines


@contextmanager
def told_outside() -> Iterator[None]:
    """Silence the automatic progress of nested work while the block runs."""
    before = _told_outside.set(True)
    try:
        yield
    finally:
        _told_outside.reset(before)


@contextmanager
def ticking(tick: Callable[[], object]) -> Iterator[None]:
    """Call ``tick`` once a second in a thread while the block runs."""
    over = threading.Event()

    def run() -> None:
        while not over.wait(TICK_S):
            tick()

    thread = threading.Thread(target=run, name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def is_asked(progress: object) -> bool:
    """Return True if progress is automatic: for None and True, not for False. Raises InputError."""
    if progress is not None and not isinstance(progress, bool):
        raise InputError(
            f"progress is {progress!r}; it must be None (automatic), False (silent) or, for a render, a function that "
            "receives the progress."
        )
    return progress is not False


def write_line(line: str) -> None:
    """Write a line to stderr, if it exists."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def duration(seconds: float) -> str:
    """Return a time in h, min or s."""
    if seconds > 5400:
        return f"{seconds / 3600:.1f} h"
    if seconds > 90:
        return f"{seconds / 60:.1f} min"
    return f"{seconds:.0f} s"
