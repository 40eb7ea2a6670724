"""The preview shows the raw digital numbers, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007, masks_CFA_Bayer

import mitsuba_sensor as ms
from mitsuba_sensor.optics.spectra import srgb_curve
from mitsuba_sensor.output.demosaic import bilinear, demosaic, demosaic_bayer
from mitsuba_sensor.output.preview import preview
from mitsuba_sensor.stages.chain import black_level_dn

MONO = ms.load_camera("konnik_table1")
RGBIR = ms.load_camera("rgbir_2mp")
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
    planes = bilinear(mosaic, BAYER, 3)
    np.testing.assert_array_equal(
        np.take_along_axis(planes, BAYER[..., None], axis=-1)[..., 0], mosaic
    )


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, 0.0), (0.0, 0.02), (0.03, 0.02)])
def test_demosaicing_is_exact_on_planes_inside_the_picture(slope: tuple[float, float]) -> None:
    rows, columns = np.mgrid[:8, :10]
    plane = 0.1 + slope[0] * rows + slope[1] * columns
    colours = np.stack([plane, 2 * plane, 3 * plane], axis=-1)
    mosaic = np.take_along_axis(colours, BAYER[..., None], axis=-1)[..., 0]
    np.testing.assert_allclose(
        bilinear(mosaic, BAYER, 3)[1:-1, 1:-1], colours[1:-1, 1:-1], rtol=1e-12
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_thin_pictures_are_demosaiced_without_complaint(shape: tuple[int, int]) -> None:
    with np.errstate(all="raise"):
        picture = preview(np.full(shape, 100, np.uint16), COLOUR)
    assert picture.shape == (*shape, 3)


@pytest.mark.parametrize("origin", [(0, 0), (0, 1), (1, 0), (1, 1), (7, 12)])
@pytest.mark.parametrize("camera", [COLOUR, RGBIR], ids=lambda camera: camera.name)
def test_a_crop_of_a_frame_has_the_colours_of_the_frame(
    camera: ms.Camera, origin: tuple[int, int]
) -> None:
    """Wherever the window begins; 12 pixels from its border the interpolation is the same."""
    red = (np.arange(len(camera.filter_names)) == 0)[camera.filter_index((60, 60))]
    raw = (
        black_level_dn(camera)
        + 1500.0 * red
        + 200.0 * np.random.default_rng(2).random((60, 60))
    )
    row, column = origin
    whole, part = preview(raw, camera), preview(raw[row:, column:], camera, origin=origin)
    np.testing.assert_array_equal(
        whole[row + 12 : -12, column + 12 : -12], part[12:-12, 12:-12]
    )
    if camera is COLOUR:
        assert part[..., 0].mean() > 1.5 * part[..., 1:].mean()


def test_the_edge_of_a_grey_surface_has_no_colour() -> None:
    """A slanted edge, 5° from upright, blurred over a pixel: bilinear means colour 0.4 of its height there."""
    rows, columns = np.mgrid[:80, :80]
    edge = 0.1 + 0.8 * np.clip(columns - 40 - (rows - 40) * np.tan(np.radians(5)) + 0.5, 0, 1)
    filters = COLOUR.filter_index(edge.shape)
    inner = np.s_[8:-8, 8:-8]
    assert np.ptp(bilinear(edge, filters, 3), axis=-1)[inner].max() > 0.3
    assert np.ptp(demosaic(edge, filters, COLOUR), axis=-1)[inner].max() < 0.02


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
@pytest.mark.parametrize("values", [2, 5, 4096])
def test_bayer_patterns_are_demosaiced_as_by_colour_demosaicing(
    pattern: str, values: int
) -> None:
    """To the bit, also where rows and columns change as little as each other, and in the smallest pictures."""
    random = np.random.default_rng(values)
    for _ in range(30):
        mosaic = random.integers(0, values, tuple(random.integers(2, 20, 2))) / values
        red, _, blue = masks_CFA_Bayer(mosaic.shape, pattern)
        expected = demosaicing_CFA_Bayer_Menon2007(mosaic, pattern)
        np.testing.assert_array_equal(demosaic_bayer(mosaic, red, blue), expected)


def test_saturation_is_white_whatever_the_balance() -> None:
    for camera in (COLOUR, RGBIR):
        assert (preview(np.full((4, 4), 2**camera.adc.bits - 1), camera) >= 254).all()


@pytest.mark.parametrize("camera", [MONO, COLOUR, RGBIR], ids=lambda camera: camera.name)
@pytest.mark.parametrize("origin", [(0, 0), (3, 1)])
def test_a_preview_of_some_rows_at_a_time_is_that_of_the_whole_frame(
    camera: ms.Camera, origin: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, in strips of one row and of seven, of noise, which has edges everywhere."""
    raw = np.random.default_rng(1).integers(0, 2**camera.adc.bits, (61, 34))
    whole = preview(raw, camera, origin=origin)
    for rows in (1, 7):
        monkeypatch.setattr("mitsuba_sensor.output.preview.PIXELS_AT_ONCE", rows * 34)
        np.testing.assert_array_equal(preview(raw, camera, origin=origin), whole)
