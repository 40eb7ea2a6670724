"""Partial resets of the well during the exposure: ShotNoiseWithResets, a piecewise-linear response."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e

SHORT = ms.Exposure(0.01)
RESETS = [[0.9, 6_000.0], [0.99, 9_000.0]]
CAMERA = ms.load_camera("sony_imx174").replace(
    **{"pixel.prnu": 0.0, "dark_current.cv": 0.0, "pixel.partial_resets": RESETS}
)


def well_e(mean_e: np.ndarray) -> np.ndarray:
    """The closed form: each part of the exposure fills the well, each reset leaves so much."""
    first = np.minimum(0.9 * mean_e, 6_000)
    second = np.minimum(first + 0.09 * mean_e, 9_000)
    return np.asarray(second + 0.01 * mean_e)


def test_the_response_is_piecewise_linear_and_its_noise_that_of_the_last_part() -> None:
    levels = np.array([100.0, 5_000.0, 20_000.0, 100_000.0, 1e6])
    light = ms.Photons(np.tile(levels[:, None], (1, 20_000)), detected=True)
    electrons = ms.expose(light, CAMERA, SHORT, keep=["electrons"]).electrons
    assert electrons is not None
    expected = well_e(levels)
    mean, variance = electrons[0].mean(axis=1), electrons[0].var(axis=1)
    poisson = np.array([100, 5_000, 20_000 * 0.1, 1_000, 10_000])
    assert mean == pytest.approx(expected, abs=5 * np.sqrt(expected.max() / 20_000))
    assert variance == pytest.approx(poisson, rel=0.05)  # five standard errors of 20 000 pixels


def test_theory_knows_the_response_and_its_noise() -> None:
    light = ms.Photons(np.tile(np.geomspace(10, 3e5, 200), (100, 1)), detected=True)
    frames = ms.expose(light, CAMERA, SHORT, frames=20)
    off = (frames.digital.mean(axis=(0, 1)) - frames.clean.mean(axis=0)) / np.sqrt(
        frames.temporal_variance.mean(axis=0) / 2_000
    )
    assert np.abs(off).max() < 5
    ratio = frames.digital.var(axis=0, ddof=1).mean(axis=0) / frames.temporal_variance.mean(
        axis=0
    )
    assert np.median(ratio) == pytest.approx(1, abs=0.02)


def test_saturation_is_where_the_well_is_full_behind_the_last_reset() -> None:
    camera = CAMERA.replace(**{"pixel.full_well_e": 10_000.0, "readout.gain_dn_per_e": 0.1})
    assert well_e(np.array(saturation_e(camera))) == pytest.approx(10_000)
    assert saturation_e(camera) == pytest.approx(100_000)
