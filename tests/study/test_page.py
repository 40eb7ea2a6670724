"""Pages and drawings of a study: one file that needs nothing else, and drawings that hold what was measured."""

from __future__ import annotations

import io
import math
import random
import re
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import pytest
from helpers.marks import one_in
from helpers.study_pages import faults
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from mitsuba_sensor.cli.measuring import ROWS_MAX, study_sheet
from mitsuba_sensor.files.texts import to_json
from mitsuba_sensor.pages.drawing import RING_LABEL, png, svg
from mitsuba_sensor.pages.html_page import html, text
from mitsuba_sensor.pages.page import (
    Bars,
    Grid,
    Line,
    Plot,
    Section,
    Study,
    Table,
    study_of,
    table,
)

TABLE = Table(
    "Series <all>",
    ("name", "ms", "error"),
    (("a & b", 1.23456, None), ("c", 2.0, 1e-9)),
    ("good", "bad"),
    "read me",
)
LINES = (
    Line("steep", (1.0, 10.0, 100.0), (1.0, 0.1, 0.01), (0.1, 0.01, 0.001), ringed=(2,)),
    Line("", (1.0, 10.0), (3.0, 3.0), dashed=True),
)
PICTURES = (
    Plot("error", "seconds", "error", LINES, level=(0.02, "wanted")),
    Plot("all zero", "x", "y", (Line("z", (0.0, 1.0), (0.0, 0.0)),)),
    Plot("nothing", "x", "y", ()),
    Bars(
        "bars",
        "DN",
        ("one", "two"),
        {"p": (1.0, None), "m": (0.5, 2.0)},
        {"m": (0.1, 0.2)},
        level=(0.7, "here"),
    ),
    Bars("zeros", "DN", ("one",), {"p": (0.0,)}, log_x=True),
    Grid("verdicts", ("r1", "r2"), ("c1",), (("good",), ("bad",)), (("3/3",), ("1/2",))),
)


def study(*parts: object, passed: bool = True) -> Study:
    section = Section(("1 < 2", "done"), passed, parts)  # type: ignore[arg-type]
    return study_of("stress", "A <title>", [section], machine={"cpus": 2})


def test_a_study_is_its_sections_one_after_the_other() -> None:
    whole = study_of(
        "stress", "t", [Section(("a",), True, (TABLE,)), Section(("b",), False, PICTURES[:1])]
    )
    assert (whole.findings, whole.passed) == (("a", "b"), False)
    assert [part.title for part in whole.parts] == ["Series <all>", "error"]


def of_names(*names: str) -> Plot:
    return Plot(
        names[0],
        "x [1]",
        "y [1]",
        tuple(Line(name, (1.0,), (float(k),)) for k, name in enumerate(names)),
    )


def test_a_plot_of_many_series_becomes_several_each_with_the_first_and_none_is_lost() -> None:
    names = [f"s{k}" for k in range(17)]
    parts = study_of(
        "s", "t", [Section((), True, (of_names(*names), of_names(*names[:8])))]
    ).parts
    shown = [[line.label for line in part.lines] for part in parts if isinstance(part, Plot)]
    assert [len(some) for some in shown] == [8, 8, 3, 8] and {some[0] for some in shown} == {
        "s0"
    }
    assert sorted(name for some in shown[:3] for name in some[1:]) == sorted(names[1:])
    assert [part.title for part in parts] == ["s0 (1 of 3)", "s0 (2 of 3)", "s0 (3 of 3)", "s0"]


@pytest.mark.parametrize("seed", range(20))
def test_a_series_has_one_colour_through_a_page_that_no_other_of_its_plots_has(
    seed: int,
) -> None:
    """Plots and bars of three of twelve series, so that a colour is free for each of them."""
    choice = random.Random(seed)
    names = [choice.sample("abcdefghijkl", 3) for _ in range(4)]
    bars = Bars("bars", "change [DN]", ("one",), dict.fromkeys(names[0], (1.0,)))
    found = study_of(
        "s", "t", [Section((), True, (*(of_names(*some) for some in names), bars))]
    )
    assert not faults(found)


def test_faults_of_a_page_are_found() -> None:
    found = "\n".join(faults(replace(study(), parts=(of_names(*"abcdefghi"), TABLE))))
    assert "9 series" in found and "one colour" in found and "ms has no unit" in found


@pytest.mark.parametrize(
    "picture", [p for p in PICTURES if isinstance(p, Bars)], ids=lambda p: p.title
)
def test_no_label_lies_on_a_bar(picture: Bars, monkeypatch: pytest.MonkeyPatch) -> None:
    """No text is drawn inside the axes, and the legend begins right of them."""
    seen: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: seen.append(self))
    png(picture)
    (axes,) = seen[0].axes
    seen[0].canvas.draw()
    assert not axes.texts
    if legend := axes.get_legend():
        assert legend.get_window_extent().x0 >= axes.get_window_extent().x1


@pytest.mark.parametrize("span", [1.001, 1.1, 1.9, 3.0, 9.0, 40.0, 1e3, 1e9, 1e20])
@pytest.mark.parametrize("low", [1.0, 0.13, 8.7e-5])
def test_a_logarithmic_axis_has_three_to_nine_labels_that_differ(
    span: float, low: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: seen.append(self))
    points = (low, low * span)
    png(Plot("y versus x", "x [1]", "y [1]", (Line("one", points, points, ringed=(1,)),)))
    bars = {"one": points}
    png(Bars("bars", "x [1]", ("a", "b"), bars, log_x=True), small=True)
    for figure in seen:
        figure.canvas.draw()
    (plot,), (bar,) = (figure.axes for figure in seen)
    for axis in (plot.xaxis, plot.yaxis, bar.xaxis):
        start, end = axis.get_view_interval()
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        shown = [label.get_text() for tick, label in ticks if start <= tick <= end]
        assert 3 <= len(set(shown)) == len(shown) <= 9 and all(shown)
    assert [one.get_text() for one in plot.get_legend().get_texts()] == [RING_LABEL, "one"]


def test_a_page_is_made_for_a_phone() -> None:
    """Every table and every plot is in a box that scrolls, and the page is as wide as the screen."""
    page = html(study(TABLE, *PICTURES))
    assert 'name="viewport" content="width=device-width"' in page
    assert re.search(r"\.wide \{ overflow-x: auto; \}", page)
    assert page.count('<div class="wide"><table>') == page.count("<table>") == 1
    assert page.count('<div class="wide"><svg') == page.count("<svg") == len(PICTURES)


def test_a_table_has_a_column_for_each_heading_and_marks_only_where_there_are_any() -> None:
    made = table(
        "t", "name | ± | ±", [("", ("a", 1.0, 2.0)), ("bad", ("b", 3.0, None))], "note"
    )
    assert (
        made.columns == ("name", "±", "±")
        and made.marks == ("", "bad")
        and made.rows[1] == ("b", 3.0, None)
    )
    assert table("t", "name", [("", ("a",))]).marks == ()


def test_a_page_asks_the_network_for_nothing_and_is_well_formed() -> None:
    page = html(study(TABLE, *PICTURES))
    assert (
        not re.search(r"(src|href)\s*=\s*[\"'](?!#)", page)
        and "<script" not in page
        and "@import" not in page
    )
    assert "url(http" not in page
    body = page[page.index("<body>") : page.index("</body>") + len("</body>")]
    ElementTree.fromstring(body)
    assert "A &lt;title&gt;" in page and "1 &lt; 2" in page and "a &amp; b" in page
    assert page.count("<svg") == len(PICTURES)


@pytest.mark.parametrize("picture", one_in(3, PICTURES), ids=lambda p: p.title)
def test_every_drawing_is_a_picture_and_is_drawn_the_same_again(
    picture: Plot | Bars | Grid,
) -> None:
    drawn = svg(picture)
    ElementTree.fromstring(drawn)
    assert drawn == svg(picture)
    with Image.open(io.BytesIO(png(picture))) as image:
        assert image.width > 400 and len(image.convert("RGB").getcolors(1 << 20) or ()) > 4


def test_a_drawing_holds_the_labels_of_its_axes_and_lines_as_text() -> None:
    drawn = svg(PICTURES[0])
    for label in ("seconds", "error", "steep", "wanted"):
        assert f">{label}</text>" in drawn or f">{label}<" in drawn


def test_steeper_lines_are_drawn_steeper() -> None:
    """The y of the points of a line of slope −1 in log-log fall by equal steps."""
    [found] = [
        m
        for m in re.findall(r'<path d="(M [^"]+)" clip-path', svg(PICTURES[0]))
        if m.count("L") == 2
    ][:1]
    points = [tuple(map(float, pair)) for pair in re.findall(r"([\d.]+) ([\d.]+)", found)]
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(points, points[1:], strict=False)]
    assert steps[0] == pytest.approx(steps[1], abs=0.01) and steps[0][0] > 0 and steps[0][1] > 0


@pytest.mark.parametrize(
    ("value", "label"),
    [
        (None, "–"), (True, "yes"), (0.0, "0"), (1.23456, "1.235"), (1e-9, "1e-09"), (123456.0, "1.23e+05"), (7, "7"),
        (math.inf, "inf"), ((1.5, "a"), "1.5, a"), ({"time_s": 0.1}, "time_s 0.1"),
    ],
)  # fmt: skip
def test_numbers_are_shown_with_four_digits(value: object, label: str) -> None:
    assert text(value) == label


def test_study_json_holds_the_numbers_of_every_part() -> None:
    import json

    found = json.loads(to_json(study(TABLE, *PICTURES).to_dict()))
    assert found["passed"] is True and found["machine"] == {"cpus": 2}
    kinds = [part["kind"] for part in found["parts"]]
    assert kinds == ["table", "plot", "plot", "plot", "bars", "bars", "grid"]
    assert found["parts"][0]["rows"] == [["a & b", 1.23456, None], ["c", 2.0, 1e-9]]


def shown(found: Study, width: int = 140) -> str:
    console = Console(record=True, width=width, file=io.StringIO())
    console.print(study_sheet(found, "here/study.html"), crop=False)
    return console.export_text()


def test_the_terminal_shows_verdict_findings_and_tables() -> None:
    said = shown(study(TABLE, *PICTURES, passed=False))
    for label in (
        "some checks failed",
        "here/study.html",
        "1 < 2",
        "Series <all>",
        "1.23",
        "verdicts",
        "1/2",
    ):
        assert label in said


def test_of_a_long_table_the_terminal_shows_what_is_not_as_it_must_be() -> None:
    rows = tuple((f"case {i}", i) for i in range(ROWS_MAX + 1))
    marks = tuple("bad" if i == 7 else "good" for i in range(len(rows)))
    said = shown(study(Table("long", ("case", "n"), rows, marks)))  # type: ignore[arg-type]
    assert "case 7" in said and "case 8" not in said and f"{ROWS_MAX} more rows" in said
