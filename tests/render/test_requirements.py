"""Requirements of a render: how many bands a camera can distinguish, and what else a render may leave out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.render.passes.requirements import render_requirements
from mitsuba_sensor.stages.gains import gain_dn_per_e

TABLE1 = ms.load_camera("konnik_table1")
BAYER = ms.load_camera("bayer_2mp")
EXPOSURE = ms.Exposure(0.1)
SHAPE = (6, 8)


@pytest.fixture(scope="module")
def make(light: Any) -> Any:
    """make(spectrum, first_nm, last_nm): Irradiance of len(spectrum) equal bands; each pixel has its own brightness."""

    def made(spectrum: Any, first_nm: float, last_nm: float) -> Any:
        width = (last_nm - first_nm) / len(spectrum)
        brightness = np.random.default_rng(4).uniform(0.2, 1.0, SHAPE)
        data = brightness[..., None] * np.asarray(spectrum, dtype=np.float64)
        return type(light)(
            data=data,
            wavelengths_nm=first_nm + width * (np.arange(len(spectrum)) + 0.5),
            bandwidths_nm=np.full(len(spectrum), width),
            standard_error=np.zeros_like(data),
            relative_error=np.zeros(SHAPE),
            statistics=light.statistics,
        )

    return made


def bands_of(light: Any, camera: ms.Camera, tolerance_dn: float) -> Any:
    need, *_ = render_requirements(light, camera, EXPOSURE, gain_dn_per_e(camera), tolerance_dn)
    assert need.what == f"{len(light.wavelengths_nm)} bands"
    return need


def rebinned(light: Any, size: int) -> Any:
    """``size`` neighbouring bands as one of their mean irradiance, written the long way."""
    groups = [slice(start, start + size) for start in range(0, len(light.wavelengths_nm), size)]
    return replace(
        light,
        data=np.stack([light.data[..., group].mean(axis=-1) for group in groups], axis=-1),
        wavelengths_nm=np.array([light.wavelengths_nm[group].mean() for group in groups]),
        bandwidths_nm=np.array([light.bandwidths_nm[group].sum() for group in groups]),
    )


def signal_dn(light: Any, camera: ms.Camera) -> Any:
    """Mean signal of every pixel through the public API: photons, then the QE of the pixel's own filter."""
    photons = ms.collect(light, camera, EXPOSURE)
    qe = camera.qe(photons.wavelengths_nm, photons.bandwidths_nm)[camera.filter_index(SHAPE)]
    return gain_dn_per_e(camera) * (photons.mean * qe).sum(axis=-1)


def alone(light: Any, band: int) -> Any:
    """The light of one band."""
    return replace(
        light, data=np.where(np.arange(light.data.shape[2]) == band, light.data, 0.0)
    )


def moved_dn(light: Any, camera: ms.Camera, size: int) -> float:
    """What re-binning changes, every band by itself and summed up, at the pixel where it is most."""
    bands = [alone(light, band) for band in range(light.data.shape[2])]
    changes = [
        np.abs(signal_dn(rebinned(one, size), camera) - signal_dn(one, camera)) for one in bands
    ]
    return float(np.sum(changes, axis=0).max())


def test_what_the_bands_of_a_group_change_does_not_cancel(make: Any) -> None:
    """Photons grow with λ: the middle of 400 to 700 nm stands for all of it by chance, each band is 75/550 off."""
    light = make(np.full(30, 1e-5), 400, 700)
    brightest = signal_dn(light, TABLE1).max()
    assert (
        np.abs(signal_dn(rebinned(light, 30), TABLE1) - signal_dn(light, TABLE1)).max() < 1e-6
    )
    need = bands_of(light, TABLE1, 0.14 * brightest)
    assert need.effect_dn == pytest.approx(75 / 550 * brightest, rel=1e-6)
    assert not need.kept and need.reason == "1 are enough: --bandwidth-nm 300"
    assert bands_of(light, TABLE1, 0.01 * brightest).reason != need.reason


def test_a_full_well_hides_no_band(make: Any) -> None:
    """Ten times as much light as the well holds: its spectrum matters all the same, in a shorter exposure."""
    light = make(np.linspace(1e-5, 3e-5, 30), 400, 700)
    bright = replace(light, data=light.data * 1e4)
    assert signal_dn(bright, BAYER).min() > 10 * 2**BAYER.adc.bits
    assert bands_of(bright, BAYER, 1.0).kept
    assert bands_of(bright, BAYER, 1.0).effect_dn == pytest.approx(
        1e4 * moved_dn(light, BAYER, 2), rel=1e-6
    )


def test_a_narrow_line_under_a_mosaic_needs_all_bands(make: Any) -> None:
    """The filters tell 10 nm apart: smeared over 20 nm, the line moves by far more than 0.01 DN.

    (545 nm is the centre of no group of 2, 3, 5, 6, 10, 15 or 30 bands; there re-binning would move nothing.)
    """
    spectrum = np.zeros(30)
    spectrum[14] = 1e-5
    light = make(spectrum, 400, 700)
    need = bands_of(light, BAYER, 0.01)
    assert need.kept and "more than the tolerance" in need.reason
    assert np.abs(signal_dn(rebinned(light, 2), BAYER) - signal_dn(light, BAYER)).max() > 1


@pytest.mark.parametrize("tolerance_dn", [0.01, 0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize(
    "camera",
    one_in(2, [TABLE1, BAYER, ms.load_camera("rgbir_2mp")]),
    ids=lambda camera: camera.name,
)
def test_the_bands_that_are_left_out_move_no_pixel_by_more_than_the_tolerance(
    camera: ms.Camera, tolerance_dn: float, make: Any
) -> None:
    """A smooth spectrum: the stated effect is that of re-binning band by band, and the next coarser grid breaks it."""
    light = make(2e-6 * (1 + np.sin(np.linspace(0, 2, 36)) ** 2), 400, 760)
    moved = {size: moved_dn(light, camera, size) for size in (36, 18, 12, 9, 6, 4, 3, 2)}
    size = next((size for size, effect in moved.items() if effect <= tolerance_dn), 1)
    need = bands_of(light, camera, tolerance_dn)
    assert need.kept == (size == 1)
    if size > 1:
        assert need.reason == f"{36 // size} are enough: --bandwidth-nm {10 * size:g}"
        assert need.effect_dn == pytest.approx(moved[size], rel=1e-6, abs=1e-9)
        assert need.effect_dn <= tolerance_dn
        whole, coarse = signal_dn(light, camera), signal_dn(rebinned(light, size), camera)
        assert np.abs(coarse - whole).max() <= need.effect_dn * (1 + 1e-9)


def test_the_tolerances_of_these_tests_lead_to_different_answers(make: Any) -> None:
    light = make(2e-6 * (1 + np.sin(np.linspace(0, 2, 36)) ** 2), 400, 760)
    assert (
        len({bands_of(light, BAYER, tolerance).reason for tolerance in (0.01, 1.0, 100.0, 1e9)})
        >= 3
    )


def test_without_tolerance_all_bands_are_kept(make: Any) -> None:
    assert bands_of(make(np.linspace(1e-5, 3e-5, 8), 400, 700), BAYER, 0.0).kept
    assert bands_of(make([1e-5], 545, 555), BAYER, 0.0).what == "1 bands"


def test_infinite_light_is_not_looked_at(make: Any) -> None:
    """It saturates its pixel whatever the bands are."""
    light = make(np.full(4, 1e-5), 400, 700)
    light.data[0, 0, 1] = np.inf
    assert np.isfinite(bands_of(light, BAYER, 0.1).effect_dn)


def test_a_pinhole_needs_no_depth_of_field_and_a_lens_does(light: Any) -> None:
    gain = gain_dn_per_e(TABLE1)
    _, pinhole, aovs = render_requirements(light, TABLE1, EXPOSURE, gain, 0.1)
    assert pinhole.what == "depth of field" and not pinhole.kept and "pinhole" in pinhole.reason
    assert aovs.what == "AOVs" and not aovs.kept
    lens = replace(light, statistics=replace(light.statistics, aperture_f_number=2.8))
    _, depth, _ = render_requirements(lens, TABLE1, EXPOSURE, gain, 0.1)
    assert depth.kept and "f/2.8" in depth.reason
