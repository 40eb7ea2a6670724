"""Photons to mean photoelectrons through the QE of each colour filter; curves: test_quantum_efficiency."""

from __future__ import annotations

from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.quantum_efficiency import QuantumEfficiency


class TestDetection(StageTests):
    stage = QuantumEfficiency
    camera = ms.load_camera("bayer_2mp")


class TestDetectionBehindInfraredFilters(StageTests):
    stage = QuantumEfficiency
    camera = ms.load_camera("rgbir_2mp")
    level = 0.1
