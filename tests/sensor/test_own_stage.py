"""A stage of a user's own in the chain of a camera passes the shared stage tests without a line in the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.stage_tests import EXPOSURE, TALL, StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.types import Array
from mitsuba_sensor.sensor.stage import Stage


@dataclass(frozen=True)
class SupplyRipple(Stage):
    """An offset of whole rows, new in each frame.  sigma_v : [V rms]."""

    sigma_v: float
    domain = "volts"

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the offsets of this frame."""
        return swing + frame.number(self.sigma_v) * frame.row_normal("supply_ripple") if self.sigma_v else swing

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance."""
        return m.add(temporal=self.sigma_v**2)


BASE = ms.load_camera("konnik_table1")
RIPPLE = SupplyRipple(1e-4)


class TestSupplyRipple(StageTests):
    stage = SupplyRipple
    camera = BASE.replace(**{"readout.dsnu_col": 0.0}).with_stage(RIPPLE, after="reset_noise")
    without = BASE.replace(**{"readout.dsnu_col": 0.0})
    neutral = (SupplyRipple(0.0),)
    shape = TALL
    level = 0.0


def test_it_stands_behind_the_stage_that_is_named_even_where_the_camera_has_none() -> None:
    names = [stage.key() for stage in BASE.with_stage(RIPPLE, after="reset_noise").stages]
    assert names[names.index("supply_ripple") - 1] == "reset_noise"
    ccd = ms.load_camera("eev_44_82").with_stage(RIPPLE, after="reset_noise")
    assert "reset_noise" not in [stage.key() for stage in ccd.stages] and RIPPLE in ccd.stages


def test_the_camera_without_it_is_not_changed_and_a_changed_camera_keeps_it() -> None:
    camera = BASE.with_stage(RIPPLE, after="reset_noise")
    assert RIPPLE not in BASE.stages
    assert RIPPLE in camera.replace(**{"adc.bits": 14}).stages


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_frames_of_float64_and_of_float32_differ_by_1_dn_at_most(engine: str) -> None:
    camera, light = BASE.with_stage(RIPPLE, after="reset_noise"), np.linspace(0, 4e4, 600).reshape(20, 30)
    exact = ms.expose(light, camera, EXPOSURE, precision="float64").digital.astype(int)
    found = ms.expose(light, camera, EXPOSURE, engine=engine).digital.astype(int)  # type: ignore[arg-type]
    assert np.abs(found - exact).max() <= 1 and np.mean(found != exact) < 0.01


@pytest.mark.parametrize(
    ("stage", "after", "sentence"),
    [
        (RIPPLE, "reset_nois", "Did you mean"),
        (RIPPLE, "shot_noise", "delivers volts, and behind shot_noise are electrons"),
        (SupplyRipple, "reset_noise", "pass an instance"),
    ],
    ids=["misspelt", "unit", "class"],
)
def test_a_place_that_does_not_fit_is_refused_in_one_sentence(stage: Stage, after: str, sentence: str) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        BASE.with_stage(stage, after=after)
