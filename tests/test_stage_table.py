"""The README's table of stages is right: every stage is in it, with fields, modules and tests that exist."""

from __future__ import annotations

import dataclasses
import re
from importlib import import_module

import pytest
from helpers import ROOT

from mitsuba_sensor.sensor.camera import Camera
from mitsuba_sensor.sensor.datasheet_errors import fields_of

ROWS = [
    [cell.strip() for cell in line.strip("|\n").split("|")]
    for line in (ROOT / "README.md").read_text("utf-8").splitlines()
    if re.match(r"\| `[A-Z]\w+` \|", line)
]
ABSTRACT = {"Offset", "Gain"}


def stages_of(module: str) -> set[str]:
    """Names of the stages that a module of the sensor defines: dataclasses that have a domain."""
    found = vars(import_module(f"mitsuba_sensor.sensor.{module}"))
    here = f"mitsuba_sensor.sensor.{module}"
    return {
        name
        for name, value in found.items()
        if dataclasses.is_dataclass(value) and hasattr(value, "domain") and getattr(value, "__module__", "") == here
    } - ABSTRACT


def test_the_table_names_every_stage_in_its_module_and_no_other() -> None:
    listed = {(row[0].strip("`"), row[3].strip("`")) for row in ROWS}
    assert listed == {(name, module) for module in ("electrons", "volts", "digital") for name in stages_of(module)}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("`"))
def test_a_row_names_fields_that_exist_and_a_test_that_speaks_of_the_stage(row: list[str]) -> None:
    name, equation, options, _, test = row
    assert equation
    assert set(re.findall(r"`([^`]+)`", options)) <= set(fields_of(Camera))
    (file,) = (ROOT / "tests" / "sensor").rglob(f"{test.strip('`')}.py")
    text = file.read_text("utf-8")
    fields = [field.rpartition(".")[2] for field in re.findall(r"`([^`]+)`", options)]
    assert name.strip("`") in text or any(field in text for field in fields)


def test_every_option_of_the_sensor_stands_in_the_table() -> None:
    """But the description of chip and lens, which are the light's business, and what goes with another field."""
    listed = {field for row in ROWS for field in re.findall(r"`([^`]+)`", row[2])}
    with_another = {"at_temperature_k", "coupling", "cds_sample_s", "cds_dominant_s", "wavelengths_nm", "reference_nm"}
    light = {"pitch_x_um", "pitch_y_um", "fill_factor"}
    for field in fields_of(Camera):
        table, _, last = field.rpartition(".")
        if table.split(".")[0] not in ("", "lens", "sensor") and last not in with_another | light:
            assert field in listed, field
