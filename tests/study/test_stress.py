"""The stress study: cases that hold, on every engine; wrong answers, warnings and exceptions are found."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.study_pages import faults, through_files

import mitsuba_sensor as ms
from mitsuba_sensor.pages.page import Grid, Study
from mitsuba_sensor.study import stress as package
from mitsuba_sensor.study.kit import Kit
from mitsuba_sensor.study.stress import RECORDS, THEMES, Theme, stress, verdicts
from mitsuba_sensor.study.stress.case import (
    ENGINES,
    NO_ENGINE,
    RENDERERS,
    Row,
    problem_of,
    refusal,
    table1,
    within,
)
from mitsuba_sensor.study.stress.sensitivity import sensitivities

QUICK = ("refusals", "smallest divisors", "special noise")
"""Themes that take less than a second; the command has them all."""


@pytest.mark.parametrize("engine", ENGINES[:3], ids=lambda engine: engine.name)
@pytest.mark.parametrize(
    "theme", [one for one in THEMES if one.name in QUICK[1:]], ids=lambda theme: theme.name
)
def test_quick_themes_hold_on_every_engine(theme: Theme, engine: package.Engine) -> None:
    if problem_of(engine):
        pytest.skip(problem_of(engine))
    rows = verdicts(theme, engine)
    assert rows and all(row.got.passed for row in rows), [
        row for row in rows if not row.got.passed
    ]


@pytest.mark.parametrize(
    "theme",
    one_in(16, [one for one in THEMES if ENGINES[0] in one.engines and one.name not in QUICK]),
    ids=lambda theme: theme.name,
)
def test_every_stage_has_its_theory_at_extremes(theme: Theme) -> None:
    rows = verdicts(theme, ENGINES[0])
    assert rows and all(row.got.passed for row in rows), [
        row for row in rows if not row.got.passed
    ]


def test_what_cannot_be_is_refused_in_one_sentence() -> None:
    (theme,) = [one for one in THEMES if one.name == "refusals"]
    rows = verdicts(theme, NO_ENGINE)
    assert len(rows) > 20 and all(row.got.passed for row in rows), [
        row for row in rows if not row.got.passed
    ]


def test_renders_have_their_closed_forms() -> None:
    for theme in THEMES:
        if theme.name == "radiance":
            rows = verdicts(theme, RENDERERS[0])
            assert rows and all(row.got.passed for row in rows), [
                row for row in rows if not row.got.passed
            ]


def cases(kind: str, _: object) -> Iterator[Row]:
    """A case that holds, and one that does not."""
    yield Row("a", "right", "1", within(1.0, 1.0))
    if kind == "wrong":
        yield Row("a", "wrong", "1", within(1.1, 1.0, 0.05))
    if kind == "exception":
        raise ZeroDivisionError("division by zero")
    if kind == "warning":
        yield Row("a", "NaN", "a number", within(np.divide(np.zeros(1), np.zeros(1)), 0.0))


@pytest.mark.parametrize(
    ("kind", "failed"), [("right", 0), ("wrong", 1), ("exception", 1), ("warning", 1)]
)
def test_wrong_answers_exceptions_and_warnings_fail(kind: str, failed: int) -> None:
    rows = verdicts(Theme("made", partial(cases, kind)), NO_ENGINE)
    assert sum(not row.got.passed for row in rows) == failed


def test_not_a_number_is_never_within_and_a_sentence_must_say_its_part() -> None:
    assert not within(np.nan, 1.0, np.inf).passed and within(1.04, 1.0, 0.05).passed

    def refused() -> None:
        raise ms.InputError("bits is 99; it must be at most 24.")

    assert refusal("bits is 99", refused).passed and not refusal("bits is 98", refused).passed
    assert not refusal("bits", lambda: None).passed


@pytest.fixture(scope="module")
def measured() -> tuple[Kit, Study]:
    """The study with two themes and the condition numbers of one camera."""
    small = pytest.MonkeyPatch()
    themes = (
        Theme("made", partial(cases, "wrong"), ENGINES[:2]),
        Theme("right", partial(cases, "right"), ENGINES[:1]),
    )
    small.setattr(package, "THEMES", themes)
    small.setattr(package, "cameras", lambda: {"konnik_table1": table1()})
    kit = Kit()
    study = stress(kit)
    small.undo()
    return kit, study


def test_the_page_names_what_fails_and_counts_what_holds(measured: tuple[Kit, Study]) -> None:
    study = measured[1]
    assert not study.passed and study.findings[0].startswith(
        "3 of 5 cases have the expected result on NumPy float64, NumPy float32"
    )
    assert any(
        finding.startswith("Not as expected: made, wrong, NumPy float64")
        for finding in study.findings
    )
    grid = next(part for part in study.parts if isinstance(part, Grid))
    assert (
        grid.texts[0][1:3] == ("1/2", "1/2")
        and grid.marks[0][1] == "bad"
        and grid.marks[1][1] == "good"
    )
    json.dumps(study.to_dict(), allow_nan=False)
    assert not faults(study)


def test_nothing_is_measured_twice(measured: tuple[Kit, Study], tmp_path: Path) -> None:
    read = through_files(measured[0].known, RECORDS, tmp_path)
    assert {key: value for key, (value, _) in read.items()} == {
        k: v for k, (v, _) in measured[0].known.items()
    }


def test_condition_numbers_are_those_of_closed_forms() -> None:
    """Light and dark signal have the share of each in the mean; the full well scales both, and the temperature has
    3/2 + (E_g − T·dE_g/dT)/2kT = 24.67 times the dark signal's (paper eq. 1 and 2 at 25 °C), to 2 % of a step of 1e-3.
    """
    found = {one.field: one for one in sensitivities("konnik_table1")}
    dark, light = found["time_s"].condition, found["photons"].condition
    assert found["dark_current.fom_na_per_cm2"].condition == pytest.approx(dark, rel=1e-3)
    assert found["pixel.full_well_e"].condition == pytest.approx(dark + light, abs=3e-3)
    assert found["temperature_k"].condition == pytest.approx(24.67 * dark, rel=0.02)
