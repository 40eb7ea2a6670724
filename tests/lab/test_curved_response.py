"""Responses that are curved, in few levels: K of small signals, or an interval that includes a line and a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.small_cameras import SmallCamera
from lab_coverage import coverage

from mitsuba_sensor.lab.measure.emva_linear import EmvaLinear, emva_linear

WELL_E = 10_000.0


def measure(
    camera: SmallCamera, levels: int, light_error: float = 0.0, seed: int = 1
) -> EmvaLinear:
    """Flat fields up to 1.1 full wells, whose stated light is off by a normal share."""
    rng = np.random.default_rng(seed)
    darks, flats = camera.bench(rng, count=8, shape=(48, 48), levels=levels)
    off = 1 + light_error * rng.standard_normal(levels)
    pairs = zip(flats, off, strict=True)
    return emva_linear(darks, [replace(x, photons=x.photons * share) for x, share in pairs])


def curved(bend: float, noise_e: float = 0.0) -> SmallCamera:
    """Gain at full well is 1 + bend times that at zero.  noise_e : before the curve."""
    rng = np.random.default_rng(2)

    def curve(electrons: np.ndarray) -> np.ndarray:
        noisy = electrons + noise_e * rng.standard_normal(electrons.shape)
        return np.asarray(noisy * (1 + bend * noisy / WELL_E))

    return SmallCamera(curve=curve)


@pytest.mark.parametrize("bend", [-0.3, -0.1, 0.3])
@pytest.mark.parametrize("levels", one_in(3, [6, 8, 10]))
def test_few_levels_show_a_strong_curve(bend: float, levels: int) -> None:
    """Of a line, K would be up to 17 % off."""
    measured = measure(curved(bend), levels)
    assert measured["K"].covers(0.3) and measured["K"].value == pytest.approx(0.3, rel=0.025)
    assert measured["η"].covers(0.6)
    assert measured["K_line"].value == pytest.approx(measured.as_measured.gain.value)
    assert "the response is curved" in measured.notes[-1]
    assert measured.curve.kappa == pytest.approx(bend / 3000, rel=0.025)


@pytest.mark.parametrize("noise_e", [6.0, 20.0])
def test_dark_noise_may_arise_before_the_curve(noise_e: float) -> None:
    """The slope scales it as it scales shot noise: taken as if after the curve, K of 20 e- is 6 % off."""
    measured = measure(curved(-0.3, noise_e), 10)
    assert measured["K"].covers(0.3) and measured["K"].value == pytest.approx(0.3, rel=0.035)


@pytest.mark.parametrize("levels", one_in(2, [4, 5, 8, 12]))
def test_light_that_is_not_as_stated_is_no_curve(levels: int) -> None:
    """Photons that are off by 1 %: of three benches none is curved, K holds, and a note names what levels hide."""
    measured = [measure(SmallCamera(), levels, 0.01, seed) for seed in range(3)]
    for one in measured:
        assert one.curve.kappa == 0
        assert one["K"].low < 0.3 * 1.005 and one["K"].high > 0.3 * 0.995
    assert any("do not distinguish a curve" in one["K"].note for one in measured)


def test_two_levels_have_an_interval_that_holds_line_and_curve_and_one_level_a_note() -> None:
    two, one = measure(curved(-0.1), 3), measure(curved(-0.1), 1)
    assert two["K"].covers(0.3) and "2 levels do not distinguish a curve" in two["K"].note
    assert "do not show whether the response is curved" in one["K"].note


@pytest.mark.exhaustive
def test_cameras_of_few_levels_are_covered() -> None:
    """24 cameras of -30 to 30 %: fewer than 19 of 24 intervals hold once in 200 tests of 95 %."""
    gain = coverage("few", 24)["K"]
    assert gain.covered >= 19 and gain.printed == 24


def test_a_response_of_the_fourth_power_has_more_terms() -> None:
    """y = s(1 − 0.02 (s/s_end)³), as the simulated reference set of EMVA 1288 has it: of a parabola K is 0.8 % off."""
    camera = SmallCamera(curve=lambda n: n * (1 - 0.02 * (n / WELL_E) ** 3))
    found = emva_linear(*camera.bench(np.random.default_rng(10), 8, (160, 160), 30))
    assert found["K"].covers(0.3) and found["K"].value == pytest.approx(0.3, rel=0.006)
    assert found["η"].covers(0.6) and found["R"].value == pytest.approx(0.18, rel=0.001)
