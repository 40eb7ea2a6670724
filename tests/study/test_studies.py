"""The three studies: changes have their closed forms, errors are told with the reference's, wrong answers are found."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.lab.statistics.estimators import spread
from mitsuba_sensor.pages.page import Dots, Plot, Study, Table
from mitsuba_sensor.study import ablation as of_ablation
from mitsuba_sensor.study import stress as of_stress
from mitsuba_sensor.study import work_precision as of_work
from mitsuba_sensor.study.ablation import SENSORS, ablation, compared, shared_rms
from mitsuba_sensor.study.kit import Subject, change_of_moments, measured, moments
from mitsuba_sensor.study.stress import SENSORS as ENGINES
from mitsuba_sensor.study.stress import Case, answer, cases, problem_of, stress
from mitsuba_sensor.study.work_precision import work_precision
from mitsuba_sensor.theory import expected


def silent(now: str, share: float) -> None:
    """Progress that nobody reads."""


def subject_of(folder: Path, **options: Any) -> Subject:
    scene = write_scene(folder, scene_text(SKY))
    same = {"width": 8, "variant": "scalar_spectral", **options}
    return Subject(scene, ms.load_camera("konnik_table1"), ms.Exposure(0.1), same)


def rows(study: Study, title: str) -> dict[str, dict[str, Any]]:
    part = next(
        one for one in study.parts if isinstance(one, Table) and one.title.startswith(title)
    )
    return {str(row[0]): dict(zip(part.columns, row, strict=True)) for row in part.rows}


# The kit


def test_steps_are_measured_in_order_and_their_share_is_told() -> None:
    told = list[tuple[str, float]]()
    found = measured({"a": lambda: 1, "b": lambda: 2}, lambda *said: told.append(said))
    assert found == {"a": 1, "b": 2} and told == [("a", 0.0), ("b", 0.5), ("done", 1.0)]


def test_moments_of_frames_are_those_of_their_noise() -> None:
    """Mean 100, temporal σ 5, spatial σ 3 of 8 sensors of 64 × 64 pixels: within 5 standard errors."""
    rng = np.random.default_rng(3)
    frames = 100 + rng.normal(0, 3, (8, 1, 64, 64)) + rng.normal(0, 5, (8, 16, 64, 64))
    mean, temporal, spatial = moments(list(frames)).mean(axis=1)
    assert mean == pytest.approx(100, abs=0.1)
    assert temporal == pytest.approx(25, abs=0.25) and spatial == pytest.approx(9, abs=0.45)


def test_changes_of_moments_are_those_of_mean_and_sigma() -> None:
    """σ from 5 to 6 DN and the mean by 2 DN in every sensor: no standard error."""
    before, after = (
        np.tile(np.array(one)[:, None], (1, 5))
        for one in ([100.0, 25.0, 4.0], [102.0, 36.0, 4.0])
    )
    change, error = change_of_moments(after, before)
    assert change == pytest.approx([2.0, 1.0, 0.0]) and error == pytest.approx([0.0] * 3)


# Ablation


@pytest.fixture(scope="module")
def ablated(tmp_path_factory: pytest.TempPathFactory) -> Study:
    with pytest.MonkeyPatch.context() as small:
        small.setattr(of_ablation, "TURNS", 2)
        small.setattr(of_ablation, "PAIRS", 3)
        small.setattr(of_ablation, "SENSORS", 4)
        small.setattr(expected, "WINDOWS_MAX", 4)
        return ablation(subject_of(tmp_path_factory.mktemp("scene")), silent, frames=4)


def test_the_plan_keeps_its_tolerance_and_every_source_is_left_out_once(ablated: Study) -> None:
    shown = rows(ablated, "Changes without each noise source")
    assert ablated.passed and list(shown)[-1] == "the plan"
    assert {"PRNU", "dark current", "shot noise", "DSNU column"} <= set(shown)
    assert "ADC" not in shown and "full well" not in shown
    json.dumps(ablated.to_dict(), allow_nan=False)


def test_without_dark_current_the_mean_falls_by_its_closed_form(ablated: Study) -> None:
    """174.158 e- (paper eq. 1 at 25 °C in 0.1 s) times K = 4096/33 000 DN/e-, to 5 standard errors of 4 × 64 pixels."""
    change = rows(ablated, "Changes without each noise source")["dark current"]["mean [DN]"]
    assert change == pytest.approx(-174.158 * 4096 / 33_000, abs=0.3)


def test_a_source_that_changes_no_code_is_not_timed(ablated: Study) -> None:
    row = rows(ablated, "Changes without each noise source")["reset noise"]
    assert row["median [%]"] is None and row["mean [DN]"] == 0 == row["temporal σ [DN]"]
    (picture,) = [part for part in ablated.parts if isinstance(part, Dots)]
    assert "shot noise" in picture.labels and "reset noise" not in picture.labels


def test_a_sky_has_no_indirect_light_and_a_fall_off_of_its_lens(ablated: Study) -> None:
    shown = rows(ablated, "Changes with a simpler render")
    assert shown["no indirect light"]["rms [DN]"] == 0
    assert {"one band", "channels instead of bands", "no lens fall-off"} <= set(shown)


def test_a_plan_that_moves_frames_too_far_is_found() -> None:
    """Frames of 8 sensors whose mean is 0.5 DN off in all pixels, by 0.5 in 50 standard errors."""
    rng = np.random.default_rng(1)
    whole = [rng.integers(90, 110, (4, 16, 16)) for _ in range(SENSORS)]
    moved = [frames + rng.integers(0, 2, frames.shape) for frames in whole]
    assert compared(moved, whole).beyond > 0.4 and compared(whole, whole).moved == 0


def test_a_saving_inside_the_scatter_is_none() -> None:
    spread = of_ablation.saved_share([1.0, 1.0, 1.0], [0.9, 1.0, 1.1])
    assert "beyond the scatter" in of_ablation.in_words(spread)
    assert "10 %" in of_ablation.in_words(of_ablation.saved_share([1.0, 1.0], [0.9, 0.9]))


def test_the_rms_of_a_change_is_free_of_noise() -> None:
    """A pattern of 3 DN rms in noise of 10 DN: 3 within three standard errors; the plain mean square has 5.8."""
    rng = np.random.default_rng(1)
    pattern = 3.0 * np.where(np.arange(10_000).reshape(100, 100) % 2, 1.0, -1.0)
    off = pattern + rng.normal(0.0, 10.0, (4, 100, 100))
    rms, error = shared_rms(off)
    assert rms == pytest.approx(3.0, abs=3 * error) and error < 0.3


# Work-precision


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Both sides in small."""
    with pytest.MonkeyPatch.context() as small:
        for name, value in {"REFERENCE_S": 0.5, "RUN_S": 0.02, "RUNGS": 3, "TURNS": 2}.items():
            small.setattr(of_work, name, value)
        small.setattr(of_work, "ENGINES", (("numpy", "float32"), ("drjit", "float32")))
        small.setattr(of_work, "TOLERANCES_DN", (None, 1.0))
        small.setattr(of_work, "SENSORS", 4)
        small.setattr(expected, "WINDOWS_MAX", 4)
        subject = subject_of(tmp_path_factory.mktemp("scene"), variant=None)
        asked = {"seeds": 2, "variants": ["scalar_spectral"], "tolerance": 0.05}
        return work_precision(subject, silent, **asked)  # type: ignore[arg-type]


def test_every_setting_is_a_line_and_the_reference_has_no_point(worked: Study) -> None:
    of_render, of_sensor = (part for part in worked.parts if isinstance(part, Plot))
    names = {one.label for one in of_sensor.lines}
    assert {
        "numpy float32",
        "drjit float32, plan 1 DN",
    } <= names and "NumPy float64" not in names
    assert "|NumPy float64, reference" in of_sensor.levels
    assert {"one band", "channels"} <= {one.label for one in of_render.lines}
    json.dumps(worked.to_dict(), allow_nan=False)


def test_the_recommended_point_is_the_fastest_within_the_tolerance(worked: Study) -> None:
    for plot, tolerance in zip(
        (one for one in worked.parts if isinstance(one, Plot)), (0.05, 0.02), strict=True
    ):
        (star,) = (one for one in plot.lines if one.star)
        others = [
            (x, y + error)
            for one in plot.lines
            if not one.star
            for x, y, error in zip(one.x, one.y, one.error, strict=True)
        ]
        assert star.x[0] == min(x for x, y in others if y <= tolerance)


def test_a_reference_that_is_too_coarse_gives_no_recommendation() -> None:
    point = of_work.Point("s", "--spp 16", spread([1.0, 2.0]), 0.005, 0.001)
    best, said = of_work.recommended([point], 0.003, 0.01)
    assert best is None and said.startswith("No render is recommended")
    assert of_work.recommended([point], 0.002, 0.01)[0] is point
    assert of_work.recommended([point], 0.001, 0.0055)[0] is None


def test_the_error_of_a_render_is_relative_to_a_tenth_of_the_mean_at_least() -> None:
    electrons = np.array([[0.0, 100.0, 200.0]])
    exact = of_work.Reference(electrons, np.maximum(electrons, 15.0), electrons > 0, 0.0)
    assert exact.square(electrons * 1.1) == pytest.approx(0.01)


def test_a_variant_that_does_not_work_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ms.InputError, match="scalar_rgb"):
        work_precision(subject_of(tmp_path), silent, variants=["scalar_rgb"])


# Stress

EVERY = list(cases())


@pytest.mark.parametrize("engine", ENGINES[:3], ids=lambda engine: engine.name)
def test_cases_hold_on_every_engine(engine: Any) -> None:
    """One case in 24; the command asks for all of them."""
    if problem_of(engine):
        pytest.skip(problem_of(engine))
    quick = [case for case in EVERY if engine in case.engines and case.theme != "corners"][::24]
    told = [answer(case, engine) for case in quick]
    assert len(told) > 3 and not [one for one in told if not one.holds]


@pytest.mark.parametrize(
    "case",
    one_in(12, [case for case in EVERY if case.theme == "corners"]),
    ids=lambda c: c.given,
)
def test_corners_hold(case: Case) -> None:
    assert answer(case, ENGINES[0]).holds


@pytest.mark.exhaustive
@pytest.mark.parametrize("theme", sorted({case.theme for case in EVERY}))
def test_every_case_holds(theme: str) -> None:
    for case in EVERY:
        for engine in case.engines:
            if case.theme == theme and not problem_of(engine):
                told = answer(case, engine)
                assert told.holds, told


def wrong(kind: str, engine: Any) -> float:
    if kind == "exception":
        raise ZeroDivisionError("division by zero")
    if kind == "warning":
        return float(np.divide(np.zeros(1), np.zeros(1))[0])
    if kind == "refused":
        raise ms.InputError("precision is 'float32', which holds 24 bits.")
    return {"right": 0.5, "wrong": 1.1, "nan": math.nan}[kind]


def test_wrong_answers_exceptions_and_warnings_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = ("right", "refused", "wrong", "nan", "warning", "exception")
    made = [
        Case("made", kind, lambda engine, kind=kind: wrong(kind, engine), ENGINES[:2])
        for kind in kinds
    ]
    monkeypatch.setattr(of_stress, "cases", lambda: iter(made))
    study = stress(silent)
    assert not study.passed and study.findings[0].startswith("4 of 12 results of 6 cases")
    table = next(
        one for one in study.parts if isinstance(one, Table) and one.title == "All cases"
    )
    assert table.marks == ("good", "good", "bad", "bad", "bad", "bad")
    json.dumps(study.to_dict(), allow_nan=False)
