"""All instruments on every kind of frames: a sentence, or figures whose gaps are marked."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from numpy.typing import NDArray

import mitsuba_sensor as ms

SHAPES = [(1, 1, 1), (3, 1, 2), (9, 1, 40), (9, 40, 1), (2, 3, 3), (16, 12, 14), (1, 30, 30)]
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
        (np.arange(values.size) == 0).reshape(values.shape) + 100
    ),
}


@pytest.mark.parametrize("kind", one_in(3, KINDS))
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_no_frames_give_a_number_without_a_mark_or_an_error_without_a_sentence(
    shape: tuple[int, int, int], kind: str
) -> None:
    rng = np.random.default_rng(1)

    def stack(level: float, sigma: float, time_s: float) -> ms.lab.Stack:
        values = level + 2 * rng.normal(size=shape[1:]) + sigma * rng.normal(size=shape)
        return ms.lab.Stack(KINDS[kind](values), time_s)

    darks = [stack(100 + 100 * time_s, 2, time_s) for time_s in (0.1, 0.3, 0.5)]
    flats = [stack(level, 0.3 * level**0.5, 0.1) for level in (500, 1500, 3000)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (found,) = ms.lab.measure_bench(ms.lab.Bench((), tuple(darks), tuple(flats)))
    for figure in found.figures.values():
        assert figure.note or not math.isnan(figure.value), figure
        assert math.isnan(figure.value) or figure.low <= figure.value <= figure.high, figure
        if kind in ("black", "saturated"):
            assert math.isnan(figure.value), figure
    assert all(sentence.endswith((".", ".)")) for sentence in found.refused.values())
