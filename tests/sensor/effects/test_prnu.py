"""Photo-response non-uniformity (PRNU): every family of gain maps, and what no map may do."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.prnu import Prnu
from mitsuba_sensor.stages.fpn_distributions import Rectified

SMALL = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))
CHARGE = ms.stages.Electrons(np.linspace(0, 4e4, 200).reshape(4, 50), np.full((4, 50), 174.0))


def test_prnu_multiplies_light_and_leaves_the_dark_alone() -> None:
    after = Prnu(Rectified(0.1)).sample(CHARGE, SMALL)
    assert after.dark is CHARGE.dark
    gain = after.light[CHARGE.light > 0] / CHARGE.light[CHARGE.light > 0]
    assert gain.std() == pytest.approx(0.1, rel=0.3)
    np.testing.assert_array_equal(after.light[CHARGE.light == 0], 0.0)
