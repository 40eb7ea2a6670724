"""The source follower: its noise after CDS, its gain, and its V/V curve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.effects.source_follower import NonlinearSourceFollower, SourceFollower
from mitsuba_sensor.sensor.effects.source_follower_noise import SourceFollowerNoise

BASE = ms.load_camera("konnik_table1")


class TestSourceFollowerNoise(StageTests):
    stage = SourceFollowerNoise
    camera = BASE
    without = {"source_follower.white_nv_per_rthz": 0.0}
    neutral = (SourceFollowerNoise(0.0),)


class TestReadNoiseOfADatasheet(TestSourceFollowerNoise):
    camera = BASE.replace(**{"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 20.0})
    without = {"source_follower.read_noise_e": 0.0}
    level = 0.0


class TestTelegraphNoiseInABand(TestSourceFollowerNoise):
    camera = BASE.replace(
        **{"source_follower.band_hz": [10.0, 2e7], "source_follower.rtn_uv": 200.0, "source_follower.rtn_s": 1e-6},
        **{"adc.bits": 16},
    )


class TestSourceFollower(StageTests):
    stage = SourceFollower
    camera = BASE.replace(**{"source_follower.gain": 0.9, "readout.cds_gain": 2.0})
    neutral = (SourceFollower(1.0),)


class TestNonlinearSourceFollower(StageTests):
    stage = NonlinearSourceFollower
    camera = BASE.replace(**{"source_follower.vv_nonlinearity": 1.05, "source_follower.gain": 0.85})
    neutral = (NonlinearSourceFollower(1.0, 1.0, 0.165),)
    level = 0.6


def stage_of(camera: ms.Camera, kind: type) -> Any:
    """The one stage of that kind in a camera's chain."""
    return next(stage for stage in chain(camera) if isinstance(stage, kind))


def test_telegraph_noise_reaches_the_chain_of_a_cmos_sensor_only() -> None:
    """ΔV = 200 µV at 1 µs on Table 1: 17.8268 e- beside the 6.105 e- of the datasheet's white and flicker noise."""
    camera = ms.load_camera("konnik_table1").replace(**{"source_follower.rtn_uv": 200.0})
    alone = np.hypot(17.8268, 6.105069)
    sigma = {type(stage): stage for stage in chain(camera)}[SourceFollowerNoise].sigma_v / 5e-6
    assert sigma == pytest.approx(alone, rel=1e-5)
    with pytest.raises(ms.InputError, match=r"source_follower\.rtn_uv is 200\.0"):
        camera.replace(**{"sensor.technology": "ccd", "readout.dsnu_col": 0.0})


@pytest.mark.parametrize("gain", [0.7, 0.9, 1.0])
def test_read_noise_in_electrons_follows_the_gain_of_the_follower_only_where_it_is_made(gain: float) -> None:
    """σ_SF[e-] = √(∫S·H)/(A_SN·A_SF·(1 − e^(−a))); a datasheet's read_noise_e is in electrons already."""
    camera = ms.load_camera("konnik_table1").replace(**{"source_follower.gain": gain})
    assert stage_of(camera, SourceFollowerNoise).sigma_v / 5e-6 == pytest.approx(6.105069 / gain, rel=1e-6)
    given = {"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 3.0}
    assert stage_of(camera.replace(**given), SourceFollowerNoise).sigma_v / 5e-6 == pytest.approx(3.0, rel=1e-12)


def test_darkness_stays_at_the_black_level_for_every_gain_of_the_follower() -> None:
    """A_SF acts on the swing: on the node voltage, 0.9 would move darkness by 0.31 V, most of the range."""
    for gain in (0.7, 0.9, 1.0):
        camera = ms.load_camera("konnik_table1").replace(**{"source_follower.gain": gain, "adc.black_level_dn": 100.0})
        digital = ms.expose(np.zeros((4, 4000)), camera, ms.Exposure(0.0)).digital
        assert digital.mean() == pytest.approx(100, abs=5 * 4.2 / np.sqrt(4000))
