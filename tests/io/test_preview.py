"""The preview shows the raw digital numbers, and nothing else."""

from __future__ import annotations

import colour
import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.io.preview import colour_order, daylight_photons, demosaic, preview, srgb_curve, white_balance
from mitsuba_sensor.sensor.chain import black_level_dn

MONO = ms.load_camera("konnik_table1")
COLOUR = next(c for c in map(ms.load_camera, ms.list_cameras()) if len(c.filter_names) == 3)
BAYER = COLOUR.filter_index((8, 10))


def test_darkness_is_black_and_the_largest_code_is_white() -> None:
    raw = np.array([[black_level_dn(MONO), 2**MONO.adc.bits - 1]]).astype(np.uint16)
    assert preview(raw, MONO).tolist() == [[0, 255]]


def test_half_of_the_range_is_188_in_srgb() -> None:
    """0.5 linear is 0.7354 by IEC 61966-2-1, 187.5 of 255."""
    half = (2**MONO.adc.bits - 1 + black_level_dn(MONO)) / 2
    assert abs(int(preview(np.full((2, 2), half), MONO)[0, 0]) - 187.5) <= 1


def test_the_srgb_curve_has_no_step_where_its_two_pieces_meet() -> None:
    below, above = srgb_curve(np.array([0.0031308 - 1e-9, 0.0031308 + 1e-9]))
    assert abs(above - below) < 1e-6
    assert srgb_curve(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])


def test_a_dark_frame_is_not_stretched() -> None:
    raw = np.array([[black_level_dn(MONO), black_level_dn(MONO) + 4]]).astype(np.uint16)
    assert preview(raw, MONO).max() <= 12 * 255 * 4 / 4095 + 4


def test_demosaicing_keeps_what_was_measured() -> None:
    mosaic = np.random.default_rng(1).random((8, 10))
    planes = demosaic(mosaic, BAYER, 3)
    np.testing.assert_array_equal(np.take_along_axis(planes, BAYER[..., None], axis=-1)[..., 0], mosaic)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, 0.0), (0.0, 0.02), (0.03, 0.02)])
def test_demosaicing_is_exact_on_planes_inside_the_picture(slope: tuple[float, float]) -> None:
    rows, columns = np.mgrid[:8, :10]
    plane = 0.1 + slope[0] * rows + slope[1] * columns
    colours = np.stack([plane, 2 * plane, 3 * plane], axis=-1)
    mosaic = np.take_along_axis(colours, BAYER[..., None], axis=-1)[..., 0]
    np.testing.assert_allclose(demosaic(mosaic, BAYER, 3)[1:-1, 1:-1], colours[1:-1, 1:-1], rtol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_thin_pictures_are_demosaiced_without_complaint(shape: tuple[int, int]) -> None:
    with np.errstate(all="raise"):
        picture = preview(np.full(shape, 100, np.uint16), COLOUR)
    assert picture.shape == (*shape, 3)


def test_daylight_is_a_black_body_of_6504_k() -> None:
    """CIE 15: D65 and Planck's law agree on the ratio of 450 to 650 nm within 20 %; Wien's peak is at 2.898e6/T nm."""
    wavelengths_nm = np.linspace(300.0, 900.0, 6001)
    power = daylight_photons(wavelengths_nm) / wavelengths_nm
    assert wavelengths_nm[power.argmax()] == pytest.approx(2.897772e6 / 6504, abs=0.1)
    assert power[1500] / power[3500] == pytest.approx(117.008 / 80.0268, rel=0.2)


def test_a_grey_surface_in_daylight_is_grey() -> None:
    """D65 from colour-science, not our black body: within 8 of 255."""
    wavelengths_nm = np.linspace(*COLOUR.band_nm, 256)
    d65 = colour.SDS_ILLUMINANTS["D65"].copy().align(colour.SpectralShape(300, 830, 1))
    power = np.interp(wavelengths_nm, d65.wavelengths, d65.values)
    electrons = (COLOUR.qe(wavelengths_nm) * power * wavelengths_nm).sum(axis=-1)
    mosaic = black_level_dn(COLOUR) + 1000 * (electrons / electrons.max())[BAYER]
    picture = preview(mosaic, COLOUR)
    assert np.ptp(picture.reshape(-1, 3), axis=1).max() <= 8


def test_saturation_is_white_whatever_the_balance() -> None:
    assert white_balance(COLOUR).min() == 1.0
    assert (preview(np.full((4, 4), 2**COLOUR.adc.bits - 1), COLOUR) == 255).all()


def test_filters_are_put_in_the_order_of_the_screen() -> None:
    assert colour_order(("B", "G", "R")) == [2, 1, 0]
    assert colour_order(("red", "green", "blue", "white")) == [0, 1, 2]
    assert colour_order(("mono",)) is None
    assert colour_order(("cyan", "magenta", "yellow")) is None
