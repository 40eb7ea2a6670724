"""The source follower: its noise after CDS, its gain, and its V/V curve."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise

BASE = ms.load_camera("konnik_table1")


def test_telegraph_noise_reaches_the_chain_of_a_cmos_sensor_only() -> None:
    """ΔV = 200 µV at 1 µs on Table 1: 17.8268 e- beside the 6.105 e- of the datasheet's white and flicker noise."""
    camera = ms.load_camera("konnik_table1").replace(**{"source_follower.rtn_uv": 200.0})
    alone = np.hypot(17.8268, 6.105069)
    sigma = {type(stage): stage for stage in chain(camera)}[SourceFollowerNoise].sigma_v / 5e-6
    assert sigma == pytest.approx(alone, rel=1e-5)
    with pytest.raises(ms.InputError, match=r"source_follower\.rtn_uv is 200\.0"):
        camera.replace(**{"sensor.technology": "ccd", "readout.dsnu_col": 0.0})


def test_so_many_pixels_are_noisy_by_the_factor_and_the_rms_of_all_stays() -> None:
    """A million pixels: 5 standard errors of the fraction are 7e-4; the mean square to 1 %, by its own scatter."""
    noisy = {
        "source_follower.white_nv_per_rthz": None,
        "source_follower.read_noise_e": 5.0,
        "source_follower.noisy_pixel_fraction": 0.02,
        "source_follower.noisy_pixel_factor": 3.0,
    }
    sigma = ms.fpn_maps(BASE.replace(**noisy), (1000, 1000), precision="float64")["read_noise"]
    levels = np.unique(sigma)
    assert levels[1] / levels[0] == pytest.approx(3.0, rel=1e-12)
    assert (sigma > 2 * levels[0]).mean() == pytest.approx(0.02, abs=7e-4)
    assert np.square(sigma).mean() == pytest.approx(25.0, rel=0.01)


def test_every_pixel_has_the_noise_of_its_map_and_a_measured_map_stands_in_for_it() -> None:
    """400 frames: the σ of 40 pixels of each value within 5 standard errors of σ (1/√(2·400·40): 2.8 %)."""
    camera = BASE.replace(
        **{"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 50.0},
        **{"source_follower.read_noise_cv": 0.4, "adc.bits": 16, "adc.black_level_dn": 2000.0},
    )
    sigma = np.repeat([[0.0, 10.0, 50.0, 200.0]], 40, axis=0)
    frames = ms.expose(
        np.zeros((40, 4)), camera, ms.Exposure(0.0), frames=400, maps={"read_noise": sigma}
    )
    seen = np.sqrt(
        (frames.digital / frames.report["K_dn_per_e"]).var(axis=0, ddof=1).mean(axis=0)
    )
    rounding = 1 / 12 / frames.report["K_dn_per_e"] ** 2
    assert seen[0] == 0.0
    np.testing.assert_allclose(seen[1:], np.sqrt(sigma[0, 1:] ** 2 + rounding), rtol=0.028)
    last, gain = frames.report["stages"][-1], frames.report["K_dn_per_e"]
    own_e, error_e = (last[f"sigma_temporal_{what}"] / gain for what in ("expected", "error"))
    assert own_e == pytest.approx(np.sqrt((sigma**2).mean() + rounding), abs=4 * error_e)
    assert error_e < 2.0
    own = ms.fpn_maps(camera, (40, 4))["read_noise"]
    light = np.full((40, 4), 1000.0)
    given, made = (
        ms.expose(light, camera, ms.Exposure(0.0), maps=maps).digital
        for maps in ({"read_noise": own}, {})
    )
    np.testing.assert_array_equal(given, made)
