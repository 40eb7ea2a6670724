"""Correlation of temporal noise: that of autoregressive and smoothed frames, none of white ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames import stack
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.correlation import correlation


def test_intervals_of_white_noise_cover_0() -> None:
    """300 stacks of 9 frames with patterns and drift: shares within 4.2 % of 95 %, beyond once in 1000 runs each."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(300):
        frames = (
            rng.normal(size=(9, 16, 20))
            + 5 * rng.normal(size=(16, 20))
            + rng.normal(size=(9, 1, 1))
        )
        found.append(
            [one.covers(0.0) for one in correlation(Stack(frames, 0.1), lags=2).quantities]
        )
    assert np.mean(found, axis=0) == pytest.approx([0.95] * 4, abs=0.042)


def test_autoregressive_frames_have_their_coefficient_by_lag() -> None:
    """ρ = 0.3 from frame to frame, 60 frames of 50 × 50: 0.3, 0.09, 0.027 less the bias of 1.9/60·(1 − ρ_k)."""
    rng = np.random.default_rng(2)
    frames = np.zeros((80, 50, 50))
    for n in range(1, 80):
        frames[n] = 0.3 * frames[n - 1] + rng.normal(size=(50, 50))
    found = correlation(Stack(frames[20:], 0.1), lags=3)
    assert [one.value for one in found.temporal] == pytest.approx([0.3, 0.09, 0.027], abs=0.03)
    assert found.temporal[0].low > 0.25 and found.horizontal.covers(0)


def test_smoothed_frames_correlate_with_their_neighbours_only_in_that_direction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The mean of two neighbours has ρ = 1/2; small strips, whose edges count too."""
    monkeypatch.setattr(stack, "STRIP_VALUES", 12 * 61 * 7)
    rng = np.random.default_rng(3)
    white = rng.normal(size=(12, 60, 61))
    across, down = white[:, :, 1:] + white[:, :, :-1], (white[:, 1:] + white[:, :-1])
    for frames, expected in ((across, (0.5, 0.0)), (down, (0.0, 0.5))):
        found = correlation(Stack(frames, 0.1))
        assert (found.horizontal.value, found.vertical.value) == pytest.approx(
            expected, abs=0.02
        )
        assert found.horizontal.covers(expected[0]) and found.vertical.covers(expected[1])
    horizontal = np.corrcoef(
        *(across[:, :, part].ravel() for part in (slice(1, None), slice(None, -1)))
    )[0, 1]
    assert correlation(Stack(across, 0.1)).horizontal.value == pytest.approx(
        horizontal, abs=0.005
    )


def test_what_has_no_correlation_says_why() -> None:
    rng = np.random.default_rng(4)
    alike = np.repeat(rng.integers(10, 30, (1, 8, 8)), 8, axis=0)
    for frames, note in (
        (rng.normal(size=(2, 8, 8)), "fewer than 3 frames"),
        (np.zeros((5, 8, 8), np.uint16), "every value is 0"),
        (alike, "0.24 DN²"),
    ):
        for figure in correlation(Stack(frames, 0.1)).quantities:
            assert math.isnan(figure.value) and note in figure.note
    row = correlation(Stack(rng.normal(size=(9, 1, 50)), 0.1))
    assert "no interval" in row.temporal[0].note and "nothing to compare" in row.vertical.note
    with pytest.raises(ms.InputError, match="lags is 0"):
        correlation(Stack(rng.normal(size=(9, 4, 4)), 0.1), lags=0)
