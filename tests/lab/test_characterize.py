"""The laboratory as one command: a virtual bench beside its datasheet, frames from disk, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.bench.datasheet import Said, expected
from mitsuba_sensor.bench.figures_page import (
    beside_datasheet,
    characterized,
    figure_row,
    figures_of,
)
from mitsuba_sensor.bench.virtual_bench import FLAT_S, Setup, rendered_field, virtual_bench
from mitsuba_sensor.cli import app
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.measure.measurement import INSTRUMENTS, Measurement, measure_bench
from mitsuba_sensor.lab.quantity import TWO_SIDED
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Drawing, Table

CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "readout.row_noise_e": 3.0,
        "readout.dsnu_row": 2e-4,
        "readout.prnu_col": 0.003,
        "pixel.dsnu_e": 12.0,
        "dark_current.cv": 0.1,
    }
)


@pytest.fixture(scope="module")
def small() -> Bench:
    """Table 1's camera with noise of every kind, 96 × 128 pixels of it."""
    small = CAMERA.replace(**{"sensor.rows": 96, "sensor.columns": 128})
    return virtual_bench(small, Setup(serial=3, seed=5))


@pytest.fixture(scope="module")
def measurement(small: Bench) -> Measurement:
    (measured,) = measure_bench(small)
    return measured


def test_every_figure_of_the_datasheet_is_measured_within_4_standard_errors(
    small: Bench,
) -> None:
    """22 figures: one beyond once in 700 runs; the seed is fixed."""
    asked: list[tuple[float, int]] = []
    (found,) = figures_of(small, lambda done, total, now: asked.append((done, total)))
    instruments = len(INSTRUMENTS)
    assert asked == sorted(asked) and {total for _, total in asked} == {instruments}
    assert {done for done, _ in asked} > {*range(instruments)}, "and parts of a long one"
    assert not found.refused
    sheet = expected(CAMERA, ms.Exposure(FLAT_S), 0.6, 96 * 128)
    study = characterized(CAMERA.name, [found], {"": sheet})
    assert study.passed, study.findings
    beside = {
        one["symbol"]: one
        for one in study.to_dict()["measured"]["all pixels"]["figures"]
        if "z" in one
    }
    assert set(beside) == set(sheet) and len(sheet) == 22
    assert all(abs(one["z_of_chip"]) < 4 for one in beside.values())
    for one in beside.values():
        if one["low"] <= one["datasheet"] <= one["high"]:
            assert abs(one["z"]) < 2  # 1.96 standard errors are the interval
        else:
            assert abs(one["z"]) > 1.9, one["symbol"]
    assert beside["K"]["value"] == pytest.approx(0.1241212, rel=0.01)  # Table 1: A_SN·2^12/V_FS
    assert beside["η"]["value"] == pytest.approx(0.6, rel=0.01) and beside["σ_row"][
        "value"
    ] == pytest.approx(3, rel=0.1)


def test_a_datasheet_that_is_5_percent_off_is_found_out(measurement: Measurement) -> None:
    wrong, right = 1.05 * 0.1241212, 0.6
    study = characterized(
        "x",
        [measurement],
        {"": {"K": Said(wrong, wrong, wrong), "η": Said(right, right, right)}},
    )
    assert not study.passed
    assert [one for one in study.findings if one.startswith("K: measured 0.12")]
    table = next(
        part for part in study.parts if isinstance(part, Table) and part.title == "All figures"
    )
    assert [
        row[0] for row, mark in zip(table.rows, table.marks, strict=True) if mark == "bad"
    ] == ["K"]
    one_unit = characterized("x", [measurement], {"": {"K": Said(wrong, 0.12, wrong)}})
    said = (
        "holds, although the 95 % interval excludes the datasheet's value: K; one sensor unit"
    )
    assert one_unit.passed and any(x.startswith(said) for x in one_unit.findings)


def test_every_drawing_has_axes_with_names_and_at_most_eight_series(
    measurement: Measurement,
) -> None:
    assert len(measurement.drawings) >= 20
    for title, draw in measurement.drawings.items():
        axes = Figure().subplots()
        draw(axes)
        assert axes.get_xlabel() and axes.get_ylabel() and not axes.texts, title
        assert len(axes.get_legend_handles_labels()[1]) <= 8, title
    assert png(Drawing("Dark current", measurement.drawings["Dark current"])).startswith(
        b"\x89PNG"
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--frames", "nowhere"], "there is no nowhere"),
        (["--frames", ".", "--seed", "3"], "--seed is for simulated frames"),
        (["--gain", "100"], "gain"),
        (["--bits", "12"], "--bits is for frames from disk"),
        (["--camera", "konnik_tabel1"], "Did you mean 'konnik_table1'?"),
        (["--wavelength-nm", "2000"], "detects no light at 2000 nm; give a wavelength from"),
        (["--wavelength-nm", "-3"], "--wavelength-nm is -3"),
        (["--camera", "konnik_table1", "-o", ""], "-o is empty"),
    ],
)
def test_what_cannot_be_measured_is_one_sentence_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["characterize", *options])
    assert done.exit_code == 2 and said in done.output.replace("\n", " "), done.output
    assert not list(tmp_path.iterdir())


def test_rendered_light_is_as_bright_as_the_closed_form_says() -> None:
    """E = πLT/(4N²); 4 standard errors of the render's mean are below 1e-3."""
    field = rendered_field(CAMERA)
    assert field.shares.sum() == pytest.approx(1, rel=1e-3)
    assert field.efficiency == pytest.approx([0.6], rel=1e-3)


def test_a_standard_deviation_that_should_be_0_is_judged_by_its_square() -> None:
    """A variance of 3 ± 1 standard errors: its root is from √1.04 to √4.96, and 3 standard errors above 0."""
    low, high = (np.sqrt(3 + sign * TWO_SIDED) for sign in (-1, 1))
    figure = ms.lab.Quantity("σ_col", "column noise", np.sqrt(3), low, high, "e-", "")
    beside = beside_datasheet(figure, {"σ_col": Said(0.0, 0.0, 0.0)})
    assert beside["z"] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("interval", "shown"), [((np.nan, 0.0, 3.2), "< 3.2"), ((3e4, 3e4, np.inf), "≥ 3e+04")]
)
def test_a_limit_is_shown_as_one_and_not_judged(
    interval: tuple[float, float, float], shown: str
) -> None:
    figure = ms.lab.Quantity("σ_d", "a figure", *interval, "e-", "")
    mark, cells = figure_row(figure, {"σ_d": Said(1.0, 1.0, 1.0)}, 3.0)
    assert mark == "" and cells[2] == shown


def test_ratios_stand_in_the_page_as_ratios_and_in_db(measurement: Measurement) -> None:
    """EMVA 1288 prints both; a datasheet outside of the interval may be within the range of single chips."""
    figure = measurement.figures["DR"]
    error = (figure.high - figure.value) / 1.96
    said = Said(figure.value + 3 * error, figure.value - error, figure.value + 3 * error)
    study = characterized("x", [measurement], {"": {"DR": said}})
    main = next(part for part in study.parts if isinstance(part, Table))
    rows = {(str(row[0]).split()[0], row[4]): row for row in main.rows}
    ratio, decibels = (float(rows["DR", unit][1]) for unit in ("", "dB"))
    assert decibels == pytest.approx(20 * np.log10(ratio), abs=0.1)
    assert study.passed
    beside = beside_datasheet(figure, {"DR": said})
    assert beside["z"] == pytest.approx(-3, rel=1e-2) and beside["z_of_chip"] == 0
