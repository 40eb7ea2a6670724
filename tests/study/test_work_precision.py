"""The work-precision study: slopes and predictions follow their laws, frames keep what the package says of itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import SKY, scene_text, write_scene
from helpers.study_pages import faults, through_files

import mitsuba_sensor as ms
from mitsuba_sensor.pages.page import Study, Table
from mitsuba_sensor.study.kit import Kit, Subject
from mitsuba_sensor.study.work_precision import RECORDS, work_precision
from mitsuba_sensor.study.work_precision import render as of_render
from mitsuba_sensor.study.work_precision import sensor as of_sensor
from mitsuba_sensor.study.work_precision.results import (
    Result,
    Rung,
    Setting,
    choices,
    typed_options,
)
from mitsuba_sensor.study.work_precision.sensor import change_of_moments


def result(square: float, power: float = -0.5, own: float = 0.0, **options: object) -> Result:
    """Four runs whose squared error with n samples is square·n^(2·power), 1 % apart, 0.01 s per sample."""
    setting = Setting("made", {"denoise": False, **options})
    runs = []
    for run in range(4):
        squares = [
            (n, (1 + 0.01 * run) * square * n ** (2 * power) + own) for n in (16, 32, 64, 128)
        ]
        runs.append([Rung(n, 0.01 * n, x) for n, x in squares])
    return Result(setting, runs, own)


@pytest.mark.parametrize(
    ("power", "verdict"), [(-0.5, "holds"), (-0.8, "holds"), (-0.4, "off"), (-1.7, "off")]
)
def test_a_slope_that_no_sampler_has_is_found(power: float, verdict: str) -> None:
    made = result(1.0, power)
    assert made.slope is not None and made.slope.value == pytest.approx(power, abs=1e-9)
    assert made.verdict == verdict


def test_the_error_of_the_reference_is_taken_off_and_what_is_below_it_does_not_count() -> None:
    points = result(1.0, own=0.02).points()
    assert [point.spp for point in points] == [16, 32]
    assert points[0].error == pytest.approx(np.sqrt(1.015 / 16), rel=1e-9)


def test_a_denoised_render_has_no_law() -> None:
    assert result(1.0, -0.3, denoise=True).verdict == ""


@pytest.mark.parametrize("tolerance", [0.2, 0.1, 0.05])
def test_the_samples_that_reach_a_tolerance_are_predicted_with_a_margin(
    tolerance: float,
) -> None:
    """Error² = 1/n, 0.01 s per sample: 1/tolerance² samples and a tenth more; the last one is beyond all rungs."""
    (choice,) = choices([result(1 / 1.015)], tolerance)
    assert choice.spp == pytest.approx(1.1 / tolerance**2, abs=1.5)
    assert choice.seconds == pytest.approx(0.01 * choice.spp, rel=0.01)
    assert choice.options == f"--spp {choice.spp} --no-denoise"


def test_the_quickest_options_come_first() -> None:
    slow, quick = result(4.0), result(1.0, spectral="channels")
    assert [
        choice.options.partition("--spectral")[1] for choice in choices([slow, quick], 0.1)
    ] == ["--spectral", ""]


def test_options_are_typed_as_the_command_line_has_them() -> None:
    setting = Setting(
        "x", {"denoise": True, "bandwidth_nm": 470.0, "variant": "scalar_spectral"}
    )
    assert (
        typed_options(setting, 64) == "--spp 64 --bandwidth-nm 470.0 --variant scalar_spectral"
    )


def test_changes_of_moments_are_those_of_mean_and_sigma() -> None:
    """σ from 5 to 6 DN, mean by 2 DN, in every sensor alike: no standard error."""
    before = np.tile(np.array([100.0, 25.0, 4.0])[:, None], (1, 5))
    after = np.tile(np.array([102.0, 36.0, 4.0])[:, None], (1, 5))
    change, error = change_of_moments(after, before)
    assert change == pytest.approx([2.0, 1.0, 0.0]) and error == pytest.approx([0.0] * 3)


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    scene = write_scene(tmp_path_factory.mktemp("scene"), scene_text(SKY))
    return Subject(scene, ms.load_camera("konnik_table1"), ms.Exposure(0.1), {"width": 8})


@pytest.fixture(scope="module")
def measured(subject: Subject) -> tuple[Kit, Study]:
    """Both sides in small: renders of 8 × 8 pixels for 0.05 s, frames of 64 × 64."""
    small = pytest.MonkeyPatch()
    for name, value in {"REFERENCE_S": 0.2, "RUN_S": 0.02}.items():
        small.setattr(of_render, name, value)
    for name, value in {"LARGE": (64, 64), "SMALL": (32, 32), "TURNS": 2, "SENSORS": 5}.items():
        small.setattr(of_sensor, name, value)
    with small.context():
        kit = Kit()
        study = work_precision(kit, subject, seeds=2, variants=["scalar_spectral"])
    small.undo()
    return kit, study


@pytest.mark.exhaustive
def test_frames_of_every_engine_are_what_the_package_says_of_itself(
    measured: tuple[Kit, Study],
) -> None:
    tables = [part for part in measured[1].parts if isinstance(part, Table)]
    must_hold = next(
        part for part in tables if part.title.startswith("Checks on the sensor side")
    )
    assert must_hold.rows and set(must_hold.marks) == {"good"}


@pytest.mark.exhaustive
def test_every_setting_is_shown(measured: tuple[Kit, Study]) -> None:
    tables = {part.title: part for part in measured[1].parts if isinstance(part, Table)}
    assert {row[0] for row in tables["Settings of the render"].rows} >= {
        "as shipped",
        "one band",
        "channels",
    }
    sensor = {row[0] for row in tables["Settings of the sensor"].rows}
    assert {"numpy float64", "numpy float32", "numpy float32, plan 1 DN"} <= sensor


@pytest.mark.exhaustive
def test_the_page_has_units_and_one_colour_for_each_series(measured: tuple[Kit, Study]) -> None:
    assert not faults(measured[1])


@pytest.mark.exhaustive
def test_measurements_come_back_from_files(measured: tuple[Kit, Study], tmp_path: Path) -> None:
    through_files(measured[0].known, RECORDS, tmp_path)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"sides": "render"}, "sides is 'render'"),
        ({"sides": ()}, "sides is"),
        ({"tolerance": 0.0}, "tolerance is 0"),
        ({"seeds": 1}, "seeds is 1"),
        ({"variants": ["scalar_rgb"]}, "scalar_rgb"),
    ],
)
def test_what_cannot_be_studied_is_refused(
    subject: Subject, given: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        work_precision(Kit(), subject, **given)  # type: ignore[arg-type]
