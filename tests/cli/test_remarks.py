"""The last lines of a command: the files that it wrote, and what it took because nobody said otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.cli.remarks import taken_by_default, written
from mitsuba_sensor.files.appearing import output_folder
from mitsuba_sensor.render.scene.scene_settings import SceneSettings

CAMERA = ms.load_camera("konnik_table1")
NOTHING = {"camera": None, "exposure_s": None, "meter": None, "temperature_k": None}


@pytest.mark.parametrize(
    ("flags", "settings", "said"),
    [
        (
            {},
            {},
            "camera konnik_table1 (--camera), metered exposure time (--exposure-s), 298.15 K "
            "(--temperature-k)",
        ),
        (
            {"camera": "konnik_table1", "temperature_k": 298.15},
            {},
            "metered exposure time (--exposure-s)",
        ),
        ({"meter": "median"}, {"camera": CAMERA, "temperature_k": 300.0}, None),
        ({"temperature_k": 300.0}, {"camera": CAMERA, "exposure_s": 0.1}, None),
    ],
)
def test_what_neither_user_nor_scene_gave_is_said(
    flags: dict[str, Any], settings: dict[str, Any], said: str | None
) -> None:
    remarks = taken_by_default({**NOTHING, **flags}, SceneSettings(**settings), CAMERA)
    assert remarks == ([] if said is None else [f"taken by default: {said}"])


def test_a_command_without_an_exposure_says_none() -> None:
    assert taken_by_default({"camera": None}, SceneSettings(), CAMERA) == [
        "taken by default: camera konnik_table1 (--camera)"
    ]


def test_files_are_named_in_the_order_of_the_command(tmp_path: Path) -> None:
    for name in ("b.png", "study.html", "other.txt", "a.png"):
        (tmp_path / name).touch()
    said = written(tmp_path, ("study.html", "study.json", "*.png"))
    assert said == f"wrote in {tmp_path}: study.html, a.png, b.png"


def test_files_of_an_earlier_result_are_named_where_they_are_replaced(tmp_path: Path) -> None:
    """The second result has one file less; the first one replaces nothing, whatever else is in the folder."""
    folder, said = tmp_path / "out", list[str]()
    folder.mkdir()
    (folder / "mine.txt").touch()
    for names in (("a.png", "b.png"), ("a.png",)):
        with output_folder(folder, ("*.png",)) as scratch:
            for name in names:
                (scratch / name).touch()
        said.append(written(folder, ("*.png",)))
    assert said[0] == f"wrote in {folder}: a.png, b.png"
    assert said[1] == (
        f"wrote in {folder}: a.png; an earlier result there was replaced (a.png, b.png)"
    )


def test_expose_ends_with_its_files(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    done = cli("expose", light_file, "-o", tmp_path / "out", "--camera", "konnik_table1")
    last = " ".join(done.stdout.split()).rpartition("wrote in ")[2]
    assert last.endswith(": frame.tiff, frame.png, frame.json")
    as_json = cli("expose", light_file, "-o", tmp_path / "out", "--json").stdout
    assert "wrote in" not in as_json
