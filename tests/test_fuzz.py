"""A short run of benchmarks/fuzz_files.py, and what its longer runs have found."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from helpers import BENCHMARKS

from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.dataset.planned import load_plan
from mitsuba_sensor.render.motion import read_motion
from mitsuba_sensor.sensor.camera_file import SHIPPED, load_camera

sys.path.insert(0, str(BENCHMARKS))

import fuzz_cases
from fuzz_files import report

CASES = 210


def test_damaged_files_are_accepted_or_refused_in_one_sentence() -> None:
    """In a process of its own with a limit of time; both results occur for each kind of file."""
    found = report(CASES, first=7)
    assert found["faults"] == []
    assert found["cases"] == CASES and len(found["counts"]) == 2 * len(fuzz_cases.KINDS)


@pytest.mark.parametrize("kind", fuzz_cases.KINDS)
def test_the_files_that_are_damaged_are_right(kind: str, tmp_path: Path) -> None:
    suffix = fuzz_cases.SUFFIXES.get(kind, ".toml")
    files = (
        [(suffix, text.encode()) for text in fuzz_cases.sources(kind)] if kind != "pixels" else fuzz_cases.pixel_files()
    )
    for one in files:
        found = fuzz_cases.examined_file(kind, *one, tmp_path)
        assert found == ("accepted", ""), found


def test_a_camera_of_a_name_that_is_too_long_is_not_there() -> None:
    with pytest.raises(InputError, match="is no camera that ships"):
        load_camera("9" * 5000)


def test_a_number_that_no_float_holds_is_one_sentence(tmp_path: Path) -> None:
    text = (SHIPPED / "bayer_2mp.toml").read_text("utf-8").replace("cv = 0.4", f"cv = {'9' * 400}")
    with pytest.raises(InputError, match=r"dark_current.cv is 9999"):
        load_camera(text)


@pytest.mark.parametrize("field", ["rotate_deg_per_s", "velocity_m_per_s"])
def test_a_motion_has_no_number_whose_square_is_none(field: str) -> None:
    value = {"rotate_deg_per_s": {"rotate_deg_per_s": 1e308, "axis": [0, 0, 1]}}.get(field, {field: [1e308, 0, 0]})
    with pytest.raises(InputError, match=f"{field}.* is 1e.308"):
        read_motion({"camera": value})


@pytest.mark.parametrize("serial", ['"a"', "1.5", "-1", "true"])
def test_a_serial_number_of_a_dataset_is_whole(serial: str, tmp_path: Path) -> None:
    """1.5 was 1."""
    text = fuzz_cases.DATASET.replace("exposure_s = [0.001, 0.01]", f"exposure_s = [0.001]\nserial = [{serial}]")
    (tmp_path / "d.toml").write_text(text.replace("[splits]\nshares = {train = 0.5, test = 0.5}\n", ""))
    with pytest.raises(InputError, match="serial is"):
        list(load_plan(tmp_path / "d.toml", [fuzz_cases.ROOT]).views())


def test_a_file_of_a_name_that_is_too_long_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "d.toml").write_text(fuzz_cases.DATASET.replace("konnik_table1", "a" * 5000 + ".toml"))
    with pytest.raises(InputError, match="no such file"):
        load_plan(tmp_path / "d.toml", [fuzz_cases.ROOT]).cameras.as_given  # noqa: B018


@pytest.mark.parametrize(("kind", "number"), [("scene", 400312), ("scene", 401474), ("pixels", 500156)])
def test_names_without_end_or_letters_are_shown_as_a_sentence_can(kind: str, number: int, tmp_path: Path) -> None:
    """Of a parameter of the film, of the sensor, and of a channel."""
    assert fuzz_cases.examined(kind, number, tmp_path)[0] == "refused"
