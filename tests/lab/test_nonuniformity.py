"""DSNU1288, PRNU1288 and the paper's σ/µ against what went into the frames; outliers, coarse codes, uneven light."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from helpers.lab_frames import Sigmas, frames, noise, rounded, stack
from helpers.small_cameras import SmallCamera

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import highpass, highpass_power, nonuniformity
from mitsuba_sensor.lab.measure.profiles import profiles
from mitsuba_sensor.lab.measure.spectrogram import spectrograms
from mitsuba_sensor.lab.statistics.mean_squares import MeanSquare, combined, root
from mitsuba_sensor.lab.statistics.outliers import outliers
from mitsuba_sensor.lab.twin.evidence import CombinedMap

DSNU, PRNU = Sigmas(1.0, 2.0, 1.5), Sigmas(0.2, 0.3, 0.5)
PARTS = [f"{name}{end}" for name in ("dsnu", "prnu") for end in ("", "_row", "_col", "_pixel")]
TRUE = (DSNU.total, *DSNU, PRNU.total, *PRNU, PRNU.total)
KNOWN = dict(zip([*PARTS, "paper"], TRUE, strict=True))


def pair(
    rng: np.random.Generator, shape: tuple[int, int], count: int, row_noise: float = 0.0
) -> tuple[Stack, Stack]:
    """Dark and light stacks of 12 bits: DSNU in DN, PRNU in percent of 1500 DN."""
    dark = 100 + noise(rng, shape, DSNU)
    light = dark + 1500 * (1 + noise(rng, shape, PRNU) / 100)
    dark_frames, light_frames = (
        stack(frames(rng, mean, count, Sigmas(row_noise, 0, sigma)))
        for mean, sigma in ((dark, 2.0), (light, 11.0))
    )
    return dark_frames, light_frames


@pytest.mark.exhaustive
def test_intervals_cover_what_went_in_95_times_in_100() -> None:
    """600 pairs of 32 × 40 pixels, 8 frames, with temporal row noise: of each of 9 shares, chance leaves ±3.4 % once in
    7000 runs."""
    rng = np.random.default_rng(1)
    found = [nonuniformity(*pair(rng, (32, 40), 8, row_noise=0.7)) for _ in range(600)]
    for name, known in KNOWN.items():
        figures = [getattr(one, name) for one in found]
        squares = [figure.value**2 for figure in figures]
        assert np.mean([x.covers(known) for x in figures]) == pytest.approx(0.95, abs=0.034), (
            name
        )
        error = 4.5 * np.std(squares) / 600**0.5
        assert np.mean(squares) == pytest.approx(known**2, abs=error), name


def test_a_single_term_has_the_chi_square_interval_of_a_variance() -> None:
    ends = 21 / scipy.stats.chi2.ppf([0.975, 0.025], 7)
    assert combined([MeanSquare(3.0, 7.0)]) == pytest.approx((3.0, *ends))
    assert root([MeanSquare(-1.0, 7.0)])[0] == 0
    assert root([MeanSquare(1.0, 50.0), MeanSquare(-4.0, 50.0)])[2] > 0


def test_the_share_that_the_filter_leaves_is_that_of_white_noise() -> None:
    rng = np.random.default_rng(10)
    line, _, pixel = highpass_power()
    image = rng.normal(size=(700, 700))
    assert highpass(image).var() / image.var() == pytest.approx(pixel, rel=0.01)
    columns = np.repeat(rng.normal(size=(1, 40_000)), 40, axis=0)
    assert highpass(columns).var() / columns.var() == pytest.approx(line, rel=0.02)


def test_correlated_columns_widen_their_interval() -> None:
    """Autoregressive column offsets, ρ₁ = 0.9, of 80 chips: 90 % are covered, and fewer than half by the chi-square
    law of independent columns; 78 % is reached but once in 1000 runs."""
    rng, covered = np.random.default_rng(11), 0
    for _ in range(80):
        steps = rng.normal(size=400) * (1 - 0.81) ** 0.5
        columns = 3 * scipy.signal.lfilter([1], [1, -0.9], steps)[200:]
        mean = 100 + columns + noise(rng, (20, 200), Sigmas(0, 0, 1.0))
        dark = Stack(frames(rng, mean, 4, Sigmas(0, 0, 2)), 0.1)
        covered += nonuniformity(dark, Stack(dark.frames + 1000, 0.1)).dsnu_col.covers(3.0)
    assert covered >= 0.78 * 80


def test_frames_that_cannot_show_it_are_marked_or_refused() -> None:
    """One frame has an upper limit, clipped ones no value, a line of pixels no parts."""
    dark, light = pair(np.random.default_rng(3), (40, 50), 4)
    single = nonuniformity(Stack(dark.frames[:1], 0.1), Stack(light.frames[:1], 0.1))
    assert math.isnan(single.dsnu_pixel.value) and single.dsnu_pixel.high > DSNU.pixel
    assert "one frame" in single.prnu.note and single.paper_raw.value > 0
    full = nonuniformity(dark, Stack(np.full_like(dark.frames, 4095), 0.1, bits=12))
    assert math.isnan(full.prnu.value) and "every value is 4095 DN" in full.prnu.note
    assert full.dsnu.value > 0 and not full.dsnu.note
    cut = Stack(np.maximum(dark.frames.astype(int) - 99, 0).astype(np.uint16), 0.1)
    assert "black level is too low" in nonuniformity(cut, light).dsnu.note
    half = Stack(np.minimum(light.frames, 1600), 0.1)
    assert "largest code 1600" in nonuniformity(dark, half).prnu.note
    line = nonuniformity(*(one.window(slice(0, 1), slice(None)) for one in (dark, light)))
    assert line.dsnu.value > 0 and math.isnan(line.dsnu_row.value)
    pixel = [one.window(slice(0, 1), slice(0, 1)) for one in (dark, light)]
    corner = dark.window(slice(0, 5), slice(0, 5))
    for given in ((dark, Stack(light.frames, 0.2)), (dark, corner), (light, dark), pixel):
        with pytest.raises(ms.InputError):
            nonuniformity(*given)


def test_figures_are_what_went_in_and_raw_ones_have_the_noise_of_the_mean() -> None:
    """Three half widths of each interval, once in 10⁸; of the paper's σ/µ averaging leaves σ²/N of both."""
    found = nonuniformity(*pair(np.random.default_rng(2), (100, 120), 8))
    for name, known in KNOWN.items():
        figure = getattr(found, name)
        assert abs(figure.value - known) < 1.5 * (figure.high - figure.low), name
    noise_percent = 100 * math.sqrt((11**2 + 2**2 + 2 / 12) / 8) / 1500
    raw = math.hypot(found.paper.value, noise_percent)
    assert found.paper_raw.value == pytest.approx(raw, rel=0.01)


@pytest.mark.parametrize("fall", [0.0, 0.05, 0.2])
def test_uneven_light_is_filtered_out_of_prnu_and_out_of_the_map_of_a_twin(fall: float) -> None:
    """Light that falls off to the corners; PRNU 1 %. A window too small for the filter has a note."""
    y, x = np.meshgrid(np.linspace(-1, 1, 100), np.linspace(-1, 1, 120), indexing="ij")
    rng, camera = np.random.default_rng(3), SmallCamera(prnu=0.01)
    light = 8000 * (1 - 0.5 * fall * (x**2 + y**2))
    lit, dark = (camera.stack(rng, photons, 16, (100, 120)) for photons in (light, 0.0))
    found = nonuniformity(dark, lit)
    assert found.prnu.value == pytest.approx(1.0, rel=0.04)
    assert found.prnu_col.value < 0.1 and ("uneven by" in found.prnu.note) == bool(fall)
    assert found.difference.std() / found.difference.mean() < 0.0125
    corner = [one.window(slice(0, 30), slice(0, 30)) for one in (dark, lit)]
    assert ("which is part of it" in nonuniformity(*corner).prnu.note) == bool(fall)


def test_weak_flicker_widens_prnu_and_strong_flicker_hides_it() -> None:
    """A lamp before a rolling shutter that flickers by 0.1 or 3 %, PRNU 1 % of 2000 DN."""
    rng, pattern = np.random.default_rng(6), np.random.default_rng(7).normal(size=(96, 100))
    phase = rng.random((8, 1, 1)) + np.arange(96)[:, None] / 40
    dark = Stack(np.rint(100 + rng.normal(0, 2, (8, 96, 100))), 0.1)
    for flicker, shown in ((0.001, True), (0.03, False)):
        light = 2000 * (1 + 0.01 * pattern + flicker * np.sin(2 * np.pi * phase))
        found = nonuniformity(dark, Stack(np.rint(100 + rng.normal(light, 10)), 0.1))
        assert math.isfinite(found.prnu.value) == shown and "flicker" in found.prnu.note
        assert found.prnu_pixel.covers(1.0) and (not shown or found.prnu.covers(1.0))


@pytest.mark.parametrize("count", [5, 40])
def test_hot_pixels_do_not_hide_prnu(count: int) -> None:
    """Up to 0.1 % of 40 000 pixels with 500 to 3500 DN, most of them clipped in the flat field; with them PRNU1288 was
    0 (0 to 0)."""
    rng = np.random.default_rng(count)
    dark = 100 + noise(rng, (160, 250), Sigmas(0.5, 1.0, 2.0))
    dark.flat[rng.choice(dark.size, count, replace=False)] += rng.uniform(500, 3500, count)
    light = dark + 2000 * (1 + noise(rng, dark.shape, Sigmas(0.1, 0.2, 0.5)) / 100)
    stacks = (
        Stack(rounded(frames(rng, mean, 8, Sigmas(0, 0, sigma))), 0.1, bits=12)
        for mean, sigma in ((dark, 2.0), (light, 12.0))
    )
    found = nonuniformity(*stacks)
    assert found.prnu_pixel.covers(0.5) and found.dsnu_pixel.covers(2.0), str(found.prnu_pixel)
    assert found.prnu_pixel.high < 1.1 * found.prnu_pixel.low
    assert f"without {count} outlying pixels" in found.prnu.note


def test_hot_pixels_do_not_hide_columns_in_a_spectrogram_or_a_slope_in_a_profile() -> None:
    """Only columns: F is 1.44; 40 hot pixels made the spectrum white. A slope of 5 DN has an interval of ±1 DN."""
    rng, shape = np.random.default_rng(2), (160, 250)
    image = 100 + noise(rng, shape, Sigmas(0, 3, 0.1))
    hot = rng.choice(image.size, 40, replace=False)
    image.flat[hot] = rng.uniform(0, 4095, 40)
    _, along_columns = spectrograms(Stack(image[None], 0.1))
    assert along_columns.non_whiteness.value > 100 and "40" in along_columns.non_whiteness.note
    tilted = 100 + np.linspace(-2.5, 2.5, shape[1]) + noise(rng, shape, Sigmas(0, 0, 3.0))
    tilted.flat[hot] = 3000
    horizontal, _ = profiles(Stack(tilted[None], 0.1))
    assert horizontal.slope.covers(5) and horizontal.slope.high - horizontal.slope.low < 1
    assert horizontal.largest.max() == 3000


@pytest.mark.parametrize("cv", [0.1, 0.4])
def test_the_tail_of_a_log_normal_dark_current_is_no_defect(cv: float) -> None:
    """What is left out of 90 000 pixels has less than 2 % of the variance, and of a normal pattern nothing."""
    rng, width = np.random.default_rng(3), np.log(1 + cv**2) ** 0.5
    image = 100 * np.exp(width * rng.normal(size=(300, 300)) - width**2 / 2)
    assert image[~outliers(image)].var() > 0.98 * image.var()
    assert not outliers(rng.normal(100, 100 * cv, (300, 300))).any()


def test_the_map_of_a_twin_keeps_its_hot_pixels_and_the_spread_of_the_others() -> None:
    image = noise(np.random.default_rng(5), (100, 100), Sigmas(0, 0, 0.005)) + 1
    image[5, 6] = 0.0
    gains = CombinedMap(image, ())
    value, low, high = gains.spread()["pixel"]
    assert low < 0.005 < high and value == pytest.approx(0.005, rel=0.03)
    assert gains.parts()["pixel"][5, 6] == pytest.approx(-1, abs=0.02)
