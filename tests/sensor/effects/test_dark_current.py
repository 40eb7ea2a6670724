"""Electrons that come without light: how many, how they spread over pixels and they follow time and temperature."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.units import BOLTZMANN_EV_PER_K, ELEMENTARY_CHARGE_C
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.dark_current_models import (
    Doubling,
    FigureOfMerit,
    Measured,
    Mpp,
    band_gap_ev,
)
from mitsuba_sensor.stages.effects.dark_current import (
    DarkCurrent,
    dark_current_model,
    mean_dark_e,
)
from mitsuba_sensor.stages.gains import gain_dn_per_e

TABLE1 = ms.load_camera("konnik_table1")
SHAPE = (300, 500)


def dark_stage(camera: ms.Camera) -> DarkCurrent:
    return next(stage for stage in chain(camera) if isinstance(stage, DarkCurrent))


def dark_map(camera: ms.Camera, time_s: float, shape: tuple[int, int] = SHAPE) -> Any:
    """Mean dark electrons of every pixel."""
    frame = ms.stages.Frame(ms.Exposure(time_s, 300.0), SensorWindow(7, shape))
    return np.broadcast_to(
        dark_stage(camera).sample(ms.stages.Electrons(np.zeros(shape)), frame).dark, shape
    )


K = gain_dn_per_e(TABLE1)
LONG = {
    "dark_current.fom_na_per_cm2": None,
    "dark_current.rate_e_per_s": 914.6579 * 0.0611 / K,
    "dark_current.at_temperature_k": 300.0,
    "dark_current.distribution": "gamma",
    "dark_current.cv": 914.6579**-0.5,
    "dark_current.components": [
        {"weight": 0.001, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}
    ],
}
"""The paper's long integration: gamma(914.6579, 0.0611) DN with one pixel in a thousand on U[45, 440] DN."""


HOT = {"weight": 0.01, "family": "uniform", "low": 5e3, "high": 3e4, "unit": "e_per_s"}
"""1 % hot pixels of 5000 to 30 000 e-/s at 300 K."""


@pytest.mark.parametrize(("unit", "one_e"), [("e", 1.0), ("e_per_s", 2.0), ("dn", 1 / K)])
def test_components_in_every_unit_have_the_moments_of_the_mixture(
    unit: str, one_e: float
) -> None:
    """0.5·main + 0.3·U[100, 300] + 0.2·N(500, 50) at t = 2 s, each unit by hand; samples within 5 se (0.8 %, 0.9 %)."""
    parts = [
        {"weight": 0.3, "family": "uniform", "low": 100, "high": 300, "unit": unit},
        {"weight": 0.2, "family": "normal", "mean": 500, "sigma": 50, "unit": unit},
    ]
    camera = TABLE1.replace(
        **LONG | {"dark_current.rate_e_per_s": 400.0, "dark_current.components": parts}
    )
    laws = [(0.5, 800.0, 800.0**2 / 914.6579), (0.3, 200 * one_e, (200 * one_e) ** 2 / 12),
            (0.2, 500 * one_e, (50 * one_e) ** 2)]  # fmt: skip
    mean = sum(w * m for w, m, _ in laws)
    variance = sum(w * (v + (m - mean) ** 2) for w, m, v in laws)
    x = dark_map(camera, 2.0)
    assert x.mean() == pytest.approx(mean, abs=5 * math.sqrt(variance / x.size))
    fourth = np.mean((x - x.mean()) ** 4) / variance**2
    assert x.var() == pytest.approx(variance, rel=5 * math.sqrt((fourth - 1) / x.size))


AREA_CM2 = 5.7e-4 * 8e-4
KELVINS = [77.0, 250.0, 298.15, 300.0, 308.0, 400.0]


def test_the_mpp_law_adds_diffusion_and_depletion_at_300_k_and_separates_them_elsewhere() -> (
    None
):
    """Eq. 2 written out in this test; at 300 K the sum is what both figures of merit say; diffusion falls faster."""
    model = dark_current_model(
        TABLE1.replace(
            **{
                "pixel.pitch_x_um": 5.7,
                "pixel.pitch_y_um": 8.0,
                "dark_current.diffusion_fom_na_per_cm2": 0.01,
                "dark_current.fom_na_per_cm2": 0.02,
            }
        )
    )
    assert model == Mpp(0.01, 0.02, pytest.approx(AREA_CM2))
    per_fom = AREA_CM2 * 1e-9 / ELEMENTARY_CHARGE_C
    assert model.rate_e_per_s(300.0) == pytest.approx(0.03 * per_fom, rel=1e-12)
    for t in KELVINS:
        gap = band_gap_ev(300.0) / 300.0 - band_gap_ev(t) / t
        diffusion = 0.01 * (t / 300) ** 3 * math.exp(gap / BOLTZMANN_EV_PER_K)
        depletion = 0.02 * (t / 300) ** 1.5 * math.exp(gap / (2 * BOLTZMANN_EV_PER_K))
        assert model.rate_e_per_s(t) == pytest.approx(
            per_fom * (diffusion + depletion), rel=1e-12
        )
        assert Mpp(0.0, 0.02, AREA_CM2).rate_e_per_s(t) == FigureOfMerit(
            0.02, AREA_CM2
        ).rate_e_per_s(t)
        assert Mpp(1.0, 0.0, 1.0).rate_e_per_s(t) * Mpp(1.0, 0.0, 1.0).rate_e_per_s(
            300.0
        ) == pytest.approx(FigureOfMerit(1.0, 1.0).rate_e_per_s(t) ** 2, rel=1e-9)


def test_a_measured_rate_is_what_was_measured_and_follows_silicon_from_there() -> None:
    """D(308)/D(300) = 1.8930 whatever the temperature of the measurement."""
    model = Measured(5.0, 298.15)
    assert model.rate_e_per_s(298.15) == pytest.approx(5.0, rel=1e-12)
    assert model.rate_e_per_s(308.0) / model.rate_e_per_s(300.0) == pytest.approx(
        1.8930, abs=5e-5
    )
    same = Measured(model.rate_e_per_s(320.0), 320.0)
    for t in KELVINS:
        assert same.rate_e_per_s(t) == pytest.approx(model.rate_e_per_s(t), rel=1e-12)


def test_a_doubling_temperature_doubles_and_so_does_the_exposure_time() -> None:
    camera = TABLE1.replace(
        **LONG | {"dark_current.rate_e_per_s": 5.0, "dark_current.doubling_k": 7.0}
    )
    model = dark_current_model(camera)
    assert mean_dark_e(camera, ms.Exposure(4.0, 307.0)) == pytest.approx(40.0, rel=1e-12)
    assert model == Doubling(5.0, 300.0, 7.0)
    for steps in (-10, -1, 0, 1, 3):
        assert model.rate_e_per_s(300.0 + 7.0 * steps) == pytest.approx(
            5.0 * 2.0**steps, rel=1e-12
        )


@pytest.mark.parametrize("unit", ["e_per_s", "e", "dn"])
def test_hot_pixels_cool_with_their_activation_energy_in_every_unit(unit: str) -> None:
    """0.56 eV: 1.98e-5 of it at 200 K, 7.8e-15 at 120 K. Of 1000 pixels above 400 e- none is left; for 0 eV all are.

    The electrons of each hot pixel follow exp(E/k·(1/300 − 1/T)) to the last digits.
    """
    dark = {}
    for energy in (0.56, 0.0):
        hot = HOT | {"unit": unit, "activation_ev": energy}
        fields = {"dark_current.components": [hot], "dark_current.fom_na_per_cm2": 0.0}
        stage = dark_stage(TABLE1.replace(**fields))
        for kelvin in (300.0, 200.0, 120.0, 0.0):
            frame = ms.stages.Frame(ms.Exposure(0.1, kelvin), SensorWindow(7, (200, 500)))
            dark[energy, kelvin] = stage.sample(
                ms.stages.Electrons(np.zeros((200, 500))), frame
            ).dark
    count = {key: int(np.sum(values > 400)) for key, values in dark.items()}
    assert count[0.56, 300.0] == count[0.0, 300.0] == count[0.0, 120.0] > 900
    assert count[0.56, 200.0] == count[0.56, 120.0] == count[0.56, 0.0] == 0
    factor = math.exp(0.56 / BOLTZMANN_EV_PER_K * (1 / 300 - 1 / 200))
    np.testing.assert_allclose(dark[0.56, 200.0], factor * dark[0.56, 300.0], rtol=1e-12)
