"""Irradiance against closed forms and direct integration, and the honesty of its error bars.

Single-band renders of a uniform scene have no Monte Carlo noise at all: they hold to float32. Cubes have the noise of
drawing wavelengths; their bounds are at least four standard errors, so that with the fixed seeds, and for most other
seeds, chance does not fail them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import (
    BALL,
    SCENES,
    SKY,
    both_variants,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.render import samples
from mitsuba_sensor.render.light import bands as film
from mitsuba_sensor.render.light.photons import photons_per_irradiance
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.variants import choose_variant, use
from mitsuba_sensor.stages.effects.dark_current import mean_dark_e
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
SMALL = {"width": 16, "height": 16}


@both_variants
def test_flat_field_equals_closed_form(variant: str) -> None:
    """E = π·L/(4N²) [W m⁻² nm⁻¹], in every pixel to 1e-4 in one band of 10 nm, and per band of a cube to 0.1 %.

    A band of the cube has 256 pixels × 1024 samples × 4 wavelengths / 6 bands: about 2e-4 of standard error.
    """
    expected = math.pi * 2e-4 / (4 * 2.8**2)
    options = {"parameters": SMALL, "variant": skip_unless_usable(variant)}
    single = ms.render(
        SCENES / "flat_field.xml", CAMERA, EXPOSURE, wavelength_nm=550, spp=16, **options
    )
    assert single.data.shape == (16, 16, 1)
    np.testing.assert_allclose(single.data, expected, rtol=1e-4)
    cube = ms.render(
        SCENES / "flat_field.xml", CAMERA, EXPOSURE, bandwidth_nm=50, spp=1024, **options
    )
    np.testing.assert_allclose(cube.data.mean(axis=(0, 1)), expected, rtol=1e-3)


@scalar_first
def test_perspective_uniform_scene_falls_off_with_cos4(tmp_path: Path, variant: str) -> None:
    """Under a uniform sky E(x, y) = π·L/(4N²)·cos⁴θ, every pixel within 0.1 % (60° over 12 pixels, 9 nodes each)."""
    half = math.tan(math.radians(30)) / 6
    x, y = np.meshgrid(half * (np.arange(12) - 5.5), half * (np.arange(8) - 3.5))
    step = np.linspace(-0.5, 0.5, 9) * half
    fine = [(1 + (x + a) ** 2 + (y + b) ** 2) ** -2.0 for a in step for b in step]
    edge = np.array([0.5, *[1] * 7, 0.5]) / 8
    expected = (
        math.pi
        * 2e-4
        / (4 * 2.8**2)
        * np.average(fine, axis=0, weights=np.outer(edge, edge).ravel())
    )
    light = ms.render(
        write_scene(tmp_path, scene_text(SKY)),
        CAMERA,
        EXPOSURE,
        wavelength_nm=550,
        spp=16,
        variant=skip_unless_usable(variant),
    )
    np.testing.assert_allclose(light.data[..., 0], expected, rtol=1e-3)
    assert expected.min() / expected.max() < 0.6


@pytest.mark.parametrize("mended", one_in(2, [True, False]))
@scalar_first
def test_adjacent_bands_of_nearly_equal_height_are_unbiased(
    monkeypatch: pytest.MonkeyPatch, variant: str, mended: bool
) -> None:
    """31 bands of height 1 ± 3e-7 measure a uniform sky as 1 ± 0.6 %; without the repair some come out near 2.

    Rationale: Mitsuba inverts the density of wavelengths with a formula that cancels in float32 where neighbouring
    nodes are nearly equal. The noise looks the same with and without the repair, only the means tell.
    """
    mi = use(choose_variant(skip_unless_usable(variant)))
    if not mended:
        monkeypatch.setattr(film, "round_wavelength_density", lambda *_: None)
    edges, random = np.linspace(400, 710, 32), np.random.default_rng(3)
    heights = 1 + 3e-7 * random.standard_normal(31)
    responses = [
        {"type": "irregular", "wavelengths": f"{low}, {high}", "values": f"{h!r}, {h!r}"}
        for low, high, h in zip(
            edges.tolist(), edges[1:].tolist(), heights.tolist(), strict=False
        )
    ]
    sensor = {
        "type": "orthographic",
        "film": film.response_film(responses, SMALL),
        "sampler": {"type": "multijitter", "sample_count": 400},
    }
    sky = {
        "type": "regular",
        "wavelength_min": 360.0,
        "wavelength_max": 830.0,
        "values": "1, 1",
    }
    lit = {"type": "constant", "radiance": sky}
    scene = mi.load_dict(
        {"type": "scene", "path": {"type": "path"}, "sky": lit, "sensor": sensor}
    )
    image = mi.render(scene, seed=1, spp=400)
    bands = np.array(image).astype(float).mean(axis=(0, 1)) / 10
    if mended:
        np.testing.assert_allclose(bands, 1.0, atol=6e-3)
    else:
        assert bands.max() > 1.5


def test_same_seed_same_bits_and_another_seed_another_noise(tmp_path: Path) -> None:
    """One seed gives identical arrays; another moves every lit pixel by no more than six standard errors."""
    path = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf="")))
    a, b, c = (
        ms.render(
            path, CAMERA, EXPOSURE, bandwidth_nm=100, spp=64, seed=s, variant="scalar_spectral"
        )
        for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(a.data, b.data)
    assert (a.data != c.data).any()
    assert (
        np.abs(a.data - c.data) <= 6 * np.hypot(a.standard_error, c.standard_error) + 1e-12
    ).mean() > 0.98


def test_error_bars_cover_the_reference() -> None:
    """Twelve passes of a flat cube: |electrons − expected| < relative error in 59 to 74 % of pixels (t₁₁: 66 %).

    576 pixels: the fraction has a standard deviation of 2 %, so the bounds are 3.5 away.
    """
    light = ms.render(
        SCENES / "flat_field.xml",
        CAMERA,
        EXPOSURE,
        spp=144,
        bandwidth_nm=30,
        parameters={"width": 24, "height": 24},
        variant="scalar_spectral",
        denoise=False,
    )
    assert light.statistics.passes == 12
    weights = photons_per_irradiance(
        CAMERA, EXPOSURE, light.wavelengths_nm, light.bandwidths_nm
    )
    expected = math.pi * 2e-4 / (4 * 2.8**2) * weights.sum()
    covered = (
        np.abs(light.data @ weights * light.in_band - expected)
        < light.relative_error * expected
    )
    assert 0.59 < covered.mean() < 0.74


def test_noise_ratio_is_render_variance_over_the_variance_of_the_sensor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ratio = σ_e²/(N_e + dark + read noise²): for a quiet linear sensor, all electrons of variance at the input.

    Dark current of 174 e- in 0.1 s and 3 e- of read noise beside 16 000 e- of light; 1/12 DN² is 5 e-².
    """
    monkeypatch.setattr("mitsuba_sensor.theory.input_noise.LEVELS", 257)  # as users have it
    camera = CAMERA.replace(**{"readout.reset": "true_cds", "readout.ve_nonlinearity": 0.0})
    options = {
        "spp": 64,
        "bandwidth_nm": 60,
        "parameters": SMALL,
        "variant": "scalar_spectral",
        "denoise": False,
    }
    job = prepare(SCENES / "flat_field.xml", camera, EXPOSURE, **options)
    light = job.render(1, job.stop_criterion({"spp": 64}))
    electrons = 0.6 * (
        light.data
        @ photons_per_irradiance(camera, EXPOSURE, light.wavelengths_nm, light.bandwidths_nm)
    )
    k, read_noise = gain_dn_per_e(camera), SourceFollowerNoise.from_camera(camera)
    noise = (
        electrons
        + mean_dark_e(camera, EXPOSURE)
        + (read_noise.sigma_v / sense_gain_v_per_e(camera)) ** 2
    )
    variance = (
        (light.pass_error * electrons[..., 0]) ** 2
        if electrons.ndim > 2
        else (light.pass_error * electrons * light.in_band) ** 2
    )
    ratio = variance / (noise + 1 / 12 / k**2)
    found = light.statistics
    assert found.noise_ratio_median == pytest.approx(
        np.median(ratio) * 7 / 6.346, rel=2e-3
    )  # χ² of 7
    assert found.noise_ratio_max == pytest.approx(ratio.max(), rel=2e-3)
    assert found.noise_ratio_p95 == pytest.approx(np.percentile(ratio, 95), rel=2e-3)


def test_a_saturated_pixel_shows_no_render_noise() -> None:
    """Ten times the full well: whatever the render's error, the frame reads the same."""
    options = {"spp": 64, "bandwidth_nm": 60, "parameters": SMALL, "variant": "scalar_spectral"}
    light = ms.render(SCENES / "flat_field.xml", CAMERA, ms.Exposure(10.0), **options)
    assert light.statistics.noise_ratio_max == 0
    assert light.relative_error.min() > 0


def test_strips_of_rows_see_what_the_whole_film_sees(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Cut into strips of one and two rows, a single-band uniform scene keeps its cos⁴ in every pixel."""
    path, reports = write_scene(tmp_path, scene_text(SKY)), []
    options = {
        "wavelength_nm": 550,
        "spp": 16,
        "variant": "scalar_spectral",
        "denoise": True,
    }
    whole = ms.render(path, CAMERA, EXPOSURE, **options)
    monkeypatch.setattr(samples, "IN_FLIGHT_MAX", 12 * 2 * 2)
    cut = ms.render(path, CAMERA, EXPOSURE, **options, progress=reports.append)
    np.testing.assert_allclose(cut.data, whole.data, rtol=1e-5)
    rendering = [(step.done, step.most) for step in reports if step.doing == "rendering"]
    assert rendering == [(k, 32) for k in range(33)]


def test_crop_of_the_film_is_the_crop_of_the_picture(tmp_path: Path) -> None:
    """A crop window of the film gives those pixels of the full film, with their own cos⁴."""
    options = {"wavelength_nm": 550, "spp": 16, "variant": "scalar_spectral"}
    full = ms.render(write_scene(tmp_path, scene_text(SKY)), CAMERA, EXPOSURE, **options)
    crop = "".join(
        f'<integer name="crop_{k}" value="{v}"/>'
        for k, v in (("width", 3), ("height", 2), ("offset_x", 9), ("offset_y", 1))
    )
    part = ms.render(
        write_scene(tmp_path, scene_text(SKY, film=crop)), CAMERA, EXPOSURE, **options
    )
    np.testing.assert_allclose(part.data, full.data[1:3, 9:12], rtol=1e-5)
    assert any("crop" in note for note in part.statistics.notes)


def test_bad_values_of_the_renderer_are_counted_and_infinity_saturates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In every one of 8 passes: one NaN, one negative (both become 0), one +inf band (then its pixel is infinite)."""
    real = Scene.render

    def spoilt(self: Scene, *arguments: Any) -> np.ndarray:
        image = real(self, *arguments)
        image[0, 0, 0], image[0, 1, 0], image[1, 1, 1] = np.nan, -1.0, np.inf
        return image

    monkeypatch.setattr(Scene, "render", spoilt)
    light = ms.render(
        SCENES / "flat_field.xml",
        CAMERA,
        EXPOSURE,
        spp=16,
        bandwidth_nm=150,
        parameters={"width": 2, "height": 2},
        variant="scalar_spectral",
    )
    assert (light.statistics.negative, light.statistics.non_finite) == (8, 16)
    assert light.data[0, 0, 0] == 0 and light.data[0, 1, 0] == 0
    assert np.isinf(light.data[1, 1]).all() and np.isinf(light.relative_error[1, 1])
    assert np.isfinite(light.data).sum() == 6 and not np.isnan(light.data).any()
    assert math.isfinite(light.statistics.noise_ratio_max)


def test_cube_covers_the_band_of_the_camera_and_clips_its_last_band() -> None:
    light = ms.render(
        SCENES / "flat_field.xml",
        CAMERA,
        EXPOSURE,
        spp=8,
        bandwidth_nm=70,
        parameters={"width": 2, "height": 2},
        variant="scalar_spectral",
    )
    np.testing.assert_allclose(light.bandwidths_nm, [70, 70, 70, 70, 20])
    np.testing.assert_allclose(light.wavelengths_nm, [435, 505, 575, 645, 690])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"spp": 0}, "spp is 0"),
        ({"spp": 1.5}, "whole number"),
        ({"seed": -1}, "seed is -1"),
        ({"wavelength_nm": 150}, "wavelength_nm is 150"),
        ({"wavelength_nm": math.nan}, "wavelength_nm is nan"),
        ({"bandwidth_nm": -3}, "bandwidth_nm is -3"),
        ({"bandwidth_nm": 0}, "bandwidth_nm is 0"),
        ({"noise_ratio": 0}, "noise_ratio is 0"),
        ({"noise_ratio": math.nan}, "noise_ratio is nan"),
        ({"noise_ratio": 0.01, "spp": 64}, "noise_ratio is 0.01"),
        ({"spp": 64, "max_spp": 128}, "max_spp is 128"),
        ({"max_seconds": -1}, "max_seconds is -1"),
        ({"max_spp": 1}, "max_spp is 1"),
        ({"spectral": "colours"}, "spectral is 'colours'"),
        ({"spectral": "channels", "wavelength_nm": 550}, "a single band has no colour filters"),
        ({"variant": "scalar_rgb"}, "scalar_spectral"),
        ({"variant": "no_such"}, "scalar_spectral"),
        ({"parameters": {"widht": 3}}, "Did you mean 'width'"),
        ({"wavelength_nm": 1000}, "no light in the bands"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(ms.InputError) as caught:
        ms.render(
            SCENES / "flat_field.xml",
            CAMERA,
            EXPOSURE,
            **{"variant": "scalar_spectral", **options},
        )
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_the_error_of_a_sum_lies_between_its_pixels_in_quadrature_and_one_error_of_all(
    light: Any,
) -> None:
    """Even light: error bars of 1 %, of the passes 3 %. Of 4 denoised pixels the bound of one common error counts, of
    192 the passes in quadrature, 3 %/√192; with small errors of the passes the pixels' own in quadrature, 1 %/√192."""
    even = replace(
        light, data=np.ones_like(light.data), pass_error=np.full((12, 16), 0.03, np.float32)
    )
    denoised = replace(even, statistics=replace(light.statistics, denoised={"by": "a filter"}))
    corner, mask = np.s_[:2, :2], np.zeros((12, 16), bool)
    mask[5, 7] = True
    assert denoised.error_of_sum(corner) == pytest.approx(0.01, rel=1e-6)
    assert denoised.error_of_sum(mask) == pytest.approx(0.01, rel=1e-6)
    assert denoised.error_of_sum() == pytest.approx(0.03 / 192**0.5, rel=1e-6)
    assert even.error_of_sum(corner) == pytest.approx(0.03 / 2, rel=1e-6)
    small = replace(denoised, pass_error=np.full((12, 16), 1e-5, np.float32))
    assert small.error_of_sum() == pytest.approx(0.01 / 192**0.5, rel=1e-6)


def test_infinite_and_black_pixels_have_no_part_in_the_error_of_a_sum(light: Any) -> None:
    data, error = np.ones_like(light.data), np.full((12, 16), 0.03, np.float32)
    data[0], error[0], data[1] = np.inf, np.inf, 0.0
    mixed = replace(light, data=data, pass_error=error)
    assert mixed.error_of_sum() == pytest.approx(0.03 / 160**0.5, rel=1e-6)
    assert mixed.error_of_sum(np.s_[:2, :]) == 0.0


@pytest.mark.parametrize(
    "region",
    [np.s_[3:3, :], np.ones((3, 3), bool), 4, (4, 5), "all", np.zeros((12, 16), bool)],
    ids=["empty window", "mask of another size", "number", "pixel", "text", "empty mask"],
)
def test_a_region_that_is_none_is_refused(light: Any, region: Any) -> None:
    with pytest.raises(ms.InputError, match="it must be two slices"):
        replace(light, pass_error=light.relative_error).error_of_sum(region)


def test_light_from_elsewhere_has_no_error_of_a_sum(light: Any) -> None:
    with pytest.raises(ms.InputError, match="which this light does not hold"):
        light.error_of_sum()
