"""The sensor of Konnik & Welsh 2014, Table 1, against closed-form expectations: theory and frames.

data/table1_expectations.json holds mean, temporal and spatial σ at dark, 10, 50 and 90 % of the well. Frames are
600 000 columns wide, because DSNU_col dominates and there is only one per column: their σ is then known to
0.09 % and their mean to 0.005 DN, so that 1 % and 0.1 % are 11 and 4 standard errors or more.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from helpers import DATA

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.full_well import FullWell
from mitsuba_sensor.stages.effects.shot_noise import ShotNoise

EXPECTED = json.loads((DATA / "table1_expectations.json").read_text("utf-8"))["rows"]
LEVELS = [row["level"] for row in EXPECTED]
EXPOSURE = ms.Exposure(time_s=0.1, temperature_k=298.15)
CAMERA = ms.load_camera("konnik_table1")
QE = 0.60


@pytest.fixture(scope="module")
def digital() -> dict[float, Any]:
    """Level → two frames of 1 × 600 000 pixels, black level subtracted [DN]."""
    levels = np.array([[row["light_e"] / QE] for row in EXPECTED])
    wide = np.broadcast_to(levels, (len(LEVELS), 600_000))
    frames = (
        ms.expose(wide, CAMERA, EXPOSURE, frames=2).digital.astype(np.float64)
        - CAMERA.black_level_dn
    )
    return {level: frames[:, i] for i, level in enumerate(LEVELS)}


@pytest.mark.parametrize("row", EXPECTED, ids=LEVELS)
def test_mean_of_frames_is_that_of_table_1_within_a_thousandth(
    row: dict[str, Any], digital: dict[float, Any]
) -> None:
    """Smallest margin: dark, 0.1 % of 21.6 DN against 0.0056 DN of standard error, 3.9 of them: 1e-4 of the seeds."""
    assert digital[row["level"]].mean() == pytest.approx(row["mean_DN_no_pedestal"], rel=1e-3)


@pytest.mark.parametrize("row", EXPECTED, ids=LEVELS)
def test_temporal_sigma_of_frames_is_that_of_table_1_within_1_percent(
    row: dict[str, Any], digital: dict[float, Any]
) -> None:
    """From the difference of two frames over √2: 0.09 % standard error, so 1 % is 11 of them."""
    first, second = digital[row["level"]]
    assert (second - first).std() / math.sqrt(2) == pytest.approx(
        row["temporal_std_DN_no_kTC"], rel=0.01
    )


@pytest.mark.parametrize("row", EXPECTED, ids=LEVELS)
def test_spatial_sigma_of_a_frame_is_that_of_table_1_within_1_percent(
    row: dict[str, Any], digital: dict[float, Any]
) -> None:
    """σ over the pixels of one frame, temporal noise in it: 0.09 % standard error."""
    assert digital[row["level"]][0].std() == pytest.approx(
        row["spatial_std_DN_no_kTC"], rel=0.01
    )


def test_27500_photons_give_16500_electrons_with_the_noise_of_detected_electrons() -> None:
    """σ = √16500 = 128.45; Poisson before QE would give 99.5. 10⁶ draws: mean ± 0.13, σ ± 0.09, tested at 5 of them."""
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(1, (1000, 1000)))
    signal: Any = ms.Photons(np.full((1000, 1000), 27_500.0))
    for stage in (CAMERA.stages[0], ShotNoise(), FullWell(33_000.0)):
        signal = stage.sample(signal, frame)
    assert isinstance(signal, ms.stages.Electrons)
    assert signal.total.mean() == pytest.approx(16_500, abs=0.65)
    assert signal.total.std() == pytest.approx(128.45, abs=0.46)
    assert signal.total.var() / signal.total.mean() == pytest.approx(1, abs=0.0071)


def test_the_photon_transfer_slope_is_k() -> None:
    """Temporal variance against mean at 12 levels up to 70 % of the well: slope 0.1241212 DN/e-.

    Differences of two frames of 80 000 pixels: each variance is good to 0.5 %, the slope to 0.2 %; 1 % is 5 of them.
    """
    levels = np.linspace(500, 23_000, 12)[:, None] / QE
    first, second = ms.expose(
        np.broadcast_to(levels, (12, 80_000)), CAMERA, EXPOSURE, frames=2
    ).digital.astype(float)
    mean = (first + second).mean(axis=1) / 2
    variance = (second - first).var(axis=1) / 2
    slope, _ = np.polyfit(mean, variance, 1, w=1 / variance)
    assert slope == pytest.approx(0.1241212, rel=0.01)
