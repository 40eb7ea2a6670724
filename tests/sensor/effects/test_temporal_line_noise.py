"""Temporal row and column noise: one offset per row or column and frame, of the σ that is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

BASE = ms.load_camera("konnik_table1").replace(**{"readout.dsnu_col": 0.0})
QUIET = BASE.replace(
    **{"source_follower.white_nv_per_rthz": 0.0, "pixel.prnu": 0.0, "dark_current.cv": 0.0}
)
DARK = ms.Exposure(0.0)


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


def test_a_frame_has_one_offset_and_every_frame_another_the_same_in_a_crop() -> None:
    """Over 150 frames 5 standard errors are 29 % of σ (test_laws.py has it closer) and 41 % of the correlation."""
    camera = QUIET.replace(**{"readout.frame_noise_e": 3.0})
    how: Any = {"keep": ("volts",), "precision": "float64"}
    frames = ms.expose(np.zeros((4, 6)), camera, DARK, frames=150, **how).volts / 5e-6
    offsets = frames[:, 0, 0]
    np.testing.assert_allclose(
        frames, np.broadcast_to(offsets[:, None, None], frames.shape), atol=1e-9
    )
    assert offsets.std() == pytest.approx(3, rel=0.29)
    assert abs(np.corrcoef(offsets[1:], offsets[:-1])[0, 1]) < 0.41
    crop = ms.expose(np.zeros((2, 3)), camera, DARK, frames=5, origin=(9, 4), **how).volts
    np.testing.assert_allclose(crop[:, 0, 0] / 5e-6, offsets[:5], atol=1e-9)
