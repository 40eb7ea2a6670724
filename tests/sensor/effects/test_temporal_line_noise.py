"""Temporal row and column noise: one offset per row or column and frame, of the σ that is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import ENGINES, TALL, WIDE, StageTests, backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.temporal_line_noise import (
    TemporalColumnNoise,
    TemporalFrameNoise,
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


class TestTemporalFrameNoise(StageTests):
    """A frame has one offset, so that moments are compared over frames, not over pixels."""

    stage = TemporalFrameNoise
    camera = BASE.replace(**{"readout.frame_noise_e": 20.0})
    without = {"readout.frame_noise_e": 0.0}
    neutral = (TemporalFrameNoise(0.0, 5e-6),)
    level = 0.0

    @pytest.mark.parametrize("engine", ENGINES)
    def test_its_samples_have_the_moments_that_it_states(self, engine: str) -> None:
        """2000 frames: 5 standard errors of the mean and of the variance, 16 %; 1e-6 false alarms."""
        stage = next(one for one in self.camera.stages if isinstance(one, self.stage))
        window = SensorWindow(3, (2, 2), backend=backend_of(engine))
        frames = [ms.Frame(DARK, window, 5, index) for index in range(2000)]
        volts = window.backend.from_numpy(np.full((2, 2), 1e-3), window)
        behind = [window.backend.to_numpy(stage.sample(volts, f), window) for f in frames]
        first = np.array(behind, np.float64)[:, 0, 0]
        np.testing.assert_array_equal(np.ptp(behind, axis=(1, 2)), 0.0)
        stated = stage.moments(ms.Moments(1e-3, 0.0, 0.0, frames[0]))
        assert np.var(first) == pytest.approx(stated.temporal, rel=0.16)
        error_v = np.sqrt(stated.temporal / len(frames))
        assert np.mean(first) == pytest.approx(stated.mean, abs=5 * error_v)


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


def test_a_frame_has_one_offset_and_every_frame_another_the_same_in_a_crop() -> None:
    """σ = 3 e- over 2000 frames: 5 standard errors are 8 % of σ, 11 % of the correlation from frame to frame."""
    camera = QUIET.replace(**{"readout.frame_noise_e": 3.0})
    how: Any = {"keep": ("volts",), "precision": "float64"}
    frames = ms.expose(np.zeros((4, 6)), camera, DARK, frames=2000, **how).volts / 5e-6
    offsets = frames[:, 0, 0]
    np.testing.assert_allclose(
        frames, np.broadcast_to(offsets[:, None, None], frames.shape), atol=1e-9
    )
    assert offsets.std() == pytest.approx(3, rel=0.08)
    assert abs(np.corrcoef(offsets[1:], offsets[:-1])[0, 1]) < 0.11
    crop = ms.expose(np.zeros((2, 3)), camera, DARK, frames=5, origin=(9, 4), **how).volts
    np.testing.assert_allclose(crop[:, 0, 0] / 5e-6, offsets[:5], atol=1e-9)


def test_theory_has_the_jitter_of_the_black_level_and_adds_it_in_quadrature() -> None:
    """σ of 300 and 400 e- and rounding, within 4 standard errors; frame noise is one number of each sampled frame."""
    camera = QUIET.replace(
        **{
            "readout.frame_noise_e": 300.0,
            "readout.row_noise_e": 400.0,
            "adc.black_level_dn": 999.0,
        }
    )
    frames = ms.expose(np.zeros((8, 8)), camera, DARK, frames=2)
    expected = frames.theory.averages(frames.stages[-1])
    variance_dn2 = (500 * frames.report["K_dn_per_e"]) ** 2 + 1 / 12
    assert abs(expected.temporal - variance_dn2) < 4 * expected.errors[1] < 0.9 * variance_dn2
    assert "temporal frame noise" in frames.noise_budget().explain()
