"""The command "study": its arguments and the files that it writes."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import SKY, scene_text, write_scene
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app
from mitsuba_sensor.pages.page import Line, Plot, Section, Study, Table, study_of
from mitsuba_sensor.study import ablation, work_precision
from mitsuba_sensor.study.kit import Progress, Subject


class Recorder:
    """In place of a study: it notes what it was asked."""

    def __init__(self, passed: bool = True) -> None:
        self.passed = passed

    def __call__(self, subject: Subject, progress: Progress, **given: Any) -> Study:
        self.subject, self.given = subject, given
        progress("one", 0.5)
        plot = Plot("plot", "x", "y", (Line("a", (1.0, 2.0), (1.0, 2.0)),))
        section = Section(("found",), self.passed, (Table("t", ("step",), (("one",),)), plot))
        return study_of("ablation", "title", [section], n=3)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene(tmp_path, scene_text('<default name="exposure_s" value="0.1"/>', SKY))


def study(monkeypatch: pytest.MonkeyPatch, recorder: Recorder, *arguments: str) -> Any:
    monkeypatch.setattr(ablation, "ablation", recorder)
    monkeypatch.setattr(work_precision, "work_precision", recorder)
    return CliRunner().invoke(app, ["study", *arguments])


def test_a_study_leaves_a_page_numbers_and_a_picture(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    done = study(monkeypatch, Recorder(), "ablation", str(scene), "-o", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    left = {"study.html", "study.json", "ablation.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == left
    numbers = json.loads((tmp_path / "out" / "study.json").read_text(encoding="utf-8"))
    assert numbers["n"] == 3 and numbers["machine"]["cpus"] and numbers["load"]
    assert numbers["command"].startswith("mitsuba-sensor") and numbers["versions"]["mitsuba"]
    assert str(tmp_path / "out") not in numbers["command"] and numbers["seconds"] >= 0
    assert numbers["camera"] == "konnik_table1" and numbers["exposure"]["time_s"] == 0.1


def test_a_study_where_something_fails_says_so_by_its_exit_code(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    found = study(
        monkeypatch,
        Recorder(passed=False),
        "ablation",
        str(scene),
        "-o",
        str(tmp_path / "o"),
        "--json",
    )
    assert found.exit_code == 1
    assert json.loads(found.stdout)["passed"] is False


def test_the_options_of_the_command_reach_the_study(
    monkeypatch: pytest.MonkeyPatch, scene: Path, tmp_path: Path
) -> None:
    recorder, folder = Recorder(), ("-o", str(tmp_path / "a"))
    asked = shlex.split("--tolerance-dn 0.5 --spp 8 --frames 3 --width 6 --seed 5 --serial 9")
    asked += shlex.split("--camera bayer_2mp --exposure-s 0.01 --temperature-k 250")
    assert study(monkeypatch, recorder, "ablation", str(scene), *folder, *asked).exit_code == 0
    subject, exposure = recorder.subject, ms.Exposure(0.01, 250)
    assert (subject.camera.name, subject.exposure) == ("bayer_2mp", exposure)
    assert recorder.given == {"tolerance_dn": 0.5, "frames": 3, "seed": 5, "serial": 9}
    same = {"parameters": {}, "scene_unit": None, "integrator": None}
    same["ignore_polarization"] = False
    assert subject.options == {**same, "width": 6, "spp": 8, "variant": None}
    recorder, folder = Recorder(), ("-o", str(tmp_path / "b"))
    asked = shlex.split("--tolerance 0.1 --seeds 3 --side sensor --variant scalar_spectral")
    done = study(monkeypatch, recorder, "work-precision", str(scene), *folder, *asked)
    assert done.exit_code == 0, done.output
    measured = {"tolerance": 0.1, "seeds": 3, "sides": ("sensor",)}
    assert recorder.given == {**measured, "variants": ["scalar_spectral"]}
    assert recorder.subject.options == {**same, "width": None}


@pytest.mark.exhaustive
def test_a_study_is_of_one_readout_of_a_camera_that_has_several(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, where = Recorder(), ("-o", str(tmp_path / "study"), "--readout", "low")
    asked = ("ablation", "flat_field", "--camera", "scmos_dual_gain")
    assert study(monkeypatch, recorder, *asked, *where).exit_code == 0
    camera = ms.load_camera("scmos_dual_gain").at_readout("low")
    assert recorder.subject.camera.readouts == () and recorder.subject.camera.adc == camera.adc
