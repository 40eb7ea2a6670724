"""Quantile functions: in float64 against SciPy and closed forms; in float32, on NumPy and Dr.Jit, against float64.

Seeds are fixed. Where a test compares an average with its expectation, the docstring says how often chance alone
would fail it under other seeds.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import BENCHMARKS
from helpers.marks import one_in
from numpy.typing import NDArray
from scipy import special, stats

from mitsuba_sensor.core import arrays, distributions, quantiles
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.counter_rng import philox, split_key
from mitsuba_sensor.core.llvm import backend_problem

EDGES = (0, 1, 2, 3, 2**30, 2**31 - 2, 2**31 - 1, 2**31, 2**31 + 1, 3 * 2**30)
EDGES += (2**32 - 3, 2**32 - 2, 2**32 - 1)
SEARCHED = (1e-12, 1e-6, 1e-3, 0.3, 1.0, 3.0, 5.0, 9.99)
EXPANDED = (10.0, 10.5, 12.0, 17.0, 22.0, 30.0, 100.0, 1e3, 1e4, 1e5, 1e6)
CVS = (1e-7, 0.01, 0.4, 1.0, 3.0)


def integers(size: int, seed: int = 5) -> NDArray[np.uint32]:
    """Return edge integers, then random ones."""
    rest = np.random.default_rng(seed).integers(
        0, 2**32, max(size - len(EDGES), 0), dtype=np.uint32
    )
    return np.concatenate([np.array(EDGES, dtype=np.uint32), rest])[:size]


def even_integers(bits: int) -> NDArray[np.uint32]:
    """Return 2^bits evenly spaced integers: averages have no sampling error, only that of the grid."""
    return (np.arange(2**bits, dtype=np.uint64) * 2 ** (32 - bits) + 2 ** (31 - bits)).astype(
        np.uint32
    )


def poisson(w: NDArray[np.uint32], mean: Any) -> NDArray[np.float32]:
    """Return counts in float32 on NumPy."""
    return quantiles.poisson(w, np.broadcast_to(single(mean), w.shape))


def single(values: Any) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)


def assert_single_and_close(
    found: Any, exact: Any, relative: float, absolute: float = 0.0
) -> None:
    assert found.dtype == np.float32
    np.testing.assert_allclose(found.astype(np.float64), exact, rtol=relative, atol=absolute)


W = integers(100_000)
"""Random integers, edges first."""


# In float64, against SciPy and closed forms


FLOAT64_MEANS = (
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


def test_normal_equals_scipys_quantile_and_is_antisymmetric() -> None:
    w = integers(1000)
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
def test_lognormal_has_unit_mean_and_its_cv_and_is_positive(cv: float) -> None:
    """Moments of ln X, which converge for every cv: −½ln(1+cv²) and ln(1+cv²)."""
    x = distributions.lognormal(even_integers(18), cv)
    variance = math.log1p(cv * cv)
    assert (x > 0).all()
    assert np.log(x).mean() == pytest.approx(-variance / 2, rel=1e-6, abs=1e-16)
    assert np.log(x).var() == pytest.approx(variance, rel=3e-4)
    if cv <= 1:
        assert x.mean() == pytest.approx(1, abs=1e-3)
        assert x.std() == pytest.approx(cv, rel=1e-2)


@pytest.mark.parametrize("mean", FLOAT64_MEANS)
def test_poisson_equals_scipys_quantile_integer_for_integer(mean: float) -> None:
    """Including both ends and the middle. Without light the count is exactly 0; with 0.49 electrons it is not."""
    w = integers(10_000 if mean < 1e4 else 3_000)
    np.testing.assert_array_equal(
        distributions.poisson(w, mean), stats.poisson.isf(distributions.survival(w), mean)
    )


def test_poisson_equals_scipys_quantile_with_a_mean_per_pixel() -> None:
    """Means from 1e-3 to 1e3: all three methods in one array, of any shape."""
    w = integers(60_000).reshape(200, 300)
    means = 10 ** np.random.default_rng(8).uniform(-3, 3, w.shape)
    np.testing.assert_array_equal(
        distributions.poisson(w, means), stats.poisson.isf(distributions.survival(w), means)
    )


def test_poisson_of_huge_means_is_finite_and_within_6_4_sigma() -> None:
    w = integers(len(EDGES))
    for mean in (1e12, 1e30, 1e300):
        n = distributions.poisson(w, mean)
        assert np.isfinite(n).all()
        assert (np.abs(n - mean) <= 6.4 * math.sqrt(mean) + 1e-15 * mean).all()
    assert np.isinf(distributions.poisson(w, math.inf)).all()


COUPLINGS = (0.0, 1e-12, 0.25, 0.45, 0.49, 0.4999)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_isotropic_ar_has_variance_1_and_neighbour_correlation_2a(
    coupling: float,
) -> None:
    """The response to a unit impulse is the kernel: Σh² = 1 and Σh_j·h_{j+1} = 2a, without sampling."""
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
def test_isotropic_ar_solves_the_papers_equation(coupling: float, gain: float) -> None:
    """x_j = a(x_{j−1} + x_{j+1}) + U_j with white U of variance 1/gain, gain = (1 − 4a²)^(−3/2) (paper eq. 28)."""
    white = np.random.default_rng(3).standard_normal(20_000 + 2 * distributions.AR_WARM_UP)
    x = distributions.isotropic_ar(white, coupling, distributions.AR_WARM_UP)
    u = x[1:-1] - coupling * (x[:-2] + x[2:])
    expected = white[distributions.AR_WARM_UP + 1 : -distributions.AR_WARM_UP - 1] / math.sqrt(
        gain
    )
    np.testing.assert_allclose(u, expected, rtol=1e-4, atol=1e-5)


# In float32, all but Poisson, integer by integer against float64

CLOSE: dict[str, tuple[Callable[[Backend, Any], Any], float, float]] = {
    "uniform": (lambda backend, w: backend.uniform(w), 1.2e-7, 0.0),
    "normal": (lambda backend, w: backend.normal(w), 2.5e-6, 0.0),
    "logistic": (lambda backend, w: backend.logistic(w), 2e-7, 5e-7),
    **{
        f"lognormal {cv:g}": (
            lambda backend, w, cv=cv: backend.lognormal(w, cv),
            2.5e-7 + 1.5e-5 * math.log1p(cv * cv) ** 0.5,
            0.0,
        )
        for cv in CVS
    },
    **{
        f"gamma {cv:g}": (lambda backend, w, cv=cv: backend.gamma(w, cv), relative, 0.0)
        for cv, relative in ((1e-7, 2e-7), (0.01, 3e-7), (0.4, 2e-5), (1.0, 1e-4))
    },
}
"""Draws, and their relative and absolute error. A log-normal has that of its normal, 1.2e-5 at 6.3σ, times σ; a gamma
that of its logarithm, which reaches −22 at a cv of 1."""


@pytest.mark.parametrize("name", CLOSE)
def test_a_draw_is_close_to_the_float64_draw(name: str) -> None:
    draw, relative, absolute = CLOSE[name]
    found, exact = draw(NUMPY_FLOAT32, W), draw(NUMPY_FLOAT64, W)
    assert_single_and_close(found, exact, relative, absolute)
    assert np.median(np.abs(found / exact - 1)) < 1.5e-6


def test_the_normal_of_a_probability_equals_scipys_up_to_the_last_integer() -> None:
    """Small probabilities keep their digits: 2⁻³³ is 6.338σ. 0 and 1, from rounding, are the last integers."""
    s = np.concatenate(
        [np.geomspace(2.0**-33, 0.5, 1001), np.linspace(0.5, 1 - 2.0**-24, 1001)]
    )
    s = single(s)
    assert_single_and_close(
        quantiles.normal_of(s), -special.ndtri(s.astype(np.float64)), 2.5e-6
    )
    last = -special.ndtri(2.0**-33)
    np.testing.assert_allclose(
        quantiles.normal_of(single([0, 1e-30, 1])), [last, last, -last], rtol=1e-5
    )


def test_gamma_keeps_mean_and_variance_at_a_cv_of_3() -> None:
    """Against the exact draws of the same 2^16 even integers, so the coarse grid cancels."""
    w = even_integers(16)
    found, exact = NUMPY_FLOAT32.gamma(w, 3.0).astype(np.float64), distributions.gamma(w, 3.0)
    assert found.mean() == pytest.approx(exact.mean(), rel=2e-5)
    assert found.var() == pytest.approx(exact.var(), rel=2e-4)
    assert (found >= 0).all()


@pytest.mark.parametrize("cv", CVS)
def test_wald_takes_the_same_root_as_the_exact_draw(cv: float) -> None:
    """Except where the choice is within 1e-6 of the boundary, once in a million draws."""
    z, pick = quantiles.normal(W), quantiles.uniform(W[::-1].copy())
    exact = distributions.wald(z.astype(np.float64), pick.astype(np.float64), cv)
    smaller = np.minimum(exact, 1 / exact)
    clear = np.abs(pick * (1 + smaller) - 1) > 1e-6
    assert clear.mean() > 0.9999
    found = quantiles.wald(z, pick, np.float32(cv))
    assert_single_and_close(found[clear], exact[clear], 6e-7)
    assert (found > 0).all()


def test_log_is_exact_to_2e_7_over_all_of_float32() -> None:
    """All exponents, and mantissas down to the last bit before 1."""
    x = single(np.exp(np.random.default_rng(1).uniform(-87, 88.7, 200_000)))
    x = np.concatenate(
        [x, single([np.finfo(np.float32).tiny, np.finfo(np.float32).max, 1, 0.5, 2])]
    )
    x = np.concatenate([x, np.nextafter(single([1, 0.5**0.5, 2**0.5]), single([0, 0, 0]))])
    assert_single_and_close(quantiles.log(x), np.log(x.astype(np.float64)), 1.2e-7, 2.5e-7)


def test_exp_and_expm1_are_exact_to_one_rounding_from_minus_69_to_88() -> None:
    random = np.random.default_rng(2)
    small = random.choice([-1, 1], 100_000) * 10 ** random.uniform(-30, 0, 100_000)
    x = single(np.concatenate([random.uniform(-69, 88, 200_000), small, [-69, 88, 0]]))
    assert_single_and_close(arrays.exp(x), np.exp(x.astype(np.float64)), 1.2e-7)
    assert_single_and_close(arrays.expm1(x), np.expm1(x.astype(np.float64)), 1.5e-7)


# Poisson


@pytest.mark.parametrize("mean", [0.0, 5e-324, 1e-30, *SEARCHED, *EXPANDED])
def test_poisson_equals_the_exact_draw_except_for_one_count_of_few_integers(
    mean: float,
) -> None:
    """Below 10, sums are accurate to a tenth of an integer; above, one integer in a thousand is ambiguous."""
    apart = np.abs(poisson(W, mean) - distributions.poisson(W, float(np.float32(mean))))
    assert apart.max() <= 1
    assert np.mean(apart) <= (1e-5 if mean < 10 else 1e-4 if mean <= 1e5 else 5e-4)


@pytest.mark.parametrize("mean", one_in(3, [0.01, 1.0, 9.9, 10.0, 12.0, 17.0, 30.0, 1e3, 1e5]))
def test_poisson_of_even_integers_has_the_exact_distribution(
    mean: float,
) -> None:
    """Total variation 2e-5 plus the error of the coarse grid in each of the ±6σ cells; also mean and variance."""
    w, mean = even_integers(18), float(np.float32(mean))
    n = poisson(w, mean).astype(np.int64)
    share = np.bincount(n) / n.size
    k = np.arange(share.size)
    exact = stats.poisson.pmf(k, mean)
    grid = 1 / n.size
    assert 0.5 * (np.abs(share - exact).sum() + 1 - exact.sum()) < 2e-5 + grid * (
        6 * math.sqrt(mean) + 1
    )
    assert np.sum(share * (k - mean)) == pytest.approx(0, abs=1e-5 * mean + 12 * grid)
    assert np.sum(share * (k - mean) ** 2) == pytest.approx(
        mean, rel=3e-5 + grid * (40 + 12 / mean)
    )


@pytest.mark.parametrize("mean", [10.0, 17.5, 21.0, 22.0])
def test_count_0_keeps_its_integers_up_to_the_mean_without_any(mean: float) -> None:
    """2³²·e^(−mean) integers give a count of 0, 195 000 at 10 and one at 22: within a fifth plus one integer."""
    expected = 2.0**32 * math.exp(-mean)
    last = (2**32 - 1 - np.arange(int(2 * expected) + 10)).astype(np.uint32)
    zeros = np.count_nonzero(poisson(last, mean) == 0)
    assert zeros == pytest.approx(expected, rel=0.2, abs=1)


@pytest.mark.parametrize("power", [-12, 0, 3, 8, 18, 30])
def test_poisson_is_a_whole_number_within_6_4_sigma_for_any_mean(power: int) -> None:
    """Counts above 2^24 are float32 numbers, 6e-8 of the mean apart."""
    mean = float(np.float32(10.0**power))
    n = poisson(W[:20_000], mean).astype(np.float64)
    assert np.isfinite(n).all()
    np.testing.assert_array_equal(n, np.floor(n))
    assert n.min() >= 0
    assert (np.abs(n - mean) <= 6.4 * math.sqrt(mean) + 12 + 2e-7 * mean).all()


# NumPy and Dr.Jit: the same bits


THINNED = ((5, 3.0, 1.0), (30, 100.0, 174.0), (1000, 16_500.0, 174.0), (40, 1.0, 1.0))
THINNED += ((7, 0.0, 3.0), (0, 5.0, 5.0), (400, 1.0, 1.0), (10**6, 1e6, 300.0))
"""Electrons, and the mean of either kind."""


@pytest.mark.parametrize(("number", "light", "dark"), one_in(6, THINNED, several=True))
def test_binomial_of_even_integers_has_the_exact_distribution(
    number: int, light: float, dark: float
) -> None:
    """Total variation: that of the grid of 2^18 integers in float64, at most 6e-4 in float32."""
    w, reach, chance = even_integers(18), np.arange(number + 1), dark / (light + dark)
    exact = stats.binom.pmf(reach, number, chance)
    grid = np.count_nonzero(exact > 2**-19) * 2**-18
    drawn = (
        distributions.binomial(w, float(number), dark, light),
        thinned(w, number, dark, light),
    )
    for counts, variation in zip(
        drawn, (grid, 6e-4 if number * chance * (1 - chance) < 100 else 3e-5), strict=True
    ):
        share = np.bincount(counts.astype(int), minlength=reach.size) / w.size
        assert 0.5 * np.abs(share - exact).sum() <= variation + grid


def thinned(w: NDArray[np.uint32], *numbers: float) -> NDArray[np.float32]:
    """Return counts in float32 on NumPy."""
    return quantiles.binomial(w, *(np.broadcast_to(single(x), w.shape) for x in numbers))


@pytest.fixture(scope="module")
def llvm() -> Any:
    """The compiled engine, if LLVM is usable."""
    if problem := backend_problem("llvm"):
        pytest.skip(problem)
    from mitsuba_sensor.core.drjit_backend import DrJitBackend

    return DrJitBackend("llvm")


def assert_same_bits(found: Any, expected: Any) -> None:
    """Return bit patterns, so −0 differs from 0."""
    patterns = found.numpy().view(np.uint32), np.asarray(expected).view(np.uint32)
    assert expected.dtype == np.float32
    np.testing.assert_array_equal(*patterns)


LAWS: dict[str, Callable[[Any, Any], Any]] = {
    **{name: draw for name, (draw, *_) in CLOSE.items()},
    "gamma 3": lambda backend, w: backend.gamma(w, 3.0),
    "normal_of": lambda backend, w: backend.normal_of(backend.uniform(w)),
    "wald": lambda backend, w: backend.wald(backend.normal(w), backend.uniform(~w), 0.4),
}


@pytest.mark.parametrize("name", LAWS)
def test_every_distribution_has_the_same_bits_on_numpy_and_on_llvm(
    name: str, llvm: Any
) -> None:
    assert_same_bits(LAWS[name](llvm, llvm.uint(W)), LAWS[name](NUMPY_FLOAT32, W))


@pytest.mark.parametrize("mean", [0.0, 1e-40, 0.3, 9.99, 10.0, 1e4, 1e12, 1e30])
def test_poisson_has_the_same_bits_on_numpy_and_on_llvm(mean: float, llvm: Any) -> None:
    within_float32 = np.full(W.shape, mean, dtype=np.float32)
    assert_same_bits(
        llvm.poisson(llvm.uint(W), llvm.float(within_float32)),
        NUMPY_FLOAT32.poisson(W, within_float32),
    )


@pytest.mark.parametrize(
    ("number", "light", "dark"), [*THINNED, (1e30, 1e30, 174.0), (1e12, 3.0, 1e12)]
)
def test_binomial_has_the_same_bits_on_numpy_and_on_llvm(
    number: float, light: float, dark: float, llvm: Any
) -> None:
    _, found = llvm.split(llvm.uint(W), llvm.float(number), light, dark)
    expected = thinned(W, number, dark, light)
    assert_same_bits(found, expected)
    assert expected.min() >= 0 and expected.max() <= single(number)


@pytest.mark.parametrize("size", [1, 9, 1001])
def test_mixed_means_have_the_same_bits_for_any_number_of_pixels(size: int, llvm: Any) -> None:
    """Means from 0 to 20, some exactly 0 or 10: neighbours use search and expansion, centre and tail."""
    means = single(np.random.default_rng(3).uniform(0, 20, size))
    means[::5], means[2::7] = 0, 10
    w = integers(size, seed=4)
    assert_same_bits(
        llvm.poisson(llvm.uint(w), llvm.float(means)), NUMPY_FLOAT32.poisson(w, means)
    )


def test_philox_gives_the_same_integers_on_numpy_and_on_llvm(llvm: Any) -> None:
    counter = np.random.default_rng(8).integers(0, 2**32, (4, 1001), dtype=np.uint32)
    key = split_key(0xFEDCBA9876543210)
    expected = philox(tuple(counter.astype(np.uint64)), key)
    found = philox(
        tuple(llvm.uint(line) for line in counter), tuple(llvm.uint(half) for half in key)
    )
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.numpy(), other.astype(np.uint32))


# The script that checks the tables


def script(name: str, *arguments: str) -> Any:
    """Return the output of a benchmark with --json; its exit code must be 0."""
    command = [sys.executable, str(BENCHMARKS / name), *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr + done.stdout
    return json.loads(done.stdout)


@pytest.mark.exhaustive
def test_the_benchmark_enumerates_the_distributions(llvm: Any) -> None:
    found = script("enumerate_quantiles.py", "--stride", "4096", "--means", "0.3", "10", "1e6")
    assert found["inputs"] == 2**20
    assert found["zero_mean_is_zero"]
    assert [row["electrons"] for row in found["poisson"]] == pytest.approx([0.3, 10, 1e6])
    assert all(row["within_limits"] for row in (*found["poisson"], found["normal"]))


@pytest.mark.parametrize(
    "draw", [distributions.poisson, quantiles.poisson], ids=["float64", "float32"]
)
@pytest.mark.parametrize("mean", [1e-3, 1e-6, 1e-8, 1e-9, 1e-10])
def test_a_small_mean_count_is_exact_to_half_of_two_to_the_minus_32(
    draw: Any, mean: float
) -> None:
    """Without sampling: the integers with an electron are below a limit, which bisection finds."""
    precision = np.float32 if draw is quantiles.poisson else np.float64
    last_with, first_without = -1, 2**32 - 1
    while first_without - last_with > 1:
        middle = (last_with + first_without) // 2
        if draw(np.array([middle], np.uint32), np.array([mean], precision))[0] > 0:
            last_with = middle
        else:
            first_without = middle
    chance = -math.expm1(-mean)
    assert first_without / 2**32 == pytest.approx(chance, abs=2.0**-33 * 1.01, rel=1e-7)
