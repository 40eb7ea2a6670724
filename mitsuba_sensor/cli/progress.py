"""Progress of a command: a bar if stderr is a terminal, else a line every ten seconds."""

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
"""Shown while a command reports no step."""


class CommandLines(ProgressLines):
    """Progress lines of the running command."""

    running: ClassVar[CommandLines | None] = None


@contextmanager
def lines_while_working(
    is_terminal: bool, clock: Callable[[], float] = time.monotonic
) -> Iterator[None]:
    """Report the progress of a command every ten seconds while the block runs, unless a terminal shows bars."""
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
    """Show the current step and the fraction of all work done; NaN shows a moving bar.

    now : the first step.  Yields ``tell(doing, share, note)``.
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
        note = f"{100 * share:3.0f} %  {note}" if is_known else note
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
    """Show a bar for a render and its frames, with the falling noise ratio. Yields the ``progress`` of ``capture``."""
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
) -> Iterator[Callable[[float, int, str], None]]:
    """Show a bar for steps. Yields a function of the number done, the total and the current step."""
    with share_bar(console, now) as tell:

        def show(done: float, total: int, doing: str) -> None:
            tell(doing, done / total if total else 0.0)

        yield show


@contextmanager
def samples_bar(console: Console) -> Iterator[Show]:
    """Show a bar for samples, with their rate and failures. Yields the ``progress`` of :func:`dataset.run`."""
    began = time.monotonic()
    with share_bar(console, "starting") as tell:

        def show(progress: RunProgress) -> None:
            doing, share = progress.standing(time.monotonic() - began)
            tell(f"{progress.counted()}, {doing}", share)

        yield show
