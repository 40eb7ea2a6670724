"""The plan: what is left out cannot be seen, what is kept can, and the numbers are those of the frames."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.checks import as_photons

EXPOSURE = ms.Exposure(0.1)
CAMERA = ms.load_camera("konnik_table1")
SCENE = np.geomspace(1.0, 40_000.0, 600).reshape(20, 30)
UNITS = {stage.label for stage in chain(CAMERA) if stage.required}


def kept(plan: ms.Plan) -> set[str]:
    return {effect.stage for effect in plan.effects if effect.kept}


def final(stages: tuple[Any, ...], camera: ms.Camera, light: Any) -> Moments:
    """Moments of the digital numbers of every pixel of a picture."""
    photons = as_photons(light, camera)
    m = Moments(photons, 0.0, 0.0, Frame(EXPOSURE, SensorWindow(0, photons.mean.shape[:2])))
    for stage in stages:
        m = stage.moments(m)
    return m


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("light", [0.0, 1.0, 1e3, 1e5])
def test_without_tolerance_the_planned_frame_is_the_whole_frame_bit_for_bit(name: str, light: float) -> None:
    """Tolerance 0 leaves out what changes nothing, and that must be true of the sample too, not only of its moments."""
    camera = ms.load_camera(name)
    picture = np.full((20, 30), light)
    plan = ms.plan(camera, EXPOSURE, picture)
    whole = ms.expose(picture, camera, EXPOSURE, frames=2)
    np.testing.assert_array_equal(ms.expose(picture, camera, EXPOSURE, frames=2, plan=plan).digital, whole.digital)


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("tolerance", [0.0, 0.02, 0.5, 3.0, 50.0])
def test_all_that_is_left_out_together_moves_no_pixel_by_more_than_the_tolerance(name: str, tolerance: float) -> None:
    """Mean, temporal σ and fixed σ of every pixel of the picture, not only of the levels that the plan looked at."""
    camera = ms.load_camera(name)
    plan = ms.plan(camera, EXPOSURE, SCENE, tolerance)
    whole, rest = final(chain(camera), camera, SCENE), final(plan.stages, camera, SCENE)
    slack = 1e-9 + 1.05 * tolerance
    assert np.max(np.abs(np.asarray(whole.mean) - rest.mean)) <= slack
    for part in ("temporal", "spatial"):
        one, two = (np.sqrt(getattr(m, part)) for m in (whole, rest))
        assert np.max(np.abs(one - two)) <= slack


def test_two_noises_that_may_each_go_may_not_both_go() -> None:
    """Two of 8.9 DN: without one the σ falls by 3.7, without both by 10.8. A tolerance of 5 lets one of them go."""
    camera = CAMERA.replace(
        **{"readout.reset": "hard", "source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 71.68}
    )
    stays = kept(ms.plan(camera, EXPOSURE, np.zeros((2, 2)), 5.0))
    assert len({"reset noise", "source follower noise"} & stays) == 1


def test_a_larger_tolerance_never_keeps_more() -> None:
    plans = [
        kept(ms.plan(CAMERA, EXPOSURE, SCENE, tolerance)) for tolerance in (0.0, 0.1, 1.0, 5.0, 30.0, float("inf"))
    ]
    assert all(more >= fewer for more, fewer in itertools.pairwise(plans))
    assert plans[-1] == UNITS


def test_stages_stay_in_their_order_and_the_report_names_every_one_of_the_chain() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE, 1.0)
    whole = chain(CAMERA)
    assert [effect.stage for effect in plan.effects] == [stage.label for stage in whole]
    assert plan.stages == tuple(s for s, e in zip(whole, plan.effects, strict=True) if e.kept)


def test_a_picture_in_the_dark_needs_no_prnu_and_no_full_well_and_a_bright_one_does() -> None:
    """The full well shows only where the converter reaches beyond it; by default the ADC clips first."""
    dark = kept(ms.plan(CAMERA, EXPOSURE, np.zeros((4, 4)), 0.01))
    assert not {"PRNU", "full well"} & dark
    assert {"dark current", "shot noise", "DSNU column", "source follower noise"} <= dark
    bright = np.full((4, 4), 54_000.0)
    assert {"PRNU", "full well"} <= kept(ms.plan(CAMERA.replace(**{"adc.full_scale_v": 0.25}), EXPOSURE, bright, 0.01))
    assert "PRNU" in kept(ms.plan(CAMERA, EXPOSURE, bright, 0.01))


def test_neutral_stages_are_left_out_with_that_reason() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE)
    reasons = {effect.stage: effect.reason for effect in plan.effects}
    for stage in ("reset noise", "source follower", "CDS gain"):
        assert stage not in kept(plan) and reasons[stage] == "changes nothing"


def test_a_cold_short_exposure_leaves_the_dark_current_out() -> None:
    cold = ms.plan(CAMERA, ms.Exposure(1e-3, 150.0), SCENE, 0.02)
    assert "dark current" not in kept(cold) and "shot noise" in kept(cold)


def test_the_effect_of_a_stage_is_its_size_in_digital_numbers() -> None:
    """DSNU_col 4.096 DN fixed; PRNU at half a well 0.5 % of 2048 DN beside them; dark current 21.6 DN of mean."""
    effects = {effect.stage: effect for effect in ms.plan(CAMERA, EXPOSURE, np.full((2, 2), 27_500.0)).effects}
    prnu = 0.005 * 16_500 * 4096 / 33_000
    assert effects["DSNU column"].spatial_dn == pytest.approx(np.hypot(4.096, prnu) - prnu, rel=0.01)
    assert effects["PRNU"].spatial_dn == pytest.approx(np.hypot(4.096, prnu) - 4.096, rel=0.01)
    assert effects["dark current"].mean_dn == pytest.approx(21.6167, rel=1e-3)
    assert effects["shot noise"].temporal_dn == pytest.approx(16.048 - 0.8, abs=0.3)


def test_each_filter_of_a_mosaic_counts() -> None:
    """Light that only the blue pixels see still needs the full well: every level is looked at under every filter."""
    camera = ms.load_camera("bayer_2mp").replace(**{"adc.full_scale_v": 1.5})
    plan = ms.plan(camera, EXPOSURE, np.full((2, 2, 1), 80_000.0), 0.01, wavelengths_nm=[460.0])
    assert "full well" in kept(plan)


def test_one_bright_pixel_is_looked_at_under_every_filter() -> None:
    """460 nm, seen by blue alone: wherever in the order of levels the one bright pixel stands, its well is full."""
    camera = ms.load_camera("bayer_2mp").replace(**{"adc.full_scale_v": 1.5})
    for size in (9, 10):
        light = np.zeros((size, size, 1))
        light[3, 3] = 80_000.0
        assert "full well" in kept(ms.plan(camera, EXPOSURE, light, 0.01, wavelengths_nm=[460.0]))
    few = np.zeros((1, 4, 1))
    few[0, 0] = 80_000.0
    assert "full well" in kept(ms.plan(camera, EXPOSURE, few, 0.01, wavelengths_nm=[460.0]))


def test_explain_is_a_table_with_every_stage_and_to_dict_is_json() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE, 0.5)
    text = plan.explain()
    assert CAMERA.name in text and "0.5 DN" in text
    *lines, single, measured = text.splitlines()
    assert single.startswith("float32: ")
    assert measured.startswith("measured: ") and all(seconds > 0 for seconds in plan.seconds)
    assert len(lines) == len(plan.effects) + 2 and max(map(len, lines)) <= 110
    for effect, line in zip(plan.effects, lines[2:], strict=True):
        assert line.startswith(effect.stage) and ("left out" in line) == (not effect.kept)
    again = json.loads(json.dumps(plan.to_dict(), allow_nan=False))
    assert again["tolerance_dn"] == 0.5 and [s["stage"] for s in again["stages"]] == [e.stage for e in plan.effects]


def test_the_report_of_a_planned_frame_is_that_of_the_frame_that_was_delivered() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE, 30.0)
    frames = ms.expose(SCENE, CAMERA, EXPOSURE, plan=plan)
    assert {stage["name"] for stage in frames.report["stages"]} == kept(plan)
    assert frames.report["stages"][-1]["mean_frame"] == pytest.approx(frames.digital.mean())


def test_a_plan_for_another_camera_is_refused() -> None:
    """Another sensor's gain, or 16 bits in an 8-bit file, would go unseen."""
    for other in (ms.load_camera("bayer_2mp"), CAMERA.replace(**{"adc.bits": 16})):
        with pytest.raises(ms.InputError, match="plan was made for another camera"):
            ms.expose(SCENE, CAMERA, EXPOSURE, plan=ms.plan(other, EXPOSURE, SCENE))


@pytest.mark.parametrize("tolerance", [-1e-9, float("nan"), -float("inf"), "0.1", None])
def test_an_impossible_tolerance_is_refused(tolerance: Any) -> None:
    with pytest.raises(ms.InputError, match="tolerance_dn is"):
        ms.plan(CAMERA, EXPOSURE, SCENE, tolerance)


def test_a_plan_refuses_the_photons_that_expose_refuses() -> None:
    for bad in (np.full((2, 2), np.nan), -SCENE, np.zeros((0, 2)), np.zeros(3), "light"):
        for ask in (lambda x: ms.plan(CAMERA, EXPOSURE, x), lambda x: ms.expose(x, CAMERA, EXPOSURE)):
            with pytest.raises(ms.InputError, match="photons"):
                ask(bad)
