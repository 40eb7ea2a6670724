"""Measurements on disk: what was measured is not measured again, and never stands under another question."""

from __future__ import annotations

import io
import json
import math
import pickle
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.output.measurements import Measurements

QUESTION = {
    "study": "ablation",
    "camera": {"adc": {"bits": 12}, "pixel": {"pitch": 5.0}},
    "seeds": (1, 2),
}


def filled(folder: Path) -> Measurements:
    found = Measurements(folder, QUESTION)
    found["first"] = {"seconds": [0.25, 1 / 3], "error": math.inf, "array": np.arange(3.0)}
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
    for path in folder.glob("*.npz"):
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
def test_measurements_of_another_question_are_not_read_and_not_lost(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    filled(tmp_path)
    other = Measurements(tmp_path, {**QUESTION, **change})
    assert not other
    other["first"] = "of the other"
    assert Measurements(tmp_path, QUESTION)["first"]["error"] == math.inf


class Point(NamedTuple):
    """A place in a plane."""

    x: float
    of: str = ""


@dataclass(frozen=True)
class Line:
    """Some points, and what else a study may keep."""

    points: tuple[Point, ...]
    numbers: dict[Any, Any] = field(default_factory=dict)


VALUES: dict[Any, Any] = {
    (1, "a"): [math.inf, -0.0, None, True, 2**80],
    Point(0.1): (),
    "camera": ms.load_camera("bayer_2mp"),
    "exposure": ms.Exposure(0.01),
    "scalar": np.float32(1) / 3,
    "tables": {"array": [1], "tuple": [], "class": ["os.system", {}], 1: "ä\x1b"},
}


def test_records_come_back_as_they_were(tmp_path: Path) -> None:
    """A dict whose keys are those of the format's own tables stays a dict."""
    kinds = (Line, ms.Exposure)
    Measurements(tmp_path, 1, records=kinds)["line"] = Line(
        (Point(1.5, "b"), Point(-0.0)), VALUES
    )
    line = Measurements(tmp_path, 1, records=kinds)["line"]
    assert line == Line((Point(1.5, "b"), Point(-0.0)), VALUES)
    assert type(line.numbers["scalar"]) is np.float32 and type(line.points[0]) is Point
    assert math.copysign(1, line.points[1].x) == -1


def test_a_class_that_is_not_listed_is_not_made(tmp_path: Path) -> None:
    Measurements(tmp_path, 1, records=(Line,))["line"] = Line((Point(1.5),))
    assert not Measurements(tmp_path, 1)
    assert Measurements(tmp_path, 1, records=(Line,))["line"].points[0].x == 1.5


class Malicious:
    """What a pickle would run."""

    def __reduce__(self) -> Any:
        return pytest.fail, ("a file ran code",)


def archive(**arrays: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as made:
        for name, data in arrays.items():
            made.writestr(f"{name}.npy", data)
    return content.getvalue()


def saved(array: Any) -> bytes:
    content = io.BytesIO()
    np.save(content, array, allow_pickle=True)
    return content.getvalue()


def text(value: object) -> bytes:
    return saved(np.frombuffer(json.dumps(value).encode(), np.uint8))


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps(("first", Malicious())),
        saved(np.array([Malicious()], object)),
        archive(json=saved(np.array([Malicious()], object))),
        archive(json=pickle.dumps(("first", Malicious()))),
        archive(
            **{
                "json": text({"tuple": ["first", {"array": 0}]}),
                "0": saved(np.array([Malicious()], object)),
            }
        ),
        archive(json=text({"tuple": ["first", {"class": ["pytest.fail", {"reason": "ran"}]}]})),
        archive(
            json=text({"tuple": ["first", {"class": ["builtins.eval", {"source": "1/0"}]}]})
        ),
        archive(json=text({"tuple": ["first"]})),
        archive(json=text({"dict": [["first", 1]], "tuple": []})),
        archive(json=text({"dict": [[{"dict": []}, 1]]})),
        archive(json=text(["first", {"class": [f"{__name__}.Point", {"z": 1}]}])),
        archive(json=text(["first", {"camera": {"dict": []}}])),
        archive(json=saved(np.frombuffer(b"[" * 100_000, np.uint8))),
        archive(json=text(None)),
        archive(other=text(1)),
    ],
    ids=lambda content: f"{len(content)} bytes",  # an archive holds the time of its making
)
def test_files_of_strangers_run_nothing_and_are_measured_again(
    tmp_path: Path, content: bytes
) -> None:
    folder = filled(tmp_path).folder
    for name in ("stranger.npz", "stranger.pickle"):
        (folder / name).write_bytes(content)
    resumed = Measurements(tmp_path, QUESTION, records=(Point,))
    assert list(resumed) in (["first", "second"], ["second", "first"]) and resumed[
        "second"
    ] == [1, 2, 3]
    assert resumed["first"]["error"] == math.inf
