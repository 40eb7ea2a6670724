"""Distances of frames: exact twins pass as often as stated, another noise fails."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.distance import figure_distances, frame_distances
from mitsuba_sensor.lab.quantity import Quantity

RNG = np.random.default_rng(7)
N, H, W = 8, 100, 120


def _stack(
    sigma: float = 3.0, row: float = 0.5, column: float = 0.0, mean: float = 100.0
) -> Stack:
    values = mean + sigma * RNG.normal(size=(N, H, W)) + row * RNG.normal(size=(N, H, 1))
    return Stack(np.round(values + column * RNG.normal(size=(N, 1, W))).astype(np.uint16), 0.1)


def test_stacks_of_one_law_pass() -> None:
    """60 pairs × 3 tests at 1 %: more than 9 failures once in 10 000 runs, as D of rounded codes is smaller still."""
    found = [one for _ in range(60) for one in frame_distances(_stack(), _stack())]
    assert sum(not one.passed for one in found) <= 9


@pytest.mark.parametrize(
    ("other", "which"),
    [({"sigma": 3.4}, 0), ({"mean": 100.3}, 0), ({"row": 0.35}, 1), ({"column": 0.25}, 2)],
)
def test_another_noise_fails_the_test_that_is_about_it(
    other: dict[str, float], which: int
) -> None:
    """All of 10 pairs; that a test of this power misses one is below 1 in 10 000."""
    assert all(not frame_distances(_stack(), _stack(**other))[which].passed for _ in range(10))


def test_figures_differ_by_standard_errors_of_both() -> None:
    real = Quantity("K", "gain", 1.0, 0.98, 1.02, "DN/e-", "")
    twin = Quantity("K", "gain", 1.03, 1.01, 1.05, "DN/e-", "")
    (found,) = figure_distances([real, Quantity("QE", "", 0.5, 0.4, 0.6, "1", "")], [twin])
    assert found.z == pytest.approx(0.03 / (2**0.5 * 0.02 / 1.96), rel=1e-4)
    with pytest.raises(ms.InputError, match="shape"):
        frame_distances(_stack(), Stack(np.zeros((2, 3, 3), np.uint8), 0.1))
