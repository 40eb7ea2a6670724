"""Photon and dark shot noise: whole electrons by Poisson's law."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.shot_noise import ShotNoise

compiled = pytest.mark.skipif(backend_problem("llvm") is not None, reason="needs LLVM")
SMALL = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))
CHARGE = ms.Electrons(np.linspace(0, 4e4, 200).reshape(4, 50), np.full((4, 50), 174.0))


class TestShotNoise(StageTests):
    stage = ShotNoise
    camera = ms.load_camera("konnik_table1")


class TestShotNoiseOfFewElectrons(StageTests):
    stage = ShotNoise
    camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 16})
    level = 2e-4


def test_shot_noise_gives_whole_electrons_of_light_and_dark_apart() -> None:
    after = ShotNoise().sample(CHARGE, SMALL)
    for part in (after.light, after.dark):
        np.testing.assert_array_equal(part, np.floor(part))
    assert np.abs(
        np.corrcoef(after.light.ravel() - CHARGE.light.ravel(), after.dark.ravel())[0, 1]
    ) < 5 / np.sqrt(200)


LEVELS_E = (
    (1e-3, 1e-3),
    (0.4, 3.0),
    (30.0, 4.0),
    (900.0, 1100.0),
    (16_500.0, 174.0),
    (5.0, 2e4),
)
"""Mean photoelectrons and dark electrons."""


@pytest.mark.parametrize("backend", [NUMPY_FLOAT64, NUMPY_FLOAT32], ids=["float64", "float32"])
@pytest.mark.parametrize("means_e", LEVELS_E)
def test_both_parts_of_a_count_are_poisson_and_independent(
    means_e: tuple[float, float], backend: Backend
) -> None:
    """2^18 draws: mean and variance of each, and their covariance, within 5 standard errors.

    60 comparisons at P(|z| > 5) = 6e-7: one other seed in 30 000 would fail.
    """
    draws, (light, dark) = 2**18, means_e
    frame = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (1, draws), backend=backend))
    after = ShotNoise().sample(
        ms.Electrons(
            backend.from_numpy(np.full((1, draws), light), frame.window), frame.number(dark)
        ),
        frame,
    )
    away = [
        np.asarray(n, dtype=np.float64) - mean
        for n, mean in ((after.light, light), (after.dark, dark))
    ]
    np.testing.assert_array_equal(after.light + after.dark, after.total)
    for x, mean in zip(away, means_e, strict=True):
        assert x.min() >= -mean and abs(x.mean()) < 5 * np.sqrt(mean / draws)
        assert abs(np.mean(x**2) - mean) < 5 * np.sqrt((mean + 2 * mean**2) / draws)
    assert abs(np.mean(away[0] * away[1])) < 5 * np.sqrt(light * dark / draws)


@pytest.mark.parametrize("engine", ["numpy", pytest.param("drjit", marks=compiled)])
def test_the_count_is_the_same_whether_its_parts_are_asked_for_or_not(engine: str) -> None:
    light, camera = (
        np.geomspace(0.01, 1e5, 60 * 50).reshape(60, 50),
        ms.load_camera("konnik_table1"),
    )
    how: Any = {"engine": engine, "keep": "electrons"}
    one = ms.expose(light, camera, ms.Exposure(0.1), **how)
    apart = ms.expose(
        light,
        camera,
        ms.Exposure(0.1),
        **how | {"keep": ("photoelectrons", "dark_electrons", "electrons")},
    )
    assert (
        apart.photoelectrons is not None
        and apart.dark_electrons is not None
        and apart.electrons is not None
    )
    np.testing.assert_array_equal(one.digital, apart.digital)
    np.testing.assert_array_equal(one.electrons, apart.electrons)
    np.testing.assert_array_equal(apart.photoelectrons + apart.dark_electrons, apart.electrons)


def test_a_frame_is_not_split_unless_somebody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ms.Frame, "split", None)
    camera = ms.load_camera("konnik_table1")
    assert ms.expose(
        np.full((8, 9), 1e3), camera, ms.Exposure(0.1), keep=("electrons", "volts")
    ).report
    with pytest.raises(TypeError):
        ms.expose(np.full((8, 9), 1e3), camera, ms.Exposure(0.1), keep="photoelectrons")


def test_electrons_with_other_photoelectrons_are_the_sum_of_both() -> None:
    after = ShotNoise().sample(CHARGE, SMALL)
    np.testing.assert_array_equal(
        replace(after, light=after.light + 1.0).total, after.total + 1.0
    )


def test_a_pixel_twice_as_hot_has_twice_the_dark_shot_variance() -> None:
    """X = 2: temporal var/mean stays 1, because the map multiplies the mean before Poisson. 2e5 draws, 5 se = 1.6 %."""
    frame = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (1, 200_000)))
    dark = ShotNoise().sample(ms.Electrons(np.zeros((1, 200_000)), 2 * 174.158), frame).dark
    assert dark.mean() == pytest.approx(2 * 174.158, rel=5e-4)
    assert dark.var() / dark.mean() == pytest.approx(1, abs=0.016)
