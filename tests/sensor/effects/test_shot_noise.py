"""Photon and dark shot noise: whole electrons by Poisson's law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.shot_noise import ShotNoise

compiled = pytest.mark.skipif(backend_problem("llvm") is not None, reason="needs LLVM")


LEVELS_E = (
    (1e-3, 1e-3),
    (0.4, 3.0),
    (30.0, 4.0),
    (900.0, 1100.0),
    (16_500.0, 174.0),
    (5.0, 2e4),
)
"""Mean photoelectrons and dark electrons."""


@pytest.mark.parametrize(
    ("means_e", "backend"),
    [*((means_e, NUMPY_FLOAT32) for means_e in LEVELS_E), (LEVELS_E[3], NUMPY_FLOAT64)],
)
def test_both_parts_of_a_count_are_poisson_and_independent(
    means_e: tuple[float, float], backend: Backend
) -> None:
    """2^18 draws: mean and variance of each, and their covariance, within 5 standard errors.

    35 comparisons at P(|z| > 5) = 6e-7: one other seed in 50 000 would fail.
    """
    draws, (light, dark) = 2**18, means_e
    frame = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, (1, draws), backend=backend))
    after = ShotNoise().sample(
        ms.stages.Electrons(
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
