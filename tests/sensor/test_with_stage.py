"""Stages of one's own: the example is in the chain, in theory, plan, noise budget and metadata, on every backend."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import TALL, StageTests

import mitsuba_sensor as ms
from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.sensor.gains import gain_dn_per_e

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))

from own_noise_source import Banding, camera_with_banding

TABLE1, DARK = ms.load_camera("konnik_table1"), ms.Exposure(0.0)


class TestBanding(StageTests):
    stage = Banding
    camera = camera_with_banding(20.0).replace(**{"readout.dsnu_col": 0.0})
    without = TABLE1.replace(**{"readout.dsnu_col": 0.0})
    neutral = (Banding(0.0, 5e-6, (1.0, 1.0)),)
    shape = TALL


def test_a_stage_of_ones_own_stands_in_report_plan_noise_budget_and_metadata() -> None:
    camera = camera_with_banding(20.0)
    frames = ms.expose(np.zeros((64, 64)), camera, DARK)
    names = [line["name"] for line in frames.report["stages"]]
    assert names[names.index("banding") - 1] == "reset noise"
    (entry,) = (one for one in frames.noise_budget().entries if one.source == "banding")
    assert entry.temporal_dn2 == pytest.approx((20.0 * gain_dn_per_e(camera)) ** 2, rel=1e-9)
    (effect,) = (one for one in ms.plan(camera, DARK, np.zeros((8, 8)), 0.01).effects if one.stage == "banding")
    assert effect.kept and effect.temporal_dn > 1
    (added,) = camera.to_dict()["added_stages"]
    assert added["after"] == "reset_noise" and "Banding(sigma_e=20.0" in added["stage"]
    assert "added_stages" not in TABLE1.to_dict()


def test_banding_has_the_spectrum_that_it_was_given() -> None:
    """The power of row averages lies within 0.03 cycles per row of 1/16 (white noise has 12 % there)."""
    camera = camera_with_banding(200.0).replace(**{"adc.bits": 16})
    rows = ms.expose(np.zeros((4096, 16)), camera, DARK, precision="float64").digital[0].mean(axis=1)
    power, frequency = np.abs(np.fft.rfft(rows - rows.mean())) ** 2, np.fft.rfftfreq(4096)
    assert power[np.abs(frequency - 1 / 16) < 0.03].sum() > 0.95 * power.sum()


def test_fields_can_change_behind_an_added_stage_and_the_first_camera_stays_as_it_was() -> None:
    camera = camera_with_banding()
    assert len(camera.stages) == len(TABLE1.stages) + 1 == len(camera.replace(**{"adc.bits": 14}).stages)
    assert camera.replace(**{"adc.bits": 14}).stages[-1].highest == 2**14 - 1  # type: ignore[attr-defined]
    assert not any(isinstance(stage, Banding) for stage in TABLE1.stages)
    assert camera != TABLE1 and camera == camera_with_banding()


def test_a_stage_stands_at_its_place_even_where_the_camera_has_no_stage_in_front_of_it() -> None:
    """A CCD has no reset noise."""
    ccd = ms.load_camera("eev_44_82")
    names = [stage.key() for stage in ccd.with_stage(Banding(1.0, 5e-6, (1.0, 1.0)), after="reset_noise").stages]
    assert "reset_noise" not in names and names[names.index("banding") - 1] == "sense_node"


REFUSED: dict[str, tuple[Any, str, str]] = {
    "no stage": (3, "reset_noise", "pass an instance of a class derived from mitsuba_sensor.Stage"),
    "no such place": (Banding(1.0, 5e-6, (1.0, 1.0)), "reset", "Did you mean 'reset_noise'"),
    "behind the converter": (Banding(1.0, 5e-6, (1.0, 1.0)), "adc", "it must be one of"),
    "another unit": (
        Banding(1.0, 5e-6, (1.0, 1.0)),
        "shot_noise",
        "delivers volts, and behind shot_noise are electrons",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_stage_that_cannot_stand_there_is_refused_in_one_sentence(case: str) -> None:
    stage, after, sentence = REFUSED[case]
    with pytest.raises(InputError, match=sentence):
        TABLE1.with_stage(stage, after=after)
