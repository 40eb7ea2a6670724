"""Automatic exposure follows its difference equation and its delay, and takes gain where time is at its limit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.light_sum import sum_of_groups
from mitsuba_sensor.sensor.auto_exposure import ExposureControl

CAMERA = ms.load_camera("konnik_table1")
pytestmark = pytest.mark.usefixtures("few_windows")
LADDER = ms.load_camera("raspberry_pi_hq")
FPS = 30


@pytest.fixture
def lamps(light: ms.Irradiance) -> ms.Irradiance:
    """Two equal light groups, so that the light doubles where one of them goes on; 0.18 of saturation in 11 ms."""
    bright = replace(light, data=20 * light.data)
    return sum_of_groups({"sky": bright, "lamp": bright})


def captured(
    light: ms.Irradiance, camera: ms.Camera, time_s: float, **options: Any
) -> ms.Capture:
    return ms.capture(light, camera, ms.Exposure(time_s), fps=FPS, progress=False, **options)


def times(capture: ms.Capture) -> np.ndarray:
    return np.array([one.frames.first.exposure.time_s for one in capture.timed])


@pytest.mark.parametrize(("damping", "delay"), [(0.5, 0), (0.4, 2)])
def test_the_step_response_is_that_of_the_difference_equation(
    damping: float, delay: int, lamps: ms.Irradiance
) -> None:
    """ln X_{k+1} = ln X_k + damping·ln(target/measured_{k−delay}); measured is proportional to X within 2 %."""
    rule = ms.AutoExposure(target=0.18, damping=damping, delay=delay)
    found = captured(lamps, CAMERA, 0.003, frames=14, auto_exposure=rule)
    per_second = found.timed[0].measured / 0.003  # type: ignore[operator]
    expected = [0.003]
    for number in range(13):
        step = 0.0
        if number >= delay:
            step = damping * math.log(0.18 / (per_second * expected[number - delay]))
        expected.append(expected[-1] * math.exp(step))
    np.testing.assert_allclose(times(found), expected, rtol=0.02)
    assert found.timed[-1].measured == pytest.approx(0.18, rel=0.3 if delay else 0.03)


def test_gain_is_taken_where_the_time_is_at_its_limit(lamps: ms.Irradiance) -> None:
    dim = lamps.with_lights(sky=0.02, lamp=0.02)
    rule = ms.AutoExposure(damping=1.0, longest_s=0.01)
    found = captured(dim, LADDER, 0.01, frames=3, auto_exposure=rule)
    series = found.metadata["series"]["frames"]
    gains = [LADDER.at_gain(one["gain"]).system_gain_dn_per_e for one in series]
    assert gains[0] == LADDER.system_gain_dn_per_e < gains[1]
    assert all(one["exposure_s"] <= 0.01 * (1 + 1e-9) for one in series)
    assert [one.frames.camera.gain for one in found.timed] == [one["gain"] for one in series]
    top = max(LADDER.at_gain(one.label).system_gain_dn_per_e for one in LADDER.gains)
    assert series[-1]["measured"] == pytest.approx(0.18, rel=0.1) or gains[-1] == top


def control_of(rule: ms.AutoExposure, camera: ms.Camera = CAMERA) -> ExposureControl:
    return ExposureControl.begin(rule, camera, ms.Exposure(0.003), 0.04)


def test_the_time_is_a_multiple_of_half_a_period_of_the_mains() -> None:
    control = control_of(ms.AutoExposure(damping=1.0, mains_hz=50))
    for wanted_s, expected_s in ((0.004, 0.004), (0.006, 0.01), (0.016, 0.02), (0.9, 0.04)):
        control._set(wanted_s * CAMERA.system_gain_dn_per_e)
        assert control.exposure.time_s == pytest.approx(expected_s)


def test_frames_of_equal_exposure_are_those_without_a_controller(lamps: ms.Irradiance) -> None:
    lit = lamps.with_lights(lamp="pwm(100, 0.5)")
    rule = ms.AutoExposure(shortest_s=0.004, longest_s=0.004)
    found = captured(lit, CAMERA, 0.004, frames=4, auto_exposure=rule)
    plain = ms.expose(lit, CAMERA, ms.Exposure(0.004), frames=4, fps=FPS)
    np.testing.assert_array_equal(found.frames.digital, plain.digital)
    for number, frame in enumerate(
        ms.stream(lit, CAMERA, ms.Exposure(0.004), frames=4, fps=FPS)
    ):
        np.testing.assert_array_equal(frame, plain.digital[number])
    sensor = ms.Sensor(CAMERA)
    one_by_one = [sensor.expose(lit, ms.Exposure(0.004), fps=FPS).digital[0] for _ in range(4)]
    np.testing.assert_array_equal(one_by_one, plain.digital)
    with pytest.raises(ms.InputError, match="one by one"):
        sensor.expose(lit, ms.Exposure(0.004), frames=2, fps=FPS)
    still = ms.expose(replace(lit, waveforms={}), CAMERA, ms.Exposure(0.004), frames=2)
    assert still.digital.mean() != plain.digital[:2].mean()
