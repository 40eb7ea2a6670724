"""Progress on the terminal while a command works."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from ..stopping import undone_if_stopped
from .tables import number

if TYPE_CHECKING:
    from ..render.passes.stop_criterion import RenderProgress
    from ..study.kit import Forecast

FILES = "report and files"  # the last step of a capture
SAID_AGAIN = (
    1.5  # a study says again how long it takes where that is so many times what it said before
)


class MovingBar(Progress):
    """A progress bar over seconds, which moves and counts down between the reports too."""

    def get_renderables(self) -> Iterable[RenderableType]:
        """What is drawn, ten times a second."""
        for task in self.tasks:
            if task.total is None:
                task.fields["share"] = task.fields["left"] = ""
            else:
                task.completed = min(time.monotonic() - task.fields["began"], task.total)
                task.fields["share"] = f"{task.percentage:3.0f} %"
                task.fields["left"] = f"about {minutes(task.total - task.completed)} left"
        return super().get_renderables()


@contextmanager
def render_progress(
    console: Console, options: Mapping[str, object], now: str = "loading the scene"
) -> Iterator[Callable[[RenderProgress], None]]:
    """A bar over the seconds of a render and of its frames, or over frames with a render each; nothing where nobody
    watches. While nothing is known of the end, it moves all the same.

    now : what is done at first.  Beside the bar the noise ratio as it falls, and a forecast. Yields what ``capture``
    takes as its progress.
    """
    frames, first = options.get("frames", 1), options.get("first_frame", 0)
    assert isinstance(frames, int) and isinstance(first, int)
    count = 1 if options.get("render_noise", "shared") == "shared" else frames
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[share]}"),
        TextColumn("{task.fields[ratio]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    bar = MovingBar(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar as progress, undone_if_stopped(bar.stop):
        task = progress.add_task(
            now, total=None, share="", ratio="", left="", began=time.monotonic()
        )

        def show(step: RenderProgress) -> None:
            name, over = (
                step_name(step, count),
                step.doing != "rendering" and math.isnan(step.seconds_left),
            )
            if over or name == FILES:  # another step begins, of which nothing is known
                progress.tasks[task].total = None
            ratio = (
                ""
                if math.isnan(step.noise_ratio)
                else f"render noise {number(step.noise_ratio)} × the sensor's"
            )
            progress.update(task, description=name, ratio=ratio)
            if not math.isnan(step.seconds_left) and name != FILES:
                others = (
                    0 if count == 1 else first + count - 1 - step.frame
                )  # frames after this one
                left_s = step.seconds_left + others * (step.seconds + step.seconds_left)
                progress.update(
                    task, total=time.monotonic() - progress.tasks[task].fields["began"] + left_s
                )

        yield show


def step_name(step: RenderProgress, renders: int) -> str:
    """What is done now.  renders : how many there are."""
    if step.doing == "exposing":
        return (
            FILES if step.done == step.expected else f"frame {step.done + 1} of {step.expected}"
        )
    return step.doing if renders == 1 else f"{step.doing} frame {step.frame}"


@contextmanager
def seconds_bar(console: Console) -> Iterator[Callable[[Forecast], None]]:
    """A bar over the seconds that a study is expected to take. Yields what a kit tells its forecasts.

    A line says how long it takes as soon as a step was measured, and again where that was much too short.
    """
    texts = (
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    bar = Progress(
        BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal
    )
    said_s = 0.0
    with bar as progress, undone_if_stopped(bar.stop):
        task = progress.add_task("", total=None)

        def tell(forecast: Forecast) -> None:
            nonlocal said_s
            left = f"about {minutes(max(forecast.total_s - forecast.done_s, 0.0))} left"
            if forecast.done_s and forecast.total_s > SAID_AGAIN * said_s:
                said_s = forecast.total_s
                longest = (
                    f", {minutes(forecast.longest_s)} of it for {forecast.longest}"
                    if forecast.longest
                    else ""
                )
                console.print(
                    f"this takes about {minutes(said_s)}{longest}",
                    highlight=False,
                    markup=False,
                )
            description = f"{left} [dim]{escape(forecast.now)}"
            progress.update(
                task, completed=forecast.done_s, total=forecast.total_s, description=description
            )

        yield tell


@contextmanager
def steps_bar(console: Console) -> Iterator[Callable[[int, int, str], None]]:
    """A bar over steps. Yields what is told how many are done, how many there are, and what is done now."""
    texts = (
        TextColumn("{task.completed:.0f} of {task.total:.0f}"),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    bar = Progress(
        BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal
    )
    with bar as progress, undone_if_stopped(bar.stop):
        task = progress.add_task("", total=1)
        yield lambda done, total, now: progress.update(
            task, completed=done, total=total, description=now
        )


def minutes(seconds: float) -> str:
    """A time that is still to pass, in a unit that suits it."""
    if seconds > 5400:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{seconds:.0f} s"
