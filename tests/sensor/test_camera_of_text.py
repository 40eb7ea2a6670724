"""Cameras without a file: from a dict of tables and from the text of a camera file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.shipped import SHIPPED

QE = "wavelength_nm,mono_percent\n400,10\n700,50\n"


def text_of(name: str) -> str:
    return (SHIPPED / f"{name}.toml").read_text("utf-8")


@pytest.mark.parametrize("name", ["konnik_table1", "bayer_2mp", "scmos_dual_gain"])
def test_text_and_dict_are_the_camera_of_the_file(name: str) -> None:
    camera, text = ms.load_camera(name), text_of(name)
    for source in (
        text,
        text.replace("\n", "\r\n"),
        tomllib.loads(text),
        camera.to_toml(),
        camera.model_dump(),
    ):
        assert ms.load_camera(source) == camera
    assert ms.check_camera(text) == () == ms.check_camera(tomllib.loads(text))


def test_a_dict_may_have_numpy_numbers_arrays_and_paths_and_stays_as_it_is(
    tmp_path: Path,
) -> None:
    (tmp_path / "qe.csv").write_text(QE, "utf-8")
    tables: dict[str, Any] = tomllib.loads(text_of("konnik_table1"))
    tables["adc"] = {"bits": np.int64(14), "full_scale_v": np.float32(0.5)}
    tables["quantum_efficiency"] = {
        "wavelengths_nm": np.array([400.0, 700.0]),
        "curves": {"mono": np.array([0.2, 0.4])},
    }
    before = repr(tables)
    camera = ms.load_camera(tables)
    assert (camera.adc.bits, camera.adc.full_scale_v) == (14, 0.5) and repr(tables) == before
    assert camera.qe([550.0]).item() == pytest.approx(0.3)
    tables["quantum_efficiency"] = {"file": tmp_path / "qe.csv", "reference_nm": 550}
    assert ms.load_camera(tables).qe([550.0]).item() == pytest.approx(0.3)


def test_files_that_they_name_are_sought_in_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "qe.csv").write_text(QE, "utf-8")
    monkeypatch.chdir(tmp_path)
    tables = tomllib.loads(text_of("konnik_table1"))
    tables["quantum_efficiency"] = {"file": "qe.csv", "reference_nm": 550}
    assert ms.load_camera(tables).qe([700.0]).item() == 0.5
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    with pytest.raises(ms.InputError, match=r"qe\.csv"):
        ms.load_camera(tables)
