"""Correlation of temporal noise: that of autoregressive and smoothed frames, none of white noise."""

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
    rng, covered = np.random.default_rng(1), []
    for _ in range(300):
        shared = 5 * rng.normal(size=(16, 20)) + rng.normal(size=(9, 1, 1))
        noisy = Stack(rng.normal(size=(9, 16, 20)) + shared, 0.1)
        covered.append([x.covers(0.0) for x in correlation(noisy, lags=2).quantities])
    assert np.mean(covered, axis=0) == pytest.approx([0.95] * 4, abs=0.042)


def test_autoregressive_frames_have_their_coefficient_by_lag() -> None:
    """ρ = 0.3 from frame to frame, 60 frames of 50 × 50: 0.3, 0.09, 0.027 less the bias of 1.9/60·(1 − ρ_k)."""
    rng, frames = np.random.default_rng(2), np.zeros((80, 50, 50))
    for n in range(1, 80):
        frames[n] = 0.3 * frames[n - 1] + rng.normal(size=(50, 50))
    found = correlation(Stack(frames[20:], 0.1), lags=3)
    assert [x.value for x in found.temporal] == pytest.approx([0.3, 0.09, 0.027], abs=0.03)
    assert found.temporal[0].low > 0.25 and found.horizontal.covers(0)


def test_smoothed_frames_correlate_with_their_neighbours_only_in_that_direction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The mean of two neighbours has ρ = 1/2; small strips, whose edges count too."""
    monkeypatch.setattr(stack, "STRIP_VALUES", 12 * 61 * 7)
    white = np.random.default_rng(3).normal(size=(12, 60, 61))
    across, down = white[:, :, 1:] + white[:, :, :-1], white[:, 1:] + white[:, :-1]
    for frames, expected in ((across, (0.5, 0.0)), (down, (0.0, 0.5))):
        found = correlation(Stack(frames, 0.1))
        pair = found.horizontal, found.vertical
        assert [x.value for x in pair] == pytest.approx(expected, abs=0.02)
        assert all(x.covers(true) for x, true in zip(pair, expected, strict=True))


def test_frames_without_a_correlation_have_a_reason() -> None:
    rng = np.random.default_rng(4)
    equal = np.repeat(rng.integers(10, 30, (1, 8, 8)), 8, axis=0)
    for frames in (rng.normal(size=(2, 8, 8)), np.zeros((5, 8, 8), np.uint16), equal):
        for figure in correlation(Stack(frames, 0.1)).quantities:
            assert math.isnan(figure.value) and figure.note
    row = correlation(Stack(rng.normal(size=(9, 1, 50)), 0.1))
    assert math.isnan(row.vertical.value) and (row.temporal[0].low, row.temporal[0].high) == (
        -1,
        1,
    )
    with pytest.raises(ms.InputError, match="lags is 0"):
        correlation(Stack(rng.normal(size=(9, 4, 4)), 0.1), lags=0)
