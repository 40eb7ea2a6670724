"""How far long work is, where nobody sees a terminal: a line on stderr every ten seconds.

A thread asks for the line once a second, because one step may take minutes. Work inside other work that says how far it
is says nothing of its own.
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
"""Between two lines, and before the first one."""
TICK_S = 1.0

_told_outside: ContextVar[bool] = ContextVar("told_outside", default=False)


class ProgressLines:
    """What is done, as one line every ten seconds; none of work that takes less.  write : takes a line."""

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
        """What is done now, and the share of all work that is done; NaN where it is not known."""
        self._doing = f"{doing}: " + ("" if math.isnan(share) else f"{100 * share:.0f} %, ")

    def tick(self) -> None:
        """Write a line if the last one is ten seconds old."""
        now = self.clock()
        if now - self._written >= EVERY_S:
            self._written = now
            self._write(f"{self._doing}{duration(self.seconds)} so far")

    @property
    def seconds(self) -> float:
        """Since the work began."""
        return self.clock() - self._began


@contextmanager
def automatic_progress(
    name: str, doing: str, thread: bool = True
) -> Iterator[ProgressLines | None]:
    """While the block runs, say on stderr how far it is; yields None inside other work that is told of.

    name : of the function that was called.  doing : what is done at first.
    thread : whether a thread asks for it, too, while nothing is told; not for a generator, which waits for its caller.
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
    """While the block runs, work inside says nothing of its own."""
    before = _told_outside.set(True)
    try:
        yield
    finally:
        _told_outside.reset(before)


@contextmanager
def ticking(tick: Callable[[], object]) -> Iterator[None]:
    """While the block runs, a thread calls ``tick`` once a second."""
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
    """Whether progress is to be said without being asked how: None and True, not False. Raises InputError."""
    if progress is not None and not isinstance(progress, bool):
        raise InputError(
            f"progress is {progress!r}; it must be None (said automatically), False (silent) or, of a render, a "
            "function that is called with what is done."
        )
    return progress is not False


def write_line(line: str) -> None:
    """A line on stderr; nowhere if there is none."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def duration(seconds: float) -> str:
    """A time in a unit that suits it."""
    if seconds > 5400:
        return f"{seconds / 3600:.1f} h"
    if seconds > 90:
        return f"{seconds / 60:.1f} min"
    return f"{seconds:.0f} s"
