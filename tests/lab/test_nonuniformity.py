"""DSNU1288, PRNU1288 and the paper's σ/µ against what went into the frames; what cannot be measured is marked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames, noise, stack

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import highpass, highpass_power, nonuniformity
from mitsuba_sensor.lab.quantity import variance_interval
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


def test_the_papers_half_percent_reads_0_5128_raw_and_0_500_corrected() -> None:
    """Table 1's camera at 1520 DN above the dark, 64 frames of each: 0.5128 % is 0.5 % and 1/64 of the
    temporal variance. 60 000 pixels: 0.29 % of it is one standard error, four are left. Its columns have 33 e-, its
    pixels 1 % of the dark electrons."""
    camera, exposure, shape = ms.load_camera("konnik_table1"), ms.Exposure(0.1), (200, 300)
    dark, light = (
        ms.expose(
            np.full(shape, 1520 / 0.1241212 / 0.6 * lit),
            camera,
            exposure,
            frames=64,
            seed=1 + lit,
        ).digital
        for lit in (0, 1)
    )
    found = nonuniformity(Stack(dark, 0.1, bits=12), Stack(light, 0.1, bits=12))
    assert found.difference.mean() == pytest.approx(1520, rel=0.001)
    assert found.paper_raw.value == pytest.approx(0.5128, rel=0.012)
    for one in (found.paper, found.prnu_pixel):
        assert one.value == pytest.approx(0.5, rel=0.012) and one.covers(0.5)
    columns, pixels = (
        one.in_electrons(0.1241212) for one in (found.dsnu_col, found.dsnu_pixel)
    )
    assert columns.covers(33) and pixels.value == pytest.approx(1.7416, rel=0.03)
    assert found.dsnu_row.low == 0 and "not told from 0" in found.dsnu_row.note


def test_a_single_term_has_the_chi_square_interval_of_a_variance() -> None:
    assert combined([MeanSquare(3.0, 7.0)]) == pytest.approx(variance_interval(3.0, 7.0))
    assert root([MeanSquare(-1.0, 7.0)])[0] == 0


def test_one_frame_gives_no_value_but_an_upper_limit_and_says_why() -> None:
    rng = np.random.default_rng(3)
    dark, light = pair(rng, (40, 50), 4)
    found = nonuniformity(Stack(dark.frames[:1], 0.1), Stack(light.frames[:1], 0.1))
    assert math.isnan(found.dsnu_pixel.value) and found.dsnu_pixel.high > DSNU.pixel
    assert "pass at least 2" in found.prnu.note and found.paper_raw.value > 0


def test_clipped_frames_are_marked_and_saturated_ones_have_no_value() -> None:
    rng = np.random.default_rng(5)
    dark, light = pair(rng, (40, 50), 4)
    black, full = (Stack(np.full_like(dark.frames, level), 0.1, bits=12) for level in (0, 4095))
    saturated = nonuniformity(dark, full)
    assert math.isnan(saturated.prnu.value) and "every value is 4095 DN" in saturated.prnu.note
    assert saturated.dsnu.value > 0 and not saturated.dsnu.note
    assert math.isnan(nonuniformity(black, light).dsnu.value)
    cut = Stack(np.maximum(dark.frames.astype(int) - 99, 0).astype(np.uint16), 0.1)
    assert "are 0: the black level is too low" in nonuniformity(cut, light).dsnu.note
    half = Stack(np.minimum(light.frames, 1600), 0.1)
    assert "at the largest code 1600" in nonuniformity(dark, half).prnu.note


def test_a_line_of_pixels_has_a_total_and_no_parts() -> None:
    rng = np.random.default_rng(7)
    for shape in ((1, 400), (400, 1)):
        dark = stack(frames(rng, 100 + noise(rng, shape, Sigmas(0, 0, 3.0)), 16, QUIET))
        light = stack(frames(rng, 1500 + noise(rng, shape, Sigmas(0, 0, 9.0)), 16, QUIET))
        found = nonuniformity(dark, light)
        assert found.dsnu.covers(3.0) and math.isnan(found.dsnu_row.value)
        assert "a single line of pixels" in found.dsnu_row.note


def test_the_high_pass_filter_takes_away_uneven_light_and_nothing_else() -> None:
    """Light that falls off by 5 % to the corners, 5σ of chance; without the filter PRNU reads three times as much."""
    rng = np.random.default_rng(9)
    shape = 200, 240
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    dark = 100 + noise(rng, shape, DSNU)
    light = dark + 1500 * (1 - 0.025 * (x**2 + y**2)) * (1 + noise(rng, shape, PRNU) / 100)
    stacks = (
        stack(frames(rng, dark, 8, QUIET)),
        stack(frames(rng, light, 8, Sigmas(0, 0, 11.0))),
    )
    filtered, plain = (nonuniformity(*stacks, high_pass=passed) for passed in (True, False))
    assert plain.prnu.value > 2 * PRNU.total
    for name, known in KNOWN.items():
        one = getattr(filtered, name)
        scale = 1 / (1 - 0.025 * 2 / 3) if "prnu" in name or name == "paper" else 1.0
        assert (
            abs(one.value - known) < 2.5 * (one.high - one.low) / 2 + abs(scale - 1) * known
        ), name


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


def test_stacks_that_do_not_fit_are_refused() -> None:
    dark, light = pair(np.random.default_rng(13), (10, 12), 2)
    mosaic = Stack(light.frames, 0.1, tile=(("R", "G"), ("G", "B")))
    for given, said in (
        ((dark, Stack(light.frames, 0.2)), "pass the same size and exposure time"),
        ((dark, light.window(slice(0, 5), slice(0, 5))), "light of 5 × 5"),
        ((light, dark), "pass the dark stack first"),
        ((dark, mosaic), "pass each stack of Stack.of_filters"),
        (
            (dark.window(slice(0, 1), slice(0, 1)), light.window(slice(0, 1), slice(0, 1))),
            "one pixel has no",
        ),
    ):
        with pytest.raises(ms.InputError, match=said):
            nonuniformity(*given)
