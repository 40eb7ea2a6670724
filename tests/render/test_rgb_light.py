"""Light of RGB pictures: its illuminance by colour-science, one light in three units, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import colour
import numpy as np
import pytest
from helpers.marks import exhaustive
from scipy import constants

import mitsuba_sensor as ms
from mitsuba_sensor.render.light import foreign_light

BAYER = ms.load_camera("bayer_2mp")
PICTURE = np.random.default_rng(20261126).integers(0, 256, (6, 8, 3), np.uint8)


def illuminance_lx(light: ms.Irradiance) -> Any:
    """Illuminance of every pixel by the CIE 1931 observer of colour-science [lx]."""
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy()
    sensitivity = observer.align(colour.SpectralShape(360, 780, 1)).values[:, 1]
    wavelengths_nm = np.arange(360.0, 781.0)
    values = np.array(
        [
            np.interp(wavelengths_nm, light.wavelengths_nm, spectrum)
            for spectrum in light.data.reshape(-1, light.data.shape[-1])
        ]
    )
    return (683 * values @ sensitivity).reshape(light.data.shape[:2])


def test_white_of_200_cd_per_m2_has_the_illuminance_of_the_camera_equation() -> None:
    """E = π L T / (4 N²), within 0.5 %: the bands are 10 nm wide and the camera sees no blue below 400 nm."""
    lens = BAYER.lens
    expected_lx = math.pi * 200 * lens.transmission / (4 * lens.f_number**2)
    for values, options in (
        (np.full((2, 2, 3), 200.0), {"unit": "cd_per_m2"}),
        (np.full((2, 2, 3), 255, np.uint8), {"unit": "srgb", "white_cd_per_m2": 200}),
        (np.ones((2, 2, 3), np.float32), {"unit": "srgb", "white_cd_per_m2": 200.0}),
    ):
        light = ms.light_from_rgb(values, "bayer_2mp", **options)
        assert illuminance_lx(light) == pytest.approx(expected_lx, rel=5e-3)


def test_a_picture_is_the_linear_light_that_colour_science_decodes() -> None:
    linear = colour.models.eotf_sRGB(PICTURE / 255)
    encoded = ms.light_from_rgb(PICTURE, BAYER, unit="srgb", white_cd_per_m2=50.0)
    decoded = ms.light_from_rgb(50.0 * linear, BAYER, unit="cd_per_m2")
    np.testing.assert_allclose(encoded.data, decoded.data, rtol=2e-4)


def test_black_is_dark_and_a_capture_takes_the_light() -> None:
    black = ms.light_from_rgb(np.zeros((3, 4, 3)), BAYER, unit="cd_per_m2")
    assert not black.data.any()
    light = ms.light_from_rgb(PICTURE, BAYER, unit="srgb", white_cd_per_m2=100)
    captured = ms.capture(light, "bayer_2mp", ms.Exposure(0.02), seed=5)
    exposed = ms.expose(light, "bayer_2mp", ms.Exposure(0.02), seed=5)
    np.testing.assert_array_equal(captured.frames.digital, exposed.digital)


@pytest.mark.parametrize("name", ["bayer_2mp", exhaustive("rgbir_2mp")])
def test_the_camera_that_a_picture_is_for_has_the_electrons_of_its_whole_spectrum(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against bands of 0.5 nm, in which no spectrum changes. Flat bands of 10 nm would be off by up to 1 %."""
    camera, exposure = ms.load_camera(name).without("shot_noise"), ms.Exposure(1e-5)
    picture = np.random.default_rng(7).integers(0, 2, (8, 8, 3)).astype(float)
    known = ms.collect(
        ms.light_from_rgb(picture, camera, unit="radiance_rgb"), camera, exposure
    )
    monkeypatch.setattr(foreign_light, "BANDWIDTH_NM", 0.5)
    fine = ms.collect(ms.light_from_rgb(picture, camera, unit="radiance_rgb"), camera, exposure)
    own = camera.filter_index((8, 8))
    electrons, wanted = (
        (x.mean * camera.qe(x.wavelengths_nm, x.bandwidths_nm)[own]).sum(axis=-1)
        for x in (known, fine)
    )
    assert known.in_band is not None
    np.testing.assert_allclose(electrons * known.in_band, wanted, rtol=1e-4)


def test_a_picture_for_a_camera_that_sees_infrared_says_that_it_has_none() -> None:
    light = ms.light_from_rgb(PICTURE, "sony_imx174", unit="srgb", white_cd_per_m2=200)
    frames = ms.expose(light, "sony_imx174", ms.Exposure(0.001))
    assert any("this light has nothing beyond" in note for note in frames.notes)


@pytest.mark.parametrize("name", ["sony_imx174", "sony_imx990", "bayer_2mp"])
def test_white_has_the_electrons_of_daylight_up_to_830_nm(name: str) -> None:
    """∫ L·T·Ω·QE·λ/(hc) dλ · area · time, L the D series of colour-science for D65 of 200 cd/m², which the published
    table follows to 0.001; a flat field without cos⁴, the mean over the filters of the mosaic."""
    camera, time_s, luminance = ms.load_camera(name), 0.01, 200.0
    xy = colour.temperature.CCT_to_xy_CIE_D(6500 * 1.4388 / 1.4380)
    daylight = colour.colorimetry.sd_CIE_illuminant_D_series(xy)
    nm = np.arange(360.0, 830.01, 0.1)
    power = np.interp(nm, daylight.wavelengths, daylight.values)
    eye = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    seen = np.interp(nm, eye.wavelengths, eye.values[:, 1])
    power *= luminance / (683.002 * np.trapezoid(power * seen, nm))
    lens, pixel = camera.lens, camera.pixel
    watts = power * lens.transmission * math.pi / (4 * lens.f_number**2)
    photons_per_joule = nm * 1e-9 / (constants.h * constants.c)
    area_m2 = pixel.pitch_x_um * pixel.pitch_y_um * 1e-12 * pixel.fill_factor
    inside = (nm >= camera.band_nm[0]) & (nm <= camera.band_nm[1])
    per_filter = np.trapezoid(camera.qe(nm) * inside * watts * photons_per_joule, nm)
    expected = area_m2 * time_s * per_filter[camera.filter_index((4, 4))]
    light = ms.light_from_rgb(np.full((4, 4, 3), luminance), camera, unit="cd_per_m2")
    photons = ms.collect(light, camera, ms.Exposure(time_s))
    assert photons.in_band is not None
    own = camera.filter_index((4, 4))
    qe = camera.qe(photons.wavelengths_nm, photons.bandwidths_nm)[own]
    electrons = (photons.mean * qe).sum(axis=-1) * photons.in_band
    np.testing.assert_allclose(electrons, expected, rtol=3e-4)
    assert any("ends at 360 and 830 nm" in note for note in light.notes)


@pytest.mark.parametrize(
    ("rgb", "options", "sentence"),
    [
        (np.moveaxis(PICTURE, -1, 0), {"unit": "srgb"}, r"e\.g\. np\.moveaxis\(rgb, 0, -1\)"),
        ("picture.png", {}, r"is the file name 'picture.png'; .*PIL\.Image\.open"),
        (np.ones((6, 8, 4)), {}, r"without transparency, .*rgb\[\.\.\., :3\]"),
        (PICTURE[..., 0], {}, r"shape \(6, 8\); pass \(H, W, 3\)"),
        (PICTURE, {}, "unit is not given, .*pass unit='srgb' .* e.g. white_cd_per_m2=200"),
        (PICTURE / 255, {}, "unit is not given, .*73 000 cd/m²"),
        (PICTURE, {"unit": "cd_per_m2"}, 'pass unit="srgb" and white_cd_per_m2'),
        (PICTURE, {"unit": "srgb"}, "give the luminance of its white"),
        (PICTURE / 255, {"unit": "cd_per_m2", "white_cd_per_m2": 20}, 'is for unit "srgb"'),
        (PICTURE / 1.0, {"unit": "srgb", "white_cd_per_m2": 20}, "from 0 to 1"),
        (0.0 - PICTURE, {"unit": "cd_per_m2"}, "negative or not finite"),
        (PICTURE / 255, {"unit": "srg"}, "Did you mean 'srgb'"),
        (PICTURE > 9, {}, "a Boolean array"),
    ],
)
def test_what_is_no_picture_is_refused(
    rgb: Any, options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        ms.light_from_rgb(rgb, BAYER, **options)
