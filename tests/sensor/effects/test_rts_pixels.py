"""Pixels with random telegraph signal (RTS): traps that switch between frames."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.rts_pixels import RtsPixels

STEP, DUTY = 200.0, 0.3
"""100 e-/s for 2 s, on for 30 % of the time."""


def states(
    share: float, switching: float, indices: Any, shape: tuple[int, int] = (100, 100)
) -> Any:
    """(N, H, W) electrons of the traps in some frames."""
    stage, window = RtsPixels(share, STEP / 2, switching, DUTY), SensorWindow(7, shape)
    frames = [ms.stages.Frame(ms.Exposure(2.0), window, 5, index) for index in indices]
    return np.array(
        [
            np.broadcast_to(
                stage.sample(ms.stages.Electrons(np.zeros(shape)), frame).dark, shape
            )
            for frame in frames
        ]
    )


@pytest.mark.parametrize(
    ("switching", "block"),
    [(0.1, 2**8), (1e-9, 2**32)],
)
def test_traps_forget_at_the_same_rate_across_blocks_of_frames(
    switching: float, block: int
) -> None:
    """Lags from 1 frame to two lifetimes, ending and beginning on both sides of two borders; 10 000 traps.

    5 standard errors of a correlation are at most 0.07 (from the spread of the traps), of the duty 0.023.
    """
    life = min(max(round(1 / switching), 1), 2**30)
    border = block if block < 2**32 else 2**31
    lags = sorted({1, max(life // 10, 1), life, 2 * life})
    pairs = [
        (start, start + lag)
        for lag in lags
        for start in (border - lag, border - (lag + 1) // 2, border, 3)
    ]
    indices = sorted({index for pair in pairs for index in pair})
    on = dict(zip(indices, states(1.0, switching, indices) / STEP, strict=True))
    for x in on.values():
        assert x.mean() == pytest.approx(DUTY, abs=5 * math.sqrt(DUTY * (1 - DUTY) / x.size))
    for early, late in pairs:
        product = (on[early] - DUTY) * (on[late] - DUTY) / (DUTY * (1 - DUTY))
        expected = (1 - switching) ** (late - early)
        assert product.mean() == pytest.approx(
            expected, abs=5 * product.std() / math.sqrt(product.size)
        )


def test_a_frame_alone_is_that_frame_of_a_stream_whatever_its_number() -> None:
    """Around the border of two blocks, at frame 0 and at the last one; forwards, backwards and alone."""
    for indices in (range(4), range(2**8 - 3, 2**8 + 3), (2**32 - 2, 2**32 - 1)):
        stream = states(0.5, 0.1, indices)
        np.testing.assert_array_equal(stream[::-1], states(0.5, 0.1, reversed(indices)))
        for index, frame in zip(indices, stream, strict=True):
            np.testing.assert_array_equal(states(0.5, 0.1, [index])[0], frame)


COOLED = RtsPixels(1.0, STEP / 2, 0.1, DUTY, 300.0, 0.57, 0.9)


@pytest.mark.parametrize(("kelvin", "amplitude", "rate"), [
    (300.0, 1, 1), (250.0, 0.01215862, 0.0009465272), (320.0, 3.967105, 8.809645), (120.0, 4.331439e-15, 2.094104e-23),
])  # fmt: skip
def test_amplitude_and_switching_cool_each_with_its_activation_energy(
    kelvin: float, amplitude: float, rate: float
) -> None:
    """exp(E_a/k·(1/300 − 1/T)), written out for 0.57 and 0.9 eV; darkness at 0 K, and hardly anything at 120 K."""
    frame = ms.stages.Frame(ms.Exposure(2.0, kelvin), SensorWindow(7, (1, 1)))
    for energy, factor in ((0.57, amplitude), (0.9, rate)):
        assert math.exp(energy / 8.617333262e-5 * (1 / 300 - 1 / kelvin)) == pytest.approx(
            factor, rel=1e-6, abs=0
        )
    assert COOLED.step_e(frame) == pytest.approx(STEP * amplitude, rel=1e-6, abs=0)
    assert COOLED.traps(frame).rate == pytest.approx(-math.log(0.9) * rate, rel=1e-6, abs=0)
    cold = ms.stages.Frame(ms.Exposure(2.0, 0.0), SensorWindow(7, (3, 4)), 5, 9)
    assert COOLED.step_e(cold) == 0.0 and not np.any(
        COOLED.sample(ms.stages.Electrons(np.zeros((3, 4))), cold).dark
    )
