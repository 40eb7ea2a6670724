"""The camera's own noise at its input is computed once for equal cameras, also with a stage that has no hash."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.theory.input_noise import input_noise

EXPOSURE = ms.Exposure(0.01)


@dataclass(frozen=True)
class Tabulated(ms.Stage):
    """Changes nothing; holds an array, so that it cannot be hashed."""

    domain = "volts"
    table_v: ms.Array = field(default_factory=lambda: np.zeros(3))

    def sample(self, signal: ms.Array, frame: object) -> ms.Array:
        return signal


def test_equal_cameras_share_their_noise_and_others_do_not() -> None:
    one, same = ms.load_camera("bayer_2mp"), ms.load_camera("bayer_2mp")
    assert input_noise(one, EXPOSURE) is input_noise(same, EXPOSURE)
    other = one.replace(**{"source_follower.read_noise_e": 40.0})
    levels = np.array([10.0])
    assert input_noise(other, EXPOSURE).ratio(levels, levels) < 0.5 * input_noise(
        one, EXPOSURE
    ).ratio(levels, levels)


def test_a_stage_without_a_hash_has_the_same_noise() -> None:
    camera = ms.load_camera("bayer_2mp")
    added, levels = (
        camera.with_stage(Tabulated(), after="reset_noise"),
        np.array([1.0, 100.0, 5000.0]),
    )
    found = [input_noise(one, EXPOSURE).ratio(levels, levels) for one in (camera, added)]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
