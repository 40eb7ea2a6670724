"""Modulation at slanted edges against closed forms, in every direction, in uneven light and behind a mosaic."""

from __future__ import annotations

import math

import charts
import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.slanted_edge import edge_picture

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
    one_in(6, [2, 3.6, 5, 10, 14.036, 20, 30, 40, 50, 63, 80, 95, 120, 175, 230, 265, 300]),
)
def test_an_edge_of_any_direction_has_the_modulation_of_its_pixels(angle_deg: float) -> None:
    """sinc·sinc within 0.001 up to Nyquist's frequency."""
    measured = slanted_edge(charts.slanted_edge(SHAPE, angle_deg, 0.2))
    assert largest_error(measured, angle_deg) < 0.001
    turned = (angle_deg + 45) % 90 - 45
    assert abs(measured.angle_deg) == pytest.approx(abs(turned), abs=0.01)


@pytest.mark.parametrize("centre", [(0, 0), exhaustive((-200, -300)), exhaustive((100, 80))])
def test_uneven_light_is_removed_by_itself_or_by_a_flat_field(centre: tuple[int, int]) -> None:
    """cos⁴ that falls by up to 33 % over the edge: within 0.0005 of even light."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    square = ((rows - centre[1]) ** 2 + (columns - centre[0]) ** 2) / 600**2
    light = (1 + square) ** -2.0
    picture = charts.slanted_edge(SHAPE, 5) * light
    assert largest_error(slanted_edge(picture), 5) < 0.0005
    assert largest_error(slanted_edge(picture, flat=light), 5) < 0.0005


@pytest.mark.parametrize("f_number", one_in(3, [4.0, 8.0, 16.0]))
def test_light_that_a_lens_spreads_is_no_uneven_light(f_number: float) -> None:
    """Diffraction at 550 nm on pixels of 3.45 µm: lens × pixel within what of its rings lies beyond 24 px."""
    angle = math.radians(5)

    def modulation(frequency: np.ndarray) -> np.ndarray:
        pixel = np.sinc(frequency * math.cos(angle)) * np.sinc(frequency * math.sin(angle))
        return np.asarray(pixel * diffraction_mtf(frequency * 0.55 * f_number / 3.45))

    picture = edge_picture(modulation, (128, 64), 5)
    curve = slanted_edge(picture).modulation
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


def test_a_clipped_edge_is_told() -> None:
    place = np.clip(np.arange(48) - 24 - 0.1 * (np.arange(48)[:, None] - 24), 0, 1)
    edge = 100 + 800 * place + 3 * np.random.default_rng(8).normal(size=place.shape)
    told = [
        "clipped" in slanted_edge(picture).quantities[0].note
        for picture in (edge, 100 + 800 * place, np.minimum(edge, 700), np.maximum(edge, 300))
    ]
    assert told == [False, False, True, True]
