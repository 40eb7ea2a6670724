"""Quantile functions of random integers in float64: against SciPy's, closed forms and their own definition.

Seeds are fixed. Where a test compares an average with its expectation, the docstring says how often chance alone
would fail it under other seeds.
"""

from __future__ import annotations

import math
from decimal import Decimal, getcontext
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from numpy.typing import NDArray
from scipy import stats

from mitsuba_sensor.core import distributions

EDGES = (0, 1, 2, 2**31 - 1, 2**31, 2**32 - 3, 2**32 - 2, 2**32 - 1)
POISSON_MEANS = (
    1e-12,
    1e-6,
    1e-3,
    0.1,
    0.49,
    1.0,
    3.0,
    9.99,
    10.0,
    10.5,
    12.0,
    13.7,
    30.0,
    333.3,
    1e3,
    12345.6,
    1e5,
)
MOMENT_MEANS = (1e-6, 0.1, 1.0, 9.99, 10.0, 30.0, 1e3, 1e5, 1e7)


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


def test_survival_is_never_0_and_never_1() -> None:
    s = distributions.survival(np.array([0, 2**31, 2**32 - 1], dtype=np.uint32))
    np.testing.assert_array_equal(s, [2.0**-33, 0.5 + 2.0**-33, 1 - 2.0**-33])


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


def test_normal_has_mean_0_variance_1_and_the_higher_moments_of_its_distribution() -> None:
    """2^20 even integers: the cut at 2^-21 on each side costs 4e-5 of the variance, by integration."""
    z = distributions.normal(even_integers(20))
    assert abs(z.mean()) < 1e-8
    assert np.mean(z**2) == pytest.approx(1, abs=1e-4)
    assert np.mean(z**4) == pytest.approx(3, abs=4e-3)


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


@pytest.mark.parametrize("mean", one_in(3, POISSON_MEANS))
def test_poisson_equals_scipys_quantile_integer_for_integer(mean: float) -> None:
    """100 000 random integers (3000 where SciPy searches slowly), the ends and the middle; no chance is left."""
    w = with_edges(100_000 if mean < 1e4 else 3_000)
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


@pytest.mark.parametrize("mean", [1e6, 1e7])
def test_poisson_of_a_large_mean_equals_scipys_quantile_but_for_scipys_own_tail(
    mean: float,
) -> None:
    """From 1e6 our expansion may differ in 1e-5 of the integers; beyond +4.3σ SciPy is wrong (next test)."""
    w = integers(1_000)
    s = distributions.survival(w := w[w > 2**32 * 1e-5])
    np.testing.assert_array_equal(distributions.poisson(w, mean), stats.poisson.isf(s, mean))


@pytest.mark.parametrize("mean", [11.0, 1e3, 1e6, 1e7, 1e8])
@pytest.mark.parametrize("integer", [0, 1, 17, 1000])
def test_poisson_tail_is_right_where_scipys_gamma_function_is_not(
    integer: int, mean: float
) -> None:
    """By definition P(N > n) ≤ s < P(N > n − 1). The sums are made term by term, the first in 50 digits.

    (SciPy's incomplete gamma function is 3 % low 5σ above a mean of 1e7, and 27 % at 1e8.)
    """
    n = int(distributions.poisson(np.array([integer], dtype=np.uint32), mean)[0])
    s = (integer + 0.5) / 2**32
    assert upper_tail(n, mean) <= s < upper_tail(n - 1, mean)


@pytest.mark.parametrize("start", [1e3, 1e5, 1e7, 1e8])
def test_poisson_steps_by_one_where_the_mean_passes_a_boundary(start: float) -> None:
    """In the last bit before and after a step, where the expansion is in doubt, the count is right to one electron.

    The integer 1 is 6.2σ up: SciPy's tail is wrong by 400 electrons there at a mean of 1e8.
    """
    integer = np.array([1], dtype=np.uint32)
    low, high = start, start + 3
    first = distributions.poisson(integer, low)[0]
    while low < (middle := (low + high) / 2) < high:
        low, high = (
            (middle, high)
            if distributions.poisson(integer, middle)[0] <= first
            else (low, middle)
        )
    before, after = (distributions.poisson(integer, mean)[0] for mean in (low, high))
    assert after - before == 1
    s = (1 + 0.5) / 2**32
    assert upper_tail(int(before) + 1, low) <= s <= upper_tail(int(before) - 1, low)


def upper_tail(n: int, mean: float) -> float:
    """P(N > n), summed upwards from an exact first term."""
    term, total, k = poisson_pmf(n + 1, mean), 0.0, n + 1
    while term > 1e-17 * total:
        total += term
        k += 1
        term *= mean / k
    return total


def poisson_pmf(n: int, mean: float) -> float:
    """e^(−λ)·λⁿ/n! by Stirling's series in 50 digits, without the cancellation of 1e8 against 1e8."""
    getcontext().prec = 50
    m, lam, two_pi = (
        Decimal(n),
        Decimal(mean),
        Decimal("6.28318530717958647692528676655900576839433879875021"),
    )
    series = 1 / (12 * m) - 1 / (360 * m**3) + 1 / (1260 * m**5)
    return float(
        (
            m * lam.ln() - lam - (m + Decimal("0.5")) * m.ln() + m - two_pi.ln() / 2 - series
        ).exp()
    )


def test_poisson_of_no_light_is_exactly_0_for_every_integer() -> None:
    np.testing.assert_array_equal(distributions.poisson(with_edges(1000), 0.0), 0.0)


def test_poisson_of_1e_minus_12_is_0_in_a_million_pixels() -> None:
    assert not distributions.poisson(integers(1_000_000), 1e-12).any()
    assert not distributions.poisson(np.array(EDGES, dtype=np.uint32), 1e-12).any()


def test_poisson_of_astronomical_means_is_finite_and_within_6_4_sigma() -> None:
    w = np.array(EDGES, dtype=np.uint32)
    for mean in (1e12, 1e30, 1e300):
        n = distributions.poisson(w, mean)
        assert np.isfinite(n).all()
        assert (np.abs(n - mean) <= 6.4 * math.sqrt(mean) + 1e-15 * mean).all()
    assert np.isinf(distributions.poisson(w, math.inf)).all()


@pytest.mark.parametrize("mean", [5e-324, 1e-300, 1e-20])
def test_poisson_of_subnormal_means_is_0(mean: float) -> None:
    assert not distributions.poisson(np.array(EDGES, dtype=np.uint32), mean).any()


def test_poisson_never_falls_when_the_mean_or_the_wanted_quantile_rises() -> None:
    """Quantiles are monotone; a step at the seam at 10 would show here."""
    means = np.concatenate([np.linspace(0, 40, 4001), [9.999999999, 10.0, 10.000000001]])
    means.sort()
    for integer in (*EDGES, 2**30, 3 * 2**30):
        counts = distributions.poisson(np.full(means.shape, integer, dtype=np.uint32), means)
        assert (np.diff(counts) >= 0).all()
    for mean in (3.0, 12.0, 1e5):
        assert (np.diff(distributions.poisson(np.sort(integers(10_000)), mean)) <= 0).all()


@pytest.mark.parametrize("mean", one_in(3, MOMENT_MEANS))
def test_poisson_has_mean_variance_and_skewness_of_its_distribution(mean: float) -> None:
    """Mean λ, variance λ, skewness λ^(−½), from 2^20 random integers; 5 standard errors, 2e-6 false alarms each.

    Standard errors: of the mean √(λ/n), of the variance √((λ + 2λ²)/n), of the third moment √(μ₆ − …) ≤ √(15λ³ + …)/n.
    """
    count = 2**20
    n = distributions.poisson(integers(count, seed=11), mean)
    e = n - mean
    assert abs(e.mean()) < 5 * math.sqrt(mean / count)
    assert abs(np.mean(e**2) - mean) < 5 * math.sqrt((mean + 2 * mean**2) / count)
    sixth = mean + 25 * mean**2 + 15 * mean**3
    assert abs(np.mean(e**3) - mean) < 5 * math.sqrt(sixth / count)


def test_less_than_half_an_electron_is_not_black() -> None:
    """Rounding 0.49 to 0 before the draw would give P(0) = 1; it is exp(−0.49) = 0.6126. 2^20 even integers: ± 1e-6."""
    n = distributions.poisson(even_integers(20), 0.49)
    assert np.mean(n == 0) == pytest.approx(math.exp(-0.49), abs=2e-6)


COUPLINGS = (0.0, 1e-12, 0.25, 0.45, 0.49, 0.4999)


def stripes(coupling: float, size: int, lines: int = 1) -> Any:
    """Vectors of ``isotropic_ar`` from independent white normals, (lines, size)."""
    white = np.random.default_rng(3).standard_normal(
        (lines, size + 2 * distributions.AR_WARM_UP)
    )
    return np.array(
        [distributions.isotropic_ar(line, coupling, distributions.AR_WARM_UP) for line in white]
    )


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


@pytest.mark.parametrize("coupling", one_in(2, [0.0, 0.25, 0.45, 0.49]))
def test_isotropic_ar_samples_have_variance_1_and_correlate_by_2a(coupling: float) -> None:
    """A million columns; 5 standard errors with n_eff = n/Σρ² of the closed-form spectrum: 6e-7 false alarms."""
    x = stripes(coupling, 1_000_000)[0]
    effective = x.size * kernel_share(coupling)
    assert abs(np.mean(x * x) - 1) < 5 * math.sqrt(2 / effective)
    assert abs(np.mean(x[1:] * x[:-1]) - 2 * coupling) < 5 * math.sqrt(2 / effective)


def kernel_share(coupling: float) -> float:
    """1/Σ_k ρ_k², by the spectrum S(ω) ∝ (1 − 2a·cos ω)^(−2): (mean S)²/mean S²."""
    spectrum = (
        1 - 2 * coupling * np.cos(np.linspace(0, 2 * np.pi, 20_000, endpoint=False))
    ) ** -2.0
    return float(spectrum.mean() ** 2 / np.mean(spectrum**2))


@pytest.mark.parametrize("coupling", [exhaustive(0.25), 0.49, exhaustive(0.4999)])
def test_isotropic_ar_is_stationary_from_its_first_column(coupling: float) -> None:
    """First, middle and last column have variance 1 over 1500 cameras: 5·√(2/1500), 6e-7 false alarms each."""
    x = stripes(coupling, 64, lines=1500)
    for column in (0, 32, -1):
        assert abs(np.mean(x[:, column] ** 2) - 1) < 5 * math.sqrt(2 / 1500)
