"""Every stage alone: mean, temporal and spatial σ of its samples against closed forms that are written here.

``ms.check_stage`` measures them in a dim and a bright uniform signal, on windows at random places, and raises beyond 5
standard errors: one right case in 2000 would fail with another seed. It also asks for equal bytes in a frame made
again, in a crop and on every engine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
V_PER_E, WELL_E = 5e-6, 33_000.0
SECOND = ms.Exposure(1.0, 298.15)
NONE = ms.Exposure(0.0)
KTC_E = math.sqrt(1.380649e-23 * 298.15 * V_PER_E / 1.602176634e-19) / V_PER_E
RATE = {
    "dark_current.fom_na_per_cm2": None,
    "dark_current.rate_e_per_s": 1000.0,
    "dark_current.at_temperature_k": 298.15,
}
READ = {"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 20.0}
TRAPS = {
    "source_follower.rtn_pixel_fraction": 0.3,
    "source_follower.rtn_pixel_amplitude_e": 60.0,
    "source_follower.rtn_pixel_duty": 0.3,
    "source_follower.rtn_pixel_switching": 0.8,
}
RTS = {
    "dark_current.rts_fraction": 0.5,
    "dark_current.rts_amplitude_e_per_s": 2000.0,
    "dark_current.rts_duty": 0.3,
    "dark_current.rts_at_temperature_k": 298.15,
}
UNIFORM = {"weight": 0.2, "family": "uniform", "low": 100, "high": 900, "unit": "e"}
HIT_E = 1500 * (1 + 0.15 * (0.5772156649 + math.log(2)))
"""Mean charge of Moyal's distribution; its variance is (π·0.15·1500)²/2, and 1/12 by rounding."""
HITS = 0.05
"""Of each pixel, of 5.7 µm × 5.7 µm."""
HIT_E2 = HIT_E**2 + (math.pi * 0.15 * 1500) ** 2 / 2 + 1 / 12
EM, ELEMENTS = 100.0, 400
EXCESS = 2 * (EM - 1) * EM ** (-(ELEMENTS + 1) / ELEMENTS) + 1 / EM

Number = float | Callable[[float], float]


class Law(NamedTuple):
    """Fields of the camera, key of the stage, and what leaves it of a signal x: mean and both σ; None: x itself."""

    fields: dict[str, Any]
    key: str
    mean: Number | None = None
    temporal: Number = 0.0
    spatial: Number = 0.0
    exposure: ms.Exposure = NONE


def dark(more: dict[str, Any], mean_e: float, sigma_e: float) -> Law:
    return Law(RATE | more, "dark_current", lambda x: x + mean_e, 0.0, sigma_e, SECOND)


def read(more: dict[str, Any]) -> Law:
    return Law(READ | more, "source_follower_noise", None, 20 * V_PER_E)


def reset(fields: dict[str, Any], left: float) -> Law:
    return Law(fields, "reset_noise", None, left * KTC_E * V_PER_E)


def offsets(key: str, fields: dict[str, Any], sigma_e: float) -> Law:
    return Law(fields, key, None, 0.0, sigma_e * V_PER_E)


def lines(key: str, field: str) -> Law:
    return Law({field: 20.0}, key, None, 20 * V_PER_E)


LAWS = {
    "prnu": Law({"pixel.prnu": 0.02}, "prnu", None, 0.0, lambda x: 0.02 * x),
    "prnu cut at 0": Law(  # Φ(1) + φ(1); 2Φ(1) + φ(1) − mean²
        {"pixel.prnu": 1.0}, "prnu", lambda x: 1.083315 * x, 0.0, lambda x: 0.866702 * x
    ),
    "log-normal prnu": Law(
        {"pixel.prnu": 0.3, "pixel.prnu_distribution": "lognormal"},
        "prnu", None, 0.0, lambda x: 0.3 * x,
    ),
    **{
        f"{family} dark current": dark(
            {"dark_current.cv": 0.3, "dark_current.distribution": family}, 1000.0, 300.0
        )
        for family in ("gaussian", "gamma", "wald")
    },
    "dark components": dark(
        {"dark_current.cv": 0.0, "dark_current.components": [UNIFORM]},
        900.0,
        math.sqrt(0.8 * 100**2 + 0.2 * (400**2 + 800**2 / 12)),
    ),
    "rts": Law(
        RTS, "rts_pixels", lambda x: x + 300, math.sqrt(0.5 * 0.21) * 2000, 0.5 * 600, SECOND
    ),
    "shot noise": Law({}, "shot_noise", None, math.sqrt),
    "shot noise of both photodiodes": Law(
        {"sensor.dual_pixel": True}, "shot_noise", None, math.sqrt
    ),
    "overflow dark current": Law(
        RATE | {"dark_current.overflow_rate_e_per_s": 400.0},
        "overflow_dark_current", lambda x: x + 400, 20.0, 0.0, SECOND,
    ),
    "full well": Law({"pixel.full_well_e": WELL_E}, "full_well"),
    "hits": Law(
        {"pixel.hits_per_cm2_s": HITS / (5.7e-4) ** 2},
        "radiation_hits", lambda x: x + HITS * HIT_E, math.sqrt(HITS * HIT_E2), 0.0, SECOND,
    ),
    "inter-pixel capacitance": Law({"readout.ipc_coupling": 0.02}, "inter_pixel_capacitance"),
    "em gain": Law(
        {"readout.em_gain": EM, "readout.em_stages": ELEMENTS},
        "em_gain", lambda x: EM * x, lambda x: EM * math.sqrt((EXCESS - 1) * x),
    ),
    "sense node": Law({}, "sense_node", lambda x: V_PER_E * x),
    "curved sense node": Law(
        {"readout.ve_nonlinearity": 1.0},
        "nonlinear_sense_node", lambda x: -3.1 * math.expm1(-V_PER_E * x / 3.1),
    ),
    "hard reset": reset({"readout.reset": "hard"}, 1.0),
    "soft reset": reset({"readout.reset": "soft"}, math.sqrt(0.5)),
    "uncorrelated sampling": reset({"readout.ktc_residual": math.sqrt(2)}, math.sqrt(2)),
    "read noise": read({}),
    "read noise of each pixel": read({"source_follower.read_noise_cv": 0.3}),
    "noisy pixels": read(
        {
            "source_follower.noisy_pixel_fraction": 0.02,
            "source_follower.noisy_pixel_factor": 3.0,
        }
    ),
    "heavy tails": read(
        {
            "source_follower.read_noise_distribution": "tukey_lambda",
            "source_follower.read_noise_shape": -0.1,
        }
    ),
    "rtn": Law(  # P(+A) = P(−A) = 0.8·0.3·0.7
        TRAPS, "rtn_pixels", None, math.sqrt(0.3 * 2 * 0.8 * 0.21) * 60 * V_PER_E
    ),
    "follower": Law({"source_follower.gain": 0.8}, "source_follower", lambda x: 0.8 * x),
    "curved follower": Law(
        {"source_follower.vv_nonlinearity": 1.05},
        "nonlinear_source_follower", lambda x: x * (1 + 0.05 * x / (V_PER_E * WELL_E)),
    ),
    "dsnu column": offsets("dsnu_column", {"readout.dsnu_col": 0.001}, 33.0),
    "dsnu column of neighbours": offsets(
        "dsnu_column", {"readout.dsnu_col": 0.001, "readout.dsnu_col_coupling": 0.25}, 33.0
    ),
    "dsnu column behind a cds": offsets(
        "dsnu_column", {"readout.dsnu_col": 0.001, "readout.dsnu_residual": 0.4}, 13.2
    ),
    "dsnu row, which no cds takes away": offsets(
        "dsnu_row", {"readout.dsnu_row": 0.001, "readout.dsnu_residual": 0.4}, 33.0
    ),
    "dsnu pixel": offsets("dsnu_pixel", {"pixel.dsnu_e": 20.0}, 20.0),
    "prnu column": Law(
        {"readout.prnu_col": 0.005}, "prnu_column", None, 0.0, lambda x: 0.005 * x
    ),
    "row noise": lines("temporal_row_noise", "readout.row_noise_e"),
    "column noise": lines("temporal_column_noise", "readout.column_noise_e"),
    "frame noise": lines("temporal_frame_noise", "readout.frame_noise_e"),
    "cds gain": Law({"readout.cds_gain": 2.0}, "cds_gain", lambda x: 2 * x),
    "curved converter": Law(
        {"adc.gamma": 1.04},
        "integral_nonlinearity", lambda x: x * 1.04 ** (-x / (V_PER_E * WELL_E)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_samples_of_a_stage_have_the_closed_form(name: str) -> None:
    fields, key, mean, temporal, spatial, exposure = LAWS[name]
    camera = TABLE1.replace(**fields)
    stage = next(one for one in camera.stages if one.key() == key)
    ms.check_stage(
        stage,
        camera=camera,
        exposure=exposure,
        mean=(lambda x: x) if mean is None else mean,
        temporal=temporal,
        spatial=spatial,
    )
