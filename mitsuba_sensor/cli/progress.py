"""How far a command is: bars where stderr is a terminal, else a line every ten seconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)

from ..stopping import undone_if_stopped
from .lines import WORKING, CommandLines
from .tables import number

if TYPE_CHECKING:
    from ..dataset.run import RunProgress, Show
    from ..render.passes.stop_criterion import RenderProgress


@contextmanager
def shown_bar(bar: Progress, doing: str = "", **fields: Any) -> Iterator[TaskID]:
    """While the block runs, the bar is drawn, where a terminal shows it; otherwise lines say what is done."""
    lines = CommandLines.running or CommandLines(lambda line: None, doing)
    with lines.step(doing or WORKING), bar, undone_if_stopped(bar.stop):
        yield bar.add_task(doing, total=None, **fields)


def _tell(doing: str, share: float = float("nan")) -> None:
    """To the lines, if there are any."""
    if CommandLines.running is not None:
        CommandLines.running.tell(doing, share)


@contextmanager
def render_progress(
    console: Console, options: Mapping[str, object], now: str = "loading the scene"
) -> Iterator[Callable[[RenderProgress], None]]:
    """A bar over the passes of a render and over its frames, or over frames with a render each.

    While nothing is known of the end, it moves all the same.

    now : what is done at first.  Beside the bar the noise ratio as it falls, and the time so far. Yields what
    ``capture`` takes as its progress.
    """
    from ..render.passes.stop_criterion import Series

    series = Series(options)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[share]}"),
        TextColumn("{task.fields[ratio]}"),
        TimeElapsedColumn(),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with shown_bar(bar, now, share="", ratio="") as task:

        def show(step: RenderProgress) -> None:
            doing, share = series.standing(step)
            _tell(doing, share)
            is_known = share == share  # not NaN
            bar.tasks[task].total = 1.0 if is_known else None
            ratio = ""
            if step.noise_ratio == step.noise_ratio:
                ratio = f"render noise {number(step.noise_ratio)} × the sensor's"
            done, percent = (share, f"{share:3.0%}") if is_known else (0.0, "")
            bar.update(task, completed=done, description=doing, share=percent, ratio=ratio)

        yield show


@contextmanager
def share_bar(console: Console) -> Iterator[Callable[[str, float], None]]:
    """A bar over the work of a study. Yields what a kit tells: the step that begins, and the share that is done."""
    texts = (
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    bar = Progress(
        BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal
    )
    with shown_bar(bar) as task:

        def tell(now: str, share: float) -> None:
            _tell(now, share)
            bar.update(task, completed=share, total=1.0, description=now)

        yield tell


@contextmanager
def steps_bar(console: Console, now: str = "") -> Iterator[Callable[[int, int, str], None]]:
    """A bar over steps. Yields what is told how many are done, how many there are, and what is done now.

    now : what is done at first.
    """
    texts = (
        TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    bar = Progress(
        BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal
    )
    with shown_bar(bar, now) as task:
        bar.update(task, total=1)

        def tell(done: int, total: int, doing: str) -> None:
            share = 0.0
            if total:
                share = done / total
            _tell(f"{doing}, {done} of {total}" if total > 1 else doing, share)
            bar.update(task, completed=done, total=total, description=doing)

        yield tell


@contextmanager
def samples_bar(console: Console) -> Iterator[Show]:
    """A bar over samples, with the rate, the time so far and failures. Yields what :func:`dataset.run` shows to."""
    texts = (
        MofNCompleteColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    bar = Progress(
        BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal
    )
    began = time.monotonic()
    with shown_bar(bar, "starting") as task:

        def tell(progress: RunProgress) -> None:
            doing, share = progress.standing(time.monotonic() - began)
            _tell(f"{progress.counted()}, {doing}", share)
            bar.update(task, total=progress.samples, completed=progress.done, description=doing)

        yield tell
