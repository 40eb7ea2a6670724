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

import numpy as np
import pytest
from helpers.marks import one_in
from rich.console import Console, RenderableType

import mitsuba_sensor as ms
from mitsuba_sensor.cli import progress as progress_module
from mitsuba_sensor.cli import terminal
from mitsuba_sensor.cli.catalogue import _field_table
from mitsuba_sensor.cli.study_sheet import study_sheet
from mitsuba_sensor.cli.tables import FittedTable, number, rough
from mitsuba_sensor.pages.page import Grid, Section, Table, study_of
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
    console.print(what, highlight=False)
    return console.export_text()


def numbers(text: str) -> list[str]:
    """Every number of a text, as it stands there; names of stages and files have none."""
    return sorted(re.findall(r"(?<![\w.])<?-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])", text))


def sheets(light: Any) -> dict[str, Any]:
    """Every table of terminal.py, with hard numbers: name → a function of the width."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    found = ms.capture(light, camera, exposure)
    report = {
        **found.metadata,
        "times_s": {},
        "render": {**found.metadata["render"], "notes": []},
    }
    keys = ("mean_frame", "mean_expected", "sigma_frame", "sigma_expected")
    report["stages"] = [
        {**stage, **{key: HARD[(i + k) % len(HARD)] for k, key in enumerate(keys)}}
        for i, stage in enumerate(report["stages"])
    ]
    report["effects"] = [
        {**one, "temporal_dn": HARD[i % len(HARD)], "spatial_dn": HARD[-i % len(HARD)]}
        for i, one in enumerate(report["effects"])
    ]
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
    texts = (tuple(f"{x + 1:.3g}" for x in HARD),) * 2
    grid = Grid(
        "grid",
        ("r", "s"),
        tuple(f"the {chr(97 + k)}" for k in range(10)),
        (("good",) * 10,) * 2,
        texts,
    )
    study = study_of(
        "stress", "hard", [Section((), True, (Table("table", columns, rows), grid))]
    )
    return {
        "stages": lambda width: terminal.summary(report, "out"),
        "plan": lambda width: terminal.plan_sheet(plan),
        "maps": lambda width: terminal.map_list(spread, "maps.npz"),
        "study": lambda width: study_sheet(study, "study.html", width),
    }


@pytest.fixture(scope="module")
def made(light: Any) -> dict[str, Any]:
    return sheets(light)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", one_in(2, ["stages", "plan", "maps", "study"]))
def test_every_number_of_a_narrow_table_is_one_of_the_whole_table(
    name: str, width: int, made: dict[str, Any]
) -> None:
    """Nothing but whole columns of a study is left out, as the sentence below its table says."""
    whole, narrow = shown(made[name](WHOLE), WHOLE), shown(made[name](width), width)
    assert max(map(len, narrow.splitlines())) <= width and "…" not in narrow.replace(" … ", " ")
    left_out = re.findall(r"(\d+) more columns", narrow)
    found, known = numbers(narrow), numbers(whole)
    if name == "study":
        assert set(found) - set(left_out) <= set(known) and (left_out or width >= 120)
    else:
        assert found == known and "8.8e-13" not in narrow, (
            "a number is missing, or cut, or too fine"
        )
    assert "e-115" not in narrow


def test_all_columns_of_a_narrow_table_follow_in_blocks_that_name_their_rows() -> None:
    table = FittedTable(("name", "one", "two", "three"))
    table.add_row("first row", "1111111111", "2222222222", "3333333333")
    said = shown(table, 24)
    assert len(re.findall("first row", said)) == 3 and numbers(said) == [
        "1111111111",
        "2222222222",
        "3333333333",
    ]
    assert shown(table, 80).count("first row") == 1


def test_a_sigma_that_few_bright_pixels_make_is_printed_with_its_standard_error() -> None:
    """PRNU has σ = prnu·√(mean of N²) over all pixels, and the theory samples them: within four standard errors."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    photons = np.full((200, 300), 1e3)
    uniform = ms.expose(photons, camera, exposure)
    photons[::67, ::101] = 1e8
    few = ms.expose(photons, camera, exposure)
    for frames, is_uncertain in ((uniform, False), (few, True)):
        stage = frames.report["stages"][1]
        exact_e = camera.pixel.prnu * np.sqrt((np.asarray(frames.detected.mean_e) ** 2).mean())
        error_e = terminal._error_of_sigma(stage)
        assert stage["name"] == "PRNU"
        assert abs(stage["sigma_expected"] - exact_e) < 4 * error_e
        assert terminal._is_uncertain(stage) == is_uncertain


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


def texts_without_blanks(text: str) -> set[str]:
    return {piece for piece in text.split() if "─" not in piece}


@pytest.mark.parametrize("width", one_in(2, [60, 80, 120]))
@pytest.mark.parametrize("camera", one_in(6, ms.list_cameras()))
def test_no_name_and_no_text_of_a_camera_is_split(camera: str, width: int) -> None:
    """Whatever stands between two blanks at this width does so in a table with all the width there is.

    The exceptions are addresses, at their slashes, and at 60 columns names within the texts, between their parts, that
    are wider than what the names of the fields leave.
    """
    table = _field_table(ms.load_camera(camera))
    narrow, whole = shown(table, width), shown(table, 2000)
    assert max(map(len, narrow.splitlines())) <= width
    ends = "/" if width > 60 else "/._-"
    pieces = texts_without_blanks(whole)
    for text in texts_without_blanks(narrow):
        at_ends = rf"(^|[{ends}]){re.escape(text)}" + ("" if text[-1] in ends else "$")
        assert any(re.search(at_ends, piece) for piece in pieces), text
    fields = [line.split()[0] for line in whole.splitlines()[3:-1]]
    assert [name for name in fields if name not in texts_without_blanks(narrow)] == []


@pytest.mark.parametrize("width", [24, 40, 60])
def test_rows_and_texts_of_later_blocks_are_whole(width: int) -> None:
    """Addresses break behind slashes, names between their parts; rows of blanks are left out."""
    table = FittedTable(("name", "value", "source"))
    table.add_row("first_name.of_two_parts", "value", "https://example.org/one/two/three.html")
    table.add_row("second", "a_long_value_of_parts", "")
    narrow = shown(table, width)
    assert max(map(len, narrow.splitlines())) <= width
    joined = "".join(narrow.split())
    for part in ("first_", "parts", "https://", "example.org/", "three.html", "second"):
        assert part in joined
    assert narrow.count("second") == 1


def test_a_name_breaks_before_a_number_does() -> None:
    table = FittedTable(("name", "value"))
    table.add_row("internationalization", "1234567890")
    assert numbers(shown(table, 18)) == ["1234567890"]


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
