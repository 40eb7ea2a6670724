"""Passes: sample counts that the sampler keeps, seeds, sums of passes, and bad values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import channel_bands
from mitsuba_sensor.render.passes.passes import Passes
from mitsuba_sensor.render.passes.stop_criterion import PASS_SPP
from mitsuba_sensor.render.samples import (
    CORRELATED,
    MOST_SPP,
    SAMPLER,
    clean,
    hashed_seed,
    pass_plan,
    row_strips,
)
from mitsuba_sensor.render.variants import choose_variant, use

COUNTS = [*range(1, 300), 1000, 1024, 4096, 10_000, 16_384, 100_000]


def multijitter_count(samples: int) -> int:
    """What Mitsuba's multijitter makes of a sample count: ⌊√n⌋ rows of ⌈n/rows⌉."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)


def test_multijitter_keeps_exactly_the_counts_we_choose() -> None:
    """Our rule for the rounding of a sample count is Mitsuba's own."""
    mi = use(choose_variant("scalar_spectral"))
    samplers = ({"type": "multijitter", "sample_count": n} for n in range(1, 60))
    made = [mi.load_dict(sampler).sample_count() for sampler in samplers]
    assert made == [multijitter_count(n) for n in range(1, 60)]


def test_plan_takes_what_was_asked_for_in_at_least_eight_passes() -> None:
    """Within 1/8 of the request, each pass a full grid of at most 1024 whose dimensions are not correlated from 64
    samples on; below 8 samples, passes of one sample."""
    for spp in COUNTS:
        passes, samples = pass_plan(spp)
        assert multijitter_count(samples) == samples <= MOST_SPP
        assert passes >= min(max(spp, 2), 8)
        assert abs(passes * samples - spp) <= max(spp / 8, 1)
        assert spp < 64 or samples not in CORRELATED


def test_random_numbers_of_a_default_pass_are_not_correlated() -> None:
    """Mean of Π(½ + u) over 8 numbers of one sample: 1 within 1 %, where passes of 4 samples are 4 % off. A million
    samples know it to 0.05 %."""
    mi = use(choose_variant(skip_unless_usable("llvm_ad_spectral")))

    def mean(samples: int) -> float:
        sampler = mi.load_dict({"type": SAMPLER, "sample_count": samples})
        sampler.set_samples_per_wavefront(samples)
        sampler.seed(1, 2**20 // samples * samples)
        product = mi.Float(1.0)
        for _ in range(8):
            product *= 0.5 + sampler.next_1d()
        return float(np.mean(np.array(product, np.float64)))

    assert mean(PASS_SPP) == pytest.approx(1.0, abs=0.01)
    assert mean(4) < 0.97


@pytest.mark.parametrize(
    ("size", "samples"), [((256, 256), 16), ((2048, 2048), 100), ((5000, 3), 1024), ((1, 1), 1)]
)
def test_strips_cover_all_rows_once_and_bound_the_samples_in_flight(
    size: tuple[int, int], samples: int
) -> None:
    strips = row_strips(size, samples)
    assert [row for first, last in strips for row in range(first, last)] == list(range(size[1]))
    most = max(last - first for first, last in strips) * size[0] * samples
    assert most <= max(2**22, size[0] * samples)


def test_seeds_of_passes_are_distinct() -> None:
    seeds = {hashed_seed(*where) for where in np.ndindex(5, 5, 16)}
    assert len(seeds) == 400 and all(0 <= seed < 2**32 for seed in seeds)


def passes_of(values: np.ndarray) -> Passes:
    """Sums of passes of what three colour filters detect, (N, H, W, 3)."""
    camera = ms.load_camera("bayer_2mp")
    shape = values.shape[1:3]
    passes = Passes(channel_bands(camera), np.ones(shape), np.array(camera.tile), (0, 0))
    for one in values.astype(np.float32):
        passes.count += 1
        for rows in (slice(0, 2), slice(2, None)):
            passes.add(one[rows].copy(), rows.start)
    return passes


@pytest.mark.parametrize("level", [1e-30, 1e-3, 1e3, 1e30])
def test_sums_are_the_mean_its_standard_error_and_two_halves(level: float) -> None:
    """Against NumPy's two-pass formulas, in rows that come a few at a time, at any level of light: its square would be
    beyond float32 at both ends."""
    values = level * (1 + 0.1 * np.random.default_rng(1).standard_normal((12, 6, 4, 3)))
    passes = passes_of(values)
    tile = np.array(ms.load_camera("bayer_2mp").tile)
    row, column = np.indices((6, 4))
    own = values[:, row, column, tile[row % 2, column % 2]]
    mean, variance = passes.electrons()
    np.testing.assert_allclose(mean, own.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(variance), own.std(axis=0, ddof=1) / 12**0.5, rtol=1e-4)
    for half, start in zip(passes.halves(), (0, 1), strict=True):
        np.testing.assert_allclose(half, values[start::2].mean(axis=0), rtol=2e-5)


def test_bad_values_are_counted_and_clamped_and_infinity_is_marked() -> None:
    """NaN, −inf and negatives become 0; +inf is marked so that its pixel saturates; good values stay."""
    bad = np.array([[1.0, -2.0, np.nan], [np.inf, -np.inf, 0.0]], dtype=np.float32)
    values, infinite, negative, non_finite = clean(bad)
    np.testing.assert_array_equal(values, [[1, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(infinite, [[False, False, False], [True, False, False]])
    assert (negative, non_finite) == (1, 3)
    light = np.ones((2, 3, 2, 3))
    light[0, 0, 0, 0], light[1, 1, 1, 2], light[0, 2, 0, 1] = np.nan, np.inf, -1.0
    passes = passes_of(light)
    assert (passes.negative, passes.non_finite, passes.lost) == (1, 2, 1)
    assert passes.infinite.sum() == 1 and passes.infinite[1, 1]


def test_a_pixel_that_owes_its_spread_to_one_bright_pass_is_a_firefly() -> None:
    """16 passes of which one is bright have 15/16 of all squared deviations in it, of two 7/16 in each; normal noise
    nearly never has three quarters. Dark, infinite and constant pixels are none."""
    normal = 10 + np.random.default_rng(1).standard_normal(16)
    values = np.zeros((16, 3, 2, 3))
    values[3, 0, 0], values[:2, 0, 1], values[:, 1, 0] = 1.0, 1.0, normal[:, None]
    values[:, 2, 0], values[:, 2, 1] = 1.0, np.inf
    assert passes_of(values).firefly_fraction() == 1 / 4
    assert passes_of(np.zeros((2, 3, 2, 3))).firefly_fraction() == 0.0
