"""Blooming: charge above the full well flows along its column, and none is lost on the way."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.engines import backend_of
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.blooming import Blooming

FULL_WELL_E = 1000.0
COLD = ms.Exposure(0.01, 170.0)


def bloomed(count: NDArray[np.float64], share: float = 1.0, engine: str = "float64") -> NDArray:
    """Electrons of each pixel behind the stage."""
    frame = ms.stages.Frame(COLD, SensorWindow(1, count.shape, backend=backend_of(engine)))
    light = frame.window.backend.from_numpy(count, frame.window)
    found = Blooming(FULL_WELL_E, share).sample(ms.stages.Electrons(light, 0.0 * light), frame)
    return np.array(frame.window.backend.to_numpy(found.total, frame.window), np.float64)


@pytest.mark.parametrize("engine", ["float64", "numpy", "drjit"])
def test_no_electron_is_lost_and_no_well_is_overfull(engine: str) -> None:
    """Column by column, of 40 random columns with bright spots in their middle."""
    random = np.random.default_rng(1)
    count = random.poisson(300.0, (200, 40)).astype(np.float64)
    count[95:105] += random.poisson(4000.0, (10, 40))
    found = bloomed(count, engine=engine)
    np.testing.assert_array_equal(found.sum(axis=0), count.sum(axis=0))
    assert found.max() <= FULL_WELL_E and found.min() >= 0
    np.testing.assert_array_equal(found[:40], count[:40])


def test_a_trail_is_as_long_as_its_charge_fills_wells() -> None:
    """20 wells above a well that is full, in wells that are half full: 20 pixels on each side."""
    count = np.full((101, 3), 500.0)
    count[50, 1] = 1000.0 + 20_000.0
    found = bloomed(count)
    trail = np.flatnonzero(found[:, 1] == FULL_WELL_E)
    assert trail.tolist() == list(range(30, 71))
    np.testing.assert_array_equal(found[:, [0, 2]], 500.0)
    np.testing.assert_array_equal(found[:, 1], found[::-1, 1])


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_a_drain_takes_the_rest(share: float) -> None:
    """To the electron."""
    count = np.full((101, 1), 100.0)
    count[50] = 9000.0
    assert bloomed(count, share).sum() == 100 * 100 + FULL_WELL_E + share * 8000


def test_what_reaches_the_edge_is_lost_and_a_full_sensor_stays_full() -> None:
    count = np.full((20, 4), 5000.0)
    np.testing.assert_array_equal(bloomed(count), FULL_WELL_E)
