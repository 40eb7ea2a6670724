"""Spectrograms keep the variance of the image; F is 1 for white noise and 1/ln 2 for columns; profiles of lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.profiles import profiles
from mitsuba_sensor.lab.measure.spectrogram import spectrograms


def test_the_mean_square_of_the_spectrogram_is_the_variance_of_the_image() -> None:
    """Parseval: over all 2N frequencies of the padded line, of which 1 to N − 1 occur twice."""
    image = np.random.default_rng(1).gamma(2.0, size=(40, 51)) * np.arange(1, 52)
    image += 300 * np.sin(2 * np.pi * 0.25 * np.arange(51))
    assert spectrograms(image)[0].amplitude[1:].argmax() + 1 == pytest.approx(0.5 * 51, abs=1)
    for one in spectrograms(image):
        power = one.amplitude**2
        mean = (2 * power.sum() - power[0] - power[-1]) / (2 * len(power) - 2)
        assert mean == pytest.approx(image.var(), rel=1e-12)
        assert one.frequency[[0, -1]].tolist() == [0, 0.5]


def test_white_noise_of_512_lines_has_1_0007_and_columns_1_over_ln_2() -> None:
    """8 spectra of 512 × 512 within 4 of their standard errors, 0.0016/√8 (0.0014 is published); 24 patterns of
    columns, 512 of them, within 4 of theirs, 0.071/√24."""
    rng = np.random.default_rng(3)
    images = (rng.normal(size=(512, 512)) for _ in range(4))
    white = [x.non_whiteness.value for image in images for x in spectrograms(image)]
    assert np.mean(white) == pytest.approx(1.0007, abs=4 * 0.0016 / 8**0.5)
    patterns = (np.tile(rng.normal(size=512), (8, 1)) for _ in range(24))
    columns = [spectrograms(pattern)[0].non_whiteness.value for pattern in patterns]
    assert np.mean(columns) == pytest.approx(1 / math.log(2), abs=4 * 0.071 / 24**0.5)


@pytest.mark.parametrize(
    ("lines", "column_sigma"),
    one_in(4, [(64, 1.0), (16, 0.0), (128, 0.0), (64, 0.2)], several=True),
)
def test_the_interval_of_f_covers_what_many_images_have_on_average(
    lines: int, column_sigma: float
) -> None:
    """300 images of 256 columns: shares within 4.2 % of 95 %, which chance leaves once in 1000 runs."""
    rng, found = np.random.default_rng(4), []
    for _ in range(300):
        columns = column_sigma * rng.normal(size=(1, 256))
        found.append(spectrograms(rng.normal(size=(lines, 256)) + columns)[0].non_whiteness)
    mean = float(np.mean([x.value for x in found]))
    assert np.mean([x.covers(mean) for x in found]) == pytest.approx(0.95, abs=0.042)


def test_images_without_a_spectrum_have_no_f() -> None:
    constant = spectrograms(np.full((20, 20), 7.0))[0].non_whiteness
    horizontal, vertical = spectrograms(np.random.default_rng(5).normal(size=(1, 300)))
    assert "1.443" in horizontal.non_whiteness.note
    for figure in (constant, vertical.non_whiteness):
        assert math.isnan(figure.value) and figure.note
    with pytest.raises(ms.InputError, match=r"Stack\.of_filters"):
        spectrograms(Stack(np.zeros((1, 4, 4)), 0.1, tile=(("R", "G"), ("G", "B"))))


def test_profiles_are_those_of_the_mean_image_less_the_dark() -> None:
    rng = np.random.default_rng(7)
    frames, dark = rng.integers(500, 600, (4, 9, 14)), rng.integers(90, 110, (3, 9, 14))
    image = frames.mean(axis=0) - dark.mean(axis=0)
    horizontal, vertical = profiles(Stack(frames, 0.1), Stack(dark, 0.1))
    for found, expected in (
        (horizontal.mean, image.mean(axis=0)),
        (horizontal.middle, image[4]),
        (vertical.largest, image.max(axis=1)),
        (vertical.smallest, image.min(axis=1)),
    ):
        np.testing.assert_allclose(found, expected)
    with pytest.raises(ms.InputError, match="shape"):
        profiles(Stack(frames, 0.1), Stack(dark[:, :3], 0.1))


def test_the_slope_of_a_profile_covers_the_gradient_that_went_in() -> None:
    """300 images with columns of 1 DN and 5 DN of gradient; 95 % ± 4.2 %, once in 1000 runs beyond."""
    rng, covered, ramp = np.random.default_rng(8), [], np.linspace(-2.5, 2.5, 40)
    for _ in range(300):
        image = 100 + ramp + rng.normal(size=(1, 40)) + rng.normal(size=(1, 20, 40))
        covered.append(profiles(Stack(image, 0.1))[0].slope.covers(5.0))
    assert np.mean(covered) == pytest.approx(0.95, abs=0.042)
    assert math.isnan(profiles(Stack(np.zeros((1, 2, 2)), 0.1))[0].slope.value)
