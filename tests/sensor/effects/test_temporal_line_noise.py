"""Temporal row and column noise: one offset per row or column and frame, of the σ that is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import TALL, WIDE, StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.temporal_line_noise import (
    TemporalColumnNoise,
    TemporalRowNoise,
)

BASE = ms.load_camera("konnik_table1").replace(**{"readout.dsnu_col": 0.0})
QUIET = BASE.replace(
    **{"source_follower.white_nv_per_rthz": 0.0, "pixel.prnu": 0.0, "dark_current.cv": 0.0}
)
DARK = ms.Exposure(0.0)


class TestTemporalRowNoise(StageTests):
    stage = TemporalRowNoise
    camera = BASE.replace(**{"readout.row_noise_e": 20.0})
    without = {"readout.row_noise_e": 0.0}
    neutral = (TemporalRowNoise(0.0, 5e-6),)
    shape = TALL
    level = 0.0


class TestTemporalColumnNoise(StageTests):
    stage = TemporalColumnNoise
    camera = BASE.replace(**{"readout.column_noise_e": 20.0})
    without = {"readout.column_noise_e": 0.0}
    neutral = (TemporalColumnNoise(0.0, 5e-6),)
    shape = WIDE
    level = 0.0


def electrons(field: str, shape: tuple[int, int], **how: Any) -> Any:
    """Offsets of ten frames in darkness without any other noise [e-]."""
    camera = QUIET.replace(**{field: 3.0})
    return (
        ms.expose(
            np.zeros(shape),
            camera,
            DARK,
            frames=10,
            keep=("volts",),
            precision="float64",
            **how,
        ).volts
        / 5e-6
    )


@pytest.mark.parametrize(
    ("field", "axis"), [("readout.row_noise_e", 2), ("readout.column_noise_e", 1)]
)
def test_a_line_has_one_offset_and_every_line_and_frame_another(field: str, axis: int) -> None:
    """σ = 3 e- over 10 000 lines and frames: 5 standard errors are 3.6 %; correlations 5 %; 6e-7 false alarms each."""
    noise = electrons(field, (1000, 4) if axis == 2 else (4, 1000))
    np.testing.assert_allclose(
        noise, np.broadcast_to(noise.mean(axis=axis, keepdims=True), noise.shape), atol=1e-9
    )
    lines = noise.mean(axis=axis) / 3.0
    assert lines.std() == pytest.approx(1, abs=0.036) and abs(lines.mean()) < 0.05
    assert abs(np.mean(lines[:, 1:] * lines[:, :-1])) < 0.05
    assert abs(np.mean(lines[1:] * lines[:-1])) < 0.05 * np.sqrt(10 / 9)


def test_row_and_column_noise_are_independent_and_add_up() -> None:
    """In electrons at the sense node, whatever the gain of the follower."""
    both = QUIET.replace(
        **{
            "readout.row_noise_e": 3.0,
            "readout.column_noise_e": 4.0,
            "source_follower.gain": 0.8,
        }
    )
    noise = ms.expose(
        np.zeros((700, 700)), both, DARK, keep=("volts",), precision="float64"
    ).volts[0] / (0.8 * 5e-6)
    rows, columns = noise.mean(axis=1), noise.mean(axis=0)
    np.testing.assert_allclose(noise, rows[:, None] + columns - noise.mean(), atol=1e-9)
    assert rows.std() == pytest.approx(3, rel=0.14) and columns.std() == pytest.approx(
        4, rel=0.14
    )  # 5/√(2·700)
    assert abs(np.corrcoef(rows, columns)[0, 1]) < 5 / np.sqrt(700)
