"""How far long work is, where nobody sees a terminal: a line every ten seconds, or a bar in a notebook.

A thread asks for the line once a second, because one step may take minutes. Work inside other work that says how far it
is says nothing of its own.
"""

from __future__ import annotations

import html
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from types import ModuleType
from typing import Any, Protocol

from .errors import InputError

EVERY_S = 10.0
"""Between two lines, and before the first one."""
BAR_AFTER_S = 2.0
"""A bar in a notebook appears where work takes longer."""
TICK_S = 1.0

_told_outside: ContextVar[bool] = ContextVar("told_outside", default=False)


class Teller(Protocol):
    """Says how far work is."""

    @property
    def seconds(self) -> float:
        """Since the work began."""

    def tell(self, doing: str, share: float = math.nan) -> None:
        """What is done now, and the share of all work that is done; NaN where it is not known."""

    def tick(self) -> None:
        """Say it, if it is time."""


class Standing:
    """What was told last, and how long the work has taken so far.  clock : [s]."""

    def __init__(self, doing: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.began = clock()
        self.tell(doing)

    def tell(self, doing: str, share: float = math.nan) -> None:
        """See :class:`Teller`."""
        self.doing, self.share = doing, share

    @property
    def seconds(self) -> float:
        """Since the work began."""
        return self.clock() - self.began

    def text(self) -> str:
        """What is done, how much of it, and the time so far."""
        share = "" if math.isnan(self.share) else f"{100 * self.share:.0f} %, "
        return f"{self.doing}: {share}{duration(self.seconds)} so far"


class ProgressLines(Standing):
    """One line every ten seconds; none of work that takes less.  write : takes a line."""

    def __init__(
        self,
        write: Callable[[str], object],
        doing: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(doing, clock)
        self._write, self._said = write, self.began

    def tick(self) -> None:
        """Write a line if the last one is ten seconds old."""
        if self.clock() - self._said >= EVERY_S:
            self._said = self.clock()
            self._write(self.text())

    def close(self) -> None:
        """Nothing is left to be taken away."""


class NotebookBar(Standing):
    """A bar below the cell of a notebook, which goes when the work ends.  module : IPython.display."""

    def __init__(
        self,
        module: ModuleType | Any,
        doing: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(doing, clock)
        self._module = module
        self._handle: Any = None

    def tick(self) -> None:
        """Draw the bar as it is now."""
        if self.seconds < BAR_AFTER_S:
            return
        share = self.share
        if math.isnan(share):
            value = ""
        else:
            value = f' value="{share:.3f}"'
        self._draw(f"<progress{value}></progress> {html.escape(self.text())}")

    def close(self) -> None:
        """Take the bar away."""
        if self._handle is not None:
            self._draw("")

    def _draw(self, text: str) -> None:
        shown = self._module.HTML(text)
        if self._handle is None:
            self._handle = self._module.display(shown, display_id=True)
        else:
            self._handle.update(shown)


@contextmanager
def automatic_progress(name: str, doing: str, thread: bool = True) -> Iterator[Teller | None]:
    """While the block runs, say how far it is: a bar in a notebook, lines on stderr elsewhere.

    name : of the function that was called.  doing : what is done at first.
    thread : whether a thread asks for it, too, while nothing is told; not for a generator, which waits for its caller.
    Yields None inside other work that is told of.
    """
    if _told_outside.get():
        yield None
        return
    display = notebook_display()
    teller: ProgressLines | NotebookBar
    if display is None:
        teller = ProgressLines(lambda line: write_line(f"{name}: {line}"), doing)
    else:
        teller = NotebookBar(display, doing)
    try:
        if thread:
            with told_outside(), ticking(teller.tick):
                yield teller
        else:
            yield teller
    finally:
        teller.close()


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


def notebook_display() -> ModuleType | None:
    """IPython.display where a notebook shows what is displayed, else None."""
    python = sys.modules.get("IPython")
    if python is not None:
        shell = python.get_ipython()
    else:
        shell = None
    if getattr(shell, "kernel", None) is None:
        return None
    from importlib import import_module

    return import_module("IPython.display")


def duration(seconds: float) -> str:
    """A time in a unit that suits it."""
    if seconds > 5400:
        return f"{seconds / 3600:.1f} h"
    if seconds > 90:
        return f"{seconds / 60:.1f} min"
    return f"{seconds:.0f} s"
