"""The signal in electrons with all read noise, as ``expose(keep=…)`` returns it."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.engines import backend_of

import mitsuba_sensor as ms

NAME = "input_referred_electrons"
EXPOSURE = ms.Exposure(0.1)
TABLE1 = ms.load_camera("konnik_table1")
GAINS = TABLE1.replace(
    **{
        "source_follower.gain": 0.8,
        "readout.cds_gain": 2.5,
        "adc.bits": 16,
        "readout.dsnu_col": 0.0,
        "pixel.prnu": 0.0,
    }
)
LIGHT = np.linspace(0.0, 4e4, 48 * 64).reshape(48, 64)


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_it_is_the_swing_over_the_gain_of_small_signals(engine: str) -> None:
    """A_SN·A_SF·A_CDS = 5 µV/e- · 0.8 · 2.5, to the rounding of float32."""
    backend_of(engine)
    frames = ms.expose(LIGHT, GAINS, EXPOSURE, keep=(NAME, "volts"), frames=2, engine=engine)
    assert frames.volts is not None and frames.input_referred_electrons is not None
    assert frames.input_referred_electrons.shape == (2, 48, 64)
    np.testing.assert_allclose(frames.input_referred_electrons, frames.volts / 10e-6, rtol=2e-7)


def test_less_the_electrons_of_the_well_it_is_the_read_noise() -> None:
    """σ of 12 288 numbers to 5 standard errors, 3.2 %; and the code is K times it, on the black level, ± ½ DN."""
    frames = ms.expose(
        np.full((96, 128), 1e4), GAINS, EXPOSURE, keep=(NAME, "electrons"), precision="float64"
    )
    assert frames.electrons is not None and frames.input_referred_electrons is not None
    off = frames.input_referred_electrons - frames.electrons
    assert off.std() == pytest.approx(GAINS.emva1288().temporal_dark_noise_e, rel=0.032)
    ideal = GAINS.black_level_dn + GAINS.system_gain_dn_per_e * frames.input_referred_electrons
    assert np.abs(frames.digital - ideal).max() <= 0.5 + 1e-6
