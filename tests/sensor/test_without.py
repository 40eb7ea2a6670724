"""Noise sources that are switched off by name: the others stay what they are, and the theory is that of the frames."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.datasheet_checks import noise_sources
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
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
