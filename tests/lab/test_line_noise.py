"""Temporal row and column noise against what went into the frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames, noise, stack

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_noise import dark_noise
from mitsuba_sensor.lab.measure.line_noise import line_noise

KNOWN = Sigmas(0.5, 0.3, 2.0)


def test_intervals_cover_what_went_in_95_times_in_100() -> None:
    """400 stacks of 6 frames, 24 × 30 pixels with fixed patterns and 1 % of drift between frames: shares within 4.2 %,
    which chance leaves once in 8000 runs each; mean variances without bias (4.5 standard errors)."""
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        mean = 100 + noise(rng, (24, 30), Sigmas(1, 2, 3)) + rng.normal(size=(6, 1, 1))
        found.append(line_noise(Stack(mean + noise(rng, (6, 24, 30), KNOWN), 0.1)).quantities)
    for measured, known in zip(zip(*found, strict=True), KNOWN, strict=True):
        assert np.mean([x.covers(known) for x in measured]) == pytest.approx(0.95, abs=0.042)
        power = np.array([x.value**2 for x in measured])
        assert power.mean() == pytest.approx(known**2, abs=4.5 * power.std() / 20)


@pytest.mark.parametrize("sigma_dn", [0.4, 2.0])
def test_dark_noise_of_pairs_with_row_noise_has_intervals_that_hold(sigma_dn: float) -> None:
    """120 pairs of 32 × 40 pixels whose rows share as much noise as each pixel has: 88 of 100 intervals hold σ, or
    more; right ones have fewer once in 700 runs."""
    rng, held = np.random.default_rng(5), 0
    for _ in range(120):
        mean = 100 + noise(rng, (32, 40), Sigmas(0, 0, 1))
        pair = frames(rng, mean, 2, Sigmas(sigma_dn, 0, sigma_dn))
        held += dark_noise([stack(pair)]).analogue.covers(2**0.5 * sigma_dn)
    assert held > 0.88 * 120, held


def test_frames_that_show_no_row_noise_have_no_value_and_a_reason() -> None:
    rng = np.random.default_rng(4)
    values = frames(rng, np.full((12, 16), 100.0), 4, KNOWN)
    coarse = frames(rng, np.full((12, 16), 100.3), 4, Sigmas(0, 0, 0.3))
    for given in (values[:1], values * 0 + 4095, values[:, :1], coarse):
        row = line_noise(stack(given)).row
        assert math.isnan(row.value) and row.note
