"""Sinusoidal stars against the MTF that they were computed with: pixels, a normal point spread, noise."""

from __future__ import annotations

import charts
import numpy as np
import pytest

from mitsuba_sensor.lab.measure.image_quality.siemens_star import siemens_star


@pytest.mark.parametrize(("offset", "error"), [((0.3, -1.7), 1e-3), ((0.0, 0.0), 6e-3)])
def test_a_star_has_the_modulation_of_its_pixels(
    offset: tuple[float, float], error: float
) -> None:
    """Up to the Nyquist frequency, and the centre within 0.001 pixels.

    A star centred exactly on the pixels repeats its phases in all sectors: 0.005 at the Nyquist frequency.
    """
    measured = siemens_star(charts.siemens_star(160, 60, 0.8, offset), 60, contrast=0.8)
    curve = measured.modulation
    below = curve.frequency <= 0.5
    true = charts.star_modulation(curve.frequency)
    np.testing.assert_allclose(curve.value[below], true[below], atol=error)
    np.testing.assert_allclose(measured.centre, np.array(offset) + 80, atol=1e-3)


def test_uneven_light_is_divided_out_by_a_flat_field() -> None:
    """cos⁴ that falls by a third; a mean by sector removes nearly all of it already."""
    star = charts.blurred_star(240, 72, 0.6, 0.5)
    y, x = np.mgrid[:240, :240] - 60.0
    light = (1 + (x**2 + y**2) / 500**2) ** -2
    plain = siemens_star(star, 72).modulation.value
    for flat, error in ((light, 1e-3), (None, 5e-3)):
        found = siemens_star(star * light, 72, flat=flat).modulation.value
        np.testing.assert_allclose(found, plain, atol=error)


def test_one_plane_of_a_mosaic_keeps_the_frequencies_of_the_sensor() -> None:
    plane = charts.siemens_star(320, 72, 0.8, (0.3, -1.7))[0::2, 1::2]
    curve = siemens_star(plane, 72, contrast=0.8, sample_px=2).modulation
    below = curve.frequency <= 0.25
    true = charts.star_modulation(curve.frequency)
    np.testing.assert_allclose(curve.value[below], true[below], atol=2e-3)


def test_noise_alone_has_no_modulation() -> None:
    """Where the star is blurred away, the interval holds 0: 12 rings, fewer than 8 once in 10 000 tests."""
    rng = np.random.default_rng(5)
    noisy = charts.blurred_star(240, 72, 0.6, 3.0) + 0.05 * rng.normal(size=(240, 240))
    curve = siemens_star(noisy, 72).modulation
    assert (curve.low[-12:] < 1e-9).sum() >= 8 and curve.value[-12:].max() < 0.03
