"""Codes of a normal signal and of a Poisson count: mean, variance and probability against sums over all codes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from mitsuba_sensor.core.code_law import code_moments, log_chance_of_code, rounded_poisson

HIGHEST = 255


@pytest.mark.parametrize("sigma_dn", [0.0, 0.05, 1.1, 2.01, 40.0, 1e4])
def test_mean_and_variance_equal_the_sums_over_all_codes(sigma_dn: float) -> None:
    """Within 1e-4 of a DN or of the noise: far from the limits, at both, and beyond."""
    x = np.concatenate([np.linspace(-9, 264, 200) + 0.013, [-1e5, 0.2, 255.2, 1e5]])
    levels = np.arange(1, HIGHEST + 1) - 0.5
    with np.errstate(divide="ignore"):
        above = (
            special.ndtr((x[:, None] - levels) / sigma_dn) if sigma_dn else x[:, None] >= levels
        )
    mean = above.sum(axis=1)
    variance = (above * (2 * levels)).sum(axis=1) - mean**2
    found = code_moments(x, np.full(x.size, sigma_dn), HIGHEST)
    np.testing.assert_allclose(found[0], mean, atol=1e-4 * max(sigma_dn, 1.0))
    np.testing.assert_allclose(found[1], variance, rtol=1e-3, atol=5e-4)  # steps to first order


@pytest.mark.parametrize("slope", [0.124, 0.5, 1.0])
@pytest.mark.parametrize("mean_e", [0.3, 7.0, 90.0])
@pytest.mark.parametrize("sigma", [0.06, 0.4])
def test_a_rounded_poisson_and_normal_number(slope: float, mean_e: float, sigma: float) -> None:
    n = np.arange(300.0)[:, None]
    codes, x = np.arange(-20.0, 400.0), 10.3 + slope * n
    law = special.ndtr((codes + 0.5 - x) / sigma) - special.ndtr((codes - 0.5 - x) / sigma)
    chance = stats.poisson.pmf(n, mean_e) * law
    mean = np.sum(chance * codes)
    one = np.ones(1)
    found = rounded_poisson(
        one * (10.3 + slope * mean_e), one * sigma, one * slope, one * mean_e
    )
    assert found[0][0] == pytest.approx(mean, abs=1e-9)
    assert found[1][0] == pytest.approx(np.sum(chance * (codes - mean) ** 2), abs=1e-8)


@pytest.mark.parametrize("sigma_dn", [0.02, 0.7, 30.0])
@pytest.mark.parametrize("mean_dn", [-3.0, 0.4, 100.3, 254.9, 300.0])
def test_probabilities_of_all_codes_sum_to_1_and_are_finite_far_away(
    mean_dn: float, sigma_dn: float
) -> None:
    codes = np.arange(HIGHEST + 1.0)
    found = log_chance_of_code(codes, np.full(256, mean_dn), np.full(256, sigma_dn), HIGHEST)
    assert np.isfinite(found).all()
    assert np.exp(found).sum() == pytest.approx(1.0, abs=1e-12)
