"""Colours of a camera beside those that an observer sees, with reflectances that the matrix was not fitted to."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import rawpy
from helpers.patches import MIDDLES, PATCHES, SHAPE, distances, lit_by, patch_means, seen
from numpy.typing import NDArray
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.camera.colour_matrix import _fit, colour_matrix, colour_order
from mitsuba_sensor.optics.spectra import color_checker

BAYER, RGBIR = ms.load_camera("bayer_2mp"), ms.load_camera("rgbir_2mp")


@pytest.mark.parametrize("name", ["D65", "A", "FL2"])
@pytest.mark.parametrize(
    ("camera", "most"), [(BAYER, 1.1), (RGBIR, 4.0)], ids=("bayer", "rgbir")
)
def test_patches_that_were_not_trained_have_their_colours(
    camera: ms.Camera, most: float, name: str
) -> None:
    """Daylight, lamps of 2856 K, fluorescent tubes; the QE curves alone, without a picture."""
    light = lit_by(name)
    matrix = colour_matrix(camera, light)
    assert matrix is not None and matrix.illuminant == "scene"
    reflectances = np.stack([np.interp(MIDDLES, SHAPE.wavelengths, one) for one in PATCHES])
    per_filter = camera.qe(MIDDLES) * light.power * MIDDLES
    raw = (
        reflectances
        @ per_filter.T
        / per_filter.sum(axis=1)[colour_order(camera.filter_names)].max()
    )
    assert distances(raw * matrix.white_balance @ matrix.to_srgb.T, seen(name)).mean() < most


@pytest.mark.parametrize("camera", [BAYER, RGBIR], ids=("bayer", "rgbir"))
@pytest.mark.parametrize("name", ["D65", "A"])
def test_white_is_white_under_every_illuminant(camera: ms.Camera, name: str) -> None:
    light = lit_by(name)
    matrix, per_filter = (
        colour_matrix(camera, light),
        (camera.qe(MIDDLES) * light.power * MIDDLES).sum(axis=1),
    )
    assert matrix is not None
    order = colour_order(camera.filter_names)
    white = matrix.white_balance * per_filter / per_filter[order].max()
    np.testing.assert_allclose(white[order], 1.0, rtol=1e-12)
    np.testing.assert_allclose(
        matrix.to_srgb @ white, 1.0, atol=5e-4
    )  # sRGB is rounded to four digits
    assert matrix.white_balance.min() == 1.0


def test_a_camera_without_red_green_and_blue_has_no_colours() -> None:
    assert colour_matrix(ms.load_camera("konnik_table1")) is None
    curves = {"R": [0.5, 0.5], "G": [0.5, 0.5], "B": [0.0, 0.0]}
    blind = BAYER.replace(
        **{
            "quantum_efficiency.curves": curves,
            "quantum_efficiency.wavelengths_nm": [400.0, 700.0],
        }
    )
    assert colour_matrix(blind) is None and colour_matrix(blind, lit_by("A")) is None
    assert colour_order(("B", "G", "R")) == [2, 1, 0]
    assert colour_order(("red", "green", "blue", "white")) == [0, 1, 2]
    assert colour_order(("mono",)) is None
    assert colour_order(("cyan", "magenta", "yellow")) is None


def taken(camera: ms.Camera, folder: Path, dng: bool = False) -> Path:
    """The ColorChecker as a camera sees it, rendered, exposed, with all noise."""
    ms.capture(
        "scenes/color_checker.xml", camera, ms.Exposure(0.1), spp=16, width=192, seed=3, dng=dng
    ).save(folder)
    return folder


@pytest.fixture(scope="module")
def bayer_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken(BAYER, tmp_path_factory.mktemp("bayer"), dng=True)


def of_preview(folder: Path) -> NDArray[np.float64]:
    """ΔE2000 of the patches in frame.png."""
    picture = np.asarray(Image.open(folder / "frame.png")) / 255
    linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    return distances(patch_means(linear), seen("D65"))


def test_the_preview_of_a_color_checker_has_its_colours(bayer_files: Path) -> None:
    """Mean ΔE2000 0.96."""
    assert of_preview(bayer_files).mean() < 2


@pytest.mark.exhaustive
def test_a_mosaic_with_infrared_pixels_has_the_colours_of_a_color_checker(
    tmp_path: Path,
) -> None:
    """Mean ΔE2000 2.86."""
    assert of_preview(taken(RGBIR, tmp_path)).mean() < 3


def test_libraw_develops_the_dng_of_a_color_checker_to_its_colours(bayer_files: Path) -> None:
    """Without any option but those that keep it linear: ΔE2000 of the patches 0.93 on average and 3.7 at most."""
    with rawpy.imread(str(bayer_files / "frame.dng")) as raw:
        linear = raw.postprocess(no_auto_bright=True, output_bps=16, gamma=(1, 1)) / 65535
    found = distances(patch_means(linear), seen("D65"))
    assert found.mean() < 2 and found.max() < 4


def test_frames_previews_and_raw_files_never_wait_for_colour_science(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes 2 s and 170 MB to import; colour charts need it."""
    monkeypatch.setitem(sys.modules, "colour", None)
    _fit.cache_clear()
    light = ms.light_from_rgb(np.full((48, 48, 3), 200.0), BAYER, unit="cd_per_m2")
    ms.capture(light, BAYER, ms.Exposure(0.01), dng=True).save(tmp_path / "frames")
    assert {"frame.png", "frame.dng"} <= {path.name for path in tmp_path.glob("frames/*")}
    with pytest.raises(ImportError):
        color_checker([550.0])
