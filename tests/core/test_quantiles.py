"""Quantile functions in float32, on NumPy and on Dr.Jit: against the float64 ones, closed forms and each other.

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

EDGES = (
    0,
    1,
    2,
    3,
    2**30,
    2**31 - 2,
    2**31 - 1,
    2**31,
    2**31 + 1,
    3 * 2**30,
    2**32 - 3,
    2**32 - 2,
    2**32 - 1,
)
SEARCHED = (1e-12, 1e-6, 1e-3, 0.3, 1.0, 3.0, 5.0, 9.99)
EXPANDED = (10.0, 10.5, 12.0, 17.0, 22.0, 30.0, 100.0, 1e3, 1e4, 1e5, 1e6)
CVS = (1e-7, 0.01, 0.4, 1.0, 3.0)


def integers(size: int, seed: int = 5) -> NDArray[np.uint32]:
    """Edge integers first, then random ones."""
    rest = np.random.default_rng(seed).integers(
        0, 2**32, max(size - len(EDGES), 0), dtype=np.uint32
    )
    return np.concatenate([np.array(EDGES, dtype=np.uint32), rest])[:size]


def even_integers(bits: int) -> NDArray[np.uint32]:
    """2^bits integers, evenly spread: averages over them have no sampling error, only that of the coarser grid."""
    return (np.arange(2**bits, dtype=np.uint64) * 2 ** (32 - bits) + 2 ** (31 - bits)).astype(
        np.uint32
    )


def poisson(w: NDArray[np.uint32], mean: Any) -> NDArray[np.float32]:
    """Counts in float32, on NumPy."""
    return quantiles.poisson(w, np.broadcast_to(single(mean), w.shape))


def single(values: Any) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)


def assert_single_and_close(
    found: Any, exact: Any, relative: float, absolute: float = 0.0
) -> None:
    assert found.dtype == np.float32
    np.testing.assert_allclose(found.astype(np.float64), exact, rtol=relative, atol=absolute)


W = integers(200_000)
"""Random integers, edges first."""


# The distributions but Poisson's, integer by integer against float64


def test_normal_is_exact_to_2e_6_of_itself_in_both_tails() -> None:
    assert_single_and_close(quantiles.normal(W), distributions.normal(W), 2.5e-6)


def test_uniform_is_exact_to_one_rounding_and_keeps_its_digits_near_0() -> None:
    assert_single_and_close(quantiles.uniform(W), distributions.survival(W), 1.2e-7)


def test_logistic_is_exact_to_2e_7() -> None:
    assert_single_and_close(quantiles.logistic(W), distributions.logistic(W), 2e-7, 5e-7)


def test_the_normal_of_a_probability_is_scipys_and_never_beyond_the_last_integer() -> None:
    """Small probabilities keep their digits: 2⁻³³ is 6.338σ. 0 and 1, to which they may round, are the last."""
    s = single(
        np.concatenate(
            [np.geomspace(2.0**-33, 0.5, 1001), np.linspace(0.5, 1 - 2.0**-24, 1001)]
        )
    )
    assert_single_and_close(
        quantiles.normal_of(s), -special.ndtri(s.astype(np.float64)), 2.5e-6
    )
    last = -special.ndtri(2.0**-33)
    np.testing.assert_allclose(
        quantiles.normal_of(single([0, 1e-30, 1])), [last, last, -last], rtol=1e-5
    )


@pytest.mark.parametrize("cv", CVS)
def test_lognormal_is_exact_to_its_normal(cv: float) -> None:
    """The error of a normal, 1.2e-5 at 6.3σ, times σ, and the rounding of an exponential."""
    assert_single_and_close(
        NUMPY_FLOAT32.lognormal(W, cv),
        distributions.lognormal(W, cv),
        2.5e-7 + 1.5e-5 * math.log1p(cv * cv) ** 0.5,
    )


@pytest.mark.parametrize(
    ("cv", "relative"), [(1e-7, 2e-7), (0.01, 3e-7), (0.4, 2e-5), (1.0, 1e-4)]
)
def test_gamma_is_exact_to_its_logarithm(cv: float, relative: float) -> None:
    """ln x reaches −22 at a cv of 1, so its last digit is worth more there; the middle is exact to 1e-6."""
    found, exact = NUMPY_FLOAT32.gamma(W, cv), distributions.gamma(W, cv)
    assert_single_and_close(found, exact, relative)
    assert np.median(np.abs(found / exact - 1)) < 1.5e-6


@pytest.mark.parametrize("cv", [0.4, 1.0, 3.0])
def test_gamma_keeps_mean_and_variance_up_to_a_cv_of_3(cv: float) -> None:
    """Against the exact draws of the same 2^16 even integers, so that their coarse grid cancels."""
    w = even_integers(16)
    found, exact = NUMPY_FLOAT32.gamma(w, cv).astype(np.float64), distributions.gamma(w, cv)
    assert found.mean() == pytest.approx(exact.mean(), rel=2e-5)
    assert found.var() == pytest.approx(exact.var(), rel=2e-4)
    assert (found >= 0).all()


@pytest.mark.parametrize("cv", CVS)
def test_wald_takes_the_root_that_the_exact_draw_takes(cv: float) -> None:
    """But where the pick is within 1e-6 of the boundary; a million draws of other seeds would hold one such."""
    z, pick = quantiles.normal(W), quantiles.uniform(W[::-1].copy())
    exact = distributions.wald(z.astype(np.float64), pick.astype(np.float64), cv)
    smaller = np.minimum(exact, 1 / exact)
    clear = np.abs(pick * (1 + smaller) - 1) > 1e-6
    assert clear.mean() > 0.9999
    found = quantiles.wald(z, pick, np.float32(cv))
    assert_single_and_close(found[clear], exact[clear], 6e-7)
    assert (found > 0).all()


def test_log_is_exact_to_2e_7_over_all_of_float32() -> None:
    """Every exponent, and mantissas down to the last bit before 1."""
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


def test_exp_beyond_its_range_stays_at_its_ends() -> None:
    x = single([-1e30, -87, 89, 1e30])
    np.testing.assert_allclose(arrays.exp(x), np.exp([-69.0, -69, 88, 88]), rtol=1e-6)
    np.testing.assert_allclose(arrays.expm1(x), np.expm1([-69.0, -69, 88, 88]), rtol=1e-6)


# Poisson


@pytest.mark.parametrize("mean", SEARCHED)
def test_poisson_below_10_is_the_exact_draw(mean: float) -> None:
    """But for two of 200 000 integers, by one count: the sums are accurate to a tenth of an integer."""
    apart = np.abs(poisson(W, mean) - distributions.poisson(W, float(np.float32(mean))))
    assert apart.max() <= 1
    assert np.count_nonzero(apart) <= 2


@pytest.mark.parametrize("mean", EXPANDED)
def test_poisson_from_10_on_is_one_count_off_for_one_integer_in_a_thousand_at_most(
    mean: float,
) -> None:
    apart = np.abs(poisson(W, mean) - distributions.poisson(W, float(np.float32(mean))))
    assert apart.max() <= 1
    assert np.mean(apart) < (1e-4 if mean <= 1e5 else 5e-4)


@pytest.mark.parametrize("backend", [NUMPY_FLOAT64, NUMPY_FLOAT32], ids=["float64", "float32"])
@pytest.mark.parametrize(
    "mean", one_in(3, [1e-6, 1e-3, 0.3, 3.0, 9.99, 10.0, 12.0, 17.0, 100.0, 1e4, 1e6])
)
def test_poisson_passes_chi_squared_with_a_million_draws(mean: float, backend: Backend) -> None:
    """At most 400 cells of at least 5 expected counts, p > 1e-4: each of the 22 cases fails in 1e-4 of the seeds."""
    count, mean = 10**6, float(np.float32(mean))
    seen = backend.poisson(
        np.random.default_rng(12).integers(0, 2**32, count, dtype=np.uint32), mean
    )
    low, high = stats.poisson.ppf([1e-4, 1 - 1e-4], mean)
    ends = np.unique(np.linspace(low, high, 400).astype(int))
    expected = np.diff(np.concatenate([[0], stats.poisson.cdf(ends, mean), [1]])) * count
    found = np.bincount(np.searchsorted(ends, seen), minlength=ends.size + 1)
    large = expected >= 5
    expected, found = (np.append(x[large], x[~large].sum()) for x in (expected, found))
    rare = expected[-1] < 5
    if rare:  # too few for a cell of their own
        assert found[-1] <= 20
        expected, found = expected[:-1], found[:-1]
    chi2 = np.sum((found - expected) ** 2 / expected)
    assert stats.chi2.sf(chi2, max(expected.size - 1, 1)) > 1e-4


@pytest.mark.parametrize("mean", one_in(3, [0.01, 1.0, 9.9, 10.0, 12.0, 17.0, 30.0, 1e3, 1e5]))
def test_poisson_distribution_of_a_million_even_integers_is_the_exact_distribution(
    mean: float,
) -> None:
    """Total variation 2e-5, and what the coarse grid costs each of the ±6σ cells; mean and variance likewise."""
    w, mean = even_integers(20), float(np.float32(mean))
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


@pytest.mark.parametrize("mean", [10.0, 12.0, 15.0, 17.5, 18.0, 19.0, 20.0, 21.0, 22.0])
def test_the_count_0_keeps_its_integers_up_to_the_mean_that_has_none_left(mean: float) -> None:
    """2³²·e^(−mean) integers give a count of 0, 195 000 at 10 and one at 22: a fifth more or fewer, and one integer."""
    expected = 2.0**32 * math.exp(-mean)
    last = (2**32 - 1 - np.arange(int(2 * expected) + 10)).astype(np.uint32)
    zeros = np.count_nonzero(poisson(last, mean) == 0)
    assert zeros == pytest.approx(expected, rel=0.2, abs=1)


@pytest.mark.parametrize("mean", [0.0, 5e-324, 1e-40, 1e-30])
def test_poisson_of_no_light_is_exactly_0_for_every_integer(mean: float) -> None:
    np.testing.assert_array_equal(poisson(W, mean), 0.0)


def test_poisson_never_falls_by_more_than_one_count_when_the_quantile_rises() -> None:
    w = np.sort(W)[::-1]
    for mean in (1e-3, 3.0, 9.99):
        assert (np.diff(poisson(w, mean)) >= 0).all()
    for mean in (10.0, 12.0, 17.0, 22.0, 100.0, 1e4, 1e6):
        assert np.diff(poisson(w, mean)).min() >= -1


def test_poisson_never_falls_by_more_than_one_count_when_the_mean_rises() -> None:
    for integer in EDGES:
        for means in (np.linspace(0, 40, 4001), np.geomspace(40, 1e6, 4001)):
            assert (
                np.diff(poisson(np.full(means.shape, integer, dtype=np.uint32), means)).min()
                >= -1
            )


def test_mean_and_variance_of_poisson_rise_with_the_mean() -> None:
    """Even integers: the mean follows in steps of a hundredth from 9 to 11, across 10, where the method changes."""
    w, means = even_integers(16), np.linspace(9, 11, 201)
    drawn = [poisson(w, mean) for mean in means]
    assert np.diff([n.mean(dtype=np.float64) for n in drawn]) == pytest.approx(0.01, abs=2e-4)
    assert np.diff([n.var(dtype=np.float64) for n in drawn]) == pytest.approx(0.01, abs=2e-3)


def test_poisson_just_below_10_and_at_10_draw_the_same_counts() -> None:
    """In all but one integer of ten thousand, and there it is one count: the search and the expansion meet."""
    below, at = poisson(W, np.nextafter(np.float32(10), np.float32(0))), poisson(W, 10.0)
    assert np.abs(at - below).max() <= 1
    assert np.mean(at != below) < 1e-4


@pytest.mark.parametrize("power", range(-12, 31))
def test_poisson_is_a_whole_number_within_6_4_sigma_for_any_mean(power: int) -> None:
    """Counts above 2^24 are those that float32 holds, 6e-8 of the mean apart."""
    mean = float(np.float32(10.0**power))
    n = poisson(W[:20_000], mean).astype(np.float64)
    assert np.isfinite(n).all()
    np.testing.assert_array_equal(n, np.floor(n))
    assert n.min() >= 0
    assert (np.abs(n - mean) <= 6.4 * math.sqrt(mean) + 12 + 2e-7 * mean).all()


# NumPy and Dr.Jit: the same bits


THINNED = (
    (5, 3.0, 1.0),
    (30, 100.0, 174.0),
    (1000, 16_500.0, 174.0),
    (40, 1.0, 1.0),
    (60, 1.0, 0.3),
    (7, 0.0, 3.0),
)
THINNED += (
    (7, 3.0, 0.0),
    (0, 5.0, 5.0),
    (400, 1.0, 1.0),
    (16_674, 174.0, 16_500.0),
    (10**6, 1e6, 300.0),
)
"""Electrons, and the mean of either kind."""


@pytest.mark.parametrize(("number", "light", "dark"), one_in(3, THINNED, several=True))
def test_binomial_distribution_of_a_million_even_integers_is_the_exact_distribution(
    number: int, light: float, dark: float
) -> None:
    """Total variation: of the float64 draw that of the grid of 2^20 integers, of the float32 one 6e-4 at most."""
    w, reach, chance = even_integers(20), np.arange(number + 1), dark / (light + dark)
    exact = stats.binom.pmf(reach, number, chance)
    grid = np.count_nonzero(exact > 2**-21) * 2**-20
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
    """Counts in float32, on NumPy."""
    return quantiles.binomial(w, *(np.broadcast_to(single(x), w.shape) for x in numbers))


@pytest.fixture(scope="module")
def llvm() -> Any:
    """The compiled engine, where LLVM is usable."""
    if problem := backend_problem("llvm"):
        pytest.skip(problem)
    from mitsuba_sensor.core.drjit_backend import DrJitBackend

    return DrJitBackend("llvm")


def assert_same_bits(found: Any, expected: Any) -> None:
    """As bit patterns, so that −0 is not 0."""
    patterns = found.numpy().view(np.uint32), np.asarray(expected).view(np.uint32)
    assert expected.dtype == np.float32
    np.testing.assert_array_equal(*patterns)


LAWS: dict[str, Callable[[Any, Any], Any]] = {
    "uniform": lambda backend, w: backend.uniform(w),
    "normal": lambda backend, w: backend.normal(w),
    "normal_of": lambda backend, w: backend.normal_of(backend.uniform(w)),
    "logistic": lambda backend, w: backend.logistic(w),
    **{f"lognormal {cv:g}": lambda backend, w, cv=cv: backend.lognormal(w, cv) for cv in CVS},
    **{f"gamma {cv:g}": lambda backend, w, cv=cv: backend.gamma(w, cv) for cv in CVS},
    **{
        f"wald {cv:g}": lambda backend, w, cv=cv: backend.wald(
            backend.normal(w), backend.uniform(~w), cv
        )
        for cv in CVS
    },
}


@pytest.mark.parametrize("name", LAWS)
def test_every_distribution_has_the_same_bits_on_numpy_and_on_llvm(
    name: str, llvm: Any
) -> None:
    assert_same_bits(LAWS[name](llvm, llvm.uint(W)), LAWS[name](NUMPY_FLOAT32, W))


@pytest.mark.parametrize(
    "mean", [0.0, 1e-40, 1e-6, 0.3, 9.99, 10.0, 17.0, 100.0, 1e4, 1e6, 1e12, 1e30]
)
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


@pytest.mark.parametrize("size", [1, 2, 7, 8, 9, 31, 1001, 100_003])
def test_mixed_means_have_the_same_bits_for_any_number_of_pixels(size: int, llvm: Any) -> None:
    """Means from 0 to 20, some exactly 0 or 10: neighbours take the search and the expansion, centre and tail."""
    means = single(np.random.default_rng(3).uniform(0, 20, size))
    means[::5], means[2::7] = 0, 10
    w = integers(size, seed=4)
    assert_same_bits(
        llvm.poisson(llvm.uint(w), llvm.float(means)), NUMPY_FLOAT32.poisson(w, means)
    )


OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda x, y: x + y,
    "subtract": lambda x, y: x - y,
    "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y,
    "multiply and add": lambda x, y: x * y + x,
    "floor": lambda x, y: arrays.floor(x),
    "where": lambda x, y: arrays.where(x < y, x, y),
    "minimum": lambda x, y: arrays.minimum(x, y),
    "maximum": lambda x, y: arrays.maximum(x, 1.0),
    "sqrt": lambda x, y: arrays.sqrt(x * x + y * y),
    "exp": lambda x, y: arrays.exp(x),
    "expm1": lambda x, y: arrays.expm1(x),
    "log": lambda x, y: quantiles.log(arrays.maximum(x, -x)),
    "polynomial": lambda x, y: arrays.polynomial(
        1.0 / (1.0 + x * x), [0.3, -1.7, 2.9, 0.1, -0.4, 1.1, 0.7]
    ),
    "bits": lambda x, y: arrays.from_float_bits((arrays.signed_bits(x) >> 1) + 77),
    "whole": lambda x, y: arrays.float32(
        arrays.int32(arrays.minimum(arrays.maximum(x, -1e9), 1e9))
    ),
    "double": lambda x, y: arrays.float32(arrays.float64(x) * 1.1 + arrays.float64(y)),
    "product": lambda x, y: arrays.product(x, y),
    "amend": lambda x, y: arrays.replace_where(x > 3.0, y, lambda a, b: a / b, x, y),
    "choose": lambda x, y: arrays.branch(x < y, lambda a, b: a * b, lambda a, b: a - b, x, y),
    "repeat": lambda x, y: arrays.loop(
        lambda a, b: a > 1.0, lambda a, b: (a * 0.7, b + 1.0), (x, y)
    ),
    "count": lambda x, y: arrays.count_at_or_below([-5.0, -0.1, 0.0, 0.3, 1.0, 70.0], x),
}
"""All that pixels meet; the numbers stay above 1e-38, below which Dr.Jit takes them for 0."""


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation_has_the_same_bits_on_numpy_and_on_llvm(name: str, llvm: Any) -> None:
    random = np.random.default_rng(6)
    x, y = (
        single(random.choice([-1, 1], 10_001) * 10 ** random.uniform(-12, 12, 10_001))
        for _ in range(2)
    )
    x[:3], y[:3] = (0, 1, 3), (1, 1, 3)
    expected = OPERATIONS[name](x, y)
    assert_same_bits(OPERATIONS[name](llvm.float(x), llvm.float(y)), expected)


def test_whole_numbers_are_counted_between_levels_as_numpy_counts_them(llvm: Any) -> None:
    levels = np.sort(single(np.random.default_rng(7).uniform(0, 1e4, 4095)))
    x = np.concatenate([levels, np.nextafter(levels, single(0)), single([-1, 0, 2e4])])
    assert_same_bits(
        arrays.count_at_or_below(levels, llvm.float(x)), arrays.count_at_or_below(levels, x)
    )


def test_philox_on_llvm_gives_the_known_answers_of_random123(llvm: Any) -> None:
    """As in test_counter_rng.py: zeros, ones and digits of π."""
    asked = [
        (0,) * 6,
        (2**32 - 1,) * 6,
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344, 0xA4093822, 0x299F31D0),
    ]
    answers = (
        "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
        "408f276d 41c83b0e a20bc7c6 6d5451fd",
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    )
    x, y, frame, block, low, high = (
        llvm.uint(list(column)) for column in zip(*asked, strict=True)
    )
    found = np.array([integer.numpy() for integer in philox((x, y, frame, block), (low, high))])
    assert [" ".join(f"{w:08x}" for w in column) for column in found.T] == list(answers)


def test_philox_gives_the_same_integers_on_numpy_and_on_llvm(llvm: Any) -> None:
    counter = np.random.default_rng(8).integers(0, 2**32, (4, 1001), dtype=np.uint32)
    key = split_key(0xFEDCBA9876543210)
    expected = philox(tuple(counter.astype(np.uint64)), key)
    found = philox(
        tuple(llvm.uint(line) for line in counter), tuple(llvm.uint(half) for half in key)
    )
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.numpy(), other.astype(np.uint32))


# The scripts that compute and check the tables


def script(name: str, *arguments: str) -> Any:
    """What a benchmark prints with --json; its exit code must be 0."""
    command = [sys.executable, str(BENCHMARKS / name), *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr + done.stdout
    return json.loads(done.stdout)


@pytest.mark.exhaustive
def test_the_tables_are_what_their_fit_gives() -> None:
    fits = script("fit_quantiles.py", "--check")
    limits = {
        "CENTRE": 4e-7,
        "TAIL": 2e-6,
        "LOG": 2.5e-7,
        "EXP_TAIL": 4e-9,
        "SKEW": 2e-6,
        "SHIFT": 2e-6,
        "SMALL": 2e-6,
    }
    assert set(fits) == set(limits)
    for name, limit in limits.items():
        assert fits[name]["error"] < limit


@pytest.mark.exhaustive
def test_the_distributions_are_enumerated(llvm: Any) -> None:
    found = script("enumerate_quantiles.py", "--stride", "4096", "--means", "0.3", "10", "1e6")
    assert found["inputs"] == 2**20
    assert found["zero_mean_is_zero"]
    assert [row["electrons"] for row in found["poisson"]] == pytest.approx([0.3, 10, 1e6])
    assert all(row["within_limits"] for row in (*found["poisson"], found["normal"]))


def test_the_reference_draws_are_the_exact_ones() -> None:
    """So that what is compared with above is what the reference engine does."""
    np.testing.assert_array_equal(NUMPY_FLOAT64.normal(W[:100]), distributions.normal(W[:100]))
    np.testing.assert_array_equal(
        NUMPY_FLOAT64.poisson(W[:100], 12.0), distributions.poisson(W[:100], 12.0)
    )


@pytest.mark.parametrize(
    "draw", [distributions.poisson, quantiles.poisson], ids=["float64", "float32"]
)
@pytest.mark.parametrize("mean", [1e-3, 1e-6, 1e-8, 1e-9, 1e-10])
def test_a_small_mean_of_counts_is_right_to_half_of_two_to_the_minus_32(
    draw: Any, mean: float
) -> None:
    """No chance: the integers with an electron are those below a limit, which bisection finds."""
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
