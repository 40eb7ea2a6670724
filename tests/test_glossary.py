"""The names and files of docs/glossary.md: every file, key of a camera, function and class exists where it says."""

from __future__ import annotations

import re

from helpers import ROOT

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_errors import fields_of

PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    row
    for row in re.findall(r"^\| (.+) \| (.+) \| (.+) \| (.+) \|$", PAGE, re.M)
    if row[3] != "file"
]


def test_a_row_names_files_and_names_that_exist() -> None:
    """A datasheet key is a field of the camera, ``ms.name`` is public, any other name stands in one of the files."""
    known, wrong = {*fields_of(ms.Camera)} | {f"ms.{name}" for name in ms.__all__}, []
    for row in ROWS:
        files = [ROOT / "mitsuba_sensor" / name for name in re.findall(r"`([^`]+)`", row[3])]
        names = re.findall(r"`([^`]+)`", row[2])
        if not files or not names or not all(path.is_file() for path in files):
            wrong.append(row)
            continue
        text = "\n".join(path.read_text(encoding="utf-8") for path in files)
        wrong += [
            name
            for name in names
            if not (name in known if "." in name else re.search(rf"\b{name}\b", text))
        ]
    assert not wrong, wrong


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
