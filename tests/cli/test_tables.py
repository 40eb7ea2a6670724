"""Tables of the terminal at several widths: no number is cut, and none is finer than what matters."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import re
import subprocess
import sys
from typing import Any

import pytest
from rich.console import Console, RenderableType

import mitsuba_sensor as ms
from mitsuba_sensor.cli import progress as progress_module
from mitsuba_sensor.cli import terminal
from mitsuba_sensor.cli.study_sheet import study_sheet
from mitsuba_sensor.cli.tables import number, rough
from mitsuba_sensor.pages.page import Section, Table, study_of
from mitsuba_sensor.render.passes.stop_criterion import RenderProgress

WIDTHS = (40, 60, 80, 120)
WHOLE = 400  # characters, in which every table stands in one block
HARD = (
    13093.0,
    8.8e-13,
    1.2e-115,
    1e9,
    123456.7,
    0.00012345,
    3.14159e-5,
    2345678.9,
    0.5,
    99999.9,
)


def shown(what: RenderableType, width: int) -> str:
    console = Console(record=True, width=width, file=io.StringIO(), color_system=None)
    console.print(what, highlight=False, crop=False)
    return console.export_text()


def numbers(text: str) -> list[str]:
    """Every number of a text, as it stands there; names of stages and files have none."""
    return sorted(re.findall(r"(?<![\w.])<?-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])", text))


def sheets(light: Any) -> dict[str, Any]:
    """Every table of terminal.py, with hard numbers: name → a function of the width."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    plan = ms.plan(camera, exposure, ms.collect(light, camera, exposure), tolerance_dn=0.02)
    names = ("mean_dn", "temporal_dn", "spatial_dn", "structure_dn")
    effects = [
        dataclasses.replace(
            one, **{name: HARD[(i + k) % len(HARD)] for k, name in enumerate(names)}
        )
        for i, one in enumerate(plan.effects)
    ]
    vars(plan)["effects"] = tuple(effects)
    spread = {
        f"map_{chr(97 + i)}": {"shape": (1200, 1920), "mean": x, "sigma": x / 3}
        for i, x in enumerate(HARD)
    }
    rows = tuple(
        (f"case {chr(97 + i)}", *(HARD[(i + k) % len(HARD)] for k in range(9)))
        for i in range(len(HARD))
    )
    columns = ("case", *(f"column {chr(97 + k)}" for k in range(9)))
    study = study_of("stress", "hard", [Section((), True, (Table("table", columns, rows),))])
    return {
        "plan": lambda width: terminal.plan_sheet(plan),
        "maps": lambda width: terminal.map_list(spread, "maps.npz"),
        "study": lambda width: study_sheet(study, "study.html"),
    }


@pytest.fixture(scope="module")
def made(light: Any) -> dict[str, Any]:
    return sheets(light)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["plan", "maps", "study"])
def test_every_number_of_a_narrow_table_is_whole(
    name: str, width: int, made: dict[str, Any]
) -> None:
    """A terminal that is too narrow gets a table wider than itself."""
    narrow = shown(made[name](width), width)
    assert numbers(narrow) == numbers(shown(made[name](WHOLE), WHOLE))
    assert "8.8e-13" not in narrow or name == "study", "finer than what matters"


def test_the_first_line_of_a_frame_names_gain_setting_and_system_gain(light: Any) -> None:
    exposure = ms.Exposure(0.1)
    for camera, said in (
        (ms.load_camera("konnik_table1"), "konnik_table1, K = 0.1241 DN/e-, 0.1 s"),
        (ms.load_camera("sony_a7s2").at_gain(3200), "sony_a7s2 at gain 3200, K = 3.06 DN/e-"),
        (ms.load_camera("sony_a7s2"), "sony_a7s2 at no gain setting, K = 0.09563 DN/e-"),
    ):
        found = ms.capture(light, camera, exposure)
        head = shown(terminal.summary({**found.metadata, "times_s": {}}, "out"), WHOLE)
        assert head.startswith(said)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (0.0, "0"), (1.2e-115, "0"), (-8.8e-13, "0"), (4.9e-5, "0"), (0.00012345, "0.0001"),
        (0.012345, "0.0123"), (0.5, "0.5"), (12.3456, "12.35"), (13093.2, "13093"), (1e9, "1e+09"), (-0.25, "-0.25"),
    ],
)  # fmt: skip
def test_numbers_have_four_digits_and_at_most_four_decimals(
    value: float | None, text: str
) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1.2e-115, "<0.001"), (0.0123, "0.012"), (13093.0, "13093"), (1e9, "1e+09")],
)
def test_rough_numbers_say_where_they_are_too_small_to_matter(value: float, text: str) -> None:
    assert rough(value) == text


def test_the_bar_says_what_is_done_and_no_share_where_no_end_is_known() -> None:
    console = Console(width=100, file=io.StringIO(), force_terminal=True, color_system=None)
    with progress_module.render_progress(console, {}, "reading the light") as progress:
        bar = console._live_stack[-1]

        def after(step: RenderProgress) -> str:
            progress(step)
            return drawn(bar)

        assert "reading the light" in drawn(bar) and "%" not in drawn(bar)
        assert "rendering" in after(RenderProgress(1, 10)) and "10%" in drawn(bar)
        assert "%" not in after(RenderProgress(30, 0, 0.25)), "a noise ratio ends it"
        assert "render noise 0.25 × the sensor's" in drawn(bar)
        assert "denoising" in after(RenderProgress(0, 0, doing="denoising"))
        assert "%" not in drawn(bar)
        assert "frame 2 of 4" in after(RenderProgress(1, 4, doing="exposing"))
        assert "25%" in drawn(bar)
        assert "report and files" in after(RenderProgress(4, 4, doing="exposing"))
        assert "%" not in drawn(bar) and "left" not in drawn(bar)


def drawn(live: Any) -> str:
    return shown(live.get_renderable(), 100)


@pytest.mark.exhaustive
def test_a_terminal_without_our_letters_gets_question_marks() -> None:
    """As through a pipe of Windows, or in the locale POSIX; JSON stays whole."""
    command = [sys.executable, "-m", "mitsuba_sensor", "cameras", "show", "konnik_table1"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    shown, data = (
        subprocess.run([*command, *x], capture_output=True, env=environment)
        for x in ([], ["--json"])
    )
    assert shown.returncode == data.returncode == 0 and not shown.stderr + data.stderr
    assert "?m" in shown.stdout.decode("ascii")
    assert "5.7 µm" in json.loads(data.stdout)["description"]
