"""Denoised light: nearer to the truth than the render, with error bars that hold and the same sum; bands that agree."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import DATA
from helpers.marks import one_in
from helpers.scenes import SCENES, scene_text, skip_unless_usable, write_scene
from scipy.ndimage import gaussian_filter, median_filter, uniform_filter

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.optics.f_number_law import solid_angle_sr
from mitsuba_sensor.render.denoise.denoise import Combined, combine
from mitsuba_sensor.render.denoise.guides import trace_guides
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.light.photons import mean_electrons, photons_per_irradiance
from mitsuba_sensor.render.load.scene import Scene, load_scene
from mitsuba_sensor.render.passes.loaded_render import bands_of_filters
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
BOX = SCENES / "cornell_box.xml"
SMALL: dict[str, Any] = {
    "wavelength_nm": 550,
    "parameters": {"width": 24, "height": 24},
    "spp": 16,
    "variant": "scalar_spectral",
}
pytest.importorskip("pyoidn", reason="Open Image Denoise has no wheel for this machine")


def picture(truth: np.ndarray, sigma: np.ndarray, seed: int) -> tuple[np.ndarray, ...]:
    """Even and odd halves of 16 normal passes about the truth, the variance of their mean, and the mean."""
    noise = np.random.default_rng(seed).standard_normal((16, *truth.shape))
    made = truth + sigma * noise * 4
    halves = made[::2].mean(axis=0), made[1::2].mean(axis=0)
    return *halves, made.var(axis=0, ddof=1) / 16, made.mean(axis=0)


def combined(
    truth: np.ndarray, sigma: Any, seed: int, smooth: Any
) -> tuple[Combined, np.ndarray]:
    """The combination of a picture with the same filtered, and the raw mean."""
    even, odd, variance, raw = picture(truth, np.broadcast_to(sigma, truth.shape), seed)
    return combine(even, odd, smooth(even), smooth(odd), variance), raw


def test_where_the_filter_is_right_it_is_taken_and_where_it_is_wrong_the_render() -> None:
    """Left half flat, right half a fine texture that a filter wipes out: 20 × less squared error left, none lost right.

    64 × 64 pixels of σ = 1 about 100; the filter is a mean over 9 × 9 pixels of each half. Squared errors over 1500
    pixels have a standard deviation of 4 %.
    """
    rows, columns = np.mgrid[:64, :64]
    truth = 100 + np.where(columns < 32, 0.0, 20.0 * ((rows + columns) % 2))
    found, raw = combined(truth, 1.0, 1, lambda half: uniform_filter(half, 9))
    left, right = np.s_[:, :20], np.s_[:, 44:]
    assert np.mean((found.mean - truth)[left] ** 2) < 0.05
    assert np.mean((found.mean - truth)[right] ** 2) < 1.05 * np.mean((raw - truth)[right] ** 2)


def test_what_a_filter_takes_from_a_lamp_does_not_brighten_the_walls() -> None:
    """The lamp has 4/5 of the light and loses a twentieth: shared out over all pixels that would be a fifth of the
    walls' light. Both sums stay within 1e-12 of the render's, also in a black sky that is a hundred times as large."""
    walls, lamp = np.full((48, 40), 50.0), np.s_[20:28, 16:24]
    walls[lamp] = 6000.0
    for truth in (walls, np.pad(walls, 200)):
        found, raw = combined(
            truth, 0.02 * truth, 2, lambda half: np.where(half > 1000, 0.95, 1.0) * half
        )
        for some in ((truth > 0) & (truth < 100), truth > 100):
            assert found.mean[some].sum() == pytest.approx(raw[some].sum(), rel=1e-12)


def test_error_bars_hold_also_where_the_filter_is_wrong() -> None:
    """Gradient, edge and texture: |z| < 1 in 0.60 … 0.78, |z| < 2 in 0.90 … 0.97 of 8 × 4096 pixels. The filter keeps
    edges, as the network does."""
    rows, columns = np.mgrid[:64, :64]
    texture = np.where((rows < 20) & (columns > 40), 6.0 * (columns % 3), 0.0)
    truth, z = 50 + columns / 2 + 40.0 * (rows > 30) + texture, []
    for seed in range(8):
        found, _ = combined(truth, 0.02 * truth, seed, lambda half: median_filter(half, 5))
        z.append(np.abs(found.mean - truth) / np.sqrt(found.variance))
    assert 0.60 < np.mean(np.array(z) < 1) < 0.78
    assert 0.90 < np.mean(np.array(z) < 2) < 0.97


def test_a_pixel_where_the_filter_is_wrong_has_a_wider_error_bar_than_its_neighbours() -> None:
    """One bright pixel in 9 × 9, which a blur removes: its bar is at least 1.3 times that of a pixel three away, whose
    neighbourhood is the same (medians of 9 pixels, mean of 8 pictures)."""
    truth, wider = np.full((27, 27), 100.0), []
    spots = np.s_[4::9, 4::9]
    truth[spots] = 130.0
    for seed in range(8):
        found, _ = combined(truth, 10.0, seed, lambda half: gaussian_filter(half, 1.5))
        wider.append(np.median(np.sqrt(found.variance[spots] / found.variance[4::9, 7::9])))
    assert np.mean(wider) > 1.3


@pytest.mark.parametrize("brightest", [1e3, 1e6, 1e9, 1e12])
def test_error_bars_beside_a_firefly_are_numbers(brightest: float) -> None:
    """Sums over boxes that move along a row keep a rounding error of the firefly that they have left."""
    even, odd, variance, _ = picture(np.full((24, 40), 5.0), np.full((24, 40), 1e-6), 3)
    even[7, 11], variance[7, 11] = brightest, 0.25 * brightest**2
    smooth = (gaussian_filter(half, 1.0) for half in (even, odd))
    found = combine(even, odd, *smooth, variance)
    assert np.isfinite(found.mean).all() and np.isfinite(found.variance).all()
    assert (found.variance > 0).all()


def test_constant_light_stays_as_it_is() -> None:
    """Nothing to gain: not even the last digits move, whatever the filter says."""
    flat = np.full((20, 30), 7.25)
    found = combine(flat, flat, flat * 1.1, flat * 0.9, np.zeros_like(flat))
    np.testing.assert_array_equal(found.mean, flat)


@pytest.mark.parametrize("filters", [1, 3])
def test_bands_add_up_to_what_each_filter_detects(filters: int) -> None:
    """Random spectra and responses, channels changed by up to 30 %: electrons behind every filter to 1e-5."""
    random = np.random.default_rng(5)
    bands, weights = random.uniform(0.5, 2.0, (6, 7, 30)), np.zeros((filters, 30))
    for k in range(filters):
        weights[k] = np.exp(-(((np.arange(30) - 5 - 10 * k) / 5.0) ** 2))
    wanted = (bands @ weights.T) * random.uniform(0.9, 1.3, (6, 7, filters))
    found = bands_of_filters(bands, weights, wanted, np.ones(30))
    np.testing.assert_allclose(found @ weights.T, wanted, rtol=1e-5)


def test_a_pixel_without_light_gets_the_spectrum_of_the_picture() -> None:
    bands = np.ones((2, 2, 4)) * np.arange(1.0, 5.0)
    bands[0, 0] = 0.0
    made = bands_of_filters(
        bands, np.ones((1, 4)), np.full((2, 2, 1), 10.0), np.arange(1.0, 5.0)
    )
    np.testing.assert_allclose(made, np.ones((2, 2, 4)) * np.arange(1.0, 5.0))


def reference(variant: str) -> np.ndarray:
    """Irradiance of the Cornell box at 545 to 555 nm by plain Mitsuba (benchmarks/error_bar_coverage.py), (64, 64)."""
    use(choose_variant(variant))
    bands = choose_bands(CAMERA, 550.0, 10.0, "auto")
    scene = load_scene(BOX, bands, {"width": 64, "height": 64})
    radiance = np.load(DATA / "cornell_box_64.npz")["radiance"]
    return radiance * solid_angle_sr(scene.view, CAMERA) / 10.0


@pytest.mark.exhaustive
def test_the_cornell_box_is_nearer_to_its_reference_and_its_error_bars_hold() -> None:
    """64 × 64, 128 samples against 116 736, four renders: squared error over electrons, median ÷ 4, 95th percentile
    ÷ 2.5, mean not above the render's; the sum of the picture the same to 1e-3; |z| < 1 in 0.60 … 0.75, |z| < 2 in
    0.90 … 0.97. Of the sums over 8 × 8 pixels |z| < 1 in 0.60 … 0.84 by their own error, and in less than 0.55 by
    the error bars of their pixels in quadrature. Other seeds fail one of these in 100."""
    variant = skip_unless_usable("llvm_ad_spectral")
    truth = reference(variant)
    options = {
        **SMALL,
        "parameters": {"width": 64, "height": 64},
        "spp": 128,
        "variant": variant,
    }
    seen, z = truth < np.quantile(truth, 0.97), []  # without the lamp
    windows = [np.s_[r : r + 8, c : c + 8] for r in range(0, 64, 8) for c in range(0, 64, 8)]
    of_sums, in_quadrature = [], []
    for seed in range(1, 5):
        raw, smooth = (
            ms.render(BOX, CAMERA, EXPOSURE, denoise=d, seed=seed, **options)
            for d in (False, True)
        )
        before, after = (((x.data[..., 0] - truth) ** 2 / truth)[seen] for x in (raw, smooth))
        assert np.median(after) < np.median(before) / 4
        assert np.percentile(after, 95) < np.percentile(before, 95) / 2.5
        assert after.mean() < before.mean()
        assert smooth.data.sum() == pytest.approx(raw.data.sum(), rel=1e-3)
        light = smooth.data[..., 0].astype(float)
        z.append(np.abs(light - truth) / (smooth.relative_error * light))
        for window in windows:
            off, bars = light[window].sum() - truth[window].sum(), smooth.relative_error * light
            of_sums.append(abs(off) / (smooth.error_of_sum(window) * light[window].sum()))
            in_quadrature.append(abs(off) / np.sqrt((bars[window] ** 2).sum()))
        assert smooth.statistics.sum_error == pytest.approx(smooth.error_of_sum(), rel=1e-3)
        found = smooth.statistics
        assert found.noise_ratio_median < raw.statistics.noise_ratio_median / 3
        assert found.denoised is not None
        was = found.denoised["raw_noise_ratio_median"]
        assert was == pytest.approx(raw.statistics.noise_ratio_median)
    assert 0.60 < np.mean(np.array(z) < 1) < 0.75 and 0.90 < np.mean(np.array(z) < 2) < 0.97
    assert (
        0.60 < np.mean(np.array(of_sums) < 1) < 0.84 and np.mean(np.array(of_sums) < 2) > 0.91
    )
    assert np.mean(np.array(in_quadrature) < 1) < 0.55


@pytest.mark.exhaustive
def test_a_textured_floor_is_denoised_without_its_texture() -> None:
    """Still life, chequered cloth, 96 × 64, 64 samples against 2048: squared errors ÷ 2.2 in the median, and half.

    Against 4096 samples, five seeds give 2.4 to 2.8 and 2.3 to 2.4.
    """
    scene, options = SCENES / "still_life.xml", {"width": 96, "wavelength_nm": 550}
    options["variant"] = skip_unless_usable("llvm_ad_spectral")
    truth = ms.render(scene, CAMERA, EXPOSURE, spp=2048, seed=3, denoise=False, **options).data
    raw, smooth = (
        ms.render(scene, CAMERA, EXPOSURE, spp=64, denoise=d, **options).data
        for d in (False, True)
    )
    before, after = ((x - truth.astype(float)) ** 2 / truth for x in (raw, smooth))
    assert np.median(after) < np.median(before) / 2.2 and after.mean() < before.mean() / 2


@pytest.mark.parametrize(
    ("scene", "options"),
    [
        # A flat field has no noise but that of λ within its band, 3e-4 of the light.
        ("flat_field", {"spp": 32}),
        ("cornell_box", {"parameters": {"width": 1, "height": 1}}),
        ("cornell_box", {"parameters": {"width": 12, "height": 14}}),
        ("cornell_box", {"spp": 3}),
    ],
)
def test_light_that_cannot_be_improved_is_left_alone(
    scene: str, options: dict[str, Any]
) -> None:
    """One pixel that was denoised claimed a twentieth of its variance, and was the render itself."""
    asked = SCENES / f"{scene}.xml", CAMERA, EXPOSURE
    plain, smooth = (
        ms.render(*asked, denoise=d, **{**SMALL, **options}) for d in (False, True)
    )
    assert smooth.statistics.denoised is None
    for name in ("data", "standard_error", "relative_error"):
        np.testing.assert_array_equal(getattr(smooth, name), getattr(plain, name))


def test_bands_of_a_mosaic_give_the_electrons_of_its_filters() -> None:
    """Collected with the camera's own QE the bands are the denoised photoelectrons; the error bars of the bands are
    finite, and none is below what it has in common with the photoelectrons."""
    camera = ms.load_camera("bayer_2mp")
    options = {**SMALL, "spp": 32, "wavelength_nm": None, "bandwidth_nm": 100, "denoise": True}
    light = ms.render(BOX, camera, EXPOSURE, **options)
    photons = photons_per_irradiance(
        camera, EXPOSURE, light.wavelengths_nm, light.bandwidths_nm
    )
    index = np.asarray(camera.filter_index((24, 24), (0, 0)))
    weights = (camera.qe(light.wavelengths_nm, light.bandwidths_nm) * photons)[index]
    flat = (light.data * weights).sum(axis=-1)
    electrons = mean_electrons(light, camera, EXPOSURE)
    np.testing.assert_allclose(flat * light.in_band, electrons, rtol=1e-5)
    assert np.isfinite(light.standard_error).all() and (light.standard_error > 0).mean() > 0.99
    common = light.relative_error[..., None] * light.data
    assert (light.standard_error >= 0.999 * common).all()


def guided(scene: Any, filters: int = 1, nm: float = 550.0, **options: Any) -> np.ndarray:
    """Albedo and normal of a scene, by 16 rays a pixel."""
    asked = {"wavelength_nm": 550, "variant": skip_unless_usable("llvm_ad_spectral"), **options}
    loaded = prepare(scene, CAMERA, EXPOSURE, **asked).scene
    assert isinstance(loaded, Scene)
    wavelengths_nm = nm + np.arange(4.0) * np.ones((filters, 1))
    return trace_guides(loaded, wavelengths_nm, 1, 16, (0, loaded.view.crop_size[1]))


def test_albedo_is_seen_through_a_mirror_and_averaged_over_the_pixel(tmp_path: Path) -> None:
    """A mirror over the whole view that shows a wall of albedo 0.4 behind the camera: 0.4, not the mirror's 1."""
    wall = '<bsdf type="twosided"><bsdf type="diffuse"><spectrum name="reflectance" value="0.4"/></bsdf></bsdf>'
    at = '<shape type="rectangle"><transform name="to_world"><scale value="99"/><translate z="{z}"/></transform>'
    at += "{bsdf}</shape>"
    mirror = at.format(z=-9, bsdf='<bsdf type="twosided"><bsdf type="conductor"/></bsdf>')
    scene = scene_text('<emitter type="constant"/>', mirror, at.format(z=9, bsdf=wall))
    found = guided(write_scene(tmp_path, scene))
    assert found.shape[2] == 4
    np.testing.assert_allclose(found[..., 0], 0.4, atol=1e-5)


def test_guides_of_other_light_and_more_filters_compile_and_trace_no_more() -> None:
    """Their wavelengths follow from the rendered light; every render would compile the guides anew, for as long as all
    of a small render takes."""
    kernels, dr = [], drjit()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for filters, nm in ((1, 550.0), (3, 550.0), (3, 617.3)):
            dr.kernel_history_clear()
            guided(BOX, filters, nm, width=32)
            kernels.append([k["hash"] for k in dr.kernel_history([dr.KernelType.JIT])])
    assert kernels[1] and {*kernels[2]} <= {*kernels[1]}
    assert len(kernels[1]) <= len(kernels[0]) + 2  # two more sums over the rays of a pixel


def test_without_the_library_the_render_is_raw_and_asked_for_it_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And before the render, not after it."""
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    found = ms.render(BOX, CAMERA, ms.Exposure(1.0), **SMALL)
    assert found.statistics.denoised is None
    assert any("not denoised" in note for note in found.notes)
    plain = ms.render(BOX, CAMERA, ms.Exposure(1.0), denoise=False, **SMALL)
    assert not any("not denoised" in note for note in plain.notes)
    with pytest.raises(ms.InputError, match="pip install pyoidn"):
        ms.render(BOX, CAMERA, EXPOSURE, denoise=True, **{**SMALL, "spp": 10**6})


@pytest.mark.parametrize("camera", one_in(2, ["konnik_table1", "bayer_2mp"]))
def test_raw_light_beside_the_denoised_one_is_the_render_without_denoising(camera: str) -> None:
    """Bit for bit, with its standard errors, and the denoised light is what it is without it."""
    options = {**SMALL, "wavelength_nm": None, "bandwidth_nm": 100}
    scene = BOX, ms.load_camera(camera), EXPOSURE
    both, smooth = (
        ms.render(*scene, raw_light=kept, denoise=True, **options) for kept in (True, False)
    )
    plain = ms.render(*scene, denoise=False, raw_light=True, **options)
    assert both.raw is not None and smooth.raw is None and plain.raw is None
    assert plain.before_denoising() is plain
    for name in ("data", "standard_error", "relative_error", "in_band", "pass_error"):
        raw = getattr(both.raw, name)
        np.testing.assert_array_equal(raw, getattr(plain, name), err_msg=name)
        np.testing.assert_array_equal(getattr(both, name), getattr(smooth, name), err_msg=name)
    timed = {"seconds": 0.0, "seconds_per_sample": 0.0}
    same = [
        replace(one.statistics, **timed, brightness=None, notes=()) for one in (both.raw, plain)
    ]
    assert same[0] == same[1]


def test_an_exposure_takes_raw_light_where_it_is_asked_for() -> None:
    both = ms.render(BOX, CAMERA, EXPOSURE, raw_light=True, denoise=True, **SMALL)
    smooth, raw = (ms.capture(both, CAMERA, EXPOSURE, raw_light=x) for x in (False, True))
    np.testing.assert_array_equal(smooth.photons.mean, ms.collect(both, CAMERA, EXPOSURE).mean)
    np.testing.assert_array_equal(raw.photons.mean, ms.collect(both.raw, CAMERA, EXPOSURE).mean)
    denoised = smooth.metadata["render"]["denoised"]
    assert denoised["by"].startswith("Open Image Denoise") and denoised["guided"] is False
    assert raw.metadata["render"]["denoised"] is None
    name = "over_sensor_median"
    assert smooth.metadata["render_noise"][name] < raw.metadata["render_noise"][name]
    with pytest.raises(ms.InputError, match="render it again with raw_light=True"):
        ms.capture(replace(both, raw=None), CAMERA, EXPOSURE, raw_light=True)
