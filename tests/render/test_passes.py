"""Passes: sample counts that the sampler keeps, seeds, the running mean, and bad values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mitsuba_sensor.render.passes.passes import (
    MOST_SPP,
    Welford,
    clean,
    hashed_seed,
    pass_plan,
    row_strips,
)
from mitsuba_sensor.render.variants import choose_variant, use


def multijitter_count(samples: int) -> int:
    """What Mitsuba's multijitter makes of a sample count: ⌊√n⌋ rows of ⌈n/rows⌉."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)


def test_multijitter_keeps_exactly_the_counts_we_choose() -> None:
    """Our rule for the rounding of a sample count is Mitsuba's own."""
    mi = use(choose_variant("scalar_spectral"))
    counts = range(1, 60)
    made = [
        mi.load_dict({"type": "multijitter", "sample_count": n}).sample_count() for n in counts
    ]
    assert made == [multijitter_count(n) for n in counts]


@pytest.mark.parametrize(
    "spp", [1, 2, 5, 7, 8, 9, 16, 31, 64, 100, 256, 1000, 1024, 4096, 10_000, 16_384, 100_000]
)
def test_plan_takes_what_was_asked_for_in_at_least_eight_passes(spp: int) -> None:
    """Within 7 % of the request, each pass a full grid of at most 1024; below 8 samples, passes of one sample."""
    passes, samples = pass_plan(spp)
    assert multijitter_count(samples) == samples <= MOST_SPP
    assert passes >= min(max(spp, 2), 8)
    assert abs(passes * samples - spp) <= max(0.07 * spp, 1)


def test_round_numbers_come_out_exactly() -> None:
    for spp in (16, 64, 256, 1024, 4096, 16_384):
        passes, samples = pass_plan(spp)
        assert passes * samples == spp


def test_strips_cover_all_rows_once_and_bound_the_samples_in_flight() -> None:
    for size, bands, samples in (
        ((256, 256), 30, 16),
        ((2048, 2048), 47, 100),
        ((5000, 3), 1, 1024),
        ((1, 1), 1, 1),
    ):
        strips = row_strips(size, bands, samples)
        assert [row for first, last in strips for row in range(first, last)] == list(
            range(size[1])
        )
        assert max(last - first for first, last in strips) * size[0] * samples <= max(
            2**22, size[0] * samples
        )


def test_seeds_of_passes_are_distinct() -> None:
    seeds = {
        hashed_seed(seed, strip, k)
        for seed in range(5)
        for strip in range(5)
        for k in range(16)
    }
    assert len(seeds) == 400 and all(0 <= seed < 2**32 for seed in seeds)


def test_welford_is_the_mean_and_its_standard_error() -> None:
    """Against NumPy's two-pass formulas, with a mean a million times the spread."""
    values = 1e6 + np.random.default_rng(1).standard_normal((12, 5))
    running = Welford.of_shape((5,))
    for row in values:
        running.add(row.copy())
    np.testing.assert_allclose(running.mean, values.mean(axis=0), rtol=1e-15)
    np.testing.assert_allclose(
        np.sqrt(running.variance_of_mean), values.std(axis=0, ddof=1) / np.sqrt(12), rtol=1e-8
    )


def test_several_passes_at_once_are_the_same_as_one_after_the_other() -> None:
    """Twelve passes in any portions, with a mean a million times the spread, in rows that come a few at a time; those
    that are written over are copies."""
    values = 1e6 + np.random.default_rng(3).standard_normal((12, 6, 4, 5))
    for portions in ((12,), (4, 4, 4), (1, 11), (5, 1, 6), (1,) * 12):
        running, done = Welford.of_shape((6, 4, 5)), 0
        for count in portions:
            running.begin(count)
            for rows in (slice(0, 2), slice(2, 6)):
                running.add_rows(values[done : done + count, rows].copy(), rows.start)
            done += count
        np.testing.assert_allclose(running.mean, values.mean(axis=0), rtol=1e-15)
        np.testing.assert_allclose(
            running.variance_of_mean, values.var(axis=0, ddof=1) / 12, rtol=1e-8
        )


def test_bad_values_are_counted_and_clamped_and_infinity_is_marked() -> None:
    """NaN, −inf and negatives become 0; +inf is marked so that its pixel saturates; good values stay."""
    got = clean(np.array([[1.0, -2.0, np.nan], [np.inf, -np.inf, 0.0]], dtype=np.float32))
    np.testing.assert_array_equal(got.values, [[1, 0, 0], [0, 0, 0]])
    assert got.infinite is not None
    np.testing.assert_array_equal(got.infinite, [[False, False, False], [True, False, False]])
    assert (got.negative, got.non_finite) == (1, 3)


def test_good_values_pass_untouched() -> None:
    got = clean(np.array([[0.0, 3.0]], dtype=np.float32))
    assert got.infinite is None and (got.negative, got.non_finite) == (0, 0)
    np.testing.assert_array_equal(got.values, [[0, 3]])


@pytest.mark.parametrize("level", [1e-30, 1.0, 1e30])
def test_welford_in_float32_neither_overflows_nor_underflows(level: float) -> None:
    """A spread of a tenth at any level; its square would be beyond float32 at both ends."""
    values = level * (1 + 0.1 * np.random.default_rng(2).standard_normal((12, 5)))
    running = Welford(np.zeros(5, np.float32), np.zeros(5, np.float32))
    for row in values:
        running.add(row.copy())
    error = values.std(axis=0, ddof=1) / np.sqrt(12)
    np.testing.assert_allclose(np.sqrt(running.variance_of_mean), error, rtol=1e-5)
