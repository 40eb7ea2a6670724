"""What a plan says that a dataset will take is what the run takes, as far as no clock is asked."""

from __future__ import annotations

import math
from pathlib import Path

from helpers.datasets import SCENES, TABLES

from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run.forecast import counts_of, forecast
from mitsuba_sensor.dataset.run.run import run


def test_counts_and_bytes_are_those_of_the_run(tmp_path: Path) -> None:
    """Two scenes, one of them moving; files of samples differ by what PNG saves, hence 10 %."""
    scenes = [*TABLES["scenes"], {"name": "wedge", "file": "step_wedge.xml"}]
    scenes[1]["motion"] = {"camera": {"velocity_m_per_s": [0.01, 0, 0]}}
    tables = {**TABLES, "scenes": scenes, "grid": {"exposure_s": [0.01, 0.1], "serial": [1, 2]}}
    plan = DatasetPlan(
        read_dataset({**tables, "outputs": ["raw", "clean", "preview", "irradiance"]}), [SCENES]
    )
    found = forecast(plan, workers=0)
    assert found.counts == counts_of(plan) and (found.counts.views, found.counts.samples) == (
        3,
        8,
    )
    assert found.counts.by_scene == {"flat": [1, 4], "wedge": [2, 4]}
    made = run(plan, tmp_path / "out", workers=0)
    files = [
        path
        for kind in ("samples", "views")
        for path in (tmp_path / "out" / kind).rglob("*")
        if path.is_file()
    ]
    size = sum(path.stat().st_size for path in files if path.name != "record.json")
    assert made.made == 8 and math.isclose(found.bytes, size, rel_tol=0.1) and found.seconds > 0
