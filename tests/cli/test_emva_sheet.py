"""cameras new --emva: the rows of a sheet, in its order and in one round, make a camera with the sheet's figures."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import COMPARED, KEYS, ROWS, camera_of_sheet
from mitsuba_sensor.camera.emva_sheet_file import NAMES
from mitsuba_sensor.cli import app

SHEETS: dict[str, dict[str, str]] = {
    # EMVA 1288 figures of an IMX174 camera, as in camera/cameras/sony_imx174.toml
    "sony_imx174": {
        "pitch_um": "5.86",
        "size": "1920 x 1200",
        "bits": "12",
        "wavelength_nm": "525",
        "qe": "77",
        "gain_dn_per_e": "1/8.16",
        "read_noise_e": "6.83",
        "saturation_e": "32691",
        "dsnu_e": "0",
        "prnu": "1",
        "dark_e_per_s": "5",
        "dark_temperature_k": "25",
    },
    # the data sheet of the ams CMV4000, as in examples/cmv4000.toml
    "cmv4000": {
        "pitch_um": "5.5 x 5.5",
        "size": "2048x2048",
        "bits": "10",
        "wavelength_nm": "550",
        "qe": "60",
        "gain_dn_per_e": "0.075",
        "read_noise_e": "13",
        "snr_max_db": "41.3",
        "saturation_e": "13500",
        "dsnu_e": "13,5",
        "prnu": "1",
        "linearity_percent": "0.5",
        "dark_e_per_s": "125",
        "dark_temperature_k": "25",
    },
    # Photometrics Prime 95B, as in camera/cameras/photometrics_prime_95b.toml
    "prime_95b": {
        "pitch_um": "11",
        "size": "1200 × 1200",
        "bits": "16",
        "wavelength_nm": "540",
        "qe": "94",
        "gain_dn_per_e": "1.3024",
        "read_noise_e": "1.4658",
        "absolute_sensitivity_e": "2.1",
        "saturation_e": "50200",
        "dynamic_range_db": "87.6",
        "dsnu_e": "0.3",
        "prnu": "0.5",
        "dark_e_per_s": "0.413",
        "dark_temperature_k": "-20",
    },
}


def typed(sheet: dict[str, str]) -> str:
    """What a user types: a line for each row that is asked."""
    asked = [
        row for row in ROWS if row.key != "dark_temperature_k" or sheet["dark_e_per_s"] != "0"
    ]
    return "".join(f"{sheet.get(row.key, '')}\n" for row in asked)


def new(folder: Path, sheet: dict[str, str], *more: str) -> Any:
    arguments = ["cameras", "new", str(folder / "my.toml"), "--emva", *more]
    return CliRunner().invoke(app, arguments, input=typed(sheet))


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_in_one_round_is_a_camera_with_its_figures(name: str, tmp_path: Path) -> None:
    sheet = SHEETS[name]
    done = new(tmp_path, sheet, "--name", name)
    assert done.exit_code == 0, done.stderr
    checked = CliRunner().invoke(app, ["cameras", "check", str(tmp_path / "my.toml")])
    assert checked.exit_code == 0 and "nothing is wrong" in checked.stdout
    camera = ms.load_camera(tmp_path / "my.toml")
    figures = camera.emva1288()
    gain = 1 / 8.16 if name == "sony_imx174" else float(sheet["gain_dn_per_e"])
    assert camera.name == name
    assert figures.system_gain_dn_per_e == pytest.approx(gain, rel=1e-9)
    assert figures.temporal_dark_noise_e == pytest.approx(
        float(sheet["read_noise_e"]), rel=1e-9
    )
    assert figures.saturation_e == pytest.approx(float(sheet["saturation_e"]), rel=1e-4)
    qe = camera.qe([float(sheet["wavelength_nm"])])[0, 0]
    assert qe == pytest.approx(float(sheet["qe"]) / 100)
    assert camera.pixel.prnu == pytest.approx(float(sheet["prnu"]) / 100)
    assert camera.pixel.dsnu_e == pytest.approx(float(sheet["dsnu_e"].replace(",", ".")))
    kelvin = float(sheet["dark_temperature_k"]) + 273.15
    assert camera.dark_current.at_temperature_k == pytest.approx(kelvin)
    in_dark = camera.emva1288(ms.Exposure(1.0, kelvin))
    dark_e = figures.saturation_e - in_dark.saturation_e
    assert dark_e == pytest.approx(float(sheet["dark_e_per_s"]), rel=1e-3)
    assert all(text for text in camera.sources.values())


@pytest.mark.parametrize("name", SHEETS)
def test_the_keys_of_a_row_have_its_value(name: str) -> None:
    """As the table of docs/camera-file.md says; the others are compared, or said to be left out."""
    values = {row.key: row.value(SHEETS[name].get(row.key, "")) for row in ROWS}
    camera = camera_of_sheet(values, name, "")
    assert {row.key for row in ROWS} == {*KEYS, *COMPARED, "linearity_percent"}
    for key, fields in KEYS.items():
        value = values[key]
        for field, wanted in zip(fields, value if len(fields) > 1 else (value,), strict=True):
            if field == "quantum_efficiency.curves":
                assert camera.qe([values["wavelength_nm"]])[0, 0] == wanted
            else:
                assert attrgetter(field)(camera) == wanted, field


def test_one_quantum_efficiency_gives_a_curve_of_silicon() -> None:
    """Within 0.06 of the curve of the IMX174, by other hands; other sensors are refused."""
    sheet = {**SHEETS["sony_imx174"], "wavelength_nm": "525", "qe": "77"}
    values = {row.key: row.value(sheet.get(row.key, "")) for row in ROWS}
    camera, known = camera_of_sheet(values, "mine", ""), ms.load_camera("sony_imx174")
    at_nm = np.arange(450, 1001, 50.0)
    np.testing.assert_allclose(camera.qe(at_nm), known.qe(at_nm), atol=0.06)
    (wavelength,) = [row for row in ROWS if row.key == "wavelength_nm"]
    for asked in ("365", "1300"):
        with pytest.raises(ms.InputError, match=r"from 400 to 1000 .*give quantum_eff"):
            wavelength.value(asked)


def test_the_rows_stand_in_the_order_of_the_sheet() -> None:
    order = ["pixel size", "resolution", "bit depth", "QE", "K ", "σ_d", "maximum SNR"]
    order += ["sensitivity threshold", "saturation", "dynamic range", "DSNU", "PRNU", "LE"]
    order += ["dark current [", "temperature of the dark"]
    questions = "\n".join(row.question for row in ROWS)
    places = [questions.index(name) for name in order]
    assert places == sorted(places)


def test_what_cannot_be_is_said_and_asked_again_at_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mitsuba_sensor.cli.new_camera.is_terminal", lambda: True)
    text = typed(SHEETS["sony_imx174"]).replace("1/8.16\n", "a lot\n0\n1/8.16\n")
    text = text.replace("\n77\n", "\n0.77\n77\n") + "mine\n\n"
    arguments = ["cameras", "new", str(tmp_path / "my.toml"), "--emva"]
    done = CliRunner().invoke(app, arguments, input=text)
    assert done.exit_code == 0
    assert "K [DN/e-]" in done.stderr and "is 'a lot'; it must be a number" in done.stderr
    assert "is 0.0; it must be from 1e-06 to 10000" in done.stderr
    assert "QE [%] is 0.77, which is 0.77 %; write 77 if it is a fraction" in done.stderr
    assert ms.load_camera(tmp_path / "my.toml").qe([525.0])[0, 0] == pytest.approx(0.77)


def test_a_wrong_answer_of_a_pipe_ends_it_before_the_others_are_taken_for_other_rows(
    tmp_path: Path,
) -> None:
    for wrong, said in (("0.65", "write 65 if it is a fraction"), ("x", "it must be a number")):
        done = new(tmp_path, {**SHEETS["sony_imx174"], "qe": wrong})
        assert done.exit_code == 2 and said in done.stderr and done.stderr.count("error:") == 1
        assert not list(tmp_path.iterdir())
    done = new(tmp_path, {**SHEETS["sony_imx174"], "prnu": "0.006"})
    assert (
        done.exit_code == 2 and "PRNU [%] is 0.006, which is 0.006 %; write 0.6" in done.stderr
    )


def test_a_small_percentage_that_is_meant_has_its_sign(tmp_path: Path) -> None:
    done = new(tmp_path, {**SHEETS["sony_imx174"], "prnu": "0.006 %", "qe": "1.2%"})
    assert done.exit_code == 0, done.stderr
    camera = ms.load_camera(tmp_path / "my.toml")
    assert camera.pixel.prnu == pytest.approx(6e-5)
    assert camera.qe([525.0])[0, 0] == pytest.approx(0.012)


def sheet_file(folder: Path, sheet: dict[str, str], more: str = "") -> list[str]:
    names = {row.key: name for name, row in NAMES.items()}
    lines = [f"{names[key]} = {value}  # as typed" for key, value in sheet.items()]
    (folder / "sheet.txt").write_text("\n".join(["# EMVA 1288", *lines, more]), "utf-8")
    file, out = str(folder / "sheet.txt"), str(folder / "file.toml")
    return ["cameras", "new", out, "--emva-file", file, "--name", "my", "--force"]


@pytest.mark.parametrize("name", SHEETS)
def test_a_file_of_rows_makes_the_camera_that_typed_ones_make(
    name: str, tmp_path: Path
) -> None:
    assert new(tmp_path, SHEETS[name], "--name", "my").exit_code == 0
    done = CliRunner().invoke(app, sheet_file(tmp_path, SHEETS[name]))
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "file.toml").read_text() == (tmp_path / "my.toml").read_text()


@pytest.mark.parametrize(
    ("changes", "more", "said"),
    [
        ({"qe": "0.65"}, "", "qe_percent: quantum efficiency QE [%] is 0.65, which is 0.65 %"),
        ({}, "qee_percent = 3", "Did you mean 'qe_percent'?"),
        ({}, "bits = 3", "bits is given twice"),
        ({}, "just words", "is no row NAME = VALUE"),
        ({"bits": ""}, "", "bit depth [bit] is empty"),
    ],
)
def test_a_wrong_file_is_one_sentence(
    changes: dict[str, str], more: str, said: str, tmp_path: Path
) -> None:
    argv = sheet_file(tmp_path, {**SHEETS["sony_imx174"], **changes}, more)
    done = CliRunner().invoke(app, argv)
    assert done.exit_code == 2 and said in done.stderr, done.stderr
    assert not (tmp_path / "file.toml").exists()


def test_a_file_without_a_row_names_all_that_are_missing(tmp_path: Path) -> None:
    (tmp_path / "sheet.txt").write_text("bits = 12\n", "utf-8")
    argv = ["cameras", "new", str(tmp_path / "my.toml"), "--emva-file"]
    done = CliRunner().invoke(app, [*argv, str(tmp_path / "sheet.txt")])
    assert done.exit_code == 2 and "pitch_um (pixel size [µm])" in done.stderr
    assert "dark_e_per_s" in done.stderr and "snr_max_db" not in done.stderr
    assert CliRunner().invoke(app, [*argv, str(tmp_path / "none.txt")]).exit_code == 2


def test_no_dark_current_has_no_temperature(tmp_path: Path) -> None:
    sheet = {**SHEETS["sony_imx174"], "dark_e_per_s": "0"}
    done = new(tmp_path, sheet)
    assert done.exit_code == 0, done.stderr
    assert "temperature" not in done.stderr
    assert ms.load_camera(tmp_path / "my.toml").dark_current.at_temperature_k is None


@pytest.mark.parametrize(("typed", "row"), [("", "pixel size"), ("5.86\n", "resolution")])
def test_answers_that_end_too_early_are_one_sentence_and_write_nothing(
    tmp_path: Path, typed: str, row: str
) -> None:
    """Nobody is asked who cannot type."""
    arguments = ["cameras", "new", str(tmp_path / "my.toml"), "--emva"]
    done = CliRunner().invoke(app, arguments, input=typed)
    assert done.exit_code == 2 and not done.stdout
    assert done.stderr.startswith(f"error: the answers end before the row '{row}")
    assert done.stderr.count(".\n") == 1 and "--emva-file" in done.stderr
    assert not list(tmp_path.iterdir())


def test_rows_that_follow_from_others_are_compared(tmp_path: Path) -> None:
    done = new(tmp_path, SHEETS["cmv4000"])
    assert "SNR_max: 41.3 dB on the sheet, 41.3 dB of this camera" in done.stdout
    assert "the camera is linear" in done.stdout
    wrong = new(tmp_path, {**SHEETS["cmv4000"], "bits": "8"}, "--force")
    assert "the 8 bits end" in wrong.stdout


def test_a_name_of_one_s_own(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    like = ["cameras", "new", str(file), "--like", "bayer_2mp", "--force"]
    done = CliRunner().invoke(app, like)
    assert ms.load_camera(file).name == "mine"
    assert ms.load_camera(file).description == "a camera like bayer_2mp"
    assert "note: the camera is called 'mine', as its file" in done.stdout
    done = CliRunner().invoke(app, [*like, "--name", "A 1", "--description", "of my own"])
    assert "note" not in done.stdout
    camera = ms.load_camera(file)
    assert (camera.name, camera.description) == ("A 1", "of my own")


def test_a_terminal_is_asked_for_name_and_description(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mitsuba_sensor.cli.new_camera.is_terminal", lambda: True)
    file = tmp_path / "mine.toml"
    done = CliRunner().invoke(app, ["cameras", "new", str(file)], input="A 2\n\n")
    assert done.exit_code == 0 and "note" not in done.stdout
    camera = ms.load_camera(file)
    assert (camera.name, camera.description) == ("A 2", "a camera like konnik_table1")


def test_a_sheet_and_a_camera_are_two_ways(tmp_path: Path) -> None:
    done = new(tmp_path, SHEETS["cmv4000"], "--like", "bayer_2mp")
    assert done.exit_code == 2 and "give one of these" in done.stderr
