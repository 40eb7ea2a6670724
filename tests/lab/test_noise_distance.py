"""Divergence of noise: that of normal laws, 0 for one law, and the intervals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from chart_cases import divergence_case
from image_quality_coverage import coverage

import mitsuba_sensor as ms
from mitsuba_sensor.lab.measure.noise_distance import noise_divergence

RNG = np.random.default_rng(2019)


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
    chance = 5 / 50_000
    expected = float(scipy.stats.entropy(above, below)) - chance
    assert noise_divergence(real, model, bins=200).value == pytest.approx(expected, rel=1e-6)


def test_divergences_cover_what_they_were_made_with() -> None:
    """60 pairs, half of one law: fewer than 84 % once in 1000 tests."""
    shares = [share for share, _ in coverage(divergence_case, 60).values()]
    assert 0.84 < np.mean(shares) <= 1


def test_samples_that_have_no_distance_are_refused() -> None:
    with pytest.raises(ms.InputError, match="real has 10 values; pass 100 or more"):
        noise_divergence(np.zeros(10), np.zeros(1000))
    with pytest.raises(ms.InputError, match="all equal"):
        noise_divergence(np.ones(1000), np.ones(1000))
    with pytest.raises(ms.InputError, match="whole number from 4 to 10000 "):
        noise_divergence(RNG.normal(size=1000), RNG.normal(size=1000), bins=4.5)  # type: ignore[arg-type]
    with pytest.raises(ms.InputError, match="no values in common"):
        noise_divergence(RNG.normal(size=1000), 100 + RNG.normal(size=1000))
