"""Error bars pooled over neighbouring pixels: against known variances, where they are alike and where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.core import Float64Array
from mitsuba_sensor.render.passes.pooled import pooled

PASSES = 8


def measured(variance: Float64Array, seed: int = 1) -> tuple[Float64Array, Float64Array]:
    """Errors of a mean of normal passes, and its variance as they measure it: χ² of 7 degrees of freedom."""
    noise = np.random.default_rng(seed).standard_normal((PASSES, *variance.shape))
    return noise.mean(axis=0) * np.sqrt(variance * PASSES), noise.var(axis=0, ddof=1) * variance


def test_where_all_pixels_are_alike_the_neighbours_are_believed() -> None:
    """The variance is off by a fifth instead of a half, and two standard errors hold for 95 % as of normal noise; 7
    degrees of freedom give 91.4 %. 10 000 pixels: a standard deviation of 0.3 %."""
    true = np.full((100, 100), 4.0)
    error, variance = measured(true)
    found = pooled(np.full(true.shape, 100.0), variance, PASSES)
    assert found.mean() == pytest.approx(4.0, rel=0.02)
    assert found.std() < 0.25 * 4 < 0.5 * variance.std() * 1.5
    assert (np.abs(error) < 2 * np.sqrt(found)).mean() == pytest.approx(0.945, abs=0.01)
    assert (np.abs(error) < 2 * np.sqrt(variance)).mean() == pytest.approx(0.914, abs=0.01)


def test_where_every_pixel_differs_each_keeps_its_own() -> None:
    """Variances that differ by factors of a hundred from pixel to pixel: no neighbour says anything. A measured log
    variance is itself off by 0.53 (χ² of 7)."""
    true = 10.0 ** np.random.default_rng(2).uniform(-2, 2, (100, 100))
    error, variance = measured(true)
    found = pooled(np.full(true.shape, 100.0), variance, PASSES)
    assert np.median(np.abs(np.log(found / variance))) < 0.3
    assert 0.90 < (np.abs(error) < 2 * np.sqrt(found)).mean() < 0.96


def test_a_brighter_neighbour_is_compared_by_its_relative_error() -> None:
    """A mosaic of filters, one with a tenth of the light: no pixel takes its neighbour's absolute variance."""
    mean = np.where(np.indices((60, 60)).sum(axis=0) % 2, 100.0, 10.0)
    _, variance = measured((0.05 * mean) ** 2)
    found = pooled(mean, variance, PASSES)
    for level in (10.0, 100.0):
        assert np.median(found[mean == level]) == pytest.approx((0.05 * level) ** 2, rel=0.1)


def test_darkness_has_no_error_and_too_few_passes_keep_theirs() -> None:
    mean, variance = np.zeros((4, 4)), np.zeros((4, 4))
    mean[:2], variance[:2] = 1.0, 0.1
    found = pooled(mean, variance, PASSES)
    assert not found[2:].any() and np.isfinite(found).all() and (found[:2] > 0).all()
    np.testing.assert_array_equal(pooled(mean, variance, 2), variance)
    assert not pooled(np.zeros((3, 3)), np.zeros((3, 3)), PASSES).any()
