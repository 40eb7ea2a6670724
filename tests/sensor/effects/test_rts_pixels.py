"""Pixels with random telegraph signal (RTS): traps that switch between frames."""

from __future__ import annotations

from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
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
