"""Clipped values are counted, and neither quiet nor small stacks are taken for clipped ones."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.lab.stack import Stack

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("known", [True, False])
def test_values_at_the_largest_code_are_counted_whether_the_bits_are_known_or_not(bits: int, known: bool) -> None:
    top = 2**bits - 1
    frames = np.minimum(top - 20 + 12 * RNG.normal(size=(4, 50, 60)), top).round().astype(np.uint16)
    found = Stack(frames, 0.1, bits=bits if known else None).clipping
    assert found.saturated == np.mean(frames == top) > 0.03 and not found.usable and f"largest code {top}" in found.note
    assert Stack(frames.astype(np.float32), 0.1).clipping.saturated == found.saturated


@pytest.mark.parametrize("sigma", [0.05, 0.15, 0.4, 1.0, 3.0, 30.0])
@pytest.mark.parametrize("size", [(1, 4, 5), (2, 20, 24), (8, 200, 200)])
def test_tails_and_quiet_frames_are_not_clipped(sigma: float, size: tuple[int, ...]) -> None:
    for level in (100.1, 100.5, 100.6, 100.9):
        frames = np.floor(level + 100 + sigma * RNG.normal(size=size) + 0.5).astype(np.uint16)
        assert Stack(frames, 0.1).clipping.saturated == 0


def test_black_and_constant_frames_are_said() -> None:
    cut = np.maximum(2 * RNG.normal(size=(2, 40, 40)), 0).round().astype(np.uint16)
    assert "the black level is too low" in Stack(cut, 0.1).clipping.note and not Stack(cut, 0.1).clipping.usable
    signed = (2 * RNG.normal(size=(2, 40, 40))).round().astype(np.int16)
    assert not Stack(signed, 0.1).clipping.note
    constant = Stack(np.full((2, 4, 4), 7, np.uint8), 0.1).clipping
    assert constant.note == "every value is 7 DN" and not constant.usable
