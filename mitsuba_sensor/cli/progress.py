"""How far a command is: a bar where stderr is a terminal, else a line every ten seconds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from ..core.printable import printable
from ..core.progress import ProgressLines, ticking, told_outside, write_line
from ..stopping import undone_if_stopped
from .tables import number

if TYPE_CHECKING:
    from ..dataset.run import RunProgress, Show
    from ..render.passes.stop_criterion import RenderProgress

WORKING = "working"
"""What a command does where it says nothing else."""


class CommandLines(ProgressLines):
    """The lines of the running command."""

    running: ClassVar[CommandLines | None] = None


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


@contextmanager
def share_bar(console: Console, now: str = WORKING) -> Iterator[Callable[..., None]]:
    """Show what is done now and the share of all work that is done, NaN (a bar that only moves) where no end is known.

    now : what is done at first.  Yields ``tell(doing, share, note)``.
    """
    columns = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[note]}")
    bar = Progress(
        BarColumn(),
        *columns,
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    task, lines = bar.add_task(now, total=None, note=""), CommandLines.running

    def tell(doing: str, share: float = math.nan, note: str = "") -> None:
        if lines is not None:
            lines.tell(doing, share)
        is_known = not math.isnan(share)
        bar.tasks[task].total = 1.0 if is_known else None
        note = f"{share:4.0%}  {note}" if is_known else note
        bar.update(task, completed=share if is_known else 0, description=doing, note=note)

    with bar, undone_if_stopped(bar.stop):
        tell(now)
        try:
            yield tell
        finally:
            if lines is not None:
                lines.tell(WORKING)


@contextmanager
def render_progress(
    console: Console, options: Mapping[str, object], now: str = "loading the scene"
) -> Iterator[Callable[[RenderProgress], None]]:
    """A bar over a render and its frames, with the noise ratio as it falls. Yields what ``capture`` takes as its
    progress."""
    from ..render.passes.stop_criterion import standing

    with share_bar(console, now) as tell:

        def show(step: RenderProgress) -> None:
            ratio = step.noise_ratio
            note = "" if math.isnan(ratio) else f"render noise {number(ratio)} × the sensor's"
            tell(*standing(step, options), note)

        yield show


@contextmanager
def steps_bar(
    console: Console, now: str = WORKING
) -> Iterator[Callable[[int, int, str], None]]:
    """A bar over steps. Yields what is told how many are done, how many there are, and what is done now."""
    with share_bar(console, now) as tell:

        def show(done: int, total: int, doing: str) -> None:
            counted = f"{doing}, {done} of {total}" if total > 1 else doing
            tell(counted, done / total if total else 0.0)

        yield show


@contextmanager
def samples_bar(console: Console) -> Iterator[Show]:
    """A bar over samples, with their rate and failures. Yields what :func:`dataset.run` shows to."""
    began = time.monotonic()
    with share_bar(console, "starting") as tell:

        def show(progress: RunProgress) -> None:
            doing, share = progress.standing(time.monotonic() - began)
            tell(f"{progress.counted()}, {doing}", share)

        yield show
