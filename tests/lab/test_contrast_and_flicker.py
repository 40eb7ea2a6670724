"""Contrast and flicker (IEEE 2020): normal noise against closed forms, known waves; divergence of noise."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from chart_cases import normal_share

from mitsuba_sensor.lab.measure.automotive.contrast import contrast_detection
from mitsuba_sensor.lab.measure.automotive.flicker import flicker
from mitsuba_sensor.lab.measure.noise_distance import noise_divergence

RNG = np.random.default_rng(2020)


@pytest.mark.parametrize("contrast", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("sigma", [0.05, 0.2])
def test_the_shares_of_normal_noise_are_the_closed_form(contrast: float, sigma: float) -> None:
    """200 × 200 pixels: within 0.01."""
    means, sigmas = np.array([1 + contrast, 1]), np.array([sigma, sigma])
    bright, dark = (m + sigma * RNG.normal(size=(200, 200)) for m in means)
    measured = contrast_detection(bright, dark, contrast)
    low, high = (normal_share(means, sigmas, 1 + contrast * bound) for bound in (0.5, 1.5))
    found = measured.detection.value, measured.accuracy.value
    assert found == pytest.approx((low, low - high), abs=0.01)


@pytest.mark.parametrize(("kind", "contrast"), [("weber", 0.4), ("michelson", 1 / 6)])
def test_all_pairs_are_counted(kind: str, contrast: float) -> None:
    """Against a loop over all pairs, pixels below 0 included."""
    bright, dark = RNG.normal(1.4, 0.5, (6, 6)), RNG.normal(1.0, 0.5, (6, 6))
    above, below = np.meshgrid(bright.ravel(), dark.ravel())
    contrasts = above / below - 1 if kind == "weber" else (above - below) / (above + below)
    lit = (below > 0) & (above > 0)
    accurate = lit & (contrasts >= 0.5 * contrast) & (contrasts <= 1.5 * contrast)
    detected = (above > 0) & ((below <= 0) | (contrasts >= 0.5 * contrast))
    measured = contrast_detection(bright, dark, contrast, kind=kind)
    assert measured.accuracy.value == pytest.approx(accurate.mean())
    assert measured.detection.value == pytest.approx(detected.mean())


def test_patches_without_noise_show_their_contrast_always_and_black_is_darker_than_any() -> (
    None
):
    measured = contrast_detection(np.full((8, 8), 1.5), np.ones((8, 8)), 0.5)
    assert measured.accuracy.value == measured.accuracy.high == 1 > measured.accuracy.low
    assert measured.mean.value == pytest.approx(0.5)
    dark = contrast_detection(np.full((8, 8), 50.0), np.zeros((8, 8)), 0.5)
    assert dark.accuracy.value == 0 and dark.detection.value == 1


def still(level: np.ndarray) -> np.ndarray:
    """Frames of these levels without noise."""
    return np.asarray(level[:, None, None] * np.ones((8, 8)))


def test_waves_have_their_indices() -> None:
    """Modulation of a sine and a pulse; shares of the frames above off · 1.1, and within 10 % of the mean."""
    phase = np.arange(360) / 360
    sine = flicker(still(100 + 40 * np.sin(2 * np.pi * phase)), off=100.0)
    pulse = flicker(still(np.where(phase < 0.3, 150.0, 50.0)), off=50.0)
    quarter = np.arcsin(0.25) / np.pi
    for one, expected in ((sine, (0.4, 0.5 - quarter, 2 * quarter)), (pulse, (0.5, 0.3, 0))):
        found = one.modulation.value, one.detection.value, one.mitigation.value
        assert found == pytest.approx(expected, abs=0.01)


def test_noise_is_no_flicker_and_makes_no_modulation_above_1() -> None:
    """A steady light of 100 DN with noise of 30: the range of 50 frames of 64 pixels would be 0.08."""
    measured = flicker(100 + 30 * RNG.normal(size=(50, 8, 8))).modulation
    assert measured.value < 0.05 and measured.low == 0
    out = flicker(still(np.array([100.0, 0.0] * 10)) + RNG.normal(0, 9, (20, 8, 8))).modulation
    assert out.high == 1


@pytest.mark.parametrize(("shift", "sigma"), [(0.5, 1.0), (0.0, 1.5), (0.2, 0.8)])
def test_normal_laws_have_their_divergence(shift: float, sigma: float) -> None:
    """300 000 values: within 2 % of ln σ + (1 + μ²) / 2σ² − ½."""
    measured = noise_divergence(RNG.normal(size=300_000), RNG.normal(shift, sigma, 300_000))
    true = np.log(sigma) + (1 + shift**2) / (2 * sigma**2) - 0.5
    assert measured.value == pytest.approx(true, rel=0.02)


def test_codes_have_the_divergence_of_scipy() -> None:
    """Whole numbers with a bin each, against scipy.stats.entropy of their histograms, less what chance adds."""
    real, model = RNG.poisson(3.0, 50_000) % 6, RNG.poisson(3.5, 50_000) % 6
    above, below = (np.bincount(codes) for codes in (real, model))
    expected = float(scipy.stats.entropy(above, below)) - 5 / 50_000
    assert noise_divergence(real, model, bins=200).value == pytest.approx(expected, rel=1e-6)
