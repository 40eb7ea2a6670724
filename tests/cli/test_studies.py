"""mitsuba-sensor study: what it asks of a study, what it leaves in the folder, and how it goes on after a stop."""

from __future__ import annotations

import json
from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import SKY, scene_text, write_scene
from typer.testing import CliRunner

from mitsuba_sensor.cli import app
from mitsuba_sensor.study import error_time, left_out
from mitsuba_sensor.study.page import Line, Plot, Study, Table

STEPS = ("one", "two", "three")


class Recorder:
    """In place of a study: it measures three steps, notes what it was asked, and stops where it is told to."""

    def __init__(self, stop_before: str = "", passed: bool = True) -> None:
        self.stop_before, self.passed, self.measured, self.words = stop_before, passed, list[str](), dict[str, Any]()

    def __call__(
        self, *scene_camera_exposure: Any, done: MutableMapping[str, Any], progress: Any, **words: Any
    ) -> Study:
        self.scene, self.camera, self.exposure = scene_camera_exposure
        self.words = words
        for step in STEPS:
            if step == self.stop_before:
                raise KeyboardInterrupt
            if step not in done:
                progress(0.0, 3.0, step)
                self.measured.append(step)
                done[step] = len(step) / 7
        rows = tuple((step, done[step]) for step in STEPS)
        plot = Plot("plot", "x", "y", (Line("a", (1.0, 2.0), (1.0, 2.0)),))
        return Study("left-out", "title", ("found",), self.passed, (Table("t", ("step", "s"), rows), plot), {"n": 3})


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene(tmp_path, scene_text(SKY))


def lines_of(folder: Path) -> list[str]:
    return (folder / "measurements.jsonl").read_text(encoding="utf-8").splitlines()


def study(monkeypatch: pytest.MonkeyPatch, recorder: Recorder, *words: str) -> Any:
    monkeypatch.setattr(left_out, "left_out", recorder)
    monkeypatch.setattr(error_time, "error_time", recorder)
    return CliRunner().invoke(app, ["study", *words])


def test_a_study_leaves_a_page_numbers_a_picture_and_its_measurements(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    done = study(monkeypatch, Recorder(), "left-out", str(scene), "-o", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "study.html", "study.json", "left-out.png", "measurements.jsonl",
    }  # fmt: skip
    numbers = json.loads((tmp_path / "out" / "study.json").read_text(encoding="utf-8"))
    assert numbers["n"] == 3 and numbers["machine"]["cpus"] and numbers["resumed_measurements"] == 0
    assert numbers["command"].startswith("mitsuba-sensor") and numbers["versions"]["mitsuba"]
    assert str(tmp_path / "out") not in numbers["command"] and numbers["seconds"] >= 0


def test_a_study_that_was_stopped_goes_on_where_it_was(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    words = ("left-out", str(scene), "-o", str(tmp_path / "out"))
    stopped = study(monkeypatch, Recorder(stop_before="three"), *words)
    assert stopped.exit_code == 130 and "2 measurements are kept" in stopped.output
    again = Recorder()
    assert study(monkeypatch, again, *words).exit_code == 0
    assert again.measured == ["three"]
    spent_s = [json.loads(line)["value"] for line in lines_of(tmp_path / "out") if '"seconds spent"' in line]
    assert len(spent_s) == 2 and spent_s[1] > spent_s[0] > 0, "both runs count"
    assert study(monkeypatch, Recorder(), *words).exit_code == 0
    assert len(lines_of(tmp_path / "out")) == 1 + 3 + 2, "a third run measures nothing and says nothing"
    anew = Recorder()
    assert study(monkeypatch, anew, *words, "--force").exit_code == 0
    assert anew.measured == list(STEPS)


def test_measurements_of_another_camera_are_refused_and_kept(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    words = ("left-out", str(scene), "-o", str(tmp_path / "out"))
    assert study(monkeypatch, Recorder(), *words).exit_code == 0
    before = (tmp_path / "out" / "measurements.jsonl").read_bytes()
    refused = study(monkeypatch, Recorder(), *words, "--set", "adc.bits=14")
    assert refused.exit_code == 2 and "camera.adc.bits" in refused.output
    assert (tmp_path / "out" / "measurements.jsonl").read_bytes() == before


def test_a_study_where_something_fails_says_so_by_its_exit_code(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    found = study(monkeypatch, Recorder(passed=False), "left-out", str(scene), "-o", str(tmp_path / "o"), "--json")
    assert found.exit_code == 1
    assert json.loads(found.stdout)["passed"] is False


def test_the_words_of_the_command_reach_the_study(monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path) -> None:
    recorder, folder = Recorder(), ("-o", str(tmp_path / "a"))
    asked = ("--tolerance-dn", "0.5", "--spp", "8", "--frames", "3", "--columns", "6", "--seed", "5", "--serial", "9")
    where = ("--camera", "bayer_2mp", "--exposure-s", "0.01", "--temperature-k", "250")
    assert study(monkeypatch, recorder, "left-out", str(scene), *folder, *asked, *where).exit_code == 0
    assert (recorder.camera.name, recorder.exposure.time_s, recorder.exposure.temperature_k) == ("bayer_2mp", 0.01, 250)
    assert recorder.words == {
        "tolerance_dn": 0.5, "spp": 8, "frames": 3, "columns": 6, "seed": 5, "serial": 9, "parameters": {},
        "variant": None, "scene_unit": None,
    }  # fmt: skip
    recorder, folder = Recorder(), ("-o", str(tmp_path / "b"))
    asked = ("--tolerance", "0.1", "--seeds", "3", "--side", "sensor", "--variant", "scalar_spectral")
    assert study(monkeypatch, recorder, "error-time", str(scene), *folder, *asked).exit_code == 0
    assert recorder.words == {
        "tolerance": 0.1, "seeds": 3, "sides": ("sensor",), "variants": ["scalar_spectral"], "columns": None,
        "parameters": {}, "scene_unit": None,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--side", "both"), "sides is ('both',)"),
        (("--tolerance", "0"), "tolerance is 0"),
        (("--variant", "scalar_rgb"), "scalar_rgb"),
        (("--columns", "0"), "width is 0"),
    ],
)
def test_what_cannot_be_studied_is_one_sentence(
    scene: Path, tmp_path: Path, words: tuple[str, ...], sentence: str
) -> None:
    done = CliRunner().invoke(app, ["study", "error-time", str(scene), "-o", str(tmp_path / "out"), *words])
    assert done.exit_code == 2 and sentence in done.output and "Traceback" not in done.output
    assert not (tmp_path / "out").exists()
