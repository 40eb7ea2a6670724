"""Cameras with polarisers in a dataset, beside others: each view is rendered in the variant that its camera needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.core.types import Float64Array
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run.forecast import forecast
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.run.scene_checks import check_scenes
from mitsuba_sensor.dataset.run.view_render import parsed_scene, scene_options
from mitsuba_sensor.render.variants import fastest_variant, variant_restored

CAMERAS = ("sony_imx250mzr", "sony_imx174")
EXPOSURE = ms.Exposure(0.004)


def planned(ignore: bool) -> DatasetPlan:
    tables = {
        "name": "glass",
        "outputs": ["clean", "aovs"],
        "render": {"spp": 128, "width": 24, "denoise": False},
        "scenes": [
            {"name": "table", "file": "polarisation.xml", "ignore_polarization": ignore}
        ],
        "cameras": [{"camera": name} for name in CAMERAS],
        "grid": {"exposure_s": [EXPOSURE.time_s]},
    }
    return DatasetPlan(read_dataset(tables), [SCENES], "text")


@pytest.mark.parametrize("ignore", [False, True])
def test_the_variant_of_a_view_is_that_of_its_camera(ignore: bool) -> None:
    plan = planned(ignore)
    check_scenes(plan)
    for view in plan.views():
        with variant_restored():
            variant = parsed_scene(view, scene_options(view)).variant.name
        has_polarizers = view.lead["camera"]["name"] == CAMERAS[0]
        assert variant.endswith("_polarized") == (has_polarizers and not ignore)


def clean_of(ignore: bool, folder: Path) -> Float64Array:
    """The clean frame of the camera with polarisers, in a dataset that has another camera, too."""
    plan = planned(ignore)
    assert forecast(plan, 0).counts.samples == 2
    progress = run(plan, folder, workers=0)
    assert progress.made == 2 and not progress.failed
    assert all(one.read("depth_m").shape == (16, 24) for one in ms.Dataset(folder))
    (sample,) = ms.Dataset(folder).where(camera=CAMERAS[0])
    return np.asarray(sample.read("clean"), float)


@pytest.mark.exhaustive
@pytest.mark.skipif(
    fastest_variant("llvm").backend == "scalar", reason="needs LLVM: the scalar render is slow"
)
def test_a_camera_with_polarisers_beside_another_sees_what_it_sees_alone(
    tmp_path: Path,
) -> None:
    """As `capture` has it, with and without polarisation: each dataset is near its own and far from the other."""
    options: Any = {"spp": 1024, "width": 24, "denoise": False, "seed": 1, "clean": True}
    alone = {}
    for ignore in (False, True):
        captured = ms.capture(
            "polarisation", CAMERAS[0], EXPOSURE, ignore_polarization=ignore, **options
        )
        alone[ignore] = np.asarray(captured.frames.clean)
    apart = rms(alone[False] - alone[True])
    for ignore in (False, True):
        clean = clean_of(ignore, tmp_path / str(ignore))
        near, far = (rms(clean - alone[one]) for one in (ignore, not ignore))
        print(near, far, apart)
        assert near < 0.5 * far


def rms(difference: Float64Array) -> float:
    return float(np.sqrt(np.mean(difference**2)))
