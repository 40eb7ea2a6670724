"""The preview shows the raw digital numbers, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007, masks_CFA_Bayer
from helpers.marks import exhaustive
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.colour_matrix import colour_matrix
from mitsuba_sensor.optics.spectra import srgb_curve
from mitsuba_sensor.output.demosaic import bilinear, demosaic, demosaic_bayer
from mitsuba_sensor.output.preview import preview

MONO = ms.load_camera("konnik_table1")
RGBIR = ms.load_camera("rgbir_2mp")
COLOUR = next(c for c in map(ms.load_camera, ms.list_cameras()) if len(c.filter_names) == 3)
BAYER = COLOUR.filter_index((8, 10))


def test_darkness_is_black_and_the_largest_code_is_white() -> None:
    raw = np.array([[MONO.black_level_dn, 2**MONO.adc.bits - 1]]).astype(np.uint16)
    assert preview(raw, MONO).tolist() == [[0, 255]]


def test_the_srgb_curve_has_no_step_where_its_two_pieces_meet() -> None:
    below, above = srgb_curve(np.array([0.0031308 - 1e-9, 0.0031308 + 1e-9]))
    assert abs(above - below) < 1e-6
    assert srgb_curve(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])


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


@pytest.mark.parametrize("origin", [(0, 0), (0, 1), (1, 0), (1, 1), (7, 12)])
@pytest.mark.parametrize("camera", [COLOUR, RGBIR], ids=lambda camera: camera.name)
def test_a_crop_of_a_frame_has_the_colours_of_the_frame(
    camera: ms.Camera, origin: tuple[int, int]
) -> None:
    """Wherever the window begins; 12 pixels from its border the interpolation is the same."""
    red = (np.arange(len(camera.filter_names)) == 0)[camera.filter_index((60, 60))]
    raw = (
        camera.black_level_dn + 1500.0 * red + 200.0 * np.random.default_rng(2).random((60, 60))
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


@pytest.mark.parametrize("camera", [MONO, COLOUR, RGBIR], ids=lambda camera: camera.name)
@pytest.mark.parametrize("origin", [exhaustive((0, 0)), (3, 1)])
def test_a_preview_of_some_rows_at_a_time_is_that_of_the_whole_frame(
    camera: ms.Camera, origin: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, in strips of one row and of seven, of noise, which has edges everywhere."""
    raw = np.random.default_rng(1).integers(0, 2**camera.adc.bits, (61, 34))
    whole = preview(raw, camera, origin=origin)
    for rows in (1, 7):
        monkeypatch.setattr("mitsuba_sensor.output.preview.PIXELS_AT_ONCE", rows * 34)
        np.testing.assert_array_equal(preview(raw, camera, origin=origin), whole)


def mosaic_of(
    balanced: Sequence[NDArray[np.float64] | float], camera: ms.Camera
) -> NDArray[np.float64]:
    """The codes of pixels that see these white-balanced red, green and blue, clipped at the highest code."""
    matrix = colour_matrix(camera)
    assert matrix is not None
    colours = np.stack(np.broadcast_arrays(*balanced), axis=-1) / matrix.white_balance
    filters = camera.filter_index(colours.shape[:2])
    linear = np.take_along_axis(colours, filters[..., None], axis=-1)[..., 0]
    black, white = camera.black_level_dn, 2**camera.adc.bits - 1
    return np.rint(np.minimum(black + (white - black) * linear, white))


@pytest.mark.parametrize("name", ["sony_a7s2", "raspberry_pi_hq", "bayer_2mp"])
def test_a_grey_ramp_through_saturation_has_no_colour(name: str) -> None:
    """From black to three times white, as a ramp, and as steps at which the highlight begins."""
    camera = ms.load_camera(name)
    ramp = np.linspace(0, 3, 96) * np.ones((96, 1))
    steps = 0.3 + 2.7 * (np.indices((96, 96))[1] // 12 % 2)
    for levels in (ramp, steps):
        shown = preview(mosaic_of([levels] * 3, camera), camera).astype(int)
        assert np.ptp(shown, axis=-1).max() <= 6
        assert (shown[levels >= 1] >= 249).all()


def test_a_clipped_blue_keeps_its_hue_and_goes_to_white() -> None:
    """Brighter and brighter: its chroma falls from where it clips, and it is never as green as it is blue."""
    camera, light = ms.load_camera("sony_a7s2"), np.array([0.55, 0.75, 1.0])
    exposures = np.linspace(0.2, 2.5, 60)
    pictures = []
    for exposure in exposures:
        even = [np.full((8, 8), exposure * level) for level in light]
        pictures.append(preview(mosaic_of(even, camera), camera)[4, 4])
    shown = np.array(pictures).astype(int)
    red, green, blue = shown.T
    hue = (green - red) / np.maximum(blue - red, 1)
    chroma = np.ptp(shown, axis=-1)
    unclipped = exposures <= 1
    assert np.ptp(hue[unclipped]) < 0.2
    assert (np.diff(chroma[~unclipped]) <= 1).all()
    assert shown[-1].tolist() == [255, 255, 255]


def test_colours_that_do_not_clip_are_those_beside_no_highlight() -> None:
    """Equal bytes, as far from the highlight as demosaicing reaches, and those of the matrix on even colours."""
    camera = ms.load_camera("sony_a7s2")
    colours = np.random.default_rng(3).random((3, 40, 120)) * 0.9
    plain = mosaic_of(colours, camera)
    colours[:, :, 80:] = 4.0
    with_highlight = preview(mosaic_of(colours, camera), camera)
    np.testing.assert_array_equal(with_highlight[:, :64], preview(plain, camera)[:, :64])
    assert (with_highlight[:, 96:] == 255).all()
    even, matrix = [0.3, 0.5, 0.4], colour_matrix(camera)
    assert matrix is not None
    shown = preview(mosaic_of([np.full((8, 8), level) for level in even], camera), camera)
    assert np.abs(shown - 255 * srgb_curve(matrix.to_srgb @ even)).max() <= 1
