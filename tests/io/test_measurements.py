"""Measurements on disk: what was measured is not measured again, and never stands under another question."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.io.measurements import Measurements

QUESTION = {"study": "ablation", "camera": {"adc": {"bits": 12}, "pixel": {"pitch": 5.0}}, "seeds": (1, 2)}


def filled(folder: Path) -> Measurements:
    found = Measurements(folder, QUESTION)
    found["first"] = {"seconds": [0.25, 1 / 3], "error": math.inf, "none": None, "array": np.arange(3.0)}
    found["second"] = [1, 2, 3]
    return found


def test_a_later_process_reads_every_bit_of_what_was_measured(tmp_path: Path) -> None:
    here, later = filled(tmp_path / "new"), Measurements(tmp_path / "new", QUESTION)
    assert set(later) == {"first", "second"} and later["second"] == [1, 2, 3]
    assert later["first"]["seconds"] == [0.25, 1 / 3] and later["first"]["error"] == math.inf
    np.testing.assert_array_equal(later["first"]["array"], here["first"]["array"])


@pytest.mark.parametrize("left", [0, 1, 30])
def test_a_file_that_was_cut_short_is_measured_again(tmp_path: Path, left: int) -> None:
    folder = filled(tmp_path).folder
    for path in folder.glob("*.pickle"):
        if b"first" in (content := path.read_bytes()):
            path.write_bytes(content[:left])
    resumed = Measurements(tmp_path, QUESTION)
    assert list(resumed) == ["second"]
    resumed["first"] = 1
    assert Measurements(tmp_path, QUESTION)["first"] == 1


@pytest.mark.parametrize(
    "change",
    [
        {"camera": {"adc": {"bits": 14}, "pixel": {"pitch": 5.0}}},
        {"scene_sha256": "another"},
        {"versions": {"mitsuba": "9"}},
        {"machine": {"cpus": 3}},
    ],
)
def test_measurements_of_another_question_are_not_read_and_not_lost(tmp_path: Path, change: dict[str, Any]) -> None:
    filled(tmp_path)
    other = Measurements(tmp_path, {**QUESTION, **change})
    assert not other
    other["first"] = "of the other"
    assert Measurements(tmp_path, QUESTION)["first"]["none"] is None


def test_measuring_anew_forgets_what_there_is_for_this_question_alone(tmp_path: Path) -> None:
    filled(tmp_path)
    other = {**QUESTION, "seeds": 3}
    Measurements(tmp_path, other)["first"] = 3
    anew = Measurements(tmp_path, QUESTION, force=True)
    assert not anew
    anew["third"] = 3
    assert list(Measurements(tmp_path, QUESTION)) == ["third"] and Measurements(tmp_path, other)["first"] == 3


def test_what_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ms.InputError, match="cannot write"):
        Measurements(tmp_path / "file", QUESTION)["first"] = 1


def test_nothing_is_written_before_the_first_measurement(tmp_path: Path) -> None:
    Measurements(tmp_path / "new", QUESTION)
    assert not (tmp_path / "new").exists()
