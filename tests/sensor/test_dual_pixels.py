"""Dual pixels: the picture is the sum of what two photodiodes hold, each of which is read alone, too."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array

EXPOSURE = ms.Exposure(0.01)
QUIET = {
    "pixel.prnu": 0.0,
    "source_follower.read_noise_e": 0.05,
    "readout.gain_dn_per_e": 1.0,
    "adc.bits": 16,
    "adc.black_level_dn": 100.0,
}
"""One DN is one electron: codes are counts, but for one in some thousand that rounding moves."""


def dual(**fields: object) -> ms.Camera:
    return ms.load_camera("sony_imx174").replace(**{"sensor.dual_pixel": True, **fields})


def light_of(left_e: float, right_e: float, shape: tuple[int, int] = (200, 300)) -> ms.Photons:
    """Photoelectrons in both halves."""
    whole, left = np.full(shape, left_e + right_e), np.full(shape, left_e)
    part = ms.Photons(left, detected=True)
    return ms.Photons(whole, detected=True, by_readout={"left": part})


def electrons(frames: ms.Frames) -> Float64Array:
    return frames.digital.astype(float) - 100


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_left_and_right_electrons_add_up_to_the_picture(engine: str) -> None:
    """In each pixel, within one electron of rounding."""
    frames = ms.expose(light_of(300, 900), dual(**QUIET), EXPOSURE, frames=2, engine=engine)
    left, right = (electrons(one) for one in frames.readouts.values())
    assert np.abs(electrons(frames) - left - right).max() <= 1
    assert (electrons(frames) != left + right).mean() < 1e-3


def test_each_photodiode_has_shot_noise_of_its_own() -> None:
    """Mean and variance of Poisson's law within five standard errors of 120 000 counts; no correlation of both."""
    frames = ms.expose(light_of(40, 90), dual(**QUIET), EXPOSURE, frames=2)
    left, right = (electrons(one) for one in frames.readouts.values())
    for counts, mean_e in ((left, 40), (right, 90), (electrons(frames), 130)):
        error = 5 / np.sqrt(counts.size)
        assert counts.mean() == pytest.approx(mean_e, abs=error * np.sqrt(mean_e) + 0.2)
        assert counts.var() == pytest.approx(mean_e, rel=error * np.sqrt(2) + 0.01)
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 5 / np.sqrt(left.size)


def test_a_photodiode_has_half_of_the_well_and_of_the_dark_current() -> None:
    """What is above half of the well in one of them flows to the other: the picture is linear up to the whole."""
    camera = dual(**QUIET, **{"pixel.full_well_e": 2000.0, "dark_current.rate_e_per_s": 4000.0})
    camera = camera.replace(**{"dark_current.at_temperature_k": 300.0})
    frames = ms.expose(light_of(1500, 200), camera, ms.Exposure(0.01, temperature_k=300.0))
    left, right = frames.readouts["left"], frames.readouts["right"]
    assert electrons(left).max() <= 1001
    assert electrons(left).mean() == pytest.approx(1000, abs=1)
    assert electrons(frames).mean() == pytest.approx(1740, abs=2)
    assert electrons(right).mean() == pytest.approx(220, abs=1)


@pytest.mark.usefixtures("few_windows")
def test_theory_clean_frame_and_budget_are_those_of_a_photodiode() -> None:
    """Theory of the left one against 120 000 of its pixels, five standard errors; picture as of a plain camera."""
    camera = dual()
    frames = ms.expose(light_of(500, 1500), camera, EXPOSURE, frames=2)
    left = frames.readouts["left"]
    measured = (left.digital[0].astype(float) - left.digital[1]).var() / 2
    assert left.temporal_variance.mean() == pytest.approx(measured, rel=5 * np.sqrt(2 / 60000))
    assert left.digital.mean() == pytest.approx(left.clean.mean(), abs=0.1)
    budget = left.noise_budget()
    assert np.isfinite(budget.explain().count("photon shot noise"))
    plain = camera.replace(**{"sensor.dual_pixel": False})
    np.testing.assert_array_equal(
        frames.temporal_variance,
        ms.expose(
            light_of(500, 1500).changed(by_readout=None), plain, EXPOSURE
        ).temporal_variance,
    )
