"""What no sample of a dataset could be made with is refused when it is planned, before anything is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.cameras import Folders
from mitsuba_sensor.dataset.checks import check_scenes, checked_counts
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.plan import DatasetPlan
from mitsuba_sensor.dataset.run import run

FILE: dict[str, Any] = {
    "name": "checked",
    "scenes": [{"name": "cornell", "file": "cornell_box"}],
    "cameras": [{"camera": "bayer_2mp"}],
    "render": {"width": 12, "spp": 4},
}
NEVER = {
    "a width beyond the film": (
        {"render": {"width": 10**6}},
        "scene 'cornell' of the dataset: width is 1000000; it must be a whole number from 1 to the film's own 256",
    ),
    "a film beyond the sensor": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"sensor.columns": 8}}]},
        "the film has 12 × 12 pixels, and bayer_2mp has 8 × 1200; .* sensor.columns=12",
    ),
    "a parameter of no scene": (
        {"grid": {"parameters.foo": [1, 2]}},
        "has no parameter 'foo'; it has exposure_s, height, lamp_cd_per_m2",
    ),
    "a sensor that is none": (
        {"cameras": [{"camera": "bayer_2mp", "set": {"sensor.columns": 10**9}}]},
        "sensor.columns is 1000000000; it must be at most 1000000",
    ),
}


def plan_of(changes: dict[str, Any]) -> DatasetPlan:
    return DatasetPlan(read_dataset(FILE | changes), Folders([Path()]))


@pytest.mark.parametrize("name", NEVER)
def test_what_can_never_be_made_is_refused_by_plan_and_run(name: str, tmp_path: Path) -> None:
    changes, sentence = NEVER[name]
    with pytest.raises(ms.InputError, match=sentence):
        checked_counts(plan_of(changes))
        check_scenes(plan_of(changes))
    with pytest.raises(ms.InputError, match=sentence):
        run(plan_of(changes), tmp_path / "out", progress=False)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("max_seconds", "would make other samples on another machine; max_spp limits"),
        ("repeatable", "is always true of a dataset"),
        ("luminance", "would scale each view by its own median; set the emitters of the scene"),
        ("motion", r"belongs to the tables of \[\[scenes\]\]"),
        ("gain", r"is varied: gain in \[grid\]"),
        ("widht", "is no field of it. Did you mean 'width'"),
    ],
)
def test_the_render_table_says_why_it_has_no_such_field(name: str, why: str) -> None:
    with pytest.raises(ms.InputError, match=rf"\[render\] has '{name}', which {why}"):
        read_dataset(FILE | {"render": {name: 3}})
