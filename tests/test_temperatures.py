"""A temperature that is probably in °C is told once in each call, and before the light is rendered."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms

CAMERA, COLD = ms.load_camera("konnik_table1"), ms.Exposure(0.02, 25)
PHOTONS = np.full((4, 4), 100.0)
RENDER: dict[str, Any] = {"spp": 4, "variant": "scalar_spectral", "progress": False}
SAID = "temperature_k is 25, and 70 to 400 is usual: if 25 is in °C, write 298.15"

CALLS: dict[str, Callable[[Path], object]] = {
    "capture": lambda scene: ms.capture(scene, CAMERA, COLD, **RENDER),
    "metered": lambda scene: ms.capture(scene, CAMERA, ms.Metering(25.0), **RENDER),
    "render": lambda scene: ms.render(scene, CAMERA, COLD, **RENDER),
    "expose": lambda _: ms.expose(PHOTONS, CAMERA, COLD),
    "stream": lambda _: ms.stream(PHOTONS, CAMERA, COLD),
    "Sensor": lambda _: ms.Sensor(CAMERA).expose(PHOTONS, COLD),
    "plan": lambda _: ms.plan(CAMERA, COLD, PHOTONS),
    "SensorNoise": lambda _: ms.SensorNoise(CAMERA, exposure=COLD, white_e=10),
    "emva1288": lambda _: CAMERA.emva1288(COLD),
}


@pytest.mark.parametrize("name", one_in(2, CALLS))
def test_each_function_that_takes_a_temperature_tells_once(name: str, scene_file: Path) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        CALLS[name](scene_file)
    said = [str(one.message) for one in caught if SAID in str(one.message)]
    assert len(said) == 1
    assert [Path(one.filename).name for one in caught if SAID in str(one.message)] == [
        Path(__file__).name
    ]


def test_it_is_told_before_the_first_ray(scene_file: Path) -> None:
    """As an error it stops the render: no pass is done."""
    passes = list[object]()
    with warnings.catch_warnings():
        warnings.simplefilter("error", ms.SensorWarning)
        with pytest.raises(ms.SensorWarning, match="if 25 is in °C"):
            ms.capture(scene_file, CAMERA, COLD, **RENDER | {"progress": passes.append})
    assert not passes


def test_the_command_tells_before_it_renders(
    scene_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """The render is refused after it, for its seed."""
    options = ("--temperature-k", 25, "--seed", -1)
    done = cli("render", scene_file, "-o", tmp_path / "out", *options)
    assert done.exit_code == 2
    assert done.stderr.index("if 25 is in °C, write 298.15") < done.stderr.index("error:")


def test_the_sheet_tells_before_it_renders(tmp_path: Path, cli: Callable[..., Any]) -> None:
    """It is refused after it, for its gain setting."""
    options = ("--temperatures", "25", "--gains", "none", "-o", tmp_path / "out")
    done = cli("sheet", "konnik_table1", *options)
    assert done.exit_code == 2
    assert done.stderr.index("if 25 is in °C, write 298.15") < done.stderr.index("error:")
