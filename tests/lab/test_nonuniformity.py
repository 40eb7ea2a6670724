"""DSNU1288, PRNU1288 and the paper's σ/µ against what went into the frames; what cannot be measured is marked."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from helpers.lab_frames import Sigmas, frames, noise, stack

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import highpass, highpass_power, nonuniformity
from mitsuba_sensor.lab.statistics.mean_squares import MeanSquare, combined, root

DSNU, PRNU = Sigmas(1.0, 2.0, 1.5), Sigmas(0.2, 0.3, 0.5)
PARTS = (
    "dsnu",
    "dsnu_row",
    "dsnu_col",
    "dsnu_pixel",
    "prnu",
    "prnu_row",
    "prnu_col",
    "prnu_pixel",
    "paper",
)
KNOWN = dict(zip(PARTS, (DSNU.total, *DSNU, PRNU.total, *PRNU, PRNU.total), strict=True))
QUIET = Sigmas(0, 0, 2)


def pair(
    rng: np.random.Generator, shape: tuple[int, int], count: int, row_noise: float = 0.0
) -> tuple[Stack, Stack]:
    """Dark and light stacks of 12 bits: DSNU in DN, PRNU in percent of 1500 DN."""
    dark = 100 + noise(rng, shape, DSNU)
    light = dark + 1500 * (1 + noise(rng, shape, PRNU) / 100)
    stacks = (
        frames(rng, mean, count, Sigmas(row_noise, 0, one))
        for mean, one in ((dark, 2.0), (light, 11.0))
    )
    dark_frames, light_frames = stacks
    return stack(dark_frames), stack(light_frames)


@pytest.mark.exhaustive
def test_intervals_cover_what_went_in_95_times_in_100() -> None:
    """600 pairs of 32 × 40 pixels, 8 frames, with temporal row noise: of each of 9 shares, chance leaves ±3.4 % once in
    7000 runs."""
    rng = np.random.default_rng(1)
    covered = dict.fromkeys(PARTS, 0)
    values: dict[str, list[float]] = {name: [] for name in PARTS}
    for _ in range(600):
        found = nonuniformity(*pair(rng, (32, 40), 8, row_noise=0.7))
        for name, known in KNOWN.items():
            covered[name] += getattr(found, name).covers(known)
            values[name].append(getattr(found, name).value ** 2)
    for name, known in KNOWN.items():
        assert covered[name] / 600 == pytest.approx(0.95, abs=0.034), name
        assert np.mean(values[name]) == pytest.approx(
            known**2, abs=4.5 * np.std(values[name]) / 600**0.5
        ), name


def test_a_single_term_has_the_chi_square_interval_of_a_variance() -> None:
    assert combined([MeanSquare(3.0, 7.0)]) == pytest.approx(
        (3.0, *21 / scipy.stats.chi2.ppf([0.975, 0.025], 7))
    )
    assert root([MeanSquare(-1.0, 7.0)])[0] == 0


def test_the_share_that_the_filter_leaves_is_that_of_white_noise() -> None:
    rng = np.random.default_rng(10)
    line, _, pixel = highpass_power()
    image = rng.normal(size=(700, 700))
    assert highpass(image).var() / image.var() == pytest.approx(pixel, rel=0.01)
    columns = np.repeat(rng.normal(size=(1, 40_000)), 40, axis=0)
    assert highpass(columns).var() / columns.var() == pytest.approx(line, rel=0.02)
    with pytest.raises(ms.InputError, match="at least 38 rows"):
        highpass(np.zeros((37, 100)))


def test_correlated_columns_widen_their_interval() -> None:
    """Autoregressive column offsets, ρ₁ = 0.9, of 150 chips: 90 % are covered, and fewer than half by the chi-square
    law of independent columns; 80 % is reached but once in 3000 runs."""
    rng = np.random.default_rng(11)
    covered = 0
    for _ in range(150):
        steps = rng.normal(size=400) * (1 - 0.81) ** 0.5
        columns = np.zeros(400)
        for j in range(1, 400):
            columns[j] = 0.9 * columns[j - 1] + steps[j]
        mean = 100 + 3 * columns[None, 200:] + noise(rng, (20, 200), Sigmas(0, 0, 1.0))
        dark = Stack(frames(rng, mean, 4, QUIET), 0.1)
        covered += nonuniformity(dark, Stack(dark.frames + 1000, 0.1)).dsnu_col.covers(3.0)
    assert covered >= 0.8 * 150


def test_frames_that_cannot_show_it_are_marked_or_refused() -> None:
    """One frame has an upper limit, clipped ones no value, a line of pixels no parts."""
    rng = np.random.default_rng(3)
    dark, light = pair(rng, (40, 50), 4)
    single = nonuniformity(Stack(dark.frames[:1], 0.1), Stack(light.frames[:1], 0.1))
    assert math.isnan(single.dsnu_pixel.value) and single.dsnu_pixel.high > DSNU.pixel
    assert "pass at least 2" in single.prnu.note and single.paper_raw.value > 0
    full = nonuniformity(dark, Stack(np.full_like(dark.frames, 4095), 0.1, bits=12))
    assert math.isnan(full.prnu.value) and "every value is 4095 DN" in full.prnu.note
    assert full.dsnu.value > 0 and not full.dsnu.note
    cut = Stack(np.maximum(dark.frames.astype(int) - 99, 0).astype(np.uint16), 0.1)
    assert "are 0: the black level is too low" in nonuniformity(cut, light).dsnu.note
    half = Stack(np.minimum(light.frames, 1600), 0.1)
    assert "at the largest code 1600" in nonuniformity(dark, half).prnu.note
    line = nonuniformity(*(one.window(slice(0, 1), slice(None)) for one in (dark, light)))
    assert line.dsnu.value > 0 and math.isnan(line.dsnu_row.value)
    corner = dark.window(slice(0, 5), slice(0, 5))
    pixel = [one.window(slice(0, 1), slice(0, 1)) for one in (dark, light)]
    for given, said in (
        ((dark, Stack(light.frames, 0.2)), "same size and exposure time"),
        ((dark, corner), "light of 5 × 5"),
        ((light, dark), "dark stack first"),
        (pixel, "one pixel has no"),
    ):
        with pytest.raises(ms.InputError, match=said):
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
