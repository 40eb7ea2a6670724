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


def test_a_round_trip_through_frames_gives_the_map_back() -> None:
    """Mean of 400 dark frames less the black level, within 5 standard errors of every pixel (chance: 4e-4)."""
    values = random_map("dsnu_pixel")
    frames = ms.expose(
        np.zeros(SHAPE), CAMERA, DARK, frames=400, maps={"dsnu_pixel_dn": values}
    )
    measured = frames.digital.mean(axis=0) - 60.0
    error = (
        np.sqrt(
            (CAMERA.emva1288().temporal_dark_noise_e * CAMERA.system_gain_dn_per_e) ** 2
            + 1 / 12
        )
        / 20
    )
    assert np.abs(measured - values).max() < 5 * error
    assert np.mean((measured - values) ** 2) == pytest.approx(
        error**2, rel=0.26
    )  # 5 of √(2/768)
    again = ms.expose(np.zeros(SHAPE), CAMERA, DARK, maps={"dsnu_pixel_dn": measured})
    np.testing.assert_allclose(again.clean - 60.0, measured, atol=1e-4)


def test_dn_are_electrons_times_the_overall_system_gain() -> None:
    values = random_map("dsnu_pixel")
    in_e, in_dn = (
        ms.expose(np.full(SHAPE, 1e4), CAMERA, DARK, maps=maps)
        for maps in (
            {"dsnu_pixel_e": values},
            {"dsnu_pixel_dn": values * CAMERA.system_gain_dn_per_e},
        )
    )
    np.testing.assert_array_equal(in_e.digital, in_dn.digital)


def test_read_noise_in_dn_is_the_noise_of_the_frames() -> None:
    """Of two halves of the pixels, 0.8 and 2 DN, and 1/12 DN² of rounding. 400 frames of 384 pixels: σ² to 0.36 %."""
    camera = CAMERA.replace(**{"source_follower.read_noise_cv": 0.3})
    values = np.repeat([0.8, 2.0], 12)[:, None] * np.ones(SHAPE)
    frames = ms.expose(
        np.zeros(SHAPE), camera, DARK, frames=400, maps={"read_noise_dn": values}
    )
    variance = frames.digital.var(axis=0, ddof=1)
    for rows, sigma in ((slice(0, 12), 0.8), (slice(12, 24), 2.0)):
        assert variance[rows].mean() == pytest.approx(sigma**2 + 1 / 12, rel=0.02)
