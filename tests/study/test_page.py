"""Pages and pictures of a study: one file that needs nothing else, and axes, tables and verdicts that can be read."""

from __future__ import annotations

import base64
import io
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

import mitsuba_sensor as ms
from mitsuba_sensor.bench.twin_page import distances_section
from mitsuba_sensor.cli.measuring import ROWS_MAX, study_sheet
from mitsuba_sensor.files.texts import to_json
from mitsuba_sensor.pages.drawing import png, svg
from mitsuba_sensor.pages.html_page import FIGURE_SPACE, html, text
from mitsuba_sensor.pages.page import (
    Dots,
    Drawing,
    Line,
    Plot,
    Section,
    Study,
    Table,
    line,
    study_of,
    table,
)

TABLE = Table(
    "Series <all>",
    ("name", "ms", "error [1]", "gain"),
    (("a & b", 1.23456, None, ""), ("c", 20.5, 1e-9, "")),
    ("good", "bad"),
    "read me",
)
LINES = (
    line("steep", [(1.0, 1.0, 0.1), (10.0, 0.1, 0.01), (100.0, 0.01, 0.001)]),
    Line("best", (1.0,), (3.0,), star=True),
)
PICTURES = (
    Plot("error", "seconds", "error", LINES, levels={"wanted": 0.02, "|reference": 30.0}),
    Plot("all zero", "x", "y", (Line("z", (0.0, 1.0), (0.0, 0.0)),)),
    Plot("nothing", "x", "y", ()),
    Dots("dots", "DN", ("one", "two"), {"p": [(1.0, 0.5, 2.0), None]}, (1.0, "equal")),
    Dots("zeros", "DN", ("one",), {"p": [(0.0, 0.0, 0.0)]}, (1.0, "limit"), log_x=True),
    Drawing("drawn", lambda ax: ax.plot([1, 2], [3, 4])),
)


def study(*parts: Any, passed: bool = True, **more: Any) -> Study:
    section = Section(("1 < 2", "done"), passed, parts, **more)
    return study_of("stress", "A <title>", [section], machine={"cpus": 2})


def test_a_study_is_its_sections_one_after_the_other() -> None:
    first, second = Section(("a",), True, (TABLE,)), Section(("b",), False, PICTURES[:1])
    whole = study_of("stress", "t", [first, second])
    assert (whole.findings, whole.passed) == (("a", "b"), False)
    assert [part.title for part in whole.parts] == ["Series <all>", "error"]


@pytest.mark.parametrize(
    ("given", "verdict"),
    [
        ({}, "✓ all checks passed"),
        ({"passed": False, "failed": ("K",)}, "✗ some checks failed: K"),
        ({"missing": ("star",)}, "not measured: star"),
        ({"omitted": ("not compared",)}, "not compared"),
    ],
)
def test_a_verdict_is_in_words(given: dict[str, Any], verdict: str) -> None:
    made = study(TABLE, **given)
    assert made.headline == verdict and verdict in html(made)


def test_a_twin_without_held_out_frames_is_not_called_checked() -> None:
    made = study_of("twin", "t", [distances_section([])])
    assert made.headline.startswith("not compared with held-out frames; needs 8")
    assert "verdict good" not in html(made)


def test_what_was_not_checked_has_no_verdict() -> None:
    assert replace(study_of("comparison", "t", ()), checked=False).headline == ""


@pytest.mark.parametrize(
    ("low", "span"),
    [(1.0, 1.001), (0.13, 1.1), (8.7e-5, 3.0), (0.13, 4.0), (1.0, 9.0), (0.13, 40.0), (8.7e-5, 1e9), (0.13, 1e20)],
)  # fmt: skip
def test_an_axis_has_three_to_nine_labels_that_differ_and_holds_its_points(
    low: float, span: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: seen.append(self))
    points = (low, low * span)
    png(Plot("y versus x", "x [1]", "y [1]", (Line("one", points, points),)))
    values = [(x, x, x) for x in points]
    png(Dots("dots", "x [1]", ("a", "b"), {"one": values}, (low, "level"), log_x=True))
    (plot,), (dots,) = (figure.axes for figure in seen)
    for axis in (plot.xaxis, plot.yaxis, dots.xaxis):
        start, end = axis.get_view_interval()
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        shown = [label.get_text() for tick, label in ticks if start <= tick <= end]
        assert 3 <= len(set(shown)) == len(shown) <= 9 and all(shown)
        assert start <= points[0] and points[1] <= end
    assert plot.get_xlabel() == "x" and plot.get_legend().get_texts()[0].get_text() == "one"


@pytest.fixture(scope="module")
def page() -> str:
    return html(study(TABLE, *PICTURES))


def test_a_page_asks_the_network_for_nothing_and_is_well_formed(page: str) -> None:
    targets = re.findall(r"(?:src|href)=\"([^\"]{0,24})", page)
    assert all(one.startswith(("data:image/svg+xml;", "#part-")) for one in targets)
    assert "<script" not in page and "@import" not in page and "url(" not in page
    body = ElementTree.fromstring(page[page.index("<body>") : page.index("</body>") + 7])
    names = [one.get("id") for one in body.iter() if one.get("id")]
    assert len(set(names)) == len(names)
    assert all(one.get("alt") for one in body.iter("img"))
    assert {one.get("href") for one in body.iter("a")} == {f"#{name}" for name in names}
    assert all(one.get("scope") for one in body.iter("th"))
    assert "A &lt;title&gt;" in page and "1 &lt; 2" in page and "a &amp; b" in page
    assert len(list(body.iter("figure"))) == len(PICTURES)


def test_a_table_says_its_verdict_in_words_leaves_out_empty_columns_and_aligns_numbers() -> (
    None
):
    body = ElementTree.fromstring(
        re.search(r"<table>.*</table>", html(study(TABLE)), re.DOTALL).group()  # type: ignore[union-attr]
    )
    assert [one.text for one in body.iter("th")][:4] == ["name", "verdict", "ms", "error"]
    cells = [[cell.text for cell in row] for row in body.iter("tr")][1:]
    assert [row[1] for row in cells] == ["✓ holds", "✗ fails"]
    assert [row[2] for row in cells] == ["1.235", f"20.5{2 * FIGURE_SPACE}"]


def test_a_table_has_a_column_for_each_heading_and_marks_only_where_there_are_any() -> None:
    made = table("t", "name | ±", [("", ("a", 1.0)), ("bad", ("b", None))], "note")
    assert made.columns == ("name", "±") and made.marks == ("", "bad")
    assert made.rows[1] == ("b", None)
    assert table("t", "name", [("", ("a",))]).marks == ()


@pytest.mark.parametrize("picture", PICTURES, ids=lambda one: one.title)
def test_every_picture_is_drawn_and_is_the_same_again(picture: Any, page: str) -> None:
    drawn = svg(picture)
    ElementTree.fromstring(drawn)
    assert base64.b64encode(drawn).decode() in page
    with Image.open(io.BytesIO(png(picture))) as image:
        assert image.width > 400 and len(image.convert("RGB").getcolors(1 << 20) or ()) > 4


@pytest.mark.parametrize(
    ("value", "label"),
    [
        (None, "–"), (True, "yes"), (0.0, "0"), (-0.0, "0"), (1.23456, "1.235"), (1e-9, "1e-09"),
        (298.15, "298.15"), (123456.0, "1.23e+05"), (7, "7"), (math.inf, "inf"),
        ((1.5, "a"), "1.5, a"), ({"time_s": 0.1}, "time_s 0.1"),
    ],
)  # fmt: skip
def test_numbers_are_shown_with_four_digits_and_temperatures_with_all(
    value: object, label: str
) -> None:
    assert text(value) == label


def test_study_json_holds_the_numbers_of_every_part() -> None:
    found = json.loads(to_json(study(TABLE, *PICTURES).to_dict()))
    assert found["passed"] is True and found["machine"] == {"cpus": 2}
    kinds = [part["kind"] for part in found["parts"]]
    assert kinds == ["table", "plot", "plot", "plot", "dots", "dots"]
    assert found["parts"][0]["rows"] == [["a & b", 1.23456, None, ""], ["c", 20.5, 1e-9, ""]]


def shown(found: Study) -> str:
    console = Console(record=True, width=140, file=io.StringIO())
    console.print(study_sheet(found, "here/study.html"), crop=False)
    return console.export_text()


def test_the_terminal_shows_verdict_findings_and_tables() -> None:
    said = shown(study(TABLE, *PICTURES, passed=False))
    for label in ("✗ some checks failed", "here/study.html", "1 < 2", "Series <all>", "1.235"):
        assert label in said


def test_the_terminal_shows_the_columns_that_a_table_names() -> None:
    rows = [("good", ("K", 0.5, "a long note"))]
    said = shown(study(table("t", "symbol | value | note", rows, terminal="symbol | value")))
    assert "holds" in said and "0.5" in said and "note" not in said
    assert "symbol" not in shown(study(table("t", "symbol", [("", ("K",))], terminal="")))


def test_of_a_long_table_the_terminal_shows_what_is_not_as_it_must_be() -> None:
    rows = tuple((f"case {i}", i) for i in range(ROWS_MAX + 1))
    marks = tuple("bad" if i == 7 else "good" for i in range(len(rows)))
    said = shown(study(Table("long", ("case", "n"), rows, marks)))  # type: ignore[arg-type]
    assert "case 7" in said and "case 8" not in said and f"{ROWS_MAX} more rows" in said


# In a browser

MEASURE = """<script>addEventListener("load", () => { document.title = JSON.stringify({
  overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  unnamed: [...document.querySelectorAll("img, svg, canvas")].filter(x => !(x.alt || x.getAttribute("aria-label")
    || x.getAttribute("aria-labelledby"))).length, broken: [...document.images].filter(x => !x.naturalWidth).length,
  requests: performance.getEntriesByType("resource").filter(x => !x.name.startsWith("data:")).length}); });</script>"""


@pytest.mark.exhaustive
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
@pytest.mark.parametrize("width", [380, 800, 1300])
@pytest.mark.parametrize("kind", ["study", "frame"])
def test_a_browser_shows_a_page_without_errors_requests_and_overflow(
    kind: str, width: int, tmp_path: Path
) -> None:
    path = tmp_path / "page.html"
    if kind == "study":
        path.write_text(html(study(TABLE, *PICTURES)), "utf-8")
    else:
        light = np.full((40, 60), 900.0)
        ms.expose(light, "konnik_table1", ms.Exposure(0.01)).save_page(path)
    page = path.read_text("utf-8")
    path.write_text(page.replace("</head>", f"{MEASURE}</head>"), "utf-8")
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    options = ["--enable-logging=stderr", "--virtual-time-budget=5000"]
    size = f"--window-size={width},900"
    shown = subprocess.run(
        [*command, *options, size, path.as_uri()], capture_output=True, text=True, timeout=60
    )
    assert "CONSOLE" not in shown.stderr
    title = re.search("<title>(.*?)</title>", shown.stdout)
    assert title, shown.stdout[:500]
    found = json.loads(title[1])
    assert found == {"overflow": 0, "unnamed": 0, "broken": 0, "requests": 0}
