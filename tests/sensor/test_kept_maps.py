"""expose() keeps the FPN maps of the chips that it had last: the bytes are the same, the memory is bounded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.expose import RECENT
from mitsuba_sensor.sensor.kept_maps import RECENT_BYTES, RecentMaps

EXPOSURE = ms.Exposure(0.01)
TABLE_1 = ms.load_camera("konnik_table1")
NAMESAKE = TABLE_1.replace(**{"pixel.prnu": 0.03, "dark_current.cv": 0.8})  # another chip
CAMERAS = [TABLE_1, NAMESAKE, ms.load_camera("bayer_2mp"), ms.load_camera("eev_44_82")]
ENGINES = ["numpy", "drjit"] if backend_problem("llvm") is None else ["numpy"]


@pytest.fixture(autouse=True)
def nothing_is_kept_yet() -> Iterator[None]:
    RECENT.clear()
    yield
    RECENT.clear()


def light(seed: int, shape: tuple[int, int] = (12, 16)) -> Any:
    return np.random.default_rng(seed).uniform(100, 3000, shape)


def kept_bytes() -> int:
    return RECENT._maps.bytes


@pytest.mark.parametrize("engine", ENGINES)
def test_calls_in_random_order_have_the_bytes_of_a_stream_which_keeps_nothing(
    engine: str,
) -> None:
    rng = np.random.default_rng(20261126)
    for call in range(60):
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
    assert kept_bytes() > 0


def test_a_chip_that_comes_once_takes_no_memory() -> None:
    for serial in range(5):
        ms.expose(light(1), TABLE_1, EXPOSURE, serial=serial)
    assert kept_bytes() == 0
    ms.expose(light(2), TABLE_1, EXPOSURE, serial=4)
    assert kept_bytes() > 0


def test_memory_stays_below_the_limit_whatever_comes() -> None:
    recent = RecentMaps(most_bytes=100_000)
    assert recent._maps.most_bytes < RECENT_BYTES
    for size in (40, 60, 80, 100, 200, 60):
        for _ in range(2):
            prepared = ms.Sensor(TABLE_1)._prepared(light(1, (size, size)), EXPOSURE, {})
            recent.lend(prepared, TABLE_1).frames()
            recent.drop()
            assert recent._maps.bytes <= 100_000
    assert recent._maps.bytes > 0


def test_cameras_that_came_last_are_held_and_no_more() -> None:
    for number in range(40):
        ms.expose(light(1), TABLE_1.replace(**{"pixel.prnu": 1e-3 * (number + 1)}), EXPOSURE)
    assert len(RECENT._chips) == 16


@dataclass
class Changing(ms.Stage):
    """An offset of a user's stage which he changes between two calls."""

    offset_v: float
    domain = "volts"

    def sample(self, swing: Any, frame: ms.Frame) -> Any:
        window = frame.window
        offsets = window.cached("offsets", lambda: np.full(window.shape, self.offset_v))
        return swing + window.backend.from_numpy(offsets, window)

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m


def test_a_stage_of_ones_own_may_change_between_two_calls() -> None:
    stage = Changing(0.0)
    camera = TABLE_1.with_stage(stage, after="source_follower")
    for _ in range(2):
        before = ms.expose(light(1), camera, EXPOSURE, engine="numpy").digital.mean()
    stage.offset_v = 0.01
    after = ms.expose(light(1), camera, EXPOSURE, engine="numpy").digital.mean()
    assert after > before + 1


def test_given_maps_are_those_of_their_call() -> None:
    photons = np.full((12, 16), 1000.0)
    for factor in (1.0, 1.5, 1.0):
        maps = {"prnu": np.full((12, 16), factor)}
        frames = ms.expose(photons, TABLE_1, EXPOSURE, engine="numpy", maps=maps)
        (streamed,) = ms.stream(photons, TABLE_1, EXPOSURE, engine="numpy", maps=maps)
        assert np.array_equal(frames.digital[0], streamed)
