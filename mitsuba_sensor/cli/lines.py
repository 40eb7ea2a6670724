"""Lines on stderr that say how far a command is, where stderr is no terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..core.printable import printable
from ..core.progress import ProgressLines, ticking, told_outside, write_line

WORKING = "working"
"""What a command does where it says nothing else."""


class CommandLines(ProgressLines):
    """The lines of the running command; steps tell what they do, and are forgotten when they end."""

    running: CommandLines | None = None

    @contextmanager
    def step(self, doing: str) -> Iterator[None]:
        """While the block runs, this is done, or what is told meanwhile."""
        self.tell(doing)
        try:
            yield
        finally:
            self.tell(WORKING)


@contextmanager
def lines_while_working(
    is_terminal: bool, clock: Callable[[], float] = time.monotonic
) -> Iterator[None]:
    """While the block runs, a command says every ten seconds how far it is, unless a terminal shows bars."""
    with told_outside():
        if is_terminal:
            yield
            return
        lines = CommandLines(lambda line: write_line(printable(line)), WORKING, clock)
        CommandLines.running = lines
        try:
            with ticking(lines.tick):
                yield
        finally:
            CommandLines.running = None
