"""Image lag: a share of the photoelectrons of each frame is missing in it and part of the next one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms

BASE = ms.load_camera("konnik_table1")
LAG, WELL_E = 0.02, BASE.pixel.full_well_e
LAGGING = BASE.replace(**{"quantum_efficiency.image_lag": LAG})
QUIET = LAGGING.replace(**{"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0})
SHORT = ms.Exposure(0.1)


def after(before: Any, now: Any) -> ms.Photons:
    """Photoelectrons of a frame, and those of the frame before."""
    of_before = ms.Photons(np.asarray(before, float), detected=True)
    return ms.Photons(np.asarray(now, float), detected=True, by_readout={"before": of_before})


def mean_e(camera: ms.Camera, light: Any, **options: Any) -> NDArray[np.float64]:
    """Mean photoelectrons of a frame."""
    return ms.expose(light, camera, SHORT, precision="float64", **options).theory.light.mean_e


def sequence_e(camera: ms.Camera, levels_e: list[float]) -> NDArray[np.float64]:
    """Mean photoelectrons that each frame of a sequence shows, of light that is this bright in each."""
    pairs = zip([levels_e[0], *levels_e], levels_e, strict=False)
    frames = [mean_e(camera, after([[before]], [[now]])) for before, now in pairs]
    return np.array([frame.item() for frame in frames])


def test_the_step_response_is_the_closed_form() -> None:
    """Light on: 1 − f of it in the first frame. Light off: f of it in the first dark frame, and nothing later. A full
    pixel leaves f of its full well, however bright the light was."""
    steps = sequence_e(LAGGING, [0.0, 1000.0, 1000.0, 0.0, 0.0])
    np.testing.assert_allclose(steps, [0.0, 980.0, 1000.0, 20.0, 0.0], rtol=1e-12)
    with pytest.warns(UserWarning, match="saturated"):
        full = sequence_e(LAGGING, [20 * WELL_E, 0.0, 0.0])
    np.testing.assert_allclose(full[1:], [LAG * WELL_E, 0.0], rtol=1e-12)
    assert full[0] == 20 * WELL_E


def test_charge_is_conserved_over_a_sequence() -> None:
    """Between two dark ends all electrons that wells held are shown: within 1e-12, of any lag and up to full wells."""
    random = np.random.default_rng(2)
    for lag in (0.001, 0.02, 0.5):
        levels = [0.0, *random.uniform(0.0, WELL_E, 20), 0.0, 0.0]
        camera = BASE.replace(**{"quantum_efficiency.image_lag": lag})
        assert sequence_e(camera, levels).sum() == pytest.approx(sum(levels), rel=1e-12)


def test_without_lag_or_change_no_byte_changes() -> None:
    light = np.random.default_rng(4).uniform(0.0, 4e4, (30, 40))
    plain = ms.expose(ms.Photons(light, detected=True), BASE, SHORT, frames=2).digital
    same = ms.expose(after(light, light), LAGGING, SHORT, frames=2).digital
    alone = ms.expose(ms.Photons(light, detected=True), LAGGING, SHORT, frames=2).digital
    np.testing.assert_array_equal(same, plain)
    np.testing.assert_array_equal(alone, plain)
    assert BASE.replace(**{"quantum_efficiency.image_lag": 0.0}).stages == BASE.stages
