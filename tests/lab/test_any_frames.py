"""Every spatial and dark instrument on every kind of frames: a sentence, or results whose gaps are marked."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.correlation import correlation
from mitsuba_sensor.lab.measure.dark_current import dark_current
from mitsuba_sensor.lab.measure.dark_signal import dark_signal
from mitsuba_sensor.lab.measure.defects import defects
from mitsuba_sensor.lab.measure.line_noise import line_noise
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity
from mitsuba_sensor.lab.measure.profiles import profiles
from mitsuba_sensor.lab.measure.rts_pixels import rts_pixels
from mitsuba_sensor.lab.measure.spectrogram import spectrograms
from mitsuba_sensor.lab.quantity import Quantity

RNG = np.random.default_rng(1)
SHAPES = [
    (1, 1, 1),
    (3, 1, 2),
    (1, 1, 40),
    (9, 1, 40),
    (9, 40, 1),
    (2, 3, 3),
    (16, 12, 14),
    (1, 30, 30),
]
KINDS: dict[str, Callable[[NDArray[np.float64]], NDArray[Any]]] = {
    "8 bit": lambda values: (values / 16).astype(np.uint8),
    "16 bit": lambda values: values.astype(np.uint16),
    "float32": lambda values: values.astype(np.float32),
    "float64 far from 0": lambda values: values + 1e9,
    "signed": lambda values: (values - 800).astype(np.int32),
    "volts": lambda values: values * 1e-12,
    "black": lambda values: np.zeros(values.shape, np.uint16),
    "saturated": lambda values: np.full(values.shape, 4095, np.uint16),
    "one value differs": lambda values: (
        100 + (np.arange(values.size) == 0).reshape(values.shape).astype(np.uint16)
    ),
}


def stack(
    shape: tuple[int, int, int], level: float, sigma: float, kind: str, time_s: float = 0.1
) -> Stack:
    values = level + 2 * RNG.normal(size=shape[1:]) + sigma * RNG.normal(size=shape)
    return Stack(KINDS[kind](values), time_s)


def quantities(result: Any) -> list[Quantity]:
    """All of a result, or of several."""
    if isinstance(result, tuple):
        return [one for part in result for one in quantities(part)]
    parts = [value for value in vars(result).values() if isinstance(value, Quantity | tuple)]
    return [
        one
        for part in parts
        for one in (part if isinstance(part, tuple) else (part,))
        if isinstance(one, Quantity)
    ]


@pytest.mark.parametrize("kind", one_in(3, KINDS))
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_no_frames_give_a_number_without_a_mark_or_an_error_without_a_sentence(
    shape: tuple[int, int, int], kind: str
) -> None:
    dark, light = stack(shape, 100, 2, kind), stack(shape, 1500, 10, kind)
    longer = [stack(shape, 100 + 100 * t, 2, kind, t) for t in (0.3, 0.5)]
    instruments: list[Callable[[], Any]] = [
        *(
            lambda one=one: one(dark)
            for one in (line_noise, profiles, spectrograms, dark_signal, rts_pixels)
        ),
        *(lambda one=one: one(dark) for one in (correlation, defects)),
        *(lambda one=one: one(dark, light) for one in (nonuniformity, defects)),
        lambda: dark_current([dark, *longer]),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for instrument in instruments:
            with contextlib.suppress(ms.InputError):
                for one in quantities(instrument()):
                    assert one.note or not math.isnan(one.value), one
                    assert math.isnan(one.value) or one.low <= one.value <= one.high, one
                    if (
                        kind in ("black", "saturated")
                        and one.symbol != "F"
                        and not one.symbol.startswith("Δ_")
                    ):
                        assert (
                            math.isnan(one.value)
                            or "every value" in one.note
                            or "clipped" in one.note
                        ), one
