"""Photon and dark shot noise: whole electrons by Poisson's law."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Electrons
from mitsuba_sensor.sensor.effects.shot_noise import ShotNoise

SMALL = Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))
CHARGE = Electrons(np.linspace(0, 4e4, 200).reshape(4, 50), np.full((4, 50), 174.0))


class TestShotNoise(StageTests):
    stage = ShotNoise
    camera = ms.load_camera("konnik_table1")


class TestShotNoiseOfFewElectrons(StageTests):
    stage = ShotNoise
    camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 16})
    level = 2e-4


def test_shot_noise_gives_whole_electrons_of_light_and_dark_apart() -> None:
    after = ShotNoise().sample(CHARGE, SMALL)
    for part in (after.light, after.dark):
        np.testing.assert_array_equal(part, np.floor(part))
    assert np.abs(np.corrcoef(after.light.ravel() - CHARGE.light.ravel(), after.dark.ravel())[0, 1]) < 5 / np.sqrt(200)


def test_a_pixel_twice_as_hot_has_twice_the_dark_shot_variance() -> None:
    """X = 2: temporal var/mean stays 1, because the map multiplies the mean before Poisson. 2e5 draws, 5 se = 1.6 %."""
    frame = Frame(ms.Exposure(0.1), SensorWindow(3, (1, 200_000)))
    dark = ShotNoise().sample(Electrons(np.zeros((1, 200_000)), 2 * 174.158), frame).dark
    assert dark.mean() == pytest.approx(2 * 174.158, rel=5e-4)
    assert dark.var() / dark.mean() == pytest.approx(1, abs=0.016)
