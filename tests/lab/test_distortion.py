"""Points of a chart behind a known polynomial: distortion, TV distortion, lateral colour."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.lab.measure.colour_and_geometry.distortion import distortion, lateral_colour

SHAPE = 1080, 1920
MIDDLE = np.array([960.0, 540.0])
CORNER = float(np.hypot(*MIDDLE))
GRID = np.stack(
    np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.44, 0.44, 10)), axis=-1
).reshape(-1, 2)


def points(k1: float, k2: float, tilt: float = 0.0) -> np.ndarray:
    """The grid in the picture, in the corner 1 + k1 + k2 times as high as without distortion."""
    ideal = GRID / (1 + tilt * GRID[:, :1])
    square = np.square(ideal).sum(axis=1, keepdims=True)
    return np.asarray(MIDDLE + CORNER * ideal * (1 + k1 * square + k2 * square**2))


@pytest.mark.parametrize("tilt", [0.0, 0.05])
@pytest.mark.parametrize(("k1", "k2"), [(0.0, 0.0), (-0.1, 0.0), (0.05, -0.02)])
def test_a_known_polynomial_is_the_distortion(k1: float, k2: float, tilt: float) -> None:
    measured = distortion(points(k1, k2, tilt), 30 * GRID + 7, SHAPE)
    assert measured.local.value == pytest.approx(100 * (k1 + k2), abs=1e-6)
    top = (540 / CORNER) ** 2
    tv = (1 + k1 + k2) / (1 + k1 * top + k2 * top**2) - 1
    assert measured.tv.value == pytest.approx(100 * tv, abs=1e-6)
    for line, across in zip(measured.lines, (1, 0), strict=True):
        ends, middle = MIDDLE / CORNER, MIDDLE / CORNER * np.eye(2)[across]
        drawn = [
            point[across] * (1 + k1 * (square := point @ point) + k2 * square**2)
            for point in (ends, middle)
        ]
        bend = (drawn[0] - drawn[1]) / (2 * ends[across])
        assert line.value == pytest.approx(100 * bend, abs=1e-6)


def test_a_channel_that_is_larger_has_lateral_colour_and_one_that_is_moved_has_none() -> None:
    green = points(-0.05, 0.0)
    red = MIDDLE + 1.0005 * (green - MIDDLE)
    assert lateral_colour(red, green, SHAPE).value == pytest.approx(0.0005 * CORNER)
    assert lateral_colour(green + np.array([0.3, -0.2]), green, SHAPE).value == pytest.approx(
        0, abs=1e-9
    )
