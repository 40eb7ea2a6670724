"""The names and files of docs/glossary.md: every file, key of a camera, function and class exists where it says."""

from __future__ import annotations

import re

import pytest
from helpers import ROOT

import mitsuba_sensor
import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_errors import fields_of

PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    row
    for row in re.findall(r"^\| (.+) \| (.+) \| (.+) \| (.+) \|$", PAGE, re.M)
    if row[3] != "file"
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_a_row_names_files_and_names_that_exist(row: tuple[str, str, str, str]) -> None:
    """A datasheet key is a field of the camera, ``ms.name`` is public, any other name stands in one of the files."""
    files = [ROOT / "mitsuba_sensor" / name for name in re.findall(r"`([^`]+)`", row[3])]
    missing = [str(path) for path in files if not path.is_file()]
    assert files and not missing
    text, known = (
        "\n".join(path.read_text(encoding="utf-8") for path in files),
        fields_of(ms.Camera),
    )
    names = re.findall(r"`([^`]+)`", row[2])
    assert names
    for name in names:
        if name.startswith("ms."):
            assert name[3:] in mitsuba_sensor.__all__
        elif "." in name:
            assert name in known
        else:
            assert re.search(rf"\b{name}\b", text), f"{name} is not in {row[3]}"


def test_every_effect_and_every_key_of_a_camera_file_is_in_the_glossary() -> None:
    """The tables themselves and the inside of a lens prescription have no row."""
    effects = {
        path.name for path in (ROOT / "mitsuba_sensor" / "stages" / "effects").glob("[!_]*.py")
    }
    missing = {name for name in effects if f"`stages/effects/{name}`" not in PAGE}
    assert not missing, f"{missing}: python docs/generated.py"
    keys = {
        key
        for key in fields_of(ms.Camera)
        if "." in key and not key.startswith("lens.prescription.")
    }
    assert keys == {key for key in keys if f"`{key}`" in PAGE}
