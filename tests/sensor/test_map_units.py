"""FPN maps of offsets and read noise in DN or electrons: what is given appears in the frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

DARK = ms.Exposure(0.0)
SHAPE = (24, 32)
CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "source_follower.gain": 0.8,
        "readout.cds_gain": 1.5,
        "adc.black_level_dn": 60.0,
        "readout.dsnu_col": 0.0,
    }
)
"""Read noise of 0.76 DN, which hides the steps of the converter."""

SHAPES = {"dsnu_pixel": SHAPE, "dsnu_row": (SHAPE[0], 1), "dsnu_col": (1, SHAPE[1])}


def random_map(name: str) -> Any:
    return np.random.default_rng(3).normal(0.0, 4.0, SHAPES[name])


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("residual", [1.0, 0.3])
def test_offsets_in_dn_appear_in_the_mean_of_all_frames_as_they_are(
    name: str, residual: float
) -> None:
    """The clean frame is the mean of infinitely many frames: 60 DN + map. Steps show by e^(-2π²·0.76²) < 2e-5 DN; the
    rest is float32. What a CDS leaves of offsets is in a map that was measured behind it."""
    camera, values = CAMERA.replace(**{"readout.dsnu_residual": residual}), random_map(name)
    frames = ms.expose(np.zeros(SHAPE), camera, DARK, maps={f"{name}_dn": values})
    np.testing.assert_allclose(frames.clean, 60.0 + values * np.ones(SHAPE), atol=1e-4)


def test_read_noise_in_dn_is_the_noise_of_the_frames() -> None:
    """Of two halves of the pixels, 0.8 and 2 DN, and 1/12 DN² of rounding. 200 frames of 384 pixels: σ² to 0.51 %."""
    camera = CAMERA.replace(**{"source_follower.read_noise_cv": 0.3})
    values = np.repeat([0.8, 2.0], 12)[:, None] * np.ones(SHAPE)
    frames = ms.expose(
        np.zeros(SHAPE), camera, DARK, frames=200, maps={"read_noise_dn": values}
    )
    variance = frames.digital.var(axis=0, ddof=1)
    for rows, sigma in ((slice(0, 12), 0.8), (slice(12, 24), 2.0)):
        assert variance[rows].mean() == pytest.approx(sigma**2 + 1 / 12, rel=0.02)
