"""Flat fields of computed light: cos⁴ against its closed form, equal channels, noise."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.lab.measure.colour_and_geometry.flat_field import flat_field


def falling(fall: float, shape: tuple[int, int] = (200, 300)) -> np.ndarray:
    """1/(1 + fall·h²)² over the image height h, 1 in the corner: cos⁴ of a lens with tan² = fall there."""
    y, x = ((np.arange(count) + 0.5) / count * 2 - 1 for count in shape)
    return np.asarray((1 + fall * (x**2 + y[:, None] ** 2) / 2) ** -2)


@pytest.mark.parametrize("fall", [0.0, 0.1, 0.3, 0.6])
def test_cos4_has_its_relative_illumination(fall: float) -> None:
    """Within 0.15 % of the light of the centre, down to 39 %."""
    measured = flat_field(1000 * falling(fall)).illumination[0]
    assert measured.value == pytest.approx(100 * (1 + fall) ** -2, abs=0.15)


def test_channels_that_fall_alike_have_no_shading() -> None:
    planes = np.stack([300 * falling(0.2), 1000 * falling(0.2), 500 * falling(0.25)], axis=2)
    red, blue = flat_field(planes).shading
    assert red.value == pytest.approx(0, abs=1e-9)
    assert blue.value == pytest.approx(100 * (1.2**2 / 1.25**2 - 1), abs=0.1)
