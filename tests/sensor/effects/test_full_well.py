"""The full well: light and dark electrons beyond it are lost."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.engines import backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.full_well import FullWell, SoftFullWell

SMALL = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))


@pytest.mark.parametrize("full_well_e", [1.0, 33_000.0, 5e7])
def test_the_full_well_is_cut_exactly_and_conserves_what_fits(full_well_e: float) -> None:
    """min(light + dark, full well) to the last bit of a whole number, whichever of the two overflows."""
    light = np.array(
        [[0.0, 1.0, full_well_e - 1, full_well_e, full_well_e + 1, 1e12, np.inf, 0.0, 5.0]]
    )
    dark = np.array([[0.0, 1.0, 1.0, 0.0, 3.0, 1e12, 7.0, full_well_e + 5, full_well_e]])
    after = FullWell(full_well_e).sample(ms.stages.Electrons(light, dark), SMALL)
    np.testing.assert_array_equal(after.total, np.minimum(light + dark, full_well_e))
    assert (after.light >= 0).all() and (after.dark >= 0).all()


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
@pytest.mark.parametrize("level", [0.9, 0.99, 1.05])
def test_electrons_that_come_and_go_one_by_one_have_its_mean_and_variance(
    engine: str, level: float
) -> None:
    """Gillespie's exact simulation of arrivals at rate 1 and losses at rate e^((n − W)/w), of 4000 pixels, against as
    many samples of the stage on both engines; 5 standard errors of both means and variances."""
    well_e, knee_e, pixels = 400.0, 25.0, 4000
    chance = np.random.default_rng(7)
    counts, left = np.zeros(pixels), np.full(pixels, level * well_e)
    while (left > 0).any():
        rate = 1 + np.exp((counts - well_e) / knee_e)
        left = left - chance.exponential(1 / rate)
        step = np.where(chance.uniform(size=pixels) < 1 / rate, 1.0, -1.0)
        counts = counts + np.where(left > 0, step, 0.0)
    window = SensorWindow(3, (50, 80), backend=backend_of(engine))
    light = chance.poisson(np.full(window.shape, level * well_e)).astype(float)
    arrived = ms.stages.Electrons(window.backend.from_numpy(light, window))
    held = SoftFullWell(well_e, knee_e).sample(
        arrived, ms.stages.Frame(ms.Exposure(0.1), window)
    )
    sampled = window.backend.to_numpy(held.total, window)
    error_e = 5 * np.sqrt((counts.var() + sampled.var()) / pixels)
    assert sampled.mean() == pytest.approx(counts.mean(), abs=error_e + 0.5)
    assert sampled.var() == pytest.approx(counts.var(), rel=5 * np.sqrt(4 / pixels) + 0.03)
