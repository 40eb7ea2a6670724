"""Noise sources that are switched off by name: the others stay what they are, and the theory is that of the frames."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from helpers.marks import one_in
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_checks import noise_sources
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import ORDER, chain
from mitsuba_sensor.stages.gains import gain_dn_per_e

EXPOSURE = ms.Exposure(0.1)
SOURCES = noise_sources()
TABLE1 = ms.load_camera("konnik_table1")
EVERY = TABLE1.replace(
    **{
        "pixel.prnu": 0.02,
        "pixel.dsnu_e": 8.0,
        "dark_current.cv": 0.3,
        "dark_current.rts_fraction": 0.1,
        "dark_current.rts_amplitude_e_per_s": 2000.0,
        "dark_current.rts_switching": 1.0,
        "dark_current.overflow_rate_e_per_s": 500.0,
        "source_follower.rtn_pixel_fraction": 0.1,
        "source_follower.rtn_pixel_amplitude_e": 40.0,
        "pixel.hits_per_cm2_s": 1e5,
        "pixel.hit_e": 400.0,
        "readout.reset": "hard",
        "readout.dsnu_row": 1e-3,
        "readout.dsnu_col": 1e-3,
        "readout.prnu_col": 0.005,
        "readout.row_noise_e": 6.0,
        "readout.column_noise_e": 5.0,
        "readout.frame_noise_e": 4.0,
        "adc.bits": 14,
    }
)
"""A camera with every noise source that there is."""

ADDED = [
    name for name in SOURCES if name.startswith(("dsnu", "temporal", "reset", "source", "rtn"))
]
"""Those that add something to the swing, whatever it is."""


def kept(camera: ms.Camera, what: str, light: float = 0.0) -> NDArray[np.float64]:
    shot = ms.expose(
        np.full((24, 32), light), camera, EXPOSURE, precision="float64", keep=what, frames=2
    )
    found: NDArray[np.float64] = getattr(shot, what)
    return found


@functools.cache
def whole_volts() -> NDArray[np.float64]:
    return kept(EVERY.without("prnu_column"), "volts", 9e3)


@pytest.mark.parametrize("name", ADDED)
def test_what_is_missing_without_a_source_is_what_this_source_adds_alone(name: str) -> None:
    """Superposition: whole − (whole without it) = (it alone) − (nothing), to the rounding of float64. One other random
    number in any other source, and the left side has that source's noise in it."""
    missing = whole_volts() - kept(EVERY.without("prnu_column", name), "volts", 9e3)
    nothing = EVERY.without(*SOURCES)
    alone = kept(EVERY.without(*(x for x in SOURCES if x != name)), "volts", 9e3) - kept(
        nothing, "volts", 9e3
    )
    assert np.abs(alone).max() > 1e-6
    np.testing.assert_allclose(missing, alone, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", SOURCES)
def test_the_maps_of_all_other_sources_are_the_same_bits(name: str) -> None:
    whole, rest = ms.fpn_maps(EVERY, (24, 32)), ms.fpn_maps(EVERY.without(name), (24, 32))
    own = next((stage for stage in chain(EVERY) if stage.key() == name), None)
    assert own is not None, f"give the camera EVERY of this file fields that make {name}"
    assert whole.keys() - rest.keys() == own.fpn_maps(SensorWindow(1, (2, 2))).keys()
    for key, values in rest.items():
        np.testing.assert_array_equal(values, whole[key])


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "name", one_in(3, ["prnu", "dark_current", "shot_noise", "reset_noise", "dsnu_column"])
)
def test_theory_clean_frame_plan_and_budget_are_those_of_the_frames(name: str) -> None:
    """Of 64 sensors and 2 frames. The mean lies within 5 standard errors of the theory (5e-7 by chance), with that of
    the sensors' own spread; the temporal variance within 6 % of the clean frame's (5 of 16 000 numbers: 5.5 %)."""
    camera, light = EVERY.without(name), np.full((16, 16), 2e4)
    frames = [
        ms.expose(light, camera, EXPOSURE, frames=2, serial=serial, seed=serial)
        for serial in range(64)
    ]
    means = np.array([one.digital.mean() for one in frames])
    expected = frames[0].theory.averages(frames[0].stages[-1])
    assert abs(means.mean() - expected.mean) < 5 * means.std(ddof=1) / 8
    pairs = np.array([one.digital[1] - one.digital[0].astype(float) for one in frames])
    temporal = np.mean([one.temporal_variance for one in frames[:4]])
    assert np.mean(pairs**2) / 2 == pytest.approx(temporal, rel=0.06)
    assert expected.temporal == pytest.approx(temporal, rel=0.03)
    plan = ms.plan(camera, EXPOSURE, light)
    label = next(effect.label for effect in ORDER if effect.key() == name)
    assert label not in [one.stage for one in plan.effects]
    budget = frames[1].noise_budget()
    assert label not in [one.source for one in budget.entries]


def test_without_any_noise_the_code_is_the_rounded_mean_and_so_is_the_theory() -> None:
    camera = TABLE1.without(*SOURCES)
    electrons = np.array([[100.0, 1234.5, 20_000.0, 32_000.0]])
    frames = ms.expose(electrons / camera.qe([550.0]).item(), camera, EXPOSURE)
    expected = np.floor(TABLE1.black_level_dn + gain_dn_per_e(TABLE1) * electrons + 0.5)
    np.testing.assert_array_equal(frames.digital[0], expected)
    np.testing.assert_array_equal(frames.clean, expected)
    np.testing.assert_allclose(frames.spatial_mean, expected, atol=1e-3)
    last = frames.report["stages"][-1]
    assert (
        last["mean_expected"] == pytest.approx(expected.mean(), abs=1e-9)
        and last["sigma_expected"] < 1e-6
    )
