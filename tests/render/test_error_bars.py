"""The error bars, and the flag that says when not to trust them, against references of a hundred times the samples."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import DATA
from helpers.marks import exhaustive, one_in
from helpers.scenes import SCENES, scalar_first, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.optics.f_number_law import solid_angle_sr
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.light.statistics import pooled, summary_of, why_not_trusted
from mitsuba_sensor.render.load.scene import load_scene

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
REFERENCE = DATA / "cornell_box_64.npz"
GLASS = '<bsdf type="dielectric"/>'


def ball(centre: str, radius: float, made_of: str) -> str:
    place = f'<point name="center" value="{centre}"/><float name="radius" value="{radius}"/>'
    return f'<shape type="sphere">{place}{made_of}</shape>'


def at_550(scene: str, size: int, **options: object) -> ms.Irradiance:
    options |= {
        "wavelength_nm": 550,
        "parameters": {"width": size, "height": size},
        "denoise": False,
    }
    return ms.render(SCENES / f"{scene}.xml", CAMERA, EXPOSURE, **options)


@pytest.mark.exhaustive
def test_standard_errors_cover_a_reference_of_a_hundred_times_the_samples() -> None:
    """Cornell box, 64 × 64, 1152 samples: shares of the pixels with |z| < 1 and |z| < 2.

    The reference is plain Mitsuba with its own sampler and 116 736 samples (benchmarks/error_bar_coverage.py).
    Student's t of 31 degrees of freedom has 0.675 and 0.946; the light of the box is skewed, which costs 0.02 of both.
    Three seeds, 12 288 pixels: standard deviations of 0.004 and 0.002 about 0.656 and 0.929, so that other seeds would
    fail the first bound once in a dozen times, and never the others. A flat field has the quick test (test_irradiance),
    and two renders of the box another (test_stop_criterion).
    """
    variant = skip_unless_usable("llvm_ad_spectral")
    size = {"width": 64, "height": 64}
    lights = [
        at_550("cornell_box", 64, spp=1152, seed=seed, variant=variant) for seed in (7, 8, 9)
    ]
    view = load_scene(
        SCENES / "cornell_box.xml", choose_bands(CAMERA, 550.0, 10.0, "auto"), size
    ).view
    reference = np.load(REFERENCE)["radiance"] * solid_angle_sr(view, CAMERA) / 10.0
    z = np.abs(
        [(light.data[..., 0] - reference) / light.standard_error[..., 0] for light in lights]
    )
    assert 0.65 < (z < 1).mean() < 0.70 and 0.92 < (z < 2).mean() < 0.96
    assert all(light.statistics.reliable and light.statistics.passes == 8 for light in lights)


@scalar_first
@pytest.mark.parametrize("spp", one_in(4, [64, 256]))
def test_a_caustic_raises_the_flag_and_a_note_says_what_to_do(variant: str, spp: int) -> None:
    """A glass ball under a small lamp: one pixel in six owes most of its variance to one pass."""
    found = at_550("caustic", 24, spp=spp, variant=skip_unless_usable(variant)).statistics
    assert not found.reliable and found.firefly_fraction > 0.12
    assert any("enlarge the light" in note for note in found.notes)


@scalar_first
@pytest.mark.parametrize(
    "scene",
    one_in(3, ["cornell_box", "still_life", "color_checker", "step_wedge", "flat_field"]),
)
def test_ordinary_scenes_do_not_raise_it(variant: str, scene: str) -> None:
    found = at_550(scene, 24, spp=128, variant=skip_unless_usable(variant)).statistics
    assert found.reliable, found.firefly_fraction
    assert not any("error bars" in note for note in found.notes)


@pytest.mark.exhaustive
def test_unreliable_pixels_stay_as_samples_grow() -> None:
    """In the caustic, 12 to 13 % of the pixels are unreliable after 4096 samples, and 16 to 27 % after 64 and 256."""
    variant = skip_unless_usable("llvm_ad_spectral")
    assert at_550("caustic", 24, spp=4096, variant=variant).statistics.firefly_fraction > 0.1


@pytest.mark.parametrize(
    ("bulb", "spp"),
    [(True, 64), exhaustive(False, 512), exhaustive(False, 64), exhaustive(True, 512)],
)
def test_glass_in_the_cornell_box_raises_it(tmp_path: Path, bulb: bool, spp: int) -> None:
    """A mirror and a glass ball in place of the blocks, with the lamp of the box or with one in a glass bulb. Before
    references of 32 768 samples, 32 columns, |z| < 1 holds for 0.33 (64 samples) and 0.57 (512) of the pixels with the
    lamp, for 0.30 and 0.66 with the bulb, |z| < 2 for 0.59, 0.73, 0.38 and 0.85."""
    text = (SCENES / "cornell_box.xml").read_text(encoding="utf-8")
    text = re.sub(r'<shape type="cube">.*?</shape>', "", text, flags=re.DOTALL)
    balls = ball("-0.4, 0.45, -0.3", 0.45, '<bsdf type="conductor"/>') + ball(
        "0.45, 0.4, 0.3", 0.4, GLASS
    )
    [lamp] = re.findall(
        r'<shape type="rectangle">(?:(?!</shape>).)*<emitter.*?</shape>', text, flags=re.DOTALL
    )
    if bulb:
        [emitter] = re.findall(r"<emitter.*?</emitter>", lamp, flags=re.DOTALL)
        text = text.replace(
            lamp, ball("0, 1.3, 0", 0.06, emitter) + ball("0, 1.3, 0", 0.2, GLASS)
        )
    scene = write_scene(tmp_path, text.replace("</scene>", f"{balls}</scene>"))
    options = {
        "wavelength_nm": 550,
        "width": 24,
        "denoise": False,
        "variant": skip_unless_usable("llvm_ad_spectral"),
    }
    found = ms.render(scene, CAMERA, EXPOSURE, spp=spp, **options).statistics
    assert not found.reliable and found.firefly_fraction > 0.12


def test_few_passes_are_never_trusted() -> None:
    assert (
        not why_not_trusted(8, 0.0) and why_not_trusted(7, 0.0) and why_not_trusted(100, 0.13)
    )
    assert (
        "guesses" in why_not_trusted(2, 0.0)
        and "too small" in why_not_trusted(64, 0.13)
        and not why_not_trusted(64, 0.11)
    )


def test_the_median_is_freed_of_the_bias_of_few_passes() -> None:
    """χ² of 15 degrees of freedom over 15 has a median of 0.956; 40 000 pixels see 1 %."""
    measured = np.random.default_rng(5).chisquare(15, 40_000) / 15
    found = summary_of(measured, np.ones(40_000, bool), 16)
    assert np.median(measured) == pytest.approx(0.956, rel=0.01)
    assert found["noise_ratio_median"] == pytest.approx(1.0, rel=0.01)


def test_the_summary_leaves_infinite_and_dark_pixels_out() -> None:
    ratio, many = np.array([0.0, 1.0, 2.0, np.inf, 9.0]), 10**6
    found = summary_of(ratio, np.array([True, True, True, True, False]), many)
    assert (
        found["noise_ratio_median"] == pytest.approx(1.0, rel=1e-5)
        and found["noise_ratio_max"] == 2.0
    )
    assert summary_of(np.array([np.inf]), np.array([True]), 16)["noise_ratio_max"] == 0.0


PASSES = 8


def measured(variance: np.ndarray, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Errors of a mean of normal passes, and its variance as they measure it: χ² of 7 degrees of freedom."""
    noise = np.random.default_rng(seed).standard_normal((PASSES, *variance.shape))
    return noise.mean(axis=0) * np.sqrt(variance * PASSES), noise.var(axis=0, ddof=1) * variance


def test_where_all_pixels_are_alike_the_neighbours_are_believed() -> None:
    """The variance is off by a fifth instead of a half, and two standard errors hold for 95 % as of normal noise; 7
    degrees of freedom give 91.4 %. 10 000 pixels: a standard deviation of 0.3 %."""
    true = np.full((100, 100), 4.0)
    error, variance = measured(true)
    found = pooled(np.full(true.shape, 100.0), variance, PASSES)
    assert found.mean() == pytest.approx(4.0, rel=0.02)
    assert found.std() < 0.25 * 4 < 0.5 * variance.std() * 1.5
    assert (np.abs(error) < 2 * np.sqrt(found)).mean() == pytest.approx(0.945, abs=0.01)
    assert (np.abs(error) < 2 * np.sqrt(variance)).mean() == pytest.approx(0.914, abs=0.01)


def test_where_every_pixel_differs_each_keeps_its_own() -> None:
    """Variances that differ by factors of a hundred from pixel to pixel: no neighbour says anything. A measured log
    variance is itself off by 0.53 (χ² of 7)."""
    true = 10.0 ** np.random.default_rng(2).uniform(-2, 2, (100, 100))
    error, variance = measured(true)
    found = pooled(np.full(true.shape, 100.0), variance, PASSES)
    assert np.median(np.abs(np.log(found / variance))) < 0.3
    assert 0.90 < (np.abs(error) < 2 * np.sqrt(found)).mean() < 0.96


@pytest.mark.parametrize(("hits", "low"), [(8.0, 0.93), (4.0, 0.91), (1.6, 0.83)])
def test_bars_hold_where_few_paths_find_the_light(hits: float, low: float) -> None:
    """A light group that a pixel's paths find so many times at its brightest, in all passes together. Own variances
    hold for 0.78, 0.64 and 0.44 of the pixels at two standard errors, because a quarter of them find nothing, or half;
    6400 pixels: a standard deviation of 0.005."""
    rng, (y, x) = np.random.default_rng(4), np.mgrid[:80, :80]
    light = np.exp(-((x - 40) ** 2 + (y - 40) ** 2) / 900) + 0.05
    found = rng.poisson(hits / PASSES * light, (PASSES, *light.shape))
    passes = rng.gamma(np.maximum(2.0 * found, 1e-9), PASSES / 2 / hits) * (found > 0)
    mean, variance = passes.mean(axis=0), passes.var(axis=0, ddof=1) / PASSES
    sigma = np.sqrt(pooled(mean, variance, PASSES))
    assert 0.60 < (np.abs(mean - light) < sigma).mean() < 0.72
    assert low < (np.abs(mean - light) < 2 * sigma).mean() < 0.97
