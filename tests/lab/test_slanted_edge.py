"""Modulation at slanted edges against closed forms, in every direction, in uneven light and behind a mosaic."""

from __future__ import annotations

import math
from typing import Any

import charts
import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.slanted_edge import edge_picture
from image_quality_coverage import coverage, edge_case

import mitsuba_sensor as ms
from mitsuba_sensor.lab.measure.image_quality.slanted_edge import SlantedEdge, slanted_edge
from mitsuba_sensor.optics.point_spread import diffraction_mtf

SHAPE = 100, 80


def largest_error(measured: SlantedEdge, angle_deg: float) -> float:
    """From the modulation of a full pixel, up to Nyquist's frequency."""
    curve = measured.modulation
    below = curve.frequency <= 0.5
    true = charts.pixel_modulation(curve.frequency[below], angle_deg)
    return float(np.abs(curve.value[below] - true).max())


@pytest.mark.parametrize(
    "angle_deg",
    one_in(4, [2, 3.6, 5, 10, 14.036, 20, 30, 40, 50, 63, 80, 95, 120, 175, 230, 265, 300]),
)
def test_an_edge_of_any_direction_has_the_modulation_of_its_pixels(angle_deg: float) -> None:
    """sinc·sinc within 0.001 up to Nyquist's frequency."""
    measured = slanted_edge(charts.slanted_edge(SHAPE, angle_deg, 0.2))
    assert largest_error(measured, angle_deg) < 0.001
    turned = (angle_deg + 45) % 90 - 45
    assert abs(measured.angle_deg) == pytest.approx(abs(turned), abs=0.01)


@pytest.mark.parametrize("centre", [(0, 0), exhaustive((-200, -300)), exhaustive((100, 80))])
def test_uneven_light_is_removed_by_itself_or_by_a_flat_field(centre: tuple[int, int]) -> None:
    """cos⁴ that falls by up to 33 % over the edge: 0.0005 where it is removed, up to 0.05 where not."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    square = ((rows - centre[1]) ** 2 + (columns - centre[0]) ** 2) / 600**2
    light = (1 + square) ** -2.0
    picture = charts.slanted_edge(SHAPE, 5) * light
    assert largest_error(slanted_edge(picture), 5) < 0.0005
    assert largest_error(slanted_edge(picture, flat=light, shading_order=0), 5) < 0.0005
    assert largest_error(slanted_edge(picture, shading_order=0), 5) > 0.01


@pytest.mark.parametrize("f_number", one_in(3, [4.0, 8.0, 16.0]))
def test_light_that_a_lens_spreads_is_no_uneven_light(f_number: float) -> None:
    """Diffraction at 550 nm on pixels of 3.45 µm: what removes shading changes the modulation by less than 0.0005; it
    is lens × pixel within what of the lens's rings lies beyond 24 pixels."""
    angle = math.radians(5)

    def modulation(frequency: np.ndarray) -> np.ndarray:
        pixel = np.sinc(frequency * math.cos(angle)) * np.sinc(frequency * math.sin(angle))
        return np.asarray(pixel * diffraction_mtf(frequency * 0.55 * f_number / 3.45))

    picture = edge_picture(modulation, (128, 64), 5)
    curve = slanted_edge(picture).modulation
    plain = slanted_edge(picture, shading_order=0).modulation
    np.testing.assert_allclose(curve.value, plain.value, atol=5e-4)
    true = modulation(np.maximum(curve.frequency, 1e-9))
    np.testing.assert_allclose(curve.value, np.abs(true), atol=0.0016 * f_number)


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("column", one_in(2, [0, 1]))
def test_each_plane_of_a_mosaic_has_the_same_modulation(row: int, column: int) -> None:
    """Every second pixel of every second row: the frequency stays that of the sensor, up to its Nyquist frequency."""
    picture = charts.slanted_edge((200, 160), 5)[row::2, column::2]
    measured = slanted_edge(picture, sample_px=2)
    assert measured.modulation.frequency[-1] == 0.5
    assert largest_error(measured, 5) < 0.001


def test_a_lens_that_distorts_needs_an_edge_that_is_a_polynomial() -> None:
    rows, columns = np.mgrid[: 10 * SHAPE[0], : 10 * SHAPE[1]] / 10 + 0.05
    away = (rows - 50) / 50
    distance = columns - 40 - 5 * away - 1.5 * away**2
    fine = (distance > 0).astype(float) + 0.1
    picture = fine.reshape(SHAPE[0], 10, SHAPE[1], 10).mean(axis=(1, 3))
    line, curve = (slanted_edge(picture, edge_order=order).modulation for order in (1, 2))
    assert line.at_nyquist.value < 0.45
    assert curve.at_nyquist.value == pytest.approx(2 / math.pi, abs=0.01)


@pytest.mark.parametrize("share", one_in(3, [0.3, 0.5, 0.9]))
def test_the_frequency_of_a_share_is_where_the_curve_has_it(share: float) -> None:
    curve = slanted_edge(charts.slanted_edge(SHAPE, 5)).modulation
    found = curve.falls_to(share)
    assert curve.at(found.value).value == pytest.approx(share, abs=1e-9)
    assert curve.falls_to(0.001).note.startswith("more than 0.001")
    assert math.isnan(curve.at(2.0).value)


@pytest.mark.exhaustive
def test_edges_cover_what_they_were_made_with() -> None:
    """60 edges, 5 figures of each: fewer than 87 % or none outside once in 500 tests."""
    shares = [share for share, _ in coverage(edge_case, 60).values()]
    assert 0.87 < np.mean(shares) < 1


@pytest.mark.exhaustive
def test_93_to_97_percent_of_the_intervals_of_edges_hold() -> None:
    """200 edges; benchmarks/image_quality_coverage.py has 400. Standard error of each share 1.5 %."""
    for name, (share, _) in coverage(edge_case, 200, seed=2).items():
        assert 0.905 < share < 0.99, name


@pytest.mark.parametrize(
    ("picture", "options", "said"),
    [
        (np.ones((40, 40)), {}, "no edge"),
        (charts.slanted_edge(SHAPE, 0), {}, "turn it by some degrees"),
        (charts.slanted_edge(SHAPE, 45), {}, "turn it by some degrees"),
        (charts.slanted_edge((40, 8), 3), {}, "pixels beside its edge"),
        (np.ones(5), {}, "rows, columns"),
        (charts.slanted_edge(SHAPE, 5), {"flat": np.zeros(SHAPE)}, "positive values"),
        (charts.slanted_edge(SHAPE, 5), {"edge_order": 9}, "edge_order"),
        (charts.slanted_edge(SHAPE, 5), {"sample_px": 0}, "sample_px"),
        (np.full((30, 30), np.nan), {}, "finite"),
    ],
)
def test_pictures_without_a_slanted_edge_are_refused(
    picture: np.ndarray, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(ms.InputError, match=said):
        slanted_edge(picture, **options)
