"""Reset (kTC) noise of the sense node, and what each way of resetting leaves of it."""

from __future__ import annotations

import math
from typing import Any

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.reset_noise import ResetNoise

BASE = ms.load_camera("konnik_table1")
WARM = ms.Exposure(0.1)


def test_uncorrelated_sampling_adds_the_variance_of_two_resets() -> None:
    """√2·71.6835 e- = 101.376 e- at 298.15 K; the variance is that of the difference of two hard resets. No more."""
    stage, hard = (
        stage_of(BASE.replace(**change), ResetNoise)
        for change in ({"readout.ktc_residual": math.sqrt(2)}, {"readout.reset": "hard"})
    )
    assert stage.sigma_v(WARM) / 5e-6 == pytest.approx(101.376, rel=1e-5)
    assert stage.sigma_v(WARM) ** 2 == pytest.approx(2 * hard.sigma_v(WARM) ** 2, rel=1e-14)
    with pytest.raises(
        ms.InputError,
        match=r"readout\.ktc_residual is 1\.5; it must be at most 1\.414",
    ):
        BASE.replace(**{"readout.ktc_residual": 1.5})


def stage_of(camera: ms.Camera, kind: type) -> Any:
    """The one stage of that kind in a camera's chain."""
    return next(stage for stage in chain(camera) if isinstance(stage, kind))


@pytest.mark.parametrize(
    ("reset", "electrons"), [("hard", 71.6835), ("soft", 50.6879), ("true_cds", 0.0)]
)
def test_reset_noise_is_ktc_or_what_the_reset_leaves_of_it(
    reset: str, electrons: float
) -> None:
    """√(k_B·T/C_SN) at 298.15 K with C_SN = q/A_SN = 32.04 fF: 358.417 µV; 1/√2 of it after a soft reset."""
    stage = stage_of(
        ms.load_camera("konnik_table1").replace(**{"readout.reset": reset}), ResetNoise
    )
    assert stage.sigma_v(WARM) / 5e-6 == pytest.approx(electrons, rel=1e-5)
    assert stage.sigma_v(ms.Exposure(0.1, 298.15 / 4)) == pytest.approx(
        stage.sigma_v(WARM) / 2, rel=1e-12
    )
