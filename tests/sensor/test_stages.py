"""Chains of whole cameras. What one stage does alone is tested in effects/."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.adc import AdcWithDnl
from mitsuba_sensor.stages.effects.dsnu import DsnuColumn
from mitsuba_sensor.stages.effects.reset_noise import ResetNoise

BASE = ms.load_camera("konnik_table1")
UNIFORM = [{"weight": 0.2, "family": "uniform", "low": 100, "high": 900, "unit": "e"}]
EVERYTHING = BASE.replace(
    **{
        "pixel.prnu": 0.02,
        "pixel.dsnu_e": 20.0,
        "dark_current.cv": 0.4,
        "dark_current.components": UNIFORM,
    },
    **{"dark_current.rts_fraction": 0.5, "dark_current.rts_amplitude_e_per_s": 2000.0},
    **{
        "dark_current.rts_switching": 0.2,
        "dark_current.rts_duty": 0.3,
        "readout.reset": "hard",
    },
    **{"quantum_efficiency.quantum_yield": [1.5, 1.5], "quantum_efficiency.fano_factor": 0.2},
    **{
        "readout.dsnu_col": 0.002,
        "readout.dsnu_col_coupling": 0.25,
        "readout.dsnu_residual": 0.4,
    },
    **{
        "readout.prnu_col": 0.005,
        "readout.prnu_col_coupling": 0.2,
        "readout.ve_nonlinearity": 0.8,
    },
    **{
        "source_follower.vv_nonlinearity": 0.9,
        "source_follower.rtn_uv": 200.0,
        "source_follower.rtn_s": 1e-6,
    },
    **{"adc.ile": 0.02, "adc.bits": 14},
)
"""Every noise source and every curve at once."""


def test_a_ccd_has_no_reset_noise_no_dsnu_and_no_telegraph_noise() -> None:
    """One amplifier and true CDS; asking for them is refused, unless it is asked for a CMOS sensor."""
    ccd = ms.load_camera("eev_44_82")
    noisy = {"readout.reset": "hard", "readout.dsnu_col": 0.1, "source_follower.rtn_uv": 500.0}
    with pytest.raises(
        ms.InputError,
        match=r"reset is 'hard' and source_follower\.rtn_uv is 500\.0 and readout\.ds",
    ):
        ccd.replace(**noisy)
    assert not any(isinstance(stage, ResetNoise | DsnuColumn) for stage in chain(ccd))
    cmos = ccd.replace(**noisy, **{"sensor.technology": "cmos"})
    assert sum(isinstance(stage, ResetNoise | DsnuColumn) for stage in chain(cmos)) == 2


NEUTRAL: dict[str, dict[str, Any]] = {
    "curves": {
        "source_follower.vv_nonlinearity": 1.0,
        "readout.ve_nonlinearity": 0.0,
        "adc.gamma": 1.0,
    },
    "ile": {"adc.ile": 0.0},
    "dnl": {"adc.dnl_lsb": {"7": 0.0}},
    "offsets": {
        "readout.dsnu_row": 0.0,
        "readout.dsnu_row_coupling": 0.3,
        "pixel.dsnu_e": 0.0,
        "readout.prnu_col": 0.0,
    },
    "components": {
        "dark_current.components": [
            {"weight": 0.0, "family": "uniform", "low": 5, "high": 6, "unit": "e"}
        ]
    },
    "RTS of no amplitude": {
        "dark_current.rts_fraction": 0.5,
        "dark_current.rts_amplitude_e_per_s": 0.0,
    },
    "yield of one": {
        "quantum_efficiency.quantum_yield": [1.0, 1.0],
        "quantum_efficiency.fano_factor": 0.5,
    },
}


@pytest.mark.parametrize("option", NEUTRAL)
def test_a_neutral_option_of_a_camera_gives_the_same_bytes(option: str) -> None:
    light = np.linspace(0, 60_000, 600).reshape(20, 30)
    frame = ms.expose(
        light, BASE.replace(**NEUTRAL[option]), ms.Exposure(0.1), frames=2
    ).digital
    assert (
        frame.tobytes() == ms.expose(light, BASE, ms.Exposure(0.1), frames=2).digital.tobytes()
    )


def test_a_crop_and_a_single_frame_of_the_richest_camera_are_cut_from_the_whole() -> None:
    """All options at once: window and frame number change no bit."""
    camera = EVERYTHING.replace(
        **{"readout.dsnu_row": 0.002, "pixel.dsnu_coupling": 0.25, "adc.dnl_lsb": {"700": -1.0}}
    )
    light = np.linspace(0, 20_000, 24 * 30).reshape(24, 30)
    whole = ms.expose(light, camera, ms.Exposure(0.1), frames=3, origin=(500, 4090)).digital
    part = ms.expose(
        light[5:20, 3:28], camera, ms.Exposure(0.1), first_frame=2, origin=(505, 4093)
    ).digital
    np.testing.assert_array_equal(part[0], whole[2, 5:20, 3:28])
    assert any(isinstance(stage, AdcWithDnl) for stage in chain(camera))
