"""Dead leaves behind a known transfer: its modulation by both methods, with noise taken out."""

from __future__ import annotations

import charts
import numpy as np
import pytest

from mitsuba_sensor.lab.measure.image_quality.dead_leaves import dead_leaves

CHART = charts.dead_leaves(224)


@pytest.mark.parametrize("method", ["cross", "power"])
@pytest.mark.parametrize("blur_px", [0.0, 0.5, 1.0])
def test_leaves_behind_a_normal_point_spread_have_its_transform(
    method: str, blur_px: float
) -> None:
    """Within 0.005 at any frequency."""
    picture = charts.blurred(CHART, blur_px)
    curve = dead_leaves(np.array([picture, picture]), CHART, method=method).modulation
    true = np.exp(-2 * np.square(np.pi * blur_px * curve.frequency))
    np.testing.assert_allclose(curve.value, true, atol=5e-3)


def test_a_denser_chart_shows_the_aperture_of_the_pixels() -> None:
    """Pixels that average 4 × 4 points: the mean of sinc·sinc over all directions within 0.015 up to 0.4."""
    dense = charts.dead_leaves(192, 4)
    curve = dead_leaves(charts.averaged(dense, 4), dense).modulation
    angle = 2 * np.pi * (np.arange(720) + 0.5) / 720
    waves = curve.frequency[:, None] * np.array([np.cos(angle), np.sin(angle)])[:, None]
    points = (np.arange(4) + 0.5) / 4 - 0.5
    along, across = np.cos(2 * np.pi * waves[..., None] * points).mean(axis=-1)
    below = curve.frequency < 0.4
    np.testing.assert_allclose(
        curve.value[below], (along * across).mean(axis=1)[below], atol=0.015
    )


def test_noise_is_not_in_the_texture() -> None:
    """Noise as strong as the texture at Nyquist's frequency: the squares of spectra would show 0.3 more there."""
    rng = np.random.default_rng(4)
    picture = charts.blurred(CHART, 0.6)
    frames = picture + 0.05 * rng.normal(size=(8, *picture.shape))
    for method in ("cross", "power"):
        quantity = dead_leaves(frames, CHART, method=method).modulation.at_nyquist
        true = np.exp(-2 * (np.pi * 0.6 * 0.5) ** 2)
        assert abs(quantity.value - true) < max(0.03, 2 * quantity.standard_error)


def test_a_picture_beside_the_chart_needs_the_power() -> None:
    """Moved by one pixel, the product loses its phase at Nyquist's frequency; the power keeps it."""
    moved = np.roll(CHART, 1, axis=1)
    pair = np.array([moved, moved])
    assert dead_leaves(pair, CHART).modulation.at(0.4).value < 0.5
    assert dead_leaves(pair, CHART, method="power").modulation.at(0.4).value > 0.98


def test_one_plane_of_a_mosaic_keeps_the_frequencies_of_the_sensor() -> None:
    curve = dead_leaves(CHART, CHART, sample_px=2).modulation
    assert curve.frequency[-1] == pytest.approx(0.255, abs=0.01)
    assert curve.mtf50.note.startswith("more than 0.5")
