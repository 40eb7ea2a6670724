"""Contrast and flicker (IEEE 2020): normal noise against closed forms, known waves, and the intervals."""

from __future__ import annotations

import numpy as np
import pytest
from chart_cases import normal_share

from mitsuba_sensor.lab.measure.automotive.contrast import contrast_detection
from mitsuba_sensor.lab.measure.automotive.flicker import flicker

RNG = np.random.default_rng(2020)


@pytest.mark.parametrize("contrast", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("sigma", [0.05, 0.2])
def test_the_shares_of_normal_noise_are_the_closed_form(contrast: float, sigma: float) -> None:
    """200 × 200 pixels: within 0.01."""
    means, sigmas = np.array([1 + contrast, 1]), np.array([sigma, sigma])
    bright, dark = (m + sigma * RNG.normal(size=(200, 200)) for m in means)
    measured = contrast_detection(bright, dark, contrast)
    low, high = (normal_share(means, sigmas, 1 + contrast * bound) for bound in (0.5, 1.5))
    assert measured.detection.value == pytest.approx(low, abs=0.01)
    assert measured.accuracy.value == pytest.approx(low - high, abs=0.01)


@pytest.mark.parametrize("kind", ["weber", "michelson"])
def test_all_pairs_are_counted(kind: str) -> None:
    """Against a loop over all pairs, pixels below 0 included."""
    bright, dark = RNG.normal(1.4, 0.5, (6, 6)), RNG.normal(1.0, 0.5, (6, 6))
    above, below = np.meshgrid(bright.ravel(), dark.ravel())
    contrast = {"weber": 0.4, "michelson": 1 / 6}[kind]
    found = {"weber": above / below - 1, "michelson": (above - below) / (above + below)}[kind]
    lit = (below > 0) & (above > 0)
    accurate = lit & (found >= 0.5 * contrast) & (found <= 1.5 * contrast)
    detected = (above > 0) & ((below <= 0) | (found >= 0.5 * contrast))
    measured = contrast_detection(bright, dark, contrast, kind=kind)
    assert measured.accuracy.value == pytest.approx(accurate.mean())
    assert measured.detection.value == pytest.approx(detected.mean())


def test_patches_without_noise_show_their_contrast_always() -> None:
    measured = contrast_detection(np.full((8, 8), 1.5), np.ones((8, 8)), 0.5)
    assert measured.accuracy.value == measured.accuracy.high == 1
    assert measured.accuracy.low < 1
    assert measured.mean.value == pytest.approx(0.5)


def still(level: np.ndarray) -> np.ndarray:
    """Frames of these levels without noise."""
    return np.asarray(level[:, None, None] * np.ones((8, 8)))


def test_waves_have_their_indices() -> None:
    """Modulation of a sine and a pulse; shares of the frames above off · 1.1, and within 10 % of the mean."""
    phase = np.arange(360) / 360
    sine = flicker(still(100 + 40 * np.sin(2 * np.pi * phase)), off=100.0)
    assert sine.modulation.value == pytest.approx(0.4, abs=1e-3)
    assert sine.detection.value == pytest.approx(0.5 - np.arcsin(0.25) / np.pi, abs=0.01)
    assert sine.mitigation.value == pytest.approx(2 * np.arcsin(0.25) / np.pi, abs=0.01)
    pulse = flicker(still(np.where(phase < 0.3, 150.0, 50.0)), off=50.0)
    assert pulse.modulation.value == pytest.approx(0.5)
    assert pulse.detection.value == pytest.approx(0.3, abs=0.005)
    assert pulse.mitigation.value == 0


def test_noise_is_no_flicker() -> None:
    """A steady light of 100 DN with noise of 30: the range of 50 frames of 64 pixels would be 0.08."""
    measured = flicker(100 + 30 * RNG.normal(size=(50, 8, 8))).modulation
    assert measured.value < 0.05 and measured.low == 0


def test_a_dark_pixel_is_darker_than_any_and_lights_go_out_to_a_modulation_of_1() -> None:
    """No share from 0 times infinity, and no modulation above 1 where noise is below black."""
    dark = contrast_detection(np.full((8, 8), 50.0), np.zeros((8, 8)), 0.5)
    assert dark.accuracy.value == 0 and dark.detection.value == 1
    out = flicker(still(np.array([100.0, 0.0] * 10)) + RNG.normal(0, 9, (20, 8, 8))).modulation
    assert out.high == 1
