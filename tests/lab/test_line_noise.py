"""Temporal row and column noise against what went into the frames, of NumPy and of the simulator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames, noise, stack

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_noise import dark_noise
from mitsuba_sensor.lab.measure.line_noise import line_noise

KNOWN = Sigmas(0.5, 0.3, 2.0)


def test_intervals_cover_what_went_in_95_times_in_100() -> None:
    """400 stacks of 6 frames, 24 × 30 pixels with fixed patterns and 1 % of drift between frames: shares within 4.2 %,
    which chance leaves once in 8000 runs each; mean variances without bias (4.5 standard errors)."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(400):
        mean = 100 + noise(rng, (24, 30), Sigmas(1, 2, 3))
        drift = rng.normal(size=(6, 1, 1))
        found.append(line_noise(Stack(frames(rng, mean, 6, KNOWN) + drift, 0.1)).quantities)
    for measured, known in zip(zip(*found, strict=True), KNOWN, strict=True):
        assert np.mean([one.covers(known) for one in measured]) == pytest.approx(
            0.95, abs=0.042
        )
        power = np.array([one.value**2 for one in measured])
        assert power.mean() == pytest.approx(known**2, abs=4.5 * power.std() / 20)


def test_without_line_noise_the_interval_begins_at_0_and_says_so() -> None:
    """20 stacks; 97.5 % of them have a lower limit of 0, and fewer than 16 of 20 once in 10⁶ runs."""
    rng = np.random.default_rng(2)
    rows = [
        line_noise(stack(frames(rng, np.full((30, 40), 100.0), 8, Sigmas(0, 0, 2)))).row
        for _ in range(20)
    ]
    zero = [one for one in rows if one.low == 0]
    assert len(zero) >= 16 and all(
        one.value >= 0 and "not told from 0" in one.note for one in zero
    )


def test_the_simulators_row_and_column_noise_come_back_in_electrons() -> None:
    """bayer-free camera of Table 1 with 3 and 2 e-; 24 frames of 120 × 160: five standard errors are 7 %."""
    changes = {"readout.row_noise_e": 3.0, "readout.column_noise_e": 2.0}
    camera = ms.load_camera("konnik_table1").replace(**changes)
    digital = ms.expose(
        np.zeros((120, 160)), camera, ms.Exposure(0.01), frames=24, seed=3
    ).digital
    measured = line_noise(Stack(digital, 0.01, bits=12))
    row, column = (one.in_electrons(0.1241212) for one in (measured.row, measured.column))
    assert row.value == pytest.approx(3.0, rel=0.07) and row.unit == "e-"
    assert column.value == pytest.approx(2.0, rel=0.07)


def test_what_cannot_be_measured_has_no_value_and_a_reason() -> None:
    rng = np.random.default_rng(4)
    values = frames(rng, np.full((12, 16), 100.0), 4, KNOWN)
    one_frame = line_noise(stack(values[:1])).row
    assert math.isnan(one_frame.value) and "pass at least 2" in one_frame.note
    saturated = line_noise(Stack(np.full((4, 12, 16), 4095, np.uint16), 0.1, bits=12)).row
    assert math.isnan(saturated.value) and "4095" in saturated.note
    line = line_noise(stack(values[:, :1]))
    assert math.isnan(line.row.value) and "a single line" in line.row.note
    coarse = line_noise(stack(frames(rng, np.full((12, 16), 100.3), 4, Sigmas(0, 0, 0.3)))).row
    assert "rounding hides" in coarse.note
    with pytest.raises(ms.InputError, match=r"Stack\.of_filters"):
        line_noise(Stack(values, 0.1, tile=(("R", "G"), ("G", "B"))))


@pytest.mark.parametrize("sigma_dn", [0.4, 2.0])
def test_dark_noise_of_pairs_with_row_noise_has_intervals_that_hold(sigma_dn: float) -> None:
    """120 pairs of 32 × 40 pixels whose rows share as much noise as each pixel has: 88 of 100 intervals hold σ, or
    more; right ones have fewer once in 700 runs."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(120):
        pair = frames(
            rng, 100 + noise(rng, (32, 40), Sigmas(0, 0, 1)), 2, Sigmas(sigma_dn, 0, sigma_dn)
        )
        held += dark_noise([stack(pair)]).analogue.covers(2**0.5 * sigma_dn)
    assert held > 0.88 * 120, held
