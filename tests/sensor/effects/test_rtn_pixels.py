"""Pixels with random telegraph noise of the source follower: three levels behind the CDS."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.rtn_pixels import RtnPixels

BASE = ms.load_camera("konnik_table1").replace(**{"readout.dsnu_col": 0.0})
TRAPS = {
    "source_follower.rtn_pixel_fraction": 0.3, "source_follower.rtn_pixel_amplitude_e": 60.0,
    "source_follower.rtn_pixel_duty": 0.3, "source_follower.rtn_pixel_switching": 0.8,
}  # fmt: skip
SHAPE, FRAMES = (100, 200), 30


class TestRtnPixels(StageTests):
    stage = RtnPixels
    camera = BASE.replace(**TRAPS)
    without = BASE
    neutral = (
        RtnPixels(0.0, 60.0, 0.5, 1.0, 5e-6),
        RtnPixels(0.3, 0.0, 0.5, 1.0, 5e-6),
        RtnPixels(0.3, 60.0, 0.0, 1.0, 5e-6),
        RtnPixels(0.3, 60.0, 1.0, 1.0, 5e-6),
        RtnPixels(0.3, 60.0, 0.5, 0.0, 5e-6),
    )
    level = 0.0


class TestRtnPixelsInTheLight(TestRtnPixels):
    level = 0.2


def steps(fraction: float, duty: float, switching: float) -> Any:
    """(N, H, W) steps over A of all frames."""
    stage, window = RtnPixels(fraction, 40.0, duty, switching, 5e-6), SensorWindow(7, SHAPE)
    frames = [ms.Frame(ms.Exposure(0.1), window, 5, index) for index in range(FRAMES)]
    return np.array([stage.sample(np.zeros(SHAPE), frame) for frame in frames]) / 200e-6


@pytest.mark.parametrize(("duty", "switching"), [(0.5, 1.0), (0.3, 0.8), (0.1, 0.05)])
def test_a_trap_leaves_three_levels_as_often_as_it_changed_between_the_samples(
    duty: float, switching: float
) -> None:
    """P(+A) = P(−A) = switching·duty·(1 − duty), in 600 000 pixels and frames within 5 standard errors."""
    x = steps(1.0, duty, switching)
    assert set(np.round(np.unique(x), 9)) == {-1.0, 0.0, 1.0}
    chance = switching * duty * (1 - duty)
    for level in (-1.0, 1.0):
        assert np.mean(np.round(x) == level) == pytest.approx(
            chance, abs=5 * math.sqrt(chance / x.size)
        )
    assert abs(x.mean()) < 5 * math.sqrt(2 * chance / x.size)


@pytest.mark.parametrize("tau_over_ts", [0.01, 1.0, 10.0])
def test_the_variance_is_that_of_the_difference_of_two_samples_of_a_two_state_process(
    tau_over_ts: float,
) -> None:
    """2·A²·duty·(1 − duty)·(1 − e^(−t_s/τ)): twice the variance less twice the covariance of the samples."""
    switching, duty, amplitude = -math.expm1(-1 / tau_over_ts), 0.2, 7.0
    stage = RtnPixels(1.0, amplitude, duty, switching, 1.0)
    frame = ms.Frame(ms.Exposure(0.1), SensorWindow(7, (1, 1)))
    one, covariance = duty * (1 - duty), duty * (1 - duty) * math.exp(-1 / tau_over_ts)
    found = stage.moments(ms.Moments(0.0, 0.0, 0.0, frame))
    assert found.temporal == pytest.approx(amplitude**2 * (2 * one - 2 * covariance), rel=1e-12)
    assert (found.mean, found.spatial) == (0.0, 0.0)


def test_only_the_pixels_of_the_map_have_steps_and_they_are_the_same_in_every_frame_of_a_chip() -> (
    None
):
    """20 000 pixels of which 10 % have a trap (5 standard errors: 1.1 %); half of their frames show a step."""
    stage, window = RtnPixels(0.1, 40.0, 0.5, 1.0, 5e-6), SensorWindow(7, SHAPE)
    site = stage.fpn_maps(window)["rtn_site"] > 0
    assert site.mean() == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / site.size))
    x = steps(0.1, 0.5, 1.0)
    assert not x[:, ~site].any()
    assert np.mean(x[:, site] != 0) == pytest.approx(
        0.5, abs=5 * 0.5 / math.sqrt(FRAMES * site.sum())
    )
    frames = x[:, site].astype(float)
    lagged = np.mean(frames[1:] * frames[:-1])
    assert abs(lagged) < 5 * 0.5 / math.sqrt((FRAMES - 1) * site.sum())


def test_a_measured_map_says_which_pixels_have_a_trap() -> None:
    """Variance in DN: K²·A²/2 more in the pixels of the map, nothing more in the others."""
    camera = BASE.replace(**TRAPS, **{"adc.bits": 16, "adc.black_level_dn": 3000.0})
    camera = camera.replace(
        **{"source_follower.rtn_pixel_duty": 0.5, "source_follower.rtn_pixel_switching": 1.0}
    )
    site = np.zeros((60, 80))
    site[:, ::4] = 1.0
    frames = ms.expose(
        np.zeros(site.shape), camera, ms.Exposure(0.0), frames=40, maps={"rtn_site": site}
    )
    electrons = frames.digital / frames.report["K_dn_per_e"]
    with_trap, without = (
        electrons[:, site == value].var(axis=0, ddof=1) for value in (1.0, 0.0)
    )
    difference = with_trap.mean() - without.mean()
    error = math.hypot(
        with_trap.std() / math.sqrt(with_trap.size), without.std() / math.sqrt(without.size)
    )
    assert difference == pytest.approx(60.0**2 / 2, abs=5 * error)


def test_a_camera_without_such_pixels_has_no_stage_and_steps_are_electrons_at_the_sense_node() -> (
    None
):
    assert not any(isinstance(stage, RtnPixels) for stage in chain(BASE))
    camera = BASE.replace(
        **TRAPS, **{"source_follower.gain": 0.8, "readout.sense_gain_uv_per_e": 50.0}
    )
    stage = next(stage for stage in chain(camera) if isinstance(stage, RtnPixels))
    assert stage == RtnPixels(0.3, 60.0, 0.3, 0.8, pytest.approx(50e-6))
