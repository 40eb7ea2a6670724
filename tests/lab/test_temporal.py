"""Temporal variance without fluctuations of whole frames: unbiased, with a right error, and drift and flicker found."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.frames.temporal import Maps, flicker_dn, temporal, temporal_within_rows


def of(frames: np.ndarray) -> Stack:
    return Stack(frames, 0.01)


@pytest.mark.parametrize("shape", [(2, 8, 8), (5, 8, 40)])
@pytest.mark.parametrize("row_noise", [0.0, 2.0])
def test_the_variance_is_unbiased_and_its_error_is_the_scatter_of_many_stacks(
    shape: tuple[int, int, int], row_noise: float
) -> None:
    """300 stacks: their mean within 4 standard errors (once in 16 000), the mean error within 20 % of the scatter.
    Noise that rows share is noise, not drift, which is reported for one stack in 10 000."""
    rng, found = np.random.default_rng(1), []
    for _ in range(300):
        rows = row_noise * rng.normal(size=(*shape[:2], 1))
        found.append(temporal(of(rng.normal(100, 3, shape) + rows)))
    means = np.array([one.variance for one in found])
    assert abs(means.mean() - 9 - row_noise**2) < 4 * means.std() / len(means) ** 0.5
    errors = np.mean([one.variance_error**2 for one in found]) ** 0.5
    assert errors == pytest.approx(means.std(), rel=0.2)
    assert sum(one.drift_dn > 0 for one in found) <= 2


@pytest.mark.parametrize(
    "level", [np.full((40, 50), 2000.0), np.linspace(0, 4000, 2000).reshape(40, 50)]
)
def test_light_that_drifts_by_1_percent_leaves_the_variance_alone_and_is_reported(
    level: np.ndarray,
) -> None:
    """25 DN² within 4 standard errors; with the drift it would be above 200."""
    rng = np.random.default_rng(2)
    light = np.minimum(level * (1 + 0.01 * rng.standard_normal((16, 1, 1))), 3000)
    stack = of(light + rng.normal(64, 5, light.shape))
    maps = Maps.empty(stack)
    found = temporal(stack, maps)
    assert maps.variance[level < 2800].mean() == pytest.approx(25, rel=0.04)
    assert found.drift_dn == pytest.approx(light.mean(axis=(1, 2)).std(ddof=1), rel=0.05)
    assert "drift by" in found.drift_note


def test_a_pair_of_a_megapixel_takes_strips_of_memory() -> None:
    """Strips of 1 MiB; two maps of float64 would be 16 MiB."""
    frames = np.random.default_rng(20).integers(900, 1100, (2, 1024, 1024), dtype=np.uint16)
    stack = Stack(frames, 0.1)
    tracemalloc.start()
    try:
        temporal(stack)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 4 * 2**20


def test_maps_are_those_of_every_pixel_and_figures_are_their_means() -> None:
    """Frames of several strips."""
    frames = np.random.default_rng(21).normal(500, 7, (5, 300, 400))
    maps = Maps.empty(of(frames))
    found = temporal(of(frames), maps)
    np.testing.assert_allclose(maps.mean, frames.mean(axis=0))
    centred = frames - frames.mean(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(maps.variance, centred.var(axis=0, ddof=1), rtol=1e-4)
    assert found.mean == pytest.approx(frames.mean())
    assert found.variance == pytest.approx(maps.variance.mean(), rel=1e-3)
    assert found.of_means == pytest.approx(maps.mean.var(ddof=1))


def test_pairs_of_few_codes_in_light_that_drifts_have_groups_of_equally_bright_pixels() -> None:
    """8 codes of uneven light: most pixels share their mean with thousands, and 0.5 % of drift is seen in them."""
    rng = np.random.default_rng(22)
    light = np.linspace(20, 220, 256) * np.ones((256, 1))
    frames = [np.round(light * share + rng.normal(0, 0.6, light.shape)) for share in (1, 1.02)]
    found = temporal(of(np.array(frames).astype(np.uint8)))
    assert found.drift_dn > 1 and found.variance == pytest.approx(0.36 + 1 / 12, rel=0.02)


@pytest.mark.parametrize("shape", [(2, 40, 16), (16, 48, 24), (9, 12, 32)])
def test_row_noise_and_light_that_drifts_are_no_flicker(shape: tuple[int, int, int]) -> None:
    """400 stacks of each shape, with row noise, crosstalk, shading and drift: one in 10 000 is a false alarm, so that
    two or more of 400 happen once in 1300."""
    rng, alarms = np.random.default_rng(3), 0
    frames, height, _ = shape
    for _ in range(400):
        noise = rng.normal(0, 3, shape)
        noise += 0.1 * np.roll(noise, 1, axis=1) + rng.normal(0, 2, (frames, height, 1))
        drift = 1 + rng.normal(0, 0.02, (frames, 1, 1))
        alarms += flicker_dn(of(np.linspace(100, 200, height)[:, None] * drift + noise)) > 0
    assert alarms < 2


@pytest.mark.parametrize("period_rows", [24, 100, 1000])
@pytest.mark.parametrize("frames", [2, 16])
def test_light_that_flickers_is_found_and_leaves_the_variance_within_rows_alone(
    period_rows: int, frames: int
) -> None:
    """A lamp of 2 % before a rolling shutter, with pixel noise of 3 DN: its variance within 5 standard errors; the size
    is that of the light's own rows, which rows 4 apart share by cos(8π/period), of which the removal of drift takes a
    third at most, or two thirds where a frame has a tenth of a period."""
    rng = np.random.default_rng(4)
    phase = rng.random((frames, 1, 1)) + np.arange(96)[:, None] / period_rows
    light = 1000 * (1 + 0.02 * np.sin(2 * np.pi * phase)) + np.zeros((96, 64))
    stack = of(rng.normal(light, 3))
    statistics = temporal_within_rows(stack)
    assert abs(statistics.variance - 9) < 5 * statistics.variance_error < 5
    rows = light.mean(axis=2) - light.mean(axis=(0, 2))
    rows -= rows.mean(axis=1, keepdims=True)
    shared = (np.sum(rows**2) / (frames - 1) / 96 * np.cos(8 * np.pi / period_rows)) ** 0.5
    least = 0.66 if period_rows <= 100 else 0.33
    assert least * shared < flicker_dn(stack) < 1.1 * shared
