"""readout.gain_dn_per_e: the overall system gain K of a sheet, in place of volts; and the terms of sheets for keys."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera import Camera
from mitsuba_sensor.camera.datasheet_errors import (
    did_you_mean,
    fields_of,
)

TABLES: dict[str, Any] = {
    "name": "mine",
    "sensor": {"technology": "cmos", "columns": 16, "rows": 12},
    "pixel": {
        "pitch_x_um": 5.86,
        "pitch_y_um": 5.86,
        "fill_factor": 1.0,
        "full_well_e": 32691.0,
    },
    "quantum_efficiency": {
        "value": 0.77,
        "wavelengths_nm": [400.0, 1000.0],
        "reference_nm": 525.0,
    },
    "dark_current": {"rate_e_per_s": 0.0},
    "source_follower": {"read_noise_e": 6.83},
    "readout": {"gain_dn_per_e": 0.1225, "reset": "true_cds"},
    "adc": {"bits": 12},
}


def changed(**tables: dict[str, Any]) -> dict[str, Any]:
    """The tables with others in their place."""
    return TABLES | tables


@pytest.mark.parametrize("sense_uv", [5.0, 50.0, 120.0])
def test_k_alone_makes_the_frames_that_volts_make(sense_uv: float) -> None:
    """V_FS = A_SN·2^bits/K, whatever A_SN is."""
    of_k = ms.load_camera(TABLES)
    volts = {"sense_gain_uv_per_e": sense_uv, "reset": "true_cds"}
    full_scale_v = sense_uv * 1e-6 * 2**12 / 0.1225
    of_volts = ms.load_camera(
        changed(readout=volts, adc={"bits": 12, "full_scale_v": full_scale_v})
    )
    assert of_volts.system_gain_dn_per_e == pytest.approx(0.1225, rel=1e-12)
    frames = [
        ms.expose(np.full((12, 16), 9000.0), camera, ms.Exposure(0.01), frames=3).digital
        for camera in (of_k, of_volts)
    ]
    assert np.array_equal(*frames)
    assert of_k.emva1288().saturation_e == pytest.approx(of_volts.emva1288().saturation_e)


def test_one_gain_takes_the_place_of_the_other() -> None:
    camera = ms.load_camera("sony_imx174").replace(**{"readout.gain_dn_per_e": 0.2})
    assert camera.system_gain_dn_per_e == 0.2 and camera.adc.full_scale_v is None
    with pytest.warns(
        ms.SensorWarning, match=r"gain_dn_per_e 0\.2 was replaced .* K is now 0\.1225"
    ):
        back = camera.replace(**{"adc.full_scale_v": 1.67117})
    assert back.readout.gain_dn_per_e is None
    assert back.system_gain_dn_per_e == ms.load_camera("sony_imx174").system_gain_dn_per_e
    with pytest.raises(ms.InputError, match="and not both"):
        camera.replace(**{"adc.full_scale_v": 1.0, "readout.gain_dn_per_e": 0.1})


def test_a_k_that_stays_or_was_named_is_no_warning_and_a_missing_sense_gain_is_named() -> None:
    camera = ms.load_camera("sony_imx174").replace(**{"readout.gain_dn_per_e": 0.2})
    same_v = camera.readout.sense_gain_uv_per_e * 1e-6 * 2**camera.adc.bits / 0.2
    with warnings.catch_warnings():
        warnings.simplefilter("error", ms.SensorWarning)
        camera.replace(**{"adc.full_scale_v": same_v})
        camera.replace(**{"adc.full_scale_v": 1.0, "readout.gain_dn_per_e": None})
    with pytest.raises(
        ms.InputError, match=r"gain_dn_per_e 0\.1225, and the sense gain is missing"
    ):
        ms.load_camera(TABLES).replace(**{"adc.full_scale_v": 1.0})


def test_a_gain_setting_takes_the_place_of_k() -> None:
    gains = [
        {"name": name, "gain_dn_per_e": k, "read_noise_e": 3.0}
        for name, k in (("a", 0.1), ("b", 1.0))
    ]
    camera = ms.load_camera(TABLES | {"gains": gains}).at_gain("b")
    assert camera.system_gain_dn_per_e == pytest.approx(1.0) and not camera.notes


@pytest.mark.parametrize(
    ("written", "meant"),
    {
        "K": "readout.gain_dn_per_e",
        "adc.gain": "readout.gain_dn_per_e",
        "temporal_dark_noise": "source_follower.read_noise_e",
        "saturation capacity": "pixel.full_well_e",
        "quantum_efficiency.QE": "quantum_efficiency.value",
        "dark_current.dark_current": "dark_current.rate_e_per_s",
        "sensor.bit_depth": "adc.bits",
        "pixel.pixel_size_um": "pixel.pitch_x_um",
        "sensor.width": "sensor.columns",
        "pixel.width": "pixel.pitch_x_um",
        "sensor.prnu_percent": "pixel.prnu",
        "pixel.full_wel_e": "pixel.full_well_e",
    }.items(),
)
def test_words_of_the_field_lead_to_the_key(written: str, meant: str) -> None:
    assert did_you_mean(written, fields_of(Camera)) == f" Did you mean {meant!r}?"
    with pytest.raises(ms.InputError, match=rf"Did you mean '{meant}'"):
        ms.load_camera(TABLES).replace(**{written: 1.0})
