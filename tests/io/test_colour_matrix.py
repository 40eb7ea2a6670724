"""Colours of a camera beside those that an observer sees, with reflectances that the matrix was not fitted to."""

from __future__ import annotations

from pathlib import Path

import colour
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core.illuminant import Illuminant
from mitsuba_sensor.io.colour_matrix import colour_matrix, colour_order
from mitsuba_sensor.render.spectra import surfaces

SHAPE = colour.SpectralShape(380, 780, 5)
PATCHES = np.stack([one.copy().align(SHAPE).values for one in colour.SDS_COLOURCHECKERS["ISO 17321-1"].values()])
OBSERVER = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(SHAPE).values
WHITE = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
MIDDLES = np.arange(360.0, 1101.0, 5.0)
BAYER, RGBIR = ms.load_camera("bayer_2mp"), ms.load_camera("rgbir_2mp")


def lit_by(name: str) -> Illuminant:
    """A CIE illuminant, nothing outside of its table."""
    table = colour.SDS_ILLUMINANTS[name]
    return Illuminant(MIDDLES, np.interp(MIDDLES, table.wavelengths, table.values, left=0.0, right=0.0))


def seen(name: str) -> NDArray[np.float64]:
    """XYZ of the 24 patches under an illuminant, adapted to D65 by colour-science; the Y of white is 1."""
    power = colour.SDS_ILLUMINANTS[name].copy().align(SHAPE).values
    white = power @ OBSERVER / (power @ OBSERVER)[1]
    found = (PATCHES * power) @ OBSERVER / (power @ OBSERVER)[1]
    return np.asarray(colour.chromatic_adaptation(found, white, colour.xy_to_XYZ(WHITE), transform="CAT02"))


def distances(srgb: NDArray[np.float64], xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """ΔE2000 of linear sRGB colours, which are made as bright as these on average."""
    found = srgb @ colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ.T
    found = np.maximum(found * (xyz[:, 1].sum() / found[:, 1].sum()), 0.0)
    pair = (colour.XYZ_to_Lab(one, WHITE) for one in (found, xyz))
    return np.asarray(colour.delta_E(*pair, method="CIE 2000"))


@pytest.mark.parametrize("name", ["D65", "A", "FL2"])
@pytest.mark.parametrize(("camera", "most"), [(BAYER, 1.1), (RGBIR, 4.0)], ids=("bayer", "rgbir"))
def test_patches_that_were_not_trained_have_their_colours(camera: ms.Camera, most: float, name: str) -> None:
    """Daylight, lamps of 2856 K, fluorescent tubes; the QE curves alone, without a picture."""
    light = lit_by(name)
    matrix = colour_matrix(camera, light)
    assert matrix is not None and matrix.illuminant == "scene"
    reflectances = np.stack([np.interp(MIDDLES, SHAPE.wavelengths, one) for one in PATCHES])
    per_filter = camera.qe(MIDDLES) * light.power * MIDDLES
    raw = reflectances @ per_filter.T / per_filter.sum(axis=1)[colour_order(camera.filter_names)].max()
    assert distances(raw * matrix.white_balance @ matrix.to_srgb.T, seen(name)).mean() < most


def test_no_patch_is_in_the_training_set() -> None:
    """The nearest of 190 reflectances is 0.004 and more away (rms over the wavelengths), for half of them 0.025."""
    off = [np.sqrt(((surfaces(SHAPE.wavelengths) - patch) ** 2).mean(axis=1)).min() for patch in PATCHES]
    assert min(off) > 0.003 and np.median(off) > 0.02


@pytest.mark.parametrize("camera", [BAYER, RGBIR], ids=("bayer", "rgbir"))
@pytest.mark.parametrize("name", ["D65", "A"])
def test_white_is_white_under_every_illuminant(camera: ms.Camera, name: str) -> None:
    light = lit_by(name)
    matrix, per_filter = colour_matrix(camera, light), (camera.qe(MIDDLES) * light.power * MIDDLES).sum(axis=1)
    assert matrix is not None
    order = colour_order(camera.filter_names)
    white = matrix.white_balance * per_filter / per_filter[order].max()
    np.testing.assert_allclose(white[order], 1.0, rtol=1e-12)
    np.testing.assert_allclose(matrix.to_srgb @ white, 1.0, atol=5e-4)  # sRGB is rounded to four digits
    assert matrix.white_balance.min() == 1.0


def test_light_in_which_a_filter_sees_nothing_is_no_light_for_colours() -> None:
    laser = Illuminant(MIDDLES, np.where(MIDDLES == 850.0, 1.0, 0.0))
    found, daylight = colour_matrix(RGBIR, laser), colour_matrix(RGBIR)
    assert found is not None and daylight is not None
    assert found.illuminant == daylight.illuminant == "D65"
    np.testing.assert_array_equal(found.to_srgb, daylight.to_srgb)


def test_a_camera_without_red_green_and_blue_has_no_colours() -> None:
    assert colour_matrix(ms.load_camera("konnik_table1")) is None
    curves = {"R": [0.5, 0.5], "G": [0.5, 0.5], "B": [0.0, 0.0]}
    blind = BAYER.replace(**{"quantum_efficiency.curves": curves, "quantum_efficiency.wavelengths_nm": [400.0, 700.0]})
    assert colour_matrix(blind) is None and colour_matrix(blind, lit_by("A")) is None
    assert colour_order(("B", "G", "R")) == [2, 1, 0]
    assert colour_order(("red", "green", "blue", "white")) == [0, 1, 2]
    assert colour_order(("mono",)) is None
    assert colour_order(("cyan", "magenta", "yellow")) is None


@pytest.mark.parametrize(("camera", "most"), [(BAYER, 2.0), (RGBIR, 3.0)], ids=("bayer", "rgbir"))
def test_the_preview_of_a_color_checker_has_its_colours(camera: ms.Camera, most: float, tmp_path: Path) -> None:
    """Rendered, exposed, with all noise, from frame.png: mean ΔE2000 of the patches 0.96 and 2.86."""
    ms.capture("scenes/color_checker.xml", camera, ms.Exposure(0.1), spp=16, width=384, seed=3).save(tmp_path)
    picture = np.asarray(Image.open(tmp_path / "frame.png")) / 255
    linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    pixels = picture.shape[1] / 0.3  # per metre; patches of 40 mm, 50 mm apart
    middles = [
        (picture.shape[0] / 2 - (0.075 - 0.05 * row) * pixels, picture.shape[1] / 2 + (0.05 * column - 0.125) * pixels)
        for row, column in np.ndindex(4, 6)
    ]
    half = round(0.012 * pixels)
    means = [linear[int(y) - half : int(y) + half, int(x) - half : int(x) + half].mean(axis=(0, 1)) for y, x in middles]
    assert distances(np.array(means), seen("D65")).mean() < most
