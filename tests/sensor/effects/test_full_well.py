"""The full well: light and dark electrons beyond it are lost."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.full_well import FullWell

SMALL = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))


class TestFullWell(StageTests):
    """The converter has a wider range, so that only the well clips; at 1.1 wells nearly every pixel is full."""

    stage = FullWell
    camera = ms.load_camera("konnik_table1").replace(**{"adc.full_scale_v": 0.25})
    level = 0.985
    neutral = (FullWell(float("inf")),)


class TestFullWellThatHalfThePixelsFill(TestFullWell):
    level = 1.0


class TestFullWellThatNearlyEveryPixelFills(TestFullWell):
    level = 1.1


@pytest.mark.parametrize("full_well_e", [1.0, 33_000.0, 5e7])
def test_the_full_well_is_cut_exactly_and_conserves_what_fits(full_well_e: float) -> None:
    """min(light + dark, full well) to the last bit of a whole number, whichever of the two overflows."""
    light = np.array(
        [[0.0, 1.0, full_well_e - 1, full_well_e, full_well_e + 1, 1e12, np.inf, 0.0, 5.0]]
    )
    dark = np.array([[0.0, 1.0, 1.0, 0.0, 3.0, 1e12, 7.0, full_well_e + 5, full_well_e]])
    after = FullWell(full_well_e).sample(ms.Electrons(light, dark), SMALL)
    np.testing.assert_array_equal(after.total, np.minimum(light + dark, full_well_e))
    assert (after.light >= 0).all() and (after.dark >= 0).all()
