"""Colour charts of computed cameras: no difference for an observer, known ones otherwise, and colour-science's ΔE00."""

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
    """Also where a fourth channel is there; the reference is that of colour-science."""
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
    planes = in_patches(shifted, SIDE)
    chart = colour_chart(planes, patch_regions(len(many), SIDE), reference_xyz=many, greys=())
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

    best = squares(chart.matrix)
    changed = [chart.matrix * (1 + 1e-3 * rng.normal(size=(3, 3))) for _ in range(200)]
    assert min(squares(matrix) for matrix in changed) > best


def test_stated_factors_have_the_error_that_they_have() -> None:
    """Red factor 3 % too large; blue exact."""
    values = np.repeat(XYZ[:, 1:2], 3, axis=1) / [2.0, 1.0, 1.5]
    red, blue = chart_of(values, reference_xyz=XYZ, white_balance=[2.06, 1.0, 1.5]).balance
    assert red.value == pytest.approx(3) and blue.value == pytest.approx(0, abs=1e-9)
    red, blue = chart_of(values).balance
    assert abs(red.value) < 1e-9 and abs(blue.value) < 1e-9
