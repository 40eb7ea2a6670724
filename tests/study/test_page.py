"""Pages and drawings of a study: one file that needs nothing else, and drawings that hold what was measured."""

from __future__ import annotations

import io
import math
import re
from xml.etree import ElementTree

import pytest
from PIL import Image
from rich.console import Console

from mitsuba_sensor.cli.study_sheet import LONGEST, study_sheet
from mitsuba_sensor.cli.terminal import seconds_bar
from mitsuba_sensor.io.files import to_json
from mitsuba_sensor.study.page import (
    Bars,
    Grid,
    Line,
    Plot,
    Section,
    Study,
    Table,
    html,
    png,
    study_of,
    svg,
    table,
    text,
)

TABLE = Table(
    "Series <all>", ("name", "ms", "error"), (("a & b", 1.23456, None), ("c", 2.0, 1e-9)), ("good", "bad"), "read me"
)
LINES = (
    Line("steep", (1.0, 10.0, 100.0), (1.0, 0.1, 0.01), (0.1, 0.01, 0.001), ringed=(2,)),
    Line("", (1.0, 10.0), (3.0, 3.0), dashed=True, colour=0),
)
PICTURES = (
    Plot("error", "seconds", "error", LINES, level=(0.02, "wanted")),
    Plot("all zero", "x", "y", (Line("z", (0.0, 1.0), (0.0, 0.0)),)),
    Plot("nothing", "x", "y", ()),
    Bars("bars", "DN", ("one", "two"), {"p": (1.0, None), "m": (0.5, 2.0)}, {"m": (0.1, 0.2)}, level=(0.7, "here")),
    Bars("zeros", "DN", ("one",), {"p": (0.0,)}, log_x=True),
    Grid("verdicts", ("r1", "r2"), ("c1",), (("good",), ("bad",)), (("3/3",), ("1/2",))),
)


def study(*parts: object, passed: bool = True) -> Study:
    section = Section(("1 < 2", "done"), passed, parts)  # type: ignore[arg-type]
    return study_of("stress", "A <title>", [section], machine={"cpus": 2})


def test_a_study_is_its_sections_one_after_the_other() -> None:
    whole = study_of("stress", "t", [Section(("a",), True, (TABLE,)), Section(("b",), False, PICTURES[:1])])
    assert (whole.findings, whole.passed, whole.parts) == (("a", "b"), False, (TABLE, PICTURES[0]))


def test_a_table_has_a_column_for_each_heading_and_marks_only_where_there_are_any() -> None:
    made = table("t", "name | ± | ±", [("", ("a", 1.0, 2.0)), ("bad", ("b", 3.0, None))], "note")
    assert made.columns == ("name", "±", "±") and made.marks == ("", "bad") and made.rows[1] == ("b", 3.0, None)
    assert table("t", "name", [("", ("a",))]).marks == ()


def test_a_page_asks_the_network_for_nothing_and_is_well_formed() -> None:
    page = html(study(TABLE, *PICTURES))
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!#)", page) and "<script" not in page and "@import" not in page
    assert "url(http" not in page
    body = page[page.index("<body>") : page.index("</body>") + len("</body>")]
    ElementTree.fromstring(body)
    assert "A &lt;title&gt;" in page and "1 &lt; 2" in page and "a &amp; b" in page
    assert page.count("<svg") == len(PICTURES)


@pytest.mark.parametrize("picture", PICTURES, ids=lambda p: p.title)
def test_every_drawing_is_a_picture_and_is_drawn_the_same_again(picture: Plot | Bars | Grid) -> None:
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
    [found] = [m for m in re.findall(r'<path d="(M [^"]+)" clip-path', svg(PICTURES[0])) if m.count("L") == 2][:1]
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


def shown(found: Study) -> str:
    console = Console(record=True, width=140, file=io.StringIO())
    console.print(study_sheet(found, "here/study.html", console.width))
    return console.export_text()


def test_the_terminal_shows_verdict_findings_and_tables() -> None:
    said = shown(study(TABLE, *PICTURES, passed=False))
    for label in ("not all holds", "here/study.html", "1 < 2", "Series <all>", "1.23", "verdicts", "1/2"):
        assert label in said


def test_of_a_table_where_all_holds_the_terminal_says_so_and_no_more() -> None:
    said = shown(study(Table("whole", ("case", "n"), (("one", 1), ("two", 2)), ("good", "good"))))
    assert "whole: all 2 rows as they must be" in said and "two" not in said


def test_of_a_long_table_the_terminal_shows_what_is_not_as_it_must_be() -> None:
    rows = tuple((f"case {i}", i) for i in range(LONGEST + 1))
    marks = tuple("bad" if i == 7 else "good" for i in range(len(rows)))
    said = shown(study(Table("long", ("case", "n"), rows, marks)))  # type: ignore[arg-type]
    assert "case 7" in said and "case 8" not in said and f"{LONGEST} more rows" in said


def test_a_study_says_first_how_long_it_takes() -> None:
    console = Console(file=io.StringIO())
    with seconds_bar(console) as tell:
        tell(0.0, 240.0, "pilot")
        tell(10.0, 200.0, "series")
    assert console.file.getvalue() == "this takes about 4 min\n"  # type: ignore[attr-defined]


@pytest.mark.parametrize(("width", "columns"), [(200, 12), (40, 3), (14, 1)])
def test_a_wide_table_shows_the_columns_that_fit_and_says_so(width: int, columns: int) -> None:
    names = tuple(f"column {i:02}" for i in range(12))
    table = Table("wide", names, (tuple("1234567890" for _ in names),))
    console = Console(record=True, width=width, file=io.StringIO())
    console.print(study_sheet(study(table), "here", console.width))
    said = console.export_text()
    assert said.count("1234567890") == columns
    assert (f"{12 - columns} more columns" in " ".join(said.split())) == (columns < 12)
