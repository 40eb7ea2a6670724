"""core/progress.py: progress of long work, on a simulated clock."""

from __future__ import annotations

import io
import math
import sys

import pytest

from mitsuba_sensor.cli import progress as bars
from mitsuba_sensor.core import progress as progress_module
from mitsuba_sensor.core.progress import (
    EVERY_S,
    ProgressLines,
    automatic_progress,
    told_outside,
)
from mitsuba_sensor.render.passes.stop_criterion import (
    RenderProgress,
    standing,
    told_progress,
)


class Clock:
    """A clock that advances on demand."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> list[str]:
    """Lines on stderr, with progress on the simulated clock and without a thread."""
    said: list[str] = []
    monkeypatch.setattr(progress_module, "write_line", said.append)
    monkeypatch.setattr(bars, "write_line", said.append)
    monkeypatch.setattr(progress_module.time, "monotonic", clock)
    monkeypatch.setattr(ProgressLines.__init__, "__defaults__", (clock,))
    return said


def test_a_line_is_written_every_ten_seconds_and_none_before(clock: Clock) -> None:
    said: list[str] = []
    lines = ProgressLines(said.append, "loading the scene", clock)
    for _ in range(35):
        clock.now += 1
        lines.tick()
    assert len(said) == 3 and EVERY_S == 10
    assert said[0] == "loading the scene: 10 s so far"


def test_a_series_of_renders_counts_the_remaining_ones() -> None:
    series = {"frames": 4, "first_frame": 5, "render_noise": "per-frame"}
    step = RenderProgress(1, 10, seconds=20.0, frame=6)
    assert standing(step, series) == ("rendering frame 2 of 4", pytest.approx(1.1 / 4))
    assert standing(RenderProgress(7, 0, frame=6), series)[1] == 1 / 4
    once = {"frames": 3}
    assert standing(step, once) == ("rendering", 0.1)
    assert math.isnan(standing(RenderProgress(7, 0), once)[1]), "a noise ratio ends it"
    exposing = RenderProgress(1, 4, seconds=1.0, doing="exposing")
    assert standing(exposing, once) == ("exposing frame 2 of 4", 0.25)
    doing, fraction = standing(RenderProgress(3, 3, doing="exposing"), once)
    assert doing == "report and files" and math.isnan(fraction)


def test_a_render_in_python_shows_progress(clock: Clock, written: list[str]) -> None:
    with told_progress(None, "capture", {}) as tell:
        assert tell is not None
        clock.now += 9
        tell(RenderProgress(1, 10, seconds=9.0))
        assert not written
        clock.now += 1
        tell(RenderProgress(2, 8, seconds=10.0))
    assert written == ["capture: rendering: 25 %, 10 s so far"]


def test_nested_work_prints_nothing(clock: Clock, written: list[str]) -> None:
    with told_outside(), automatic_progress("render", "rendering") as teller:
        assert teller is None
    with automatic_progress("fit", "fitting"), automatic_progress("expose", "x") as inner:
        assert inner is None
    with automatic_progress("fit", "fitting") as teller:
        assert teller is not None


@pytest.mark.parametrize("stream", [None, io.StringIO()])
def test_a_missing_stderr_is_no_failure(
    stream: io.StringIO | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if stream is not None:
        stream.close()
    monkeypatch.setattr(sys, "stderr", stream)
    progress_module.write_line("rendering")
