"""Veiling glare of images against a sum over all pairs of pixels, conservation of energy and limits."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array
from mitsuba_sensor.optics.veiling_glare import VeilingGlare

SHAPE = 18, 25
ONE_FILTER = np.zeros(SHAPE, np.intp)


def random_light(seed: int) -> tuple[Float64Array, Float64Array]:
    """Return the photoelectrons of an image and their variance."""
    rng = np.random.default_rng(seed)
    return rng.exponential(100.0, SHAPE), rng.exponential(3.0, SHAPE)


def matrix(fraction: float, half_width_px: tuple[float, float] | None) -> Float64Array:
    """Return the glare as a matrix from all pixels to all pixels."""
    rows, columns = (axis.ravel() for axis in np.indices(SHAPE))
    spread = np.ones((rows.size, rows.size))
    if half_width_px is not None:
        down = (rows[:, None] - rows) / half_width_px[0]
        across = (columns[:, None] - columns) / half_width_px[1]
        spread = 1 / (1 + down**2 + across**2)
    return (1 - fraction) * np.eye(rows.size) + fraction * spread / spread.sum(axis=0)


@pytest.mark.parametrize("half_width_px", [None, (3.0, 2.0), (0.01, 0.01), (1e6, 1e6)])
@pytest.mark.parametrize("fraction", [1e-6, 0.03, 1.0])
def test_glare_is_the_sum_over_all_pairs_of_pixels_and_conserves_energy(
    fraction: float, half_width_px: tuple[float, float] | None
) -> None:
    """Mean and variance; energy within 1e-12."""
    glare, whole = VeilingGlare(fraction, SHAPE, half_width_px), matrix(fraction, half_width_px)
    mean, variance = random_light(1)
    new_mean, new_variance = glare.of_electrons(mean, variance, ONE_FILTER)
    np.testing.assert_allclose(new_mean.ravel(), whole @ mean.ravel(), rtol=1e-10)
    np.testing.assert_allclose(new_variance.ravel(), whole**2 @ variance.ravel(), rtol=1e-9)
    assert new_mean.sum() == pytest.approx(mean.sum(), rel=1e-12)


def test_bands_and_electrons_have_equal_glare() -> None:
    glare = VeilingGlare(0.2, SHAPE, (2.0, 3.0))
    lights = [random_light(seed) for seed in (2, 3)]
    mean = np.stack([light[0] for light in lights], axis=-1).astype(np.float32)
    error = np.sqrt(np.stack([light[1] for light in lights], axis=-1)).astype(np.float32)
    glare.add_to_bands(mean, error)
    for band, light in enumerate(lights):
        new_mean, new_variance = glare.of_electrons(*light, ONE_FILTER)
        np.testing.assert_allclose(mean[..., band], new_mean, rtol=1e-6)
        np.testing.assert_allclose(error[..., band] ** 2, new_variance, rtol=1e-6)


@pytest.mark.parametrize("half_width_px", [None, (4.0, 4.0)])
def test_glare_behind_a_colour_filter_comes_from_light_of_its_own_colour(
    half_width_px: tuple[float, float] | None,
) -> None:
    """Each filter sees an even field of its own brightness: relative to it, the glare of all filters is equal."""
    filters = ms.load_camera("bayer_2mp").filter_index(SHAPE)
    levels = np.array([10.0, 200.0, 3000.0])
    glare = VeilingGlare(0.3, SHAPE, half_width_px)
    mean, _ = glare.of_electrons(levels[filters], np.zeros(SHAPE), filters)
    white, _ = glare.of_electrons(np.ones(SHAPE), np.zeros(SHAPE), ONE_FILTER)
    np.testing.assert_allclose(mean / levels[filters], white, rtol=1e-10)


def test_an_image_of_one_pixel_is_unchanged() -> None:
    glare = VeilingGlare(0.5, (1, 1))
    mean, variance = glare.of_electrons(
        np.full((1, 1), 7.0), np.full((1, 1), 2.0), np.zeros((1, 1), int)
    )
    assert (mean[0, 0], variance[0, 0]) == pytest.approx((7.0, 2.0))
