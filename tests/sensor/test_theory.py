"""Moments of chains whose well the converter hides, and of whole electrons on coarse codes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Photons
from mitsuba_sensor.sensor.chain import black_level_dn, chain
from mitsuba_sensor.sensor.gains import gain_dn_per_e
from mitsuba_sensor.sensor.plan import without
from mitsuba_sensor.sensor.stage import sample
from mitsuba_sensor.sensor.theory import final_moments, hidden_well

EXPOSURE = ms.Exposure(0.1)
TABLE1, BAYER = ms.load_camera("konnik_table1"), ms.load_camera("bayer_2mp")


def flat(electrons: float, shape: tuple[int, int]) -> Photons:
    return Photons(np.full((*shape, 1), electrons), detected=True)


def frame(shape: tuple[int, int]) -> Frame:
    return Frame(EXPOSURE, SensorWindow(0, shape))


@pytest.mark.parametrize("electrons", [32_300.0, 32_700.0, 33_000.0])
def test_a_pixel_about_to_fill_its_well_has_the_moments_of_its_frames(electrons: float) -> None:
    """32 cameras of 2048 pixels, 4 frames each; 4.5 standard errors from camera to camera: a false alarm in 1e4 runs.

    (One cut after the other in theory is off by 15 % in the temporal variance at 32 700 e-, and by a factor of six at
    33 000 e-.) 2 % are allowed on top: near the edge the skewness of 33 000 counts shows.
    """
    shape, stages = (8, 256), chain(TABLE1)
    light = flat(electrons, shape)
    m = final_moments(stages, light, frame(shape))[1]
    found = []
    for serial in range(1, 33):
        window = SensorWindow(serial, shape, backend=NUMPY_FLOAT32)
        frames = np.array([sample(stages, light, Frame(EXPOSURE, window, serial, k)) for k in range(4)], float)
        temporal = frames.var(axis=0, ddof=1).mean()
        fixed = ((frames.mean(axis=0) - m.mean) ** 2).mean() - temporal / 4
        found.append((frames.mean(), temporal, fixed))
    values, errors = np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
    for value, error, expected in zip(values, errors, (m.mean, m.temporal, m.spatial), strict=True):
        assert value == pytest.approx(float(np.mean(expected)), rel=0.02, abs=4.5 * error)
    assert values[0] == pytest.approx(float(np.mean(m.mean)), abs=4.5 * errors[0] + 0.02)


def test_a_well_above_the_converters_end_is_hidden_and_one_below_is_not() -> None:
    for name in ms.list_cameras():
        assert hidden_well(chain(ms.load_camera(name)), frame((1, 1))) is not None
    assert hidden_well(chain(TABLE1.replace(**{"adc.full_scale_v": 0.25})), frame((1, 1))) is None


@pytest.mark.parametrize("bright", [1e3, 40_000.0])
def test_far_from_the_edge_of_the_well_the_moments_are_those_of_the_stages_one_by_one(bright: float) -> None:
    shape, stages = (2, 2), chain(TABLE1)
    m = Moments(flat(bright, shape), 0.0, 0.0, frame(shape))
    for stage in stages:
        m = stage.moments(m)
    found = final_moments(stages, flat(bright, shape), frame(shape))[1]
    for part in ("mean", "temporal", "spatial"):
        np.testing.assert_allclose(getattr(found, part), getattr(m, part), rtol=1e-6, atol=1e-6)


def test_light_without_end_is_saturated_and_no_number_is_lost() -> None:
    found = final_moments(chain(BAYER), Photons(np.full((2, 2, 3), np.inf), detected=True), frame((2, 2)))[1]
    np.testing.assert_allclose(found.mean, 4095, atol=1e-6)
    assert np.all(found.temporal < 1e-6) and np.all(found.spatial < 1e-6)


def test_a_bright_picture_needs_no_full_well_where_the_converter_ends_first() -> None:
    """The well's own cut would have moved σ by 3 DN in theory, and moves no byte of a frame; tolerance 0 keeps it."""
    ramp = np.tile(np.linspace(40_000, 70_000, 64), (32, 1))
    plan = ms.plan(TABLE1, EXPOSURE, ramp, 0.02)
    effects = {effect.stage: effect for effect in plan.effects}
    assert not effects["full well"].kept and 0 < effects["full well"].spatial_dn < 0.01
    well = {stage for stage in plan.whole if stage.label == "full well"}
    ways = (replace(plan, stages=stages) for stages in (plan.whole, without(plan.whole, well)))
    whole, planned = (ms.expose(ramp, TABLE1, EXPOSURE, frames=4, plan=way) for way in ways)
    np.testing.assert_array_equal(whole.digital, planned.digital)
    assert "full well" in {e.stage for e in ms.plan(TABLE1, EXPOSURE, ramp, 0.0).effects if e.kept}


@pytest.mark.parametrize("electrons", [0.3, 2.0, 5.0, 20.0, 100.0, 400.0])
def test_the_mean_of_rounded_whole_electrons_is_that_of_every_count_with_its_chance(electrons: float) -> None:
    """bayer_2mp without read noise: 0.125 DN per electron, smeared by DSNU_col of 0.04 DN. By enumeration."""
    off = ("source follower noise", "PRNU", "dark current")
    stages: Any = tuple(stage for stage in chain(BAYER) if stage.label not in off)
    light = Photons(np.full((1, 1, 3), electrons), detected=True)
    found = float(final_moments(stages, light, frame((1, 1)))[1].mean[0, 0])
    counts = np.arange(int(electrons + 12 * np.sqrt(electrons) + 30))
    codes = np.arange(1, 200)
    sigma = gain_dn_per_e(BAYER) * BAYER.readout.dsnu_col * BAYER.pixel.full_well_e
    smooth = black_level_dn(BAYER) + gain_dn_per_e(BAYER) * counts
    mean = stats.norm.cdf((smooth[:, None] - codes + 0.5) / sigma).sum(axis=1)  # Σ P(code reached)
    assert found == pytest.approx(float(stats.poisson.pmf(counts, electrons) @ mean), abs=2e-5)


def test_read_noise_hides_the_beat() -> None:
    """0.86 DN of it leave exp(−2π²σ²) = 5e-7 of the first harmonic: theory is that of the stages one by one."""
    light = Photons(np.full((2, 2, 3), 20.0), detected=True)
    m = Moments(light, 0.0, 0.0, frame((2, 2)))
    for stage in chain(BAYER):
        m = stage.moments(m)
    np.testing.assert_allclose(final_moments(chain(BAYER), light, frame((2, 2)))[1].mean, m.mean, atol=1e-6)
