"""The command line: what render, expose, plan, cameras and doctor leave behind and say."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.marks import exhaustive, one_in
from PIL import Image
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor import cli as command_line
from mitsuba_sensor.camera.shipped import SHIPPED

OUTPUTS = {"frame.tiff", "frame.png", "frame_brightened.png", "irradiance.exr", "frame.json"}


@pytest.fixture(scope="module")
def rendered(scene_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny scene, rendered once with two frames."""
    folder = tmp_path_factory.mktemp("rendered") / "out"
    arguments = (
        f"--spp 16 --denoise --frames 2 -D level=0.0001 --set adc.bits=14 -o {folder}".split()
    )
    done = CliRunner().invoke(command_line.app, ["render", str(scene_file), *arguments])
    assert done.exit_code == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def report(rendered: Path) -> dict[str, Any]:
    return json.loads((rendered / "frame.json").read_text(encoding="utf-8"))


def test_render_leaves_its_files_and_nothing_else(rendered: Path) -> None:
    assert {path.name for path in rendered.iterdir()} == OUTPUTS


def test_the_raw_frames_hold_what_the_report_says(
    rendered: Path, report: dict[str, Any]
) -> None:
    raw = tifffile.imread(rendered / "frame.tiff")
    assert raw.dtype == np.uint16 and raw.shape == (2, 12, 16)
    assert raw.max() < 2**14
    assert raw.mean() == pytest.approx(report["stages"][-1]["mean_frame"], rel=1e-9)
    assert (raw[0] != raw[1]).any(), "two frames must not share their temporal noise"


def test_the_preview_is_an_8_bit_picture_of_the_same_size(rendered: Path) -> None:
    picture = np.asarray(Image.open(rendered / "frame.png"))
    assert picture.dtype == np.uint8 and picture.shape == (12, 16)


def test_the_report_holds_all_that_is_needed_to_make_the_frame_again(
    report: dict[str, Any],
) -> None:
    assert report["camera"]["adc"]["bits"] == 14
    assert report["camera"]["sources"]["adc.bits"] == "set by the user"
    assert report["exposure"] == {"time_s": 0.1, "temperature_k": 298.15}
    assert report["seeds"] == {"seed": 1, "serial": 1, "first_frame": 0}
    assert report["origin"]["parameters"] == {"level": "0.0001"}
    assert len(report["origin"]["scene_sha256"]) == 64
    assert (
        report["versions"]["mitsuba"] and report["versions"]["mitsuba-sensor"] == ms.__version__
    )
    assert report["render"]["samples_per_pixel"] == 16
    assert {"clipped_full_well", "clipped_adc_low", "clipped_adc_high"} <= set(report["counts"])
    assert {"negative", "non_finite"} <= set(report["counts"])
    assert report["photons"]["min"] <= report["photons"]["median"] <= report["photons"]["max"]
    assert report["times_s"]["render"] > 0


def test_theory_and_frame_agree_stage_by_stage(report: dict[str, Any]) -> None:
    """12 × 16 pixels: the mean of a stage is within 6 standard errors, which chance breaks once in 5e8."""
    for stage in report["stages"]:
        error = 6 * stage["sigma_expected"] / np.sqrt(12 * 16)
        if (
            stage["name"] != "DSNU column"
            and stage["sigma_spatial_expected"] < stage["sigma_temporal_expected"]
        ):
            assert stage["mean_frame"] == pytest.approx(
                stage["mean_expected"], abs=max(error, 1e-12)
            ), stage["name"]


def test_render_noise_is_that_of_the_render_statistics_and_grows_with_the_exposure(
    rendered: Path, report: dict[str, Any], tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """In a tenth of the time a tenth of the electrons and the same relative error: less beside the sensor's noise."""
    assert report["render_noise"]["over_sensor_median"] == pytest.approx(
        report["render"]["noise_ratio_median"], rel=1e-3
    )
    assert (
        cli(
            "expose", rendered / "irradiance.exr", "-o", tmp_path, "--exposure-s", 0.01
        ).exit_code
        == 0
    )
    shorter = json.loads((tmp_path / "frame.json").read_text(encoding="utf-8"))["render_noise"]
    for name in ("over_sensor_median", "over_sensor_p95"):
        ratio = report["render_noise"][name]
        assert ratio / 30 < shorter[name] < ratio / 10


def test_expose_makes_the_same_bits_as_render_without_rendering(
    rendered: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    options = ("--exposure-s", 0.1, "--frames", 2, "--set", "adc.bits=14")
    done = cli("expose", rendered / "irradiance.exr", "-o", tmp_path, *options)
    assert done.exit_code == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == OUTPUTS - {"irradiance.exr"}
    assert (tmp_path / "frame.tiff").read_bytes() == (rendered / "frame.tiff").read_bytes()


def test_the_raw_file_is_as_wide_as_the_converter(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    assert cli("expose", light_file, "-o", tmp_path, "--set", "adc.bits=8").exit_code == 0
    assert tifffile.imread(tmp_path / "frame.tiff").dtype == np.uint8
    assert cli("expose", light_file, "-o", tmp_path, "--set", "adc.bits=20").exit_code == 0
    assert tifffile.imread(tmp_path / "frame.tiff").dtype == np.uint32


def test_a_colour_camera_gets_a_colour_preview_and_a_mosaic(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    colour = next(
        name for name in ms.list_cameras() if len(ms.load_camera(name).filter_names) > 1
    )
    assert cli("expose", light_file, "-o", tmp_path, "--camera", colour).exit_code == 0
    assert tifffile.imread(tmp_path / "frame.tiff").shape == (12, 16)
    assert np.asarray(Image.open(tmp_path / "frame.png")).shape == (12, 16, 3)


@pytest.mark.exhaustive
def test_every_camera_that_ships_takes_a_picture(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    for name in ms.list_cameras():
        assert cli("expose", light_file, "-o", tmp_path / name, "--camera", name).exit_code == 0


def test_json_is_all_that_stdout_gets(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli("expose", light_file, "-o", tmp_path, "--json")
    assert json.loads(done.stdout) == json.loads(
        (tmp_path / "frame.json").read_text(encoding="utf-8")
    )


def test_plan_says_what_each_stage_does(light_file: Path, cli: Callable[..., Any]) -> None:
    assert "shot noise" in cli("plan", light_file).stdout
    stages = json.loads(cli("plan", light_file, "--tolerance-dn", 0.02, "--json").stdout)[
        "stages"
    ]
    assert [stage["stage"] for stage in stages][-1] == "ADC"


@pytest.mark.parametrize("columns", [exhaustive(60), 80, exhaustive(120)])
def test_plan_cuts_no_number_and_no_name_in_a_narrow_terminal(
    columns: int, light_file: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every number of the table stands on the line of its stage, between blanks; nothing ends in an ellipsis."""
    from mitsuba_sensor.cli.app import out

    monkeypatch.setattr(out, "width", columns)
    arguments = (
        "plan",
        light_file,
        "--tolerance-dn",
        0.02,
        "--set",
        "readout.row_noise_e=0.01",
    )
    said = cli(*arguments).stdout
    assert max(map(len, said.splitlines())) <= columns and "…" not in said.replace(" … ", "")
    rows = [
        line.split() for line in said.splitlines() if re.search(r" (yes|no) .* \d+ *$", line)
    ]
    stages = [
        one
        for one in json.loads(cli(*arguments, "--json").stdout)["stages"]
        if not is_listed(one)
    ]
    assert len(rows) == len(stages)
    for words, stage in zip(rows, stages, strict=True):
        assert stage["stage"].startswith(words[0]) and words[-6] == (
            "yes" if stage["kept"] else "no"
        )
        for word, name in zip(
            words[-5:], ("mean", "temporal", "spatial", "structure"), strict=False
        ):
            value = stage[f"{name}_dn"]
            assert (
                word == "<0.001"
                if 0 < value < 1e-3
                else float(word) == pytest.approx(value, rel=0.06)
            )
    assert "holds for:" in said and "mean photoelectrons" in " ".join(said.split())


def is_listed(stage: dict[str, Any]) -> bool:
    """Whether a stage is in a list below the table."""
    return stage["reason"] in ("has no effect here", "changes the unit; always needed")


@pytest.mark.parametrize("command", ["render", "expose", "plan"])
def test_help_explains_the_tolerance(command: str, cli: Callable[..., Any]) -> None:
    said = " ".join(re.sub(r"[│╭╮╰╯─]", " ", cli(command, "--help-all").stdout).split())
    assert "--tolerance-dn" in said and "DN" in said


def test_expose_leaves_out_what_the_tolerance_allows_and_says_so(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli("expose", light_file, "-o", tmp_path, "--tolerance-dn", 0.5)
    found = json.loads((tmp_path / "frame.json").read_text(encoding="utf-8"))
    plan = json.loads(cli("plan", light_file, "--tolerance-dn", 0.5, "--json").stdout)
    assert (
        found["left_out"] == [one["stage"] for one in plan["stages"] if not one["kept"]]
        and found["left_out"]
    )
    assert found["options"]["tolerance_dn"] == 0.5
    assert f"left out: {', '.join(found['left_out'])} (tolerance 0.5 DN)" in " ".join(
        done.stdout.split()
    )
    assert "left out:" not in cli("expose", light_file, "-o", tmp_path, "--force").stdout


def test_render_takes_a_tolerance_too(
    scene_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli("render", scene_file, "--spp", 16, "-o", tmp_path / "out", "--tolerance-dn", 0)
    assert done.exit_code == 0, done.stderr
    found = json.loads((tmp_path / "out" / "frame.json").read_text(encoding="utf-8"))
    assert found["left_out"] and all(
        one["reason"] == "has no effect here" for one in found["effects"] if not one["kept"]
    )


def test_a_refused_tolerance_ends_with_code_2_and_writes_nothing(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli("expose", light_file, "-o", tmp_path / "out", "--tolerance-dn", -1)
    assert done.exit_code == 2 and "--tolerance-dn is" in done.stderr
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_plan_as_json_holds_the_stages(light_file: Path, cli: Callable[..., Any]) -> None:
    found = json.loads(cli("plan", light_file, "--tolerance-dn", 0.5, "--json").stdout)
    assert {"camera", "tolerance_dn", "stages", "clipped", "pixels"} <= set(found)


def test_plan_takes_a_scene_as_well(scene_file: Path, cli: Callable[..., Any]) -> None:
    done = cli("plan", scene_file, "--spp", 16)
    assert done.exit_code == 0 and "shot noise" in done.stdout


@pytest.mark.exhaustive
def test_a_camera_whose_noise_band_cuts_its_noise_says_so(
    light_file: Path, tmp_path: Path, cli: Any
) -> None:
    """On the screen for cameras show and expose, and in frame.json."""
    file = tmp_path / "narrow.toml"
    text = (SHIPPED / "konnik_table1.toml").read_text("utf-8")
    file.write_text(
        text.replace("corner_hz = 1e6", "corner_hz = 1e6\nband_hz = [1.0, 1e4]"), "utf-8"
    )
    said = cli("cameras", "show", file).stdout
    assert "note: source_follower.band_hz [1.0, 10000.0] leaves" in said
    done = cli("expose", light_file, "--camera", file, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert "band_hz" in done.stdout + done.stderr
    (note,) = json.loads((tmp_path / "out" / "frame.json").read_text("utf-8"))["camera"][
        "notes"
    ]
    assert "of 6.11 e- of read noise" in note


def test_cameras_list_and_show_tell_where_every_number_comes_from(
    cli: Callable[..., Any],
) -> None:
    said = cli("cameras", "list").stdout
    for name in ms.list_cameras():
        assert name in said
        shown = json.loads(cli("cameras", "show", name, "--json").stdout)
        assert shown["name"] == name and shown["sources"]
        assert "adc.bits" in cli("cameras", "show", name).stdout
    listed = json.loads(cli("cameras", "list", "--json").stdout)
    assert [one["name"] for one in listed] == ms.list_cameras()
    for one in listed:
        sensor = ms.load_camera(one["name"]).sensor
        size = one["technology"], one["columns"], one["rows"]
        assert size == (sensor.technology, sensor.columns, sensor.rows)


def test_the_lenses_that_come_along_are_listed_with_their_source(
    cli: Callable[..., Any],
) -> None:
    known = {one["name"]: one for one in json.loads(cli("cameras", "lenses", "--json").stdout)}
    assert known["double_gauss"]["focal_length_mm"] == pytest.approx(50, rel=0.01)
    assert all(one["source"] and one["surfaces"] >= 2 for one in known.values())
    assert "double_gauss" in cli("cameras", "lenses").stdout


def test_the_schema_knows_every_table_of_a_camera_file(cli: Callable[..., Any]) -> None:
    schema = json.loads(cli("cameras", "schema").stdout)
    assert {"sensor", "pixel", "adc", "lens"} <= set(schema["properties"])


def test_help_shows_an_example_for_every_command_that_needs_one(
    cli: Callable[..., Any],
) -> None:
    assert "mitsuba-sensor render first_frame -o out/" in cli("--help").stdout
    for command in ("render", "expose", "plan"):
        assert f"Example: mitsuba-sensor {command}" in cli(command, "--help").stdout


@pytest.mark.parametrize("columns", [72, 80, 200])
@pytest.mark.parametrize("command", one_in(3, ["render", "expose", "plan", "fpn-maps", "lint"]))
def test_help_names_every_flag_in_full(
    command: str, columns: int, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", columns)
    shown = re.findall(r"--[a-z-]*…", cli(command, "--help-all").stdout)
    assert not shown


@pytest.mark.exhaustive
def test_doctor_survives_and_says_what_works(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mitsuba_sensor", "doctor", "--json"],
        capture_output=True,
        text=True,
    )
    findings = json.loads(done.stdout)
    assert done.returncode == 0 and findings["works"]
    assert {one["name"]: one["works"] for one in findings["variants"]}["scalar_spectral"]
    assert findings["python"]["works"] and "--variant" not in done.stdout
    assert findings["versions"]["drjit"]
    assert all(library["reason"] for library in findings["llvm"])


def test_doctor_reports_a_render_that_kills_its_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from mitsuba_sensor.render import doctor

    monkeypatch.setattr(
        doctor, "_run", lambda _: (-signal.SIGABRT, "", "LLVM ERROR: Cannot select")
    )
    findings = doctor.examine()
    assert not findings["works"]
    assert "SIGABRT" in findings["variants"][0]["reason"]
    assert "SIGABRT" in findings["python"]["reason"]
    assert findings["remedies"]


def test_doctor_names_the_command_when_the_fast_variant_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from mitsuba_sensor.render import doctor

    said = json.dumps({"render": {"variant": "scalar_spectral"}, "times_s": {"render": 1.0}})
    monkeypatch.setattr(doctor, "_run", lambda _: (0, said, ""))
    findings = doctor.examine()
    assert findings["works"]
    assert any("apt-get install libllvm19" in remedy for remedy in findings["remedies"])


def test_results_may_be_read_by_everyone_the_umask_allows(
    light_file: Path, tmp_path: Path, cli: Any
) -> None:
    assert cli("expose", light_file, "-o", tmp_path / "out").exit_code == 0
    mask = os.umask(0)
    os.umask(mask)
    assert (tmp_path / "out" / "frame.tiff").stat().st_mode & 0o777 == 0o666 & ~mask


def test_clean_writes_the_expectation_and_the_variance_of_the_frame(
    light: Any, light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli(
        "expose",
        light_file,
        "-o",
        tmp_path / "a",
        "--frames",
        3,
        "--exposure-s",
        0.01,
        "--clean",
    )
    assert done.exit_code == 0, done.stderr
    clean, variance = (
        tifffile.imread(tmp_path / "a" / name)
        for name in ("clean.tiff", "temporal_variance.tiff")
    )
    frames = ms.capture(
        light, ms.load_camera("konnik_table1"), ms.Exposure(0.01), frames=3
    ).frames
    assert clean.dtype == variance.dtype == np.float32 and clean.shape == variance.shape == (
        12,
        16,
    )
    assert (clean == frames.clean).all() and (variance == frames.temporal_variance).all()
    assert cli("expose", light_file, "-o", tmp_path / "b", "--exposure-s", 0.01).exit_code == 0
    assert not (tmp_path / "b" / "clean.tiff").exists()


def test_every_frame_with_a_render_of_its_own_has_its_own_clean_frame(
    scene_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    given = [
        "--spp",
        "16",
        "--frames",
        "2",
        "--render-noise",
        "per-frame",
        "--clean",
        "--wavelength-nm",
        "550",
    ]
    done = cli("render", scene_file, "-o", tmp_path, *given)
    assert done.exit_code == 0, done.stderr
    clean = tifffile.imread(tmp_path / "clean.tiff")
    assert clean.shape == (2, 12, 16) and (clean[0] != clean[1]).any()
