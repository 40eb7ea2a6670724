"""Arrays that are on disk while something else has the memory: they come back as they were, whatever happens."""

from __future__ import annotations

import tempfile
from typing import Any

import numpy as np
import pytest

from mitsuba_sensor.render.passes import row_strip
from mitsuba_sensor.render.passes.row_strip import Spillable, on_disk

SHAPES = ((7, 5, 3), (11, 2))
pytestmark = pytest.mark.skipif(
    not row_strip.CAN_SPILL, reason="memory is given back where the system has madvise"
)


def filled(monkeypatch: pytest.MonkeyPatch) -> tuple[list[Spillable], list[np.ndarray]]:
    """Arrays of random numbers, and copies of them; all of them are large enough."""
    monkeypatch.setattr(row_strip, "LEAST_BYTES", 1)
    arrays, random = [Spillable(shape) for shape in SHAPES], np.random.default_rng(1)
    for array in arrays:
        assert array.values.dtype == np.float32 and not array.values.any()
        array.values[...] = random.random(array.values.shape)
    return arrays, [array.values.copy() for array in arrays]


def test_memory_is_given_back_meanwhile_and_views_hold_the_same_values_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arrays, before = filled(monkeypatch)
    views = [array.values[1:3] for array in arrays]
    with on_disk(arrays):
        assert not any(array.values.any() for array in arrays)
    for array, view, values in zip(arrays, views, before, strict=True):
        np.testing.assert_array_equal(array.values, values)
        np.testing.assert_array_equal(view, values[1:3])


def test_an_error_meanwhile_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays, before = filled(monkeypatch)
    with pytest.raises(KeyboardInterrupt), on_disk(arrays):
        raise KeyboardInterrupt
    assert all(
        (array.values == values).all() for array, values in zip(arrays, before, strict=True)
    )


@pytest.mark.parametrize("when", ["opened", "written"])
def test_on_a_full_disk_they_stay_in_memory(monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    arrays, before = filled(monkeypatch)

    def full(*_: Any) -> Any:
        if when == "opened":
            raise OSError(28, "No space left on device")
        return open("/dev/full", "w+b", buffering=0)

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    with on_disk(arrays):
        assert all(
            (array.values == values).all() for array, values in zip(arrays, before, strict=True)
        )
    assert all(
        (array.values == values).all() for array, values in zip(arrays, before, strict=True)
    )


def test_little_is_not_worth_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays, before = filled(monkeypatch)
    monkeypatch.setattr(row_strip, "LEAST_BYTES", 2**20)
    monkeypatch.setattr(tempfile, "TemporaryFile", None)
    with on_disk(arrays):
        assert all(
            (array.values == values).all() for array, values in zip(arrays, before, strict=True)
        )
