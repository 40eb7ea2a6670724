"""Pixels with random telegraph noise of the source follower: three levels behind the CDS."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.rtn_pixels import RtnPixels

SHAPE, FRAMES = (100, 200), 30


def steps(fraction: float, duty: float, switching: float) -> Any:
    """(N, H, W) steps over A of all frames."""
    stage, window = RtnPixels(fraction, 40.0, duty, switching, 5e-6), SensorWindow(7, SHAPE)
    frames = [ms.stages.Frame(ms.Exposure(0.1), window, 5, index) for index in range(FRAMES)]
    return np.array([stage.sample(np.zeros(SHAPE), frame) for frame in frames]) / 200e-6


@pytest.mark.parametrize(("duty", "switching"), [(0.5, 1.0), (0.3, 0.8), (0.1, 0.05)])
def test_a_trap_leaves_three_levels_as_often_as_it_changed_between_the_samples(
    duty: float, switching: float
) -> None:
    """P(+A) = P(−A) = switching·duty·(1 − duty), in 600 000 pixels and frames within 5 standard errors."""
    x = steps(1.0, duty, switching)
    assert set(np.round(np.unique(x), 9)) == {-1.0, 0.0, 1.0}
    chance = switching * duty * (1 - duty)
    for level in (-1.0, 1.0):
        assert np.mean(np.round(x) == level) == pytest.approx(
            chance, abs=5 * math.sqrt(chance / x.size)
        )
    assert abs(x.mean()) < 5 * math.sqrt(2 * chance / x.size)


def test_only_the_pixels_of_the_map_have_steps_and_they_are_the_same_in_every_frame_of_a_chip() -> (
    None
):
    """20 000 pixels of which 10 % have a trap (5 standard errors: 1.1 %); half of their frames show a step."""
    stage, window = RtnPixels(0.1, 40.0, 0.5, 1.0, 5e-6), SensorWindow(7, SHAPE)
    site = stage.fpn_maps(window)["rtn_site"] > 0
    assert site.mean() == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / site.size))
    x = steps(0.1, 0.5, 1.0)
    assert not x[:, ~site].any()
    assert np.mean(x[:, site] != 0) == pytest.approx(
        0.5, abs=5 * 0.5 / math.sqrt(FRAMES * site.sum())
    )
    frames = x[:, site].astype(float)
    lagged = np.mean(frames[1:] * frames[:-1])
    assert abs(lagged) < 5 * 0.5 / math.sqrt((FRAMES - 1) * site.sum())
