"""Quantile functions of random integers in float64: against SciPy's, closed forms and their own definition.

Seeds are fixed. Where a test compares an average with its expectation, the docstring says how often chance alone
would fail it under other seeds.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from mitsuba_sensor.core import distributions

EDGES = (0, 1, 2, 2**31 - 1, 2**31, 2**32 - 3, 2**32 - 2, 2**32 - 1)
POISSON_MEANS = (
    0.0,
    5e-324,
    1e-12,
    1e-6,
    0.1,
    0.49,
    3.0,
    9.99,
    10.0,
    12.0,
    30.0,
    333.3,
    1e3,
    1e5,
)


def integers(size: int, seed: int = 5) -> NDArray[np.uint32]:
    """Random integers of NumPy, unrelated to the RNG under test."""
    return np.random.default_rng(seed).integers(0, 2**32, size, dtype=np.uint32)


def with_edges(size: int) -> NDArray[np.uint32]:
    return np.concatenate([np.array(EDGES, dtype=np.uint32), integers(size)])


def even_integers(bits: int) -> NDArray[np.uint32]:
    """2^bits integers, evenly spread: averages over them have no sampling error, only that of the coarser grid."""
    return (np.arange(2**bits, dtype=np.uint64) * 2 ** (32 - bits) + 2 ** (31 - bits)).astype(
        np.uint32
    )


def test_normal_is_the_quantile_function_of_scipy_and_odd_about_the_middle() -> None:
    w = with_edges(1000)
    np.testing.assert_allclose(
        distributions.normal(w),
        stats.norm.isf(distributions.survival(w)),
        rtol=1e-12,
        atol=1e-15,
    )
    np.testing.assert_allclose(
        distributions.normal(~w), -distributions.normal(w), rtol=1e-9, atol=1e-12
    )
    assert distributions.normal(np.array([0], dtype=np.uint32))[0] == pytest.approx(
        6.3379, abs=1e-3
    )


@pytest.mark.parametrize("cv", [1e-9, 0.01, 0.4, 1.0, 10.0])
def test_lognormal_has_unit_mean_its_cv_and_never_reaches_0(cv: float) -> None:
    """Moments of ln X, which converge for every cv: −½ln(1+cv²) and ln(1+cv²)."""
    x = distributions.lognormal(even_integers(18), cv)
    variance = math.log1p(cv * cv)
    assert (x > 0).all()
    assert np.log(x).mean() == pytest.approx(-variance / 2, rel=1e-6, abs=1e-16)
    assert np.log(x).var() == pytest.approx(variance, rel=3e-4)
    if cv <= 1:
        assert x.mean() == pytest.approx(1, abs=1e-3)
        assert x.std() == pytest.approx(cv, rel=1e-2)


@pytest.mark.parametrize("mean", POISSON_MEANS)
def test_poisson_equals_scipys_quantile_integer_for_integer(mean: float) -> None:
    """The ends and the middle too; no chance is left. No light is exactly 0, and 0.49 electrons are not."""
    w = with_edges(30_000 if mean < 1e4 else 3_000)
    np.testing.assert_array_equal(
        distributions.poisson(w, mean), stats.poisson.isf(distributions.survival(w), mean)
    )


def test_poisson_equals_scipys_quantile_where_the_mean_differs_from_pixel_to_pixel() -> None:
    """Means from 1e-3 to 1e3, all three ways of finding the count in one array, in any shape."""
    w = integers(60_000).reshape(200, 300)
    means = 10 ** np.random.default_rng(8).uniform(-3, 3, w.shape)
    np.testing.assert_array_equal(
        distributions.poisson(w, means), stats.poisson.isf(distributions.survival(w), means)
    )


def test_poisson_of_astronomical_means_is_finite_and_within_6_4_sigma() -> None:
    w = np.array(EDGES, dtype=np.uint32)
    for mean in (1e12, 1e30, 1e300):
        n = distributions.poisson(w, mean)
        assert np.isfinite(n).all()
        assert (np.abs(n - mean) <= 6.4 * math.sqrt(mean) + 1e-15 * mean).all()
    assert np.isinf(distributions.poisson(w, math.inf)).all()


def test_poisson_never_falls_when_the_mean_or_the_wanted_quantile_rises() -> None:
    """Quantiles are monotone; a step at the seam at 10 would show here."""
    means = np.concatenate([np.linspace(0, 40, 4001), [9.999999999, 10.0, 10.000000001]])
    means.sort()
    for integer in EDGES:
        counts = distributions.poisson(np.full(means.shape, integer, dtype=np.uint32), means)
        assert (np.diff(counts) >= 0).all()
    for mean in (3.0, 12.0, 1e5):
        assert (np.diff(distributions.poisson(np.sort(integers(10_000)), mean)) <= 0).all()


COUPLINGS = (0.0, 1e-12, 0.25, 0.45, 0.49, 0.4999)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_isotropic_ar_is_an_exact_filter_of_variance_1_and_neighbour_correlation_2a(
    coupling: float,
) -> None:
    """Its response to a unit impulse is its kernel: Σh² must be 1 and Σh_j·h_{j+1} must be 2a, without any sampling."""
    size = 4 * distributions.AR_WARM_UP
    impulse = np.zeros(size + 2 * distributions.AR_WARM_UP)
    impulse[distributions.AR_WARM_UP + size // 2] = 1
    h = distributions.isotropic_ar(impulse, coupling, distributions.AR_WARM_UP)
    assert np.sum(h * h) == pytest.approx(1, rel=1e-12)
    assert np.sum(h[1:] * h[:-1]) == pytest.approx(2 * coupling, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(
        h, h[np.abs(np.arange(size) - size) % size], rtol=1e-9, atol=1e-15
    )


@pytest.mark.parametrize(
    ("coupling", "gain"), [(0.25, 1.5396), (0.45, 12.0745), (0.49, 126.90)]
)
def test_isotropic_ar_solves_the_equation_of_the_paper(coupling: float, gain: float) -> None:
    """x_j = a(x_{j−1} + x_{j+1}) + U_j with white U of variance 1/gain, gain = (1 − 4a²)^(−3/2) (paper eq. 28)."""
    white = np.random.default_rng(3).standard_normal(20_000 + 2 * distributions.AR_WARM_UP)
    x = distributions.isotropic_ar(white, coupling, distributions.AR_WARM_UP)
    u = x[1:-1] - coupling * (x[:-2] + x[2:])
    expected = white[distributions.AR_WARM_UP + 1 : -distributions.AR_WARM_UP - 1] / math.sqrt(
        gain
    )
    np.testing.assert_allclose(u, expected, rtol=1e-4, atol=1e-5)
