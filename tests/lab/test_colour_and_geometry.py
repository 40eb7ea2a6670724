"""Colour charts, flat fields and distortion of computed cameras, against closed forms and colour-science's ΔE00."""

from __future__ import annotations

from typing import Any

import colour
import numpy as np
import pytest
from chart_cases import in_patches, patch_regions
from helpers import patches

from mitsuba_sensor.lab.measure.colour_and_geometry.colour_chart import (
    ColourChart,
    colour_chart,
)
from mitsuba_sensor.lab.measure.colour_and_geometry.distortion import distortion, lateral_colour
from mitsuba_sensor.lab.measure.colour_and_geometry.flat_field import flat_field
from mitsuba_sensor.optics import spectra

SIDE = 8
REGIONS = patch_regions(24, SIDE)
XYZ = spectra.color_checker_xyz()
OBSERVER = np.array([[1, 0.1, 0.05], [0.2, 0.9, 0.1], [0.05, 0.1, 1.1]])
"""Of a camera whose filters are sums of the observer's."""


def chart_of(values: np.ndarray, **options: Any) -> ColourChart:
    """A chart without noise of these values (24, C)."""
    return colour_chart(in_patches(values, SIDE), REGIONS, **options)


def test_the_distances_of_a_chart_are_those_of_sharma_wu_and_dalal() -> None:
    """Rows of table 1 of their paper of 2005, to its four digits: what CIELAB has, and hues across 0."""
    lab = [(50, 2.6772, -79.7751), (50, -1, 2), (50, 2.49, -0.001), (2.0776, 0.0795, -1.1350)]
    other = [(50, 0, -82.7485), (50, 0, 0), (50, -2.49, 0.0009), (0.9033, -0.0636, -0.5514)]
    found = spectra.delta_e_2000(np.array(lab), np.array(other))
    np.testing.assert_allclose(found, [2.0425, 2.3669, 7.1792, 0.9082], atol=5e-5)


def test_a_camera_that_is_an_observer_has_no_colour_difference() -> None:
    """Also with a fourth channel; the reference is that of colour-science; noise alone may be no difference."""
    np.testing.assert_allclose(XYZ, patches.seen("D65"), atol=5e-4)
    four = np.column_stack([XYZ @ OBSERVER.T, XYZ.sum(axis=1) ** 2])
    assert chart_of(four).largest.value < 1e-6
    chart = chart_of(XYZ @ OBSERVER.T)
    assert chart.largest.value < 1e-9
    np.testing.assert_allclose(chart.matrix, np.linalg.inv(OBSERVER), rtol=1e-6)
    noisy = in_patches(XYZ @ OBSERVER.T, 20)
    noisy = noisy + 0.02 * np.random.default_rng(2).normal(size=noisy.shape)
    assert colour_chart(noisy, patch_regions(24, 20)).mean.low == 0


def test_what_no_matrix_removes_is_the_distance() -> None:
    """More patches than a matrix can follow, all but one as an observer has them: that one keeps its shift."""
    many = np.concatenate([np.repeat(XYZ, 5, axis=0), XYZ[:1]])
    shifted = many.copy()
    shifted[-1] *= 1.1
    regions = patch_regions(len(many), SIDE)
    chart = colour_chart(in_patches(shifted, SIDE), regions, reference_xyz=many, greys=())
    pair = (colour.XYZ_to_Lab(one[-1], patches.WHITE) for one in (shifted, many))
    expected = float(colour.delta_E(*pair, method="CIE 2000"))
    assert chart.largest.value == pytest.approx(expected, rel=0.1)


def test_the_matrix_is_as_good_as_any() -> None:
    """Small changes of the matrix never lessen the sum of the squares of the distances in CIELAB."""
    rng = np.random.default_rng(3)
    values = (XYZ @ OBSERVER.T) * np.exp(rng.normal(0, 0.05, XYZ.shape))
    chart = chart_of(values)

    def squares(matrix: np.ndarray) -> float:
        return float(np.square(spectra.lab(values @ matrix.T) - spectra.lab(XYZ)).sum())

    changed = [chart.matrix * (1 + 1e-3 * rng.normal(size=(3, 3))) for _ in range(200)]
    assert min(squares(matrix) for matrix in changed) > squares(chart.matrix)


def test_stated_factors_have_the_error_that_they_have() -> None:
    """Red factor 3 % too large; blue exact."""
    values = np.repeat(XYZ[:, 1:2], 3, axis=1) / [2.0, 1.0, 1.5]
    for options, error in (({"white_balance": [2.06, 1.0, 1.5]}, 3.0), ({}, 0.0)):
        red, blue = chart_of(values, reference_xyz=XYZ, **options).balance
        assert (red.value, blue.value) == pytest.approx((error, 0), abs=1e-9)


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
    measured = flat_field(planes, ("R", "G", "B"))
    red, blue = measured.shading
    assert blue.name == "colour shading, B over G"
    assert red.value == pytest.approx(0, abs=1e-9)
    assert blue.value == pytest.approx(100 * (1.2**2 / 1.25**2 - 1), abs=0.1)


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
    """Local distortion, TV distortion, and bends of lines along the upper and the right side."""
    measured = distortion(points(k1, k2, tilt), 30 * GRID + 7, SHAPE)

    def growth(height: float) -> float:
        return 1 + k1 * height**2 + k2 * height**4

    top, side = MIDDLE[1] / CORNER, MIDDLE[0] / CORNER
    expected = growth(1) - 1, growth(1) / growth(top) - 1
    bends = [(growth(1) - growth(middle)) / 2 for middle in (top, side)]
    figures = measured.local, measured.tv, *measured.lines
    found = [figure.value / 100 for figure in figures]
    assert found == pytest.approx([*expected, *bends], abs=1e-8)


def test_a_channel_that_is_larger_has_lateral_colour_and_one_that_is_moved_has_none() -> None:
    green = points(-0.05, 0.0)
    red = MIDDLE + 1.0005 * (green - MIDDLE)
    assert lateral_colour(red, green, SHAPE).value == pytest.approx(0.0005 * CORNER)
    moved = lateral_colour(green + np.array([0.3, -0.2]), green, SHAPE)
    assert moved.value == pytest.approx(0, abs=1e-9)
