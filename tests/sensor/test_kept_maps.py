"""expose() keeps the FPN maps of the chips that it had last: the bytes are the same, the memory is bounded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import Backend
from mitsuba_sensor.core.llvm import backend_problem

EXPOSURE = ms.Exposure(0.01)
TABLE_1 = ms.load_camera("konnik_table1")
NAMESAKE = TABLE_1.replace(**{"pixel.prnu": 0.03, "dark_current.cv": 0.8})  # another chip
CAMERAS = [TABLE_1, NAMESAKE, ms.load_camera("bayer_2mp"), ms.load_camera("eev_44_82")]
ENGINES = ["numpy", "drjit"] if backend_problem("llvm") is None else ["numpy"]


def light(seed: int, shape: tuple[int, int] = (12, 16)) -> Any:
    return np.random.default_rng(seed).uniform(100, 3000, shape)


@pytest.mark.parametrize("engine", ENGINES)
def test_calls_in_random_order_have_the_bytes_of_a_stream_which_keeps_nothing(
    engine: str,
) -> None:
    rng = np.random.default_rng(20261126)
    for call in range(20):
        camera = CAMERAS[rng.integers(len(CAMERAS))]
        shape = (12, 16) if rng.random() < 0.7 else (int(rng.integers(1, 30)), 9)
        photons = light(call, shape)
        options: dict[str, Any] = {
            "serial": int(rng.integers(1, 3)),
            "seed": call,
            "engine": engine,
            "origin": (int(rng.integers(2)), 0),
        }
        if engine == "numpy" and rng.random() < 0.3:
            options["precision"] = "float64"
        exposure = ms.Exposure(0.01 * rng.integers(1, 4), 280 + 20 * rng.integers(2))
        frames = ms.expose(photons, camera, exposure, **options)
        (streamed,) = ms.stream(photons, camera, exposure, **options)
        assert np.array_equal(frames.digital[0], streamed), (call, camera.name, options)


@pytest.mark.usefixtures("few_windows")
def test_a_plan_that_leaves_a_coupling_stage_out_and_the_whole_chain_share_no_strips(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Blooming reaches over the ends of strips, which have no rows around them without it."""
    monkeypatch.setattr(Backend, "strip_pixels", 2**12)
    camera = TABLE_1.replace(**{"pixel.blooming": 0.5})
    dim = np.full((96, 128), 1000.0)
    plan = ms.plan(camera, EXPOSURE, dim, tolerance_dn=0.5)
    assert "blooming" in plan.left_out
    bright = dim.copy()
    bright[::16] = 1e6
    for _ in range(2):
        ms.expose(dim, camera, EXPOSURE, plan=plan, engine="numpy", serial=78)
    (streamed,) = ms.stream(bright, camera, EXPOSURE, engine="numpy", serial=78)
    for _ in range(2):
        frames = ms.expose(bright, camera, EXPOSURE, engine="numpy", serial=78)
        assert np.array_equal(frames.digital[0], streamed)


@dataclass
class Changing(ms.Stage):
    """An offset of a user's stage which he changes between two calls."""

    offset_v: float
    domain = "volts"

    def sample(self, swing: Any, frame: ms.stages.Frame) -> Any:
        window = frame.window
        offsets = window.cached("offsets", lambda: np.full(window.shape, self.offset_v))
        return swing + window.backend.from_numpy(offsets, window)


def test_a_stage_of_ones_own_may_change_between_two_calls() -> None:
    stage = Changing(0.0)
    camera = TABLE_1.with_stage(stage, after="source_follower")
    for _ in range(2):
        before = ms.expose(light(1), camera, EXPOSURE, engine="numpy").digital.mean()
    stage.offset_v = 0.01
    after = ms.expose(light(1), camera, EXPOSURE, engine="numpy").digital.mean()
    assert after > before + 1
