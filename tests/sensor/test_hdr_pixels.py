"""LOFIC, split pixels and staggered exposures: what their read-outs share, and the SNR of their combination.

Closed forms and conservation are the oracles; random numbers are the same in every run. Bounds are five standard errors
where none is stated.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from mitsuba_sensor.stages.effects.overflow_dark_current import OverflowDarkCurrent
from mitsuba_sensor.theory.dynamic_range import hdr_figures

SHORT = ms.Exposure(0.01)
PLAIN = (
    ms.load_camera("sony_imx174")
    .replace(
        **{
            "pixel.prnu": 0.0,
            "adc.bits": 12,
            "adc.black_level_dn": 64.0,
            "dark_current.cv": 0.0,
            "dark_current.rate_e_per_s": 100.0,
            "dark_current.at_temperature_k": 298.15,
        }
    )
    .without("dsnu_pixel", "dsnu_column", "dsnu_row", "prnu_column")
)


def camera_of(*readouts: dict[str, Any], **changes: Any) -> ms.Camera:
    return PLAIN.replace(**{"readouts": list(readouts), **changes})


def readout(
    name: str, gain: float, noise_e: float, well_e: float, of: str = "charge", **more: Any
) -> dict[str, Any]:
    fields = {
        "readout.gain_dn_per_e": gain,
        "source_follower.read_noise_e": noise_e,
        "pixel.full_well_e": well_e,
    }
    ratios = {k: more.pop(k) for k in ("exposure_ratio", "sensitivity") if k in more}
    return {"name": name, "of": of, "fields": {**fields, **more}, **ratios}


def flat(level_e: float, side: int = 256) -> ms.Photons:
    return ms.Photons(np.full((side, side), level_e), detected=True)


LOFIC = camera_of(
    readout("photodiode", 0.4, 1.0, 9_000.0),
    readout(
        "capacitor",
        0.02,
        5.0,
        180_000.0,
        **{
            "readout.sense_gain_uv_per_e": 8.0,
            "readout.reset": "hard",
            "dark_current.overflow_rate_e_per_s": 20_000.0,
        },
    ),
)
STAGGERED = camera_of(
    readout("long", 0.4, 1.0, 9_000.0),
    readout("short", 0.4, 1.0, 9_000.0, "exposure", exposure_ratio=1 / 16),
    readout("shortest", 0.4, 1.0, 9_000.0, "exposure", exposure_ratio=1 / 256),
)
SPLIT = camera_of(
    readout("large_high", 1.0, 0.7, 4_000.0),
    readout("large_low", 0.2, 2.5, 19_000.0),
    readout("small", 0.2, 2.5, 17_000.0, "photodiode", sensitivity=0.05),
)


def test_charge_above_the_photodiode_goes_to_the_capacitor() -> None:
    frames = ms.expose(flat(100_000.0), LOFIC, SHORT)
    low = frames.readouts["capacitor"]
    dark_e = 100.0 * 0.01 + 20_000 * 0.01
    mean_e = (low.digital.mean() - 64) / 0.02
    assert mean_e == pytest.approx(100_000 + dark_e, abs=5 * math.sqrt(100_000 / 256**2))
    assert (frames.readouts["photodiode"].digital == 64 + 0.4 * 9_000).mean() > 0.3
    assert frames.digital.mean() == pytest.approx(64 + 0.4 * mean_e, rel=1e-3)


def test_the_capacitor_has_dark_current_and_ktc_noise_of_its_own() -> None:
    """One electron more or less in the capacitor is seen by the low gain alone."""
    stage = next(
        x for x in LOFIC.at_readout("capacitor").stages if isinstance(x, OverflowDarkCurrent)
    )
    assert stage.label == "overflow dark current"
    dark = ms.expose(flat(0.0), LOFIC.replace(**{"adc.bits": 16}), SHORT)
    high, low = (one.digital[0].astype(float) for one in dark.readouts.values())
    ktc_e2 = BOLTZMANN_J_PER_K * 298.15 / (8e-6 * ELEMENTARY_CHARGE_C)
    expected_e2 = 201 + ktc_e2 + 5.0**2 + 1 / 12 / 0.02**2
    assert low.var() / 0.02**2 == pytest.approx(expected_e2, rel=5 * math.sqrt(2) / 256)
    assert (low.mean() - 64) / 0.02 == pytest.approx(201, abs=5 * math.sqrt(expected_e2) / 256)
    assert (high.mean() - 64) / 0.4 == pytest.approx(1.0, abs=0.05)


def test_staggered_exposures_have_their_own_electrons_and_one_fixed_pattern() -> None:
    noisy = STAGGERED.replace(**{"pixel.prnu": 0.05})
    frames = ms.expose(flat(5_000.0), noisy, SHORT, frames=16)
    long, short = (
        frames.readouts[name].digital.astype(float) - 64 for name in ("long", "short")
    )
    assert short.mean() / long.mean() == pytest.approx(1 / 16, rel=0.002)
    patterns = long.mean(axis=0), short.mean(axis=0)
    assert np.corrcoef(*(x.ravel() for x in patterns))[0, 1] > 0.5
    own = [(x - x.mean(axis=0)).ravel() for x in (long, short)]
    assert abs(np.corrcoef(*own)[0, 1]) < 5 / math.sqrt(own[0].size)
    assert frames.readouts["short"].first.exposure.time_s == pytest.approx(0.01 / 16)


def test_a_split_pixel_has_two_photodiodes_and_one_of_them_is_read_twice() -> None:
    noisy = SPLIT.replace(**{"pixel.prnu": 0.05})
    frames = ms.expose(flat(2_000.0), noisy, SHORT, frames=16)
    high, low, small = (one.digital.astype(float) - 64 for one in frames.readouts.values())
    assert small.mean() / low.mean() == pytest.approx(0.05, rel=0.02)
    pattern = [x.mean(axis=0).ravel() for x in (high, low, small)]
    assert np.corrcoef(pattern[0], pattern[1])[0, 1] > 0.9
    assert abs(np.corrcoef(pattern[0], pattern[2])[0, 1]) < 5 / 256
    noise = [(x - x.mean(axis=0)).ravel() for x in (high, low, small)]
    assert np.corrcoef(noise[0], noise[1])[0, 1] > 0.9
    assert abs(np.corrcoef(noise[0], noise[2])[0, 1]) < 5 / math.sqrt(noise[0].size)


WIDE = camera_of(
    readout("large_high", 1.0, 0.5, 3_500.0),
    readout("large_low", 0.15, 12.0, 24_000.0),
    readout("small_high", 0.3, 2.0, 12_000.0, "photodiode", sensitivity=0.02),
    readout("small_low", 0.01, 30.0, 380_000.0),
    **{"combine.bits": 24, "combine.gain_dn_per_e": 1.0, "dark_current.rate_e_per_s": 0.0},
)
"""140 dB: from 0.5 e- of noise to 1.7e7 e- of the large photodiode, by four read-outs."""


def test_dynamic_range_by_emva_and_iso_15739_follows_from_noise_and_saturation() -> None:
    figures = hdr_figures(WIDE, ms.Exposure(0.0))
    noise_e = math.hypot(0.5, math.sqrt(1 / 12))
    least_e = math.sqrt(noise_e**2 + 0.25) + 0.5
    full_e = 2**24 - 1 - 64  # the linear code ends before the small photodiode
    assert figures.saturation_e == pytest.approx(full_e, rel=1e-6)
    assert figures.dynamic_range_iso_db == pytest.approx(
        20 * math.log10(full_e / noise_e), abs=0.15
    )
    assert figures.dynamic_range_emva_db == pytest.approx(
        20 * math.log10(full_e / least_e), abs=0.15
    )
    assert figures.dynamic_range_iso_db > 140
    assert figures.dips_db[0] == pytest.approx(
        10 * math.log10((2_800 + 12**2) / 2_800), abs=0.05
    )
