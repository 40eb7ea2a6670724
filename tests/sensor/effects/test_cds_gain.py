"""The gain of the CDS amplifier."""

from __future__ import annotations

from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.cds_gain import CdsGain


class TestCdsGain(StageTests):
    stage = CdsGain
    camera = ms.load_camera("konnik_table1").replace(**{"readout.cds_gain": 2.0})
    neutral = (CdsGain(1.0),)
