"""The stages of the sensor: their fields, files, tests, and names for ``--without``."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from helpers import ROOT

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_checks import noise_sources
from mitsuba_sensor.camera.datasheet_errors import fields_of
from mitsuba_sensor.stages.chain import ORDER


def test_every_field_of_the_sensor_belongs_to_an_effect_but_the_description_of_the_chip() -> (
    None
):
    of_stages = {
        f"{stage.table}.{name}"
        for stage in ORDER
        if stage.fields
        for name in stage.fields.model_fields
    }
    geometry = {"pixel.pitch_x_um", "pixel.pitch_y_um", "pixel.fill_factor", "pixel.aperture"}
    geometry |= {"pixel.angular_response", "pixel.angular_response_deg"}
    geometry |= {"pixel.microlens_cra_deg", "pixel.microlens_cra_heights_mm"}
    fields = {
        name
        for name in fields_of(ms.Camera)
        if "." in name and name.split(".")[0] not in ("lens", "sensor", "combine", "companding")
    }
    assert {name for name in fields if name.count(".") == 1} - of_stages == geometry


def test_the_printed_stages_name_what_without_takes(cli: Callable[..., Any]) -> None:
    rows = json.loads(cli("cameras", "stages", "--json").stdout)
    assert [row["stage"] for row in rows if row["--without"]] == [*noise_sources()]


def test_every_effect_has_a_file_and_a_test_that_names_it() -> None:
    tests = "".join(
        path.read_text("utf-8") for path in (ROOT / "tests/sensor").rglob("test_*.py")
    )
    for effect in ORDER:
        assert effect.__module__.startswith("mitsuba_sensor.stages.effects.")
        named = effect.__name__ in tests or f'"{effect.key()}"' in tests
        assert named, f"no test in tests/sensor names {effect.__name__}"
