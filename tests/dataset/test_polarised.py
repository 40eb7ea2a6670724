"""Cameras with polarisers in a dataset, beside others: each light is rendered in the variant that its camera needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.render.variants import fastest_variant

FILE = """
name = "glass"
outputs = ["clean", "aovs"]
render = { spp = 128, width = 24, denoise = false }
scenes = [{ name = "table", file = "polarisation", ignore_polarization = IGNORE }]
cameras = [{ camera = "sony_imx250mzr" }, { camera = "sony_imx174" }]
grid = { exposure_s = [0.004] }
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(
    fastest_variant("llvm").backend == "scalar", reason="needs LLVM: the scalar render is slow"
)
def test_a_camera_with_polarisers_beside_another_sees_what_it_sees_alone(
    tmp_path: Path,
) -> None:
    """As `capture` has it, with and without polarisation: each dataset is near its own and far from the other."""
    options: Any = {"spp": 1024, "width": 24, "denoise": False, "seed": 1, "clean": True}
    alone, seen = {}, {}
    for ignore in (False, True):
        captured = ms.capture(
            "polarisation",
            "sony_imx250mzr",
            ms.Exposure(0.004),
            ignore_polarization=ignore,
            **options,
        )
        alone[ignore] = np.asarray(captured.frames.clean)
        file = tmp_path / f"{ignore}.toml"
        file.write_text(FILE.replace("IGNORE", str(ignore).lower()), "utf-8")
        found = make_dataset(file, tmp_path / str(ignore), workers=0)
        assert found.made == 2 and not found.failed
        dataset = ms.Dataset(tmp_path / str(ignore))
        assert all(one.read("depth").shape == (16, 24) for one in dataset)
        (sample,) = dataset.where(camera="sony_imx250mzr")
        seen[ignore] = np.asarray(sample.read("clean"), float)
    for ignore in (False, True):
        near, far = (np.std(seen[ignore] - alone[one]) for one in (ignore, not ignore))
        assert near < 0.5 * far
