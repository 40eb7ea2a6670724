"""cameras new --emva: a file with the rows of a sheet makes a camera with the sheet's figures."""

from __future__ import annotations

from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import COMPARED, KEYS, EmvaSheet, camera_of_sheet
from mitsuba_sensor.cli import app

IMX174 = {
    **{"pitch_um": 5.86, "size": [1920, 1200], "bits": 12, "wavelength_nm": 525},
    **{"qe_percent": 77, "gain_dn_per_e": 1 / 8.16, "read_noise_e": 6.83},
    **{"saturation_e": 32691, "dsnu_e": 0, "prnu_percent": 1},
    **{"dark_e_per_s": 5, "dark_temperature_c": 25},
}
"""EMVA 1288 figures of a camera with this sensor, as in camera/cameras/sony_imx174.toml."""
CMV4000 = {
    **{"pitch_um": [5.5, 5.4], "size": [2048, 2048], "bits": 10, "wavelength_nm": 550},
    **{"qe_percent": 60, "gain_dn_per_e": 0.075, "read_noise_e": 13, "snr_max_db": 41.3},
    **{"saturation_e": 13500, "dsnu_e": 13.5, "prnu_percent": 1, "linearity_percent": 0.5},
    **{"dark_e_per_s": 125, "dark_temperature_c": -20},
}
"""The data sheet of the ams CMV4000, as in examples/cmv4000.toml."""
SHEETS: dict[str, dict[str, Any]] = {"sony_imx174": IMX174, "cmv4000": CMV4000}


def new(folder: Path, sheet: dict[str, Any], *more: str) -> Any:
    lines = [f"{name} = {value}  # [unit]" for name, value in sheet.items()]
    (folder / "sheet.txt").write_text("\n".join(["# EMVA 1288", *lines]), "utf-8")
    file = str(folder / "my.toml")
    return CliRunner().invoke(
        app, ["cameras", "new", file, "--emva", str(folder / "sheet.txt"), *more]
    )


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_is_a_camera_with_its_figures(name: str, tmp_path: Path) -> None:
    sheet = SHEETS[name]
    done = new(tmp_path, sheet, "--name", name)
    assert done.exit_code == 0, done.stderr
    assert not [x for x in ms.check_camera(tmp_path / "my.toml") if x.level == "error"]
    camera = ms.load_camera(tmp_path / "my.toml")
    figures = camera.emva1288()
    assert camera.name == name
    for figure, row in (
        ("system_gain_dn_per_e", "gain_dn_per_e"),
        ("temporal_dark_noise_e", "read_noise_e"),
        ("saturation_e", "saturation_e"),
    ):
        assert getattr(figures, figure) == pytest.approx(sheet[row], rel=1e-4)
    in_dark = camera.emva1288(ms.Exposure(1.0, sheet["dark_temperature_c"] + 273.15))
    dark_e = figures.saturation_e - in_dark.saturation_e
    assert dark_e == pytest.approx(sheet["dark_e_per_s"], rel=1e-3)
    assert all(text for text in camera.sources.values())


@pytest.mark.parametrize("name", SHEETS)
def test_the_keys_of_a_row_have_its_value(name: str) -> None:
    """As the table of docs/camera-file.md says; the others are compared, or said to be left out."""
    sheet = EmvaSheet(**SHEETS[name])
    camera, rows = camera_of_sheet(sheet, name, ""), EmvaSheet.model_fields
    assert {*rows} == {*KEYS, *COMPARED, "linearity_percent"}
    for row, fields in KEYS.items():
        value = getattr(sheet, row)
        scale, offset = 0.01 if row.endswith("percent") else 1, 273.15 * row.endswith("_c")
        for field, wanted in zip(fields, value if len(fields) > 1 else (value,), strict=True):
            seen = attrgetter(field)(camera)
            if row == "qe_percent":
                seen = camera.qe([sheet.wavelength_nm])[0, 0]
            assert seen == pytest.approx(scale * wanted + offset, rel=1e-9), field


def test_one_quantum_efficiency_gives_a_curve_of_silicon() -> None:
    """Within 0.06 of the curve of the IMX174, by other hands; other sensors are refused."""
    camera, known = (
        camera_of_sheet(EmvaSheet(**IMX174), "my", ""),
        ms.load_camera("sony_imx174"),
    )
    at_nm = np.arange(450, 1001, 50.0)
    np.testing.assert_allclose(camera.qe(at_nm), known.qe(at_nm), atol=0.06)
    for asked in (365, 1300):
        sheet = EmvaSheet(**{**IMX174, "wavelength_nm": asked})
        with pytest.raises(ms.InputError, match=r"from 400 to 1000 .*give quantum_eff"):
            camera_of_sheet(sheet, "my", "")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"qe_percent": 0.65}, "write 65"),
        ({"prnu_percent": 0.006}, "write 0.6"),
        ({"qe_percent": "'x'"}, "qe_percent is 'x'; it must be a number"),
        ({"gain_dn_per_e": 0}, "K"),
        ({"qee_percent": 3}, "Did you mean 'qe_percent'?"),
        ({"bits": ""}, "not valid TOML"),
        ({"dark_temperature_c": None}, "dark_temperature_c is missing"),
        ({"pitch_um": None}, "pitch_um is missing; pixel size"),
    ],
)
def test_a_wrong_sheet_is_one_sentence(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    sheet = {name: x for name, x in {**IMX174, **changes}.items() if x is not None}
    done = new(tmp_path, sheet)
    assert done.exit_code == 2 and done.stderr.count("error:") == 1, done.stderr
    assert said in done.stderr
    assert not (tmp_path / "my.toml").exists()


def test_no_dark_current_has_no_temperature(tmp_path: Path) -> None:
    sheet = {name: x for name, x in IMX174.items() if name != "dark_temperature_c"}
    done = new(tmp_path, {**sheet, "dark_e_per_s": 0})
    assert done.exit_code == 0, done.stderr
    assert ms.load_camera(tmp_path / "my.toml").dark_current.at_temperature_k is None


def test_rows_that_follow_from_others_are_compared(tmp_path: Path) -> None:
    done = new(tmp_path, CMV4000)
    assert "SNR_max: 41.3 dB on the sheet, 41.3 dB of this camera" in done.stdout
    assert "the camera is linear" in done.stdout
    assert "the 8 bits end" in new(tmp_path, {**CMV4000, "bits": 8}, "--force").stdout


def test_a_name_of_one_s_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "mine.toml"
    like = ["cameras", "new", str(file), "--like", "bayer_2mp", "--force"]
    done = CliRunner().invoke(app, like)
    camera = ms.load_camera(file)
    assert (camera.name, camera.description) == ("mine", "a camera like bayer_2mp")
    assert "note: the camera is called 'mine', as its file" in done.stdout
    done = CliRunner().invoke(app, [*like, "--name", "A 1", "--description", "of my own"])
    assert "note" not in done.stdout
    camera = ms.load_camera(file)
    assert (camera.name, camera.description) == ("A 1", "of my own")
    monkeypatch.setattr("mitsuba_sensor.cli.new_camera.is_terminal", lambda: True)
    done = CliRunner().invoke(app, like, input="A 2\n\n")
    assert done.exit_code == 0 and "note" not in done.stdout
    assert ms.load_camera(file).name == "A 2"


def test_a_sheet_and_a_camera_are_two_ways(tmp_path: Path) -> None:
    done = new(tmp_path, CMV4000, "--like", "bayer_2mp")
    assert done.exit_code == 2 and "give one of both" in done.stderr
