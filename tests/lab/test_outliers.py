"""A tenth of a per cent of arbitrary pixels does not move the figures of the others; long tails are no defects."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames, noise, rounded

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity
from mitsuba_sensor.lab.measure.profiles import profiles
from mitsuba_sensor.lab.measure.spectrogram import spectrograms
from mitsuba_sensor.lab.statistics.outliers import outliers
from mitsuba_sensor.lab.twin.evidence import CombinedMap

DSNU, PRNU = Sigmas(0.5, 1.0, 2.0), Sigmas(0.1, 0.2, 0.5)
SHAPE = 160, 250


def stacks_with_hot_pixels(
    rng: np.random.Generator, count: int, shape: tuple[int, int] = SHAPE
) -> tuple[Stack, Stack]:
    """12 bits, 8 frames, half saturation; so many pixels have an offset of 500 to 3500 DN, clipped in the light."""
    dark = 100 + noise(rng, shape, DSNU)
    hot = rng.choice(dark.size, count, replace=False)
    dark.flat[hot] += rng.uniform(500, 3500, count)
    light = dark + 2000 * (1 + noise(rng, shape, PRNU) / 100)
    in_dark, in_light = (
        rounded(frames(rng, mean, 8, Sigmas(0, 0, sigma)))
        for mean, sigma in ((dark, 2.0), (light, 12.0))
    )
    return Stack(in_dark, 0.1, bits=12), Stack(in_light, 0.1, bits=12)


@pytest.mark.parametrize("count", [5, 40])
def test_hot_pixels_do_not_hide_prnu(count: int) -> None:
    """Up to 0.1 % of 40 000 pixels, most of them clipped in the flat field; with them PRNU1288 was 0 (0 to 0)."""
    rng = np.random.default_rng(count)
    found = nonuniformity(*stacks_with_hot_pixels(rng, count))
    assert found.prnu_pixel.covers(0.5) and found.dsnu_pixel.covers(2.0), str(found.prnu_pixel)
    assert found.prnu_pixel.high < 1.1 * found.prnu_pixel.low
    assert f"without {count} pixels that stand out" in found.prnu.note
    assert "% with them" in found.prnu.note and "DN with them" in found.dsnu.note


def test_hot_pixels_do_not_hide_columns_in_a_spectrogram_or_a_slope_in_a_profile() -> None:
    """Only columns: F is 1.44; 40 hot pixels made the spectrum white. A slope of 5 DN has an interval of ±1 DN."""
    rng = np.random.default_rng(2)
    image = 100 + noise(rng, SHAPE, Sigmas(0, 3, 0.1))
    hot = rng.choice(image.size, 40, replace=False)
    image.flat[hot] = rng.uniform(0, 4095, 40)
    _, along_columns = spectrograms(Stack(image[None], 0.1))
    assert along_columns.non_whiteness.value > 100
    assert "without 40 pixels that stand out" in along_columns.non_whiteness.note
    tilted = 100 + np.linspace(-2.5, 2.5, SHAPE[1]) + noise(rng, SHAPE, Sigmas(0, 0, 3.0))
    tilted.flat[hot] = 3000
    horizontal, _ = profiles(Stack(tilted[None], 0.1))
    assert horizontal.slope.covers(5) and horizontal.slope.high - horizontal.slope.low < 1
    assert horizontal.largest.max() == 3000


@pytest.mark.parametrize("cv", [0.1, 0.4])
def test_the_tail_of_a_log_normal_dark_current_is_no_defect(cv: float) -> None:
    """What is left out of 90 000 pixels has less than 2 % of the variance, and of a normal pattern nothing."""
    rng = np.random.default_rng(3)
    width = np.log(1 + cv**2) ** 0.5
    image = 100 * np.exp(width * rng.normal(size=(300, 300)) - width**2 / 2)
    kept = image[~outliers(image)]
    assert kept.var() > 0.98 * image.var()
    assert not outliers(rng.normal(100, 100 * cv, (300, 300))).any()


def test_the_map_of_a_twin_keeps_its_hot_pixels_and_the_spread_of_the_others() -> None:
    rng = np.random.default_rng(5)
    image = noise(rng, (100, 100), Sigmas(0, 0, 0.005)) + 1
    image[5, 6] = 0.0
    gains = CombinedMap(image, ())
    value, low, high = gains.spread()["pixel"]
    assert low < 0.005 < high and value == pytest.approx(0.005, rel=0.03)
    pixels = gains.parts()["pixel"]
    assert pixels[5, 6] == pytest.approx(-1, abs=0.02)
