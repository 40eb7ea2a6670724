"""The laboratory as one command: a virtual bench beside its datasheet, frames from disk, and what is refused."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.bench.datasheet import Said, expected
from mitsuba_sensor.bench.figures_page import beside_datasheet, characterized, figures_of
from mitsuba_sensor.bench.rendered_field import rendered_field
from mitsuba_sensor.bench.virtual_bench import FLAT_S, Setup, virtual_bench
from mitsuba_sensor.cli import app
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.measure.measurement import INSTRUMENTS, measure_bench
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
    """Table 1's camera with noise of every kind, 128 × 160 pixels of it."""
    small = CAMERA.replace(**{"sensor.rows": 128, "sensor.columns": 160})
    return virtual_bench(small, Setup(serial=3, seed=5))


def test_every_figure_of_the_datasheet_is_measured_within_4_standard_errors(
    small: Bench,
) -> None:
    """22 figures: one beyond once in 700 runs; the seed is fixed."""
    asked: list[tuple[int, int]] = []
    (found,) = figures_of(small, lambda done, total, now: asked.append((done, total)))
    assert (
        list(dict.fromkeys(asked))
        == [(number, len(INSTRUMENTS)) for number in range(len(INSTRUMENTS))]
        and not found.refused
    )
    sheet = expected(CAMERA, ms.Exposure(FLAT_S), 0.6, 128 * 160)
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


def test_ratios_stand_in_the_page_as_ratios_and_in_db_with_the_digits_of_their_intervals(
    small: Bench,
) -> None:
    """EMVA 1288 prints both; nothing has the unit 1; datasheet and measurement of K differ in a digit that is shown."""
    (found,) = measure_bench(small)
    sheet = expected(CAMERA, ms.Exposure(FLAT_S), 0.6, 128 * 160)
    study = characterized(CAMERA.name, [found], {"": sheet})
    main = next(part for part in study.parts if isinstance(part, Table))
    rows = {(str(row[0]).split()[0], row[4]): row for row in main.rows}
    assert not any(unit == "1" for _, unit in rows)
    for symbol in ("SNR_max", "DR"):
        for cell in (1, 2, 3, 5):
            ratio, decibels = (float(rows[symbol, unit][cell]) for unit in ("", "dB"))
            assert decibels == pytest.approx(20 * np.log10(ratio), abs=0.1)
    for symbol in ("PRNU1288", "DSNU1288"):
        (row,) = (row for (name, _), row in rows.items() if name == symbol)
        assert float(row[5]) > 0
    low, high = (float(x) for x in rows["K", "DN/e-"][2:4])
    assert high > low and len(rows["K", "DN/e-"][1]) >= 6


def test_a_datasheet_outside_of_the_interval_is_told_with_the_range_of_single_chips(
    small: Bench,
) -> None:
    """z is the distance from the datasheet, also where a single chip may be so far from it."""
    (found,) = measure_bench(small)
    figure = found.figures["µ_e.sat"]
    error = (figure.high - figure.value) / 1.96
    said = Said(figure.value + 3 * error, figure.value - error, figure.value + 3 * error)
    study = characterized("x", [found], {"": {"µ_e.sat": said}})
    assert study.passed
    beside = beside_datasheet(figure, {"µ_e.sat": said})
    assert beside["z"] == pytest.approx(-3, rel=1e-3) and beside["z_of_chip"] == 0
    (told,) = (one for one in study.findings if "outside of the 95 % interval" in one)
    assert f"µ_e.sat ({said.low:.4g} to {said.high:.4g} e-)" in told
    inside = characterized(
        "x", [found], {"": {"µ_e.sat": Said(figure.value, said.low, said.high)}}
    )
    assert not any("outside of the 95 % interval" in one for one in inside.findings)


def test_a_datasheet_that_is_5_percent_off_is_found_out(small: Bench) -> None:
    (found,) = measure_bench(small)
    wrong, right = 1.05 * 0.1241212, 0.6
    study = characterized(
        "x", [found], {"": {"K": Said(wrong, wrong, wrong), "η": Said(right, right, right)}}
    )
    assert not study.passed
    assert [one for one in study.findings if one.startswith("K: measured 0.12")]
    table = next(
        part for part in study.parts if isinstance(part, Table) and part.title == "All figures"
    )
    assert [
        row[0] for row, mark in zip(table.rows, table.marks, strict=True) if mark == "bad"
    ] == ["K"]


def test_every_drawing_has_axes_with_names_and_at_most_eight_series(small: Bench) -> None:
    from matplotlib.figure import Figure

    (found,) = measure_bench(small)
    assert len(found.drawings) >= 20
    for title, draw in found.drawings.items():
        axes = Figure().subplots()
        draw(axes)
        assert axes.get_xlabel() and axes.get_ylabel() and not axes.texts, title
        assert len(axes.get_legend_handles_labels()[1]) <= 8, title
    assert png(Drawing("Dark current", found.drawings["Dark current"])).startswith(b"\x89PNG")


@pytest.mark.exhaustive
def test_the_light_of_a_mosaic_saturates_every_filter_and_each_is_measured_apart() -> None:
    camera = ms.load_camera("bayer_2mp")
    bench = virtual_bench(camera, Setup(side=64))
    found = {one.filter_name: one.figures for one in measure_bench(bench)}
    assert list(found) == ["R", "G", "G (2)", "B"]
    for (name, figures), number in zip(found.items(), (0, 1, 1, 2), strict=True):
        qe = float(camera.qe([530.0])[number, 0])
        assert figures["η"].value == pytest.approx(qe, rel=0.05), (
            name
        )  # 1024 pixels of each filter
        assert figures["K"].value == pytest.approx(0.125, rel=0.05), name


@pytest.mark.exhaustive
def test_frames_on_disk_give_the_figures_of_the_same_frames_in_memory(
    small: Bench, tmp_path: Path
) -> None:
    lines = ["bits = 12", f"wavelength_nm = {small.wavelength_nm}"]
    kinds = (("bias", small.biases), ("dark", small.darks), ("flat", small.flats))
    for kind, stacks in kinds:
        for number, stack in enumerate(stacks):
            np.save(tmp_path / f"{kind}_{number}.npy", stack.frames)
            lines += ["[[stack]]", f'files = "{kind}_{number}.npy"', f'kind = "{kind}"']
            lines += [
                f"exposure_s = {stack.exposure_s}",
                f"temperature_k = {stack.temperature_k}",
            ]
            lines += [f"photons = {stack.photons}"] if kind == "flat" else []
    (tmp_path / "bench.toml").write_text("\n".join(lines))
    done = CliRunner().invoke(
        app, ["characterize", "--frames", str(tmp_path), "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    said = " ".join(done.stdout.split())
    assert f"measured: frames from {tmp_path}" in said
    assert said.endswith("report.html, report.json")
    told = json.loads((tmp_path / "out/report.json").read_text())["measured"]["all pixels"]
    (found,) = measure_bench(small)
    of_memory = {
        symbol: one.value for symbol, one in found.figures.items() if symbol != "K_scene"
    }
    for one in told["figures"]:
        assert (
            one["value"] == pytest.approx(of_memory[one["symbol"]], rel=1e-12, nan_ok=True)
            or one["value"] is None
        )
    page = (tmp_path / "out/report.html").read_text()
    assert page.count("<svg") >= 19 and not re.search("(src|href)=[^#]*http", page)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--frames", "nowhere"], "there is no nowhere"),
        (["--frames", ".", "--seed", "3"], "--seed is for simulated frames"),
        (["--gain", "100"], "gain"),
        (["--bits", "12"], "--bits is for frames from disk"),
        (["--camera", "konnik_tabel1"], "Did you mean 'konnik_table1'?"),
        (["--wavelength-nm", "2000"], "sees nothing at 2000 nm; give a wavelength from"),
        (["--wavelength-nm", "-3"], "wavelength_nm is -3"),
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


def test_several_gain_settings_are_measured_one_at_a_time(small: Bench) -> None:
    two = Bench((), small.darks, tuple(one for one in small.flats), wavelength_nm=550)
    two = Bench((), (*two.darks, *two.given(bits=12).darks), two.flats)
    assert measure_bench(two)[0].figures["K"].value > 0
    with pytest.raises(ms.InputError, match="no frames"):
        measure_bench(Bench((), (), ()))


def test_what_frames_cannot_show_is_said_and_not_made_up(small: Bench) -> None:
    (only_flats,) = measure_bench(Bench((), (), small.flats))
    assert (
        "K" not in only_flats.figures
        and "2 frames or more" in only_flats.refused["photon transfer"]
    )
    (black,) = measure_bench(Bench((), small.darks[:1], ()))
    assert "K" not in black.figures and all(
        math.isnan(one.value) or one.value < 50 for one in black.figures.values()
    )


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
