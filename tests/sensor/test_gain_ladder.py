"""The gain ladder of a camera: what was put in per setting is measured from frames of that setting.

Frames of 512 × 512 pixels: the difference of two shows a variance to 0.28 %. A relative error of 1.4 % is five of these
standard errors (6e-7 false alarms a figure), the seeds are fixed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

COLUMNS = [
    "gain_dn_per_e",
    "read_noise_e",
    "black_level_dn",
    "full_well_e",
    "sense_gain_uv_per_e",
]
ROWS: dict[int | str, tuple[float, ...]] = {
    100: (0.25, 8.0, 64, 15_000, 30.0),
    400: (1.0, 4.5, 66, 15_000, 30.0),
    "hcg 400": (1.0, 1.5, 80, 3000, 150.0),
}
SETTINGS = {label: dict(zip(COLUMNS, row, strict=True)) for label, row in ROWS.items()}
LADDER: list[dict[str, Any]] = [
    {"name" if isinstance(label, str) else "iso": label, **one}
    for label, one in SETTINGS.items()
]
CAMERA = ms.load_camera("konnik_table1").replace(gains=LADDER)
EVEN = CAMERA.replace(
    **{"pixel.prnu": 0.0, "readout.dsnu_col": 0.0, "quantum_efficiency.value": 1.0}
)
SHAPE, TOLERANCE = (512, 512), 0.014
DARK = ms.Exposure(0.0)


def pair(camera: ms.Camera, photons: float, **options: Any) -> tuple[float, float]:
    """Mean and temporal variance of two frames [DN, DN²]."""
    one, two = ms.expose(
        np.full(SHAPE, photons), camera, DARK, frames=2, engine="numpy", **options
    ).digital.astype(int)
    return float((one + two).mean() / 2), float((one - two).var() / 2)


@pytest.mark.parametrize("setting", SETTINGS)
def test_gain_read_noise_and_black_level_of_a_setting_are_measured_from_its_frames(
    setting: int | str,
) -> None:
    """Photon transfer: K = Δσ²/Δμ, σ_read = √(σ_dark² − 1/12)/K, the mean of darkness, the highest code."""
    given = SETTINGS[setting]
    (dark, quiet), (bright, shot) = (
        pair(EVEN, 0.0, gain=setting),
        pair(EVEN, 2000.0, gain=setting),
    )
    k = (shot - quiet) / (bright - dark)
    assert k == pytest.approx(given["gain_dn_per_e"], rel=TOLERANCE)
    assert math.sqrt(quiet - 1 / 12) / k == pytest.approx(given["read_noise_e"], rel=TOLERANCE)
    assert dark == pytest.approx(given["black_level_dn"], abs=5 * math.sqrt(quiet / 2) / 512)
    top = ms.expose(np.full((4, 4), 1e6), EVEN, DARK, gain=setting).digital.astype(float).mean()
    filled = given["black_level_dn"] + given["gain_dn_per_e"] * given["full_well_e"]
    assert top == pytest.approx(min(4095, filled), abs=5 * k * given["read_noise_e"])


def test_the_conversion_gain_is_a_step_in_everything_that_the_sense_node_decides() -> None:
    """kTC noise √(k_B·T·C)/q with C = q/A_SN: five times the conversion gain, √5 times fewer electrons."""
    soft = EVEN.replace(**{"readout.reset": "hard"})
    for setting in (400, "hcg 400"):
        camera = soft.at_gain(setting)
        farads = ELEMENTARY_CHARGE_C / sense_gain_v_per_e(camera)
        ktc_e = math.sqrt(BOLTZMANN_J_PER_K * DARK.temperature_k * farads) / ELEMENTARY_CHARGE_C
        expected = math.hypot(ktc_e, SETTINGS[setting]["read_noise_e"])
        _, variance = pair(camera.replace(**{"adc.black_level_dn": 500}), 0.0)
        assert math.sqrt(variance - 1 / 12) / gain_dn_per_e(camera) == pytest.approx(
            expected, rel=TOLERANCE
        )


def test_fixed_patterns_are_the_same_at_every_setting_and_offsets_of_columns_keep_their_volts() -> (
    None
):
    camera = CAMERA.replace(**{"pixel.dsnu_e": 5.0, "readout.dsnu_row": 0.002})
    base = ms.fpn_maps(camera, (40, 60), serial=7)
    for setting in SETTINGS:
        at = camera.at_gain(setting)
        maps, volts = (
            ms.fpn_maps(at, (40, 60), serial=7),
            sense_gain_v_per_e(at) / sense_gain_v_per_e(camera),
        )
        for name in ("prnu", "dark_fpn", "dsnu_pixel_e"):
            np.testing.assert_array_equal(maps[name], base[name])
        for name in ("dsnu_col_e", "dsnu_row_e"):
            np.testing.assert_allclose(maps[name] * volts, base[name], rtol=1e-6)


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_every_way_to_ask_for_a_setting_is_the_same_frame(engine: str) -> None:
    light, at = np.full((12, 16), 800.0), CAMERA.at_gain("hcg 400")
    options: Any = {"engine": engine, "serial": 3, "seed": 4}
    expected = ms.expose(light, at, DARK, **options).digital
    found = [ms.expose(light, CAMERA, DARK, gain="hcg 400", **options).digital]
    found += [next(ms.stream(light, CAMERA, DARK, gain="hcg 400", **options))[None]]
    found += [
        ms.Sensor(CAMERA, serial=3)
        .expose(light, DARK, gain="hcg 400", engine=engine, seed=4)
        .digital
    ]
    found += [ms.Sensor(at, serial=3).expose(light, DARK, engine=engine, seed=4).digital]
    for one in found:
        np.testing.assert_array_equal(one, expected)
    iso = [
        ms.expose(light, CAMERA, DARK, gain=x, **options).digital
        for x in (400, 400.0, "400", " 400 ")
    ]
    assert all(np.array_equal(one, iso[0]) for one in iso) and not np.array_equal(
        iso[0], expected
    )
