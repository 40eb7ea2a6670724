"""Mean and variance of the code of a normal signal on unequal steps, by tables of blurred steps and by sums."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.marks import one_in
from scipy.special import ndtr

from mitsuba_sensor.core import code_law

HIGHEST = 255


def inl_lsb(kind: str) -> np.ndarray:
    """INL of the lower edge of every code [LSB]."""
    k = np.arange(1, HIGHEST + 1) / HIGHEST
    steps = {
        "bow": 10 * k * (1 - k),
        "DNL": np.random.default_rng(1).normal(0, 0.3, HIGHEST).cumsum(),
    }
    return np.sort(k * HIGHEST - 0.5 + steps[kind]) - (k * HIGHEST - 0.5)


@pytest.mark.parametrize("kind", one_in(2, ["bow", "DNL"]))
def test_wide_noise_on_unequal_steps_has_the_moments_of_the_sum_over_all_steps(
    kind: str,
) -> None:
    """Thousands of signals are looked up, few are summed: equal to 1e-4 of σ and of the variance, clips included."""
    rng = np.random.default_rng(2)
    s, x = (
        2 ** rng.uniform(2.6, 9.0, 20_000),
        rng.uniform(-0.5 * HIGHEST, 1.5 * HIGHEST, 20_000),
    )
    assert s.sum() > 4 * code_law.FINE * HIGHEST
    mean, variance = code_law.code_moments(x, s, HIGHEST, inl_lsb(kind))
    parts = [
        code_law.code_moments(x[k : k + 20], s[k : k + 20], HIGHEST, inl_lsb(kind))
        for k in range(0, 2000, 20)
    ]
    summed_mean, summed_variance = np.concatenate(parts, axis=1)
    reached = np.minimum(s[:2000], HIGHEST)
    np.testing.assert_array_less(np.abs(mean[:2000] - summed_mean), 1e-4 * reached)
    np.testing.assert_array_less(np.abs(variance[:2000] - summed_variance), 3e-4 * reached**2)


def test_noise_beyond_every_code_decides_between_the_smallest_and_the_largest() -> None:
    """σ of 1e30 DN: the largest code with the chance Φ(x/σ), else the smallest."""
    x, s = np.linspace(-3e30, 3e30, 3000), np.full(3000, 1e30)
    mean, variance = code_law.code_moments(x, s, HIGHEST, inl_lsb("bow"))
    high = ndtr(x / s)
    np.testing.assert_allclose(mean, HIGHEST * high, atol=0.01)
    np.testing.assert_allclose(variance, HIGHEST**2 * high * (1 - high), atol=3.0)
