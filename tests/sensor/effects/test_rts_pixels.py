"""Pixels with random telegraph signal (RTS): traps that switch between frames."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Electrons
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.effects.rts_pixels import RtsPixels

BASE = ms.load_camera("konnik_table1")


class TestRtsPixels(StageTests):
    stage = RtsPixels
    camera = BASE.replace(
        **{"dark_current.rts_fraction": 0.5, "dark_current.rts_amplitude_e_per_s": 2000.0},
        **{"dark_current.rts_switching": 0.2, "dark_current.rts_duty": 0.3, "readout.dsnu_col": 0.0},
    )
    without = {"dark_current.rts_fraction": 0.0}
    neutral = (RtsPixels(0.0, 100.0, 0.1, 0.5), RtsPixels(0.5, 0.0, 0.1, 0.5))
    level = 0.0


class TestRtsPixelsInTheLight(TestRtsPixels):
    level = 0.2


STEP, DUTY = 200.0, 0.3
"""100 e-/s for 2 s, on for 30 % of the time."""


def states(share: float, switching: float, indices: Any, shape: tuple[int, int] = (100, 200)) -> Any:
    """(N, H, W) electrons of the traps in some frames."""
    stage, window = RtsPixels(share, STEP / 2, switching, DUTY), SensorWindow(7, shape)
    frames = [Frame(ms.Exposure(2.0), window, 5, index) for index in indices]
    return np.array([np.broadcast_to(stage.sample(Electrons(np.zeros(shape)), frame).dark, shape) for frame in frames])


def test_a_trap_has_two_states_and_the_moments_of_their_distribution() -> None:
    """Half of 20 000 pixels in 12 frames so far apart that nothing is left (0.9^100 = 3e-5).

    Means over 120 000 states: 5 se are 1.6 % of the mean; temporal variance 1.5 %; spatial 3 % (binomial).
    """
    x = states(0.5, 0.1, range(0, 1200, 100))
    stage = RtsPixels(0.5, STEP / 2, 0.1, DUTY)
    m = stage.moments(Moments(0.0, 0.0, 0.0, Frame(ms.Exposure(2.0), SensorWindow(7, (1, 1)))))
    assert (m.mean, m.temporal, m.spatial) == pytest.approx((30.0, 0.5 * 200**2 * 0.21, 0.25 * 60**2), rel=1e-12)
    assert set(np.unique(x)) == {0.0, STEP}
    temporal = x.var(axis=0, ddof=1)
    spatial = (x.mean(axis=0) - m.mean) ** 2 - temporal / 12
    for seen, expected in ((x.mean(axis=0), m.mean), (temporal, m.temporal), (spatial, m.spatial)):
        assert abs(seen.mean() - expected) < 5 * seen.std() / math.sqrt(seen.size)


@pytest.mark.parametrize("switching", [0.1, 0.5, 1.0])
def test_the_state_of_a_trap_is_forgotten_by_one_minus_switching_per_frame(switching: float) -> None:
    """Correlation (1 − switching)^Δ over 40 frames of 20 000 traps, 5 standard errors from the spread of the traps.

    At switching = 0.1 that is 0.004 of the correlation at Δ = 1, and 2.8 % of the number of changes.
    """
    x = (states(1.0, switching, range(40)) / STEP - DUTY) / math.sqrt(DUTY * (1 - DUTY))
    assert np.abs(x[[0, 1, 20, 39]].mean(axis=(1, 2))).max() < 5 / math.sqrt(20_000)
    for lag in (1, 2, 5, 20):
        pairs = np.mean(x[lag:] * x[:-lag], axis=0)
        assert pairs.mean() == pytest.approx((1 - switching) ** lag, abs=5 * pairs.std() / math.sqrt(pairs.size))
    changes = np.mean(x[1:] != x[:-1], axis=0)
    expected = switching * 2 * DUTY * (1 - DUTY)
    assert changes.mean() == pytest.approx(expected, abs=5 * changes.std() / math.sqrt(changes.size))


def test_no_rts_pixels_are_no_stage_and_traps_that_are_always_on_are_a_fixed_pattern() -> None:
    assert not any(isinstance(stage, RtsPixels) for stage in chain(BASE))
    stage = RtsPixels(1.0, 10.0, 0.1, 1.0)
    frame = Frame(ms.Exposure(2.0), SensorWindow(7, (4, 5)), 5, 3)
    np.testing.assert_array_equal(stage.sample(Electrons(np.zeros((4, 5))), frame).dark, 20.0)
    m = stage.moments(Moments(0.0, 0.0, 0.0, frame))
    assert (m.mean, m.temporal, m.spatial) == (20.0, 0.0, 0.0)
