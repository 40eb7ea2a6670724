"""Divergence of noise: that of normal laws, 0 for one law, and the intervals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

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
