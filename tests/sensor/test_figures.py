"""EMVA 1288 figures of a camera: closed forms of Table 1, and what frames show."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
QUANTISATION_DN = math.sqrt(1 / 12)


def test_table_1_has_its_closed_forms() -> None:
    """K = 4096 codes over 33 000 e-; σ_SF = 6.105 e- (paper eq. 19-24); the converter ends at (4095 − black)/K."""
    gain, noise_e = 4096 / 33_000, 6.10506886
    found = TABLE1.emva1288()
    assert (
        TABLE1.system_gain_dn_per_e
        == found.system_gain_dn_per_e
        == pytest.approx(gain, rel=1e-12)
    )
    assert found.temporal_dark_noise_e == pytest.approx(noise_e, rel=1e-7)
    assert found.saturation_e == pytest.approx((4095 - TABLE1.black_level_dn) / gain, rel=1e-12)
    least_e = math.sqrt(noise_e**2 + (QUANTISATION_DN / gain) ** 2 + 0.25) + 0.5
    assert found.absolute_sensitivity_e == pytest.approx(least_e, rel=1e-7)
    assert found.snr_max == pytest.approx(math.sqrt(found.saturation_e), rel=1e-12)
    assert found.dynamic_range == pytest.approx(found.saturation_e / least_e, rel=1e-7)
    assert found.dynamic_range_db == pytest.approx(
        20 * math.log10(found.dynamic_range), rel=1e-12
    )
    assert [one.value for one in found.table()][-2:] == [
        found.snr_max_db,
        found.dynamic_range_db,
    ]


def test_saturation_is_the_full_well_where_the_converter_does_not_end_before() -> None:
    wide = TABLE1.replace(**{"adc.full_scale_v": 0.33})
    assert wide.emva1288().saturation_e == 33_000
    assert wide.system_gain_dn_per_e == pytest.approx(
        TABLE1.system_gain_dn_per_e / 2, rel=1e-12
    )


def test_independent_read_noise_adds_in_squares_and_kelvin_scale_ktc_noise() -> None:
    """√(k_B·T·A_SN/q)/A_SN of a hard reset at 250 K; row, column and dark shot noise beside it."""
    noisy = TABLE1.replace(
        **{"readout.reset": "hard", "readout.row_noise_e": 3.0, "readout.column_noise_e": 4.0}
    )
    ktc_e = math.sqrt(1.380649e-23 * 250 / (1.602176634e-19 * 5e-6))
    found = noisy.emva1288(ms.Exposure(0.0, 250.0)).temporal_dark_noise_e
    assert found == pytest.approx(math.hypot(6.10506886, 3.0, 4.0, ktc_e), rel=1e-7)


def test_dark_current_adds_its_shot_noise_and_takes_its_electrons_from_the_saturation() -> None:
    camera = TABLE1.replace(
        **{
            "dark_current.fom_na_per_cm2": None,
            "dark_current.rate_e_per_s": 50,
            "dark_current.at_temperature_k": 298.15,
        }
    )
    short, long = camera.emva1288(), camera.emva1288(ms.Exposure(10.0))
    assert long.temporal_dark_noise_e == pytest.approx(
        math.hypot(short.temporal_dark_noise_e, math.sqrt(500)), rel=2e-4
    )  # averages of 16 384 pixels, whose dark currents differ
    assert short.saturation_e - long.saturation_e == pytest.approx(500, rel=4e-4)
    full = camera.emva1288(ms.Exposure(1e6))
    assert (
        full.saturation_e == 0
        and full.dynamic_range_db == -math.inf
        and math.isfinite(full.absolute_sensitivity_e)
    )


def test_noise_that_has_no_closed_form_is_sampled() -> None:
    """10 % of the pixels with steps of ±40 e- in half of the frames; EM gain 100 with its excess noise; a stage of a
    user. 65 536 pixels: 5 standard errors are 1.5 %."""
    traps = {
        "source_follower.rtn_pixel_fraction": 0.1,
        "source_follower.rtn_pixel_amplitude_e": 40.0,
    }
    found = TABLE1.replace(**traps).emva1288().temporal_dark_noise_e
    assert found == pytest.approx(math.hypot(6.10506886, 40 * math.sqrt(0.05)), rel=0.015)
    multiplied = TABLE1.replace(
        **{
            "readout.em_gain": 100.0,
            "readout.em_stages": 400,
            "dark_current.fom_na_per_cm2": None,
            "dark_current.rate_e_per_s": 100.0,
            "dark_current.at_temperature_k": 298.15,
        }
    )
    excess = 2 * 99 * 100 ** (-401 / 400) + 0.01
    found = multiplied.emva1288(ms.Exposure(1.0)).temporal_dark_noise_e
    assert found == pytest.approx(
        math.hypot(6.10506886 / 100, math.sqrt(100 * excess)), rel=0.015
    )


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (
            "konnik_table1",
            {
                "readout.reset": "hard",
                "source_follower.vv_nonlinearity": 1.05,
                "adc.gamma": 1.04,
            },
        ),
        ("bayer_2mp", {"source_follower.read_noise_cv": 0.4}),
    ],
)
def test_frames_have_the_temporal_dark_noise_and_system_gain(
    name: str, changes: dict[str, Any]
) -> None:
    """80 000 differences of dark frames: σ to 0.25 %, 5 of that 1.3 %; K by 2000 e- of exact mean, to 0.5 %."""
    camera = ms.load_camera(name).replace(**changes)
    figures, dark = camera.emva1288(), ms.Exposure(0.0)
    two = ms.expose(np.zeros((200, 400)), camera, dark, frames=2).digital.astype(float)
    variance = np.mean((two[1] - two[0]) ** 2) / 2 - 1 / 12
    found = math.sqrt(variance) / camera.system_gain_dn_per_e
    assert found == pytest.approx(figures.temporal_dark_noise_e, rel=0.013)
    quiet = camera.without(
        "shot_noise", "prnu", "prnu_column", "dsnu_column", "dsnu_row", "dsnu_pixel"
    )
    reference = quiet.quantum_efficiency.reference_nm
    photons = 500 / quiet.qe([reference])[0].item()
    levels = [np.full((64, 64), x) for x in (0.0, photons)]
    means = [ms.expose(x, quiet, dark, frames=8).digital[:, ::2, ::2] for x in levels]
    if len(quiet.filter_names) == 1:
        rise = means[1].astype(float).mean() - means[0].astype(float).mean()
        assert rise / 500 == pytest.approx(camera.system_gain_dn_per_e, rel=0.01)
