"""The full well: light and dark electrons beyond it are lost."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers.stage_tests import StageTests, backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.full_well import FullWell, SoftFullWell

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


WIDE_KNEE = ms.load_camera("konnik_table1").replace(
    **{"adc.full_scale_v": 0.25, "pixel.full_well_knee_e": 1500.0}
)


class TestSoftFullWell(StageTests):
    """Where half of the light overflows: the noise is that of second order."""

    stage = SoftFullWell
    camera = WIDE_KNEE
    level = 1.0


class TestSoftFullWellThatIsNearlyFull(TestSoftFullWell):
    level = 1.1


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
    arrived = ms.Electrons(window.backend.from_numpy(light, window))
    held = SoftFullWell(well_e, knee_e).sample(arrived, ms.Frame(ms.Exposure(0.1), window))
    sampled = window.backend.to_numpy(held.total, window)
    error_e = 5 * np.sqrt((counts.var() + sampled.var()) / pixels)
    assert sampled.mean() == pytest.approx(counts.mean(), abs=error_e + 0.5)
    assert sampled.var() == pytest.approx(counts.var(), rel=5 * np.sqrt(4 / pixels) + 0.03)


def test_a_narrow_knee_becomes_a_clip_and_darkness_keeps_its_electrons() -> None:
    """With w → 0 as min(N, W); far below the well to the last bit of float64, but for e^(−W/w)."""
    counts = np.array([[0.0, 1.0, 100.0, 32_000.0, 33_000.0, 40_000.0]])
    hard = FullWell(33_000.0).sample(ms.Electrons(counts), SMALL).total
    wide = np.broadcast_to(counts, (4, 6))
    frame = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (4, 6)))
    soft = SoftFullWell(33_000.0, 1e-3).sample(ms.Electrons(wide), frame).total
    np.testing.assert_allclose(soft, np.broadcast_to(hard, soft.shape), atol=0.2)
    knee = SoftFullWell(33_000.0, 500.0).sample(ms.Electrons(wide), frame).total
    np.testing.assert_allclose(knee[:, :3], wide[:, :3], atol=1e-9)
    assert (knee[:, 5] < 33_100).all()


def test_the_theory_of_a_frame_is_the_mean_of_many() -> None:
    """Codes at 0.8 to 1.1 wells, 40 frames of 40 × 50 pixels: 5 standard errors of the mean and of the variance,
    2.5 %; 1e-6 false alarms each."""
    camera = WIDE_KNEE.replace(
        **{"pixel.prnu": 0.0, "dark_current.cv": 0.0, "readout.dsnu_col": 0.0}
    )
    for share in (0.8, 0.95, 1.0, 1.1):
        frames = ms.expose(
            share * 55_000.0 * np.ones((40, 50)), camera, ms.Exposure(0.1), frames=40
        )
        expected = frames.theory.averages(frames.stages[-1])
        error_dn = np.sqrt(expected.temporal / frames.digital.size)
        assert frames.digital.mean() == pytest.approx(expected.mean, abs=5 * error_dn)
        variance_dn2 = frames.digital.var(axis=0, ddof=1).mean()
        assert variance_dn2 == pytest.approx(expected.temporal, rel=0.025)


def test_a_camera_without_a_knee_has_the_well_that_it_had() -> None:
    assert FullWell(33_000.0) in chain(ms.load_camera("konnik_table1"))
    assert SoftFullWell(33_000.0, 1500.0) in chain(WIDE_KNEE)


@pytest.mark.parametrize("well_e", [1e3, 1e5, 1e8])
def test_the_widest_knee_leaves_an_empty_well_as_it_is(well_e: float) -> None:
    """Of 5 e- nothing overflows, and nothing makes noise: less than 1e-6 of the knee."""
    knee_e = 0.07 * well_e
    camera = WIDE_KNEE.replace(
        **{"pixel.full_well_e": well_e, "pixel.full_well_knee_e": knee_e}
    )
    stage = next(one for one in camera.stages if isinstance(one, SoftFullWell))
    wide = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (200, 200)))
    held = stage.sample(ms.Electrons(np.full((200, 200), 5.0)), wide).total
    assert held.mean() == pytest.approx(5.0, abs=1e-6 * knee_e + 5 * held.std() / 200)
    assert held.var() < 3e-6 * knee_e
    for share in (0.071, 0.08, 0.1):
        limit = f"at most 7 % of full_well_e, {knee_e:g}: give the width"
        with pytest.raises(ms.InputError, match=re.escape(limit)):
            camera.replace(**{"pixel.full_well_knee_e": share * well_e})


def test_a_knee_has_no_blooming_which_would_take_charge_from_full_pixels() -> None:
    """A pixel that clips at the full well and then passes the knee would lack 0.69 w in bright light."""
    with pytest.raises(
        ms.InputError, match="set one of them to 0: charge of a well with a knee"
    ):
        WIDE_KNEE.replace(**{"pixel.blooming": 0.5})
