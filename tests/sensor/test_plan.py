"""The plan: what is left out cannot be seen, what is kept can, and the numbers are those of the frames."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest
from helpers import EACH_KIND
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.theory.plan_trial import Effect

EXPOSURE = ms.Exposure(0.1)
CAMERA = ms.load_camera("konnik_table1")
SCENE = np.geomspace(1.0, 40_000.0, 600).reshape(20, 30)
UNITS = {stage.label for stage in chain(CAMERA) if stage.required}


def kept(plan: ms.Plan) -> set[str]:
    return {effect.stage for effect in plan.effects if effect.kept}


def effects_of(plan: ms.Plan) -> dict[str, Effect]:
    return {effect.stage: effect for effect in plan.effects}


@pytest.mark.parametrize("name", EACH_KIND)
@pytest.mark.parametrize("light", one_in(2, [0.0, 1e3, 1e5]))
def test_without_tolerance_the_planned_frame_is_the_whole_frame_bit_for_bit(
    name: str, light: float
) -> None:
    """Tolerance 0 leaves out what changes nothing, and that must be true of the sample too, not only of its moments."""
    camera = ms.load_camera(name)
    picture = np.full((20, 30), light)
    plan = ms.plan(camera, EXPOSURE, picture)
    whole, planned = (
        ms.expose(picture, camera, EXPOSURE, frames=2, plan=one, precision="float64")
        for one in (None, plan)
    )
    np.testing.assert_array_equal(planned.digital, whole.digital)


@pytest.mark.parametrize(
    ("name", "tolerance"),
    one_in(8, itertools.product(EACH_KIND, (0.02, 0.5, 50.0)), several=True),
)
def test_all_that_is_left_out_together_moves_no_pixel_by_more_than_the_tolerance(
    name: str, tolerance: float
) -> None:
    """Of frames of other sensor units in the same light; rounding to codes adds up to 1 DN. Three of 19 200 pixels may:
    what so few have is not seen by a plan."""
    camera, scene = ms.load_camera(name), np.repeat(SCENE, 4, axis=0)
    plan = ms.plan(camera, EXPOSURE, scene, tolerance)
    beyond = 0
    for serial in (3, 4):
        whole, rest = (
            ms.expose(
                scene, camera, EXPOSURE, plan=one, serial=serial, frames=4, precision="float64"
            )
            for one in (None, plan)
        )
        moved = np.abs(whole.digital.astype(float) - rest.digital)
        beyond += int((moved > tolerance + 1).sum())
    assert beyond <= 3
    assert not plan.left_out or abs((whole.digital - 1.0 * rest.digital).mean()) < 2 * tolerance


def test_two_noises_that_may_each_go_may_not_both_go() -> None:
    """Two of 8.9 DN: 50 DN are 5.6 σ of each, so that one of 260 000 samples is beyond once in 200 times; and 4 σ of
    both, which 16 samples are."""
    camera = CAMERA.replace(
        **{
            "readout.reset": "hard",
            "source_follower.white_nv_per_rthz": None,
            "source_follower.read_noise_e": 71.68,
        }
    )
    plan = ms.plan(camera, EXPOSURE, np.zeros((64, 64)), 50.0)
    both = {
        name: effects_of(plan)[name].temporal_dn
        for name in ("reset noise", "source follower noise")
    }
    assert all(x == pytest.approx(8.9, abs=0.2) for x in both.values())
    assert len(both.keys() & kept(plan)) == 1


def test_a_larger_tolerance_never_keeps_more() -> None:
    plans = [
        kept(ms.plan(CAMERA, EXPOSURE, SCENE, tolerance)) for tolerance in (0.0, 0.1, 5.0, 1e9)
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
    assert {"PRNU", "full well"} <= kept(
        ms.plan(CAMERA.replace(**{"adc.full_scale_v": 0.25}), EXPOSURE, bright, 0.01)
    )
    assert "PRNU" in kept(ms.plan(CAMERA, EXPOSURE, bright, 0.01))


def test_neutral_stages_are_left_out_with_that_reason() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE)
    reasons = {effect.stage: effect.reason for effect in plan.effects}
    for stage in ("reset noise", "source follower", "CDS gain"):
        assert stage not in kept(plan) and reasons[stage] == "has no effect here"


def test_a_cold_short_exposure_leaves_the_dark_current_out() -> None:
    cold = ms.plan(CAMERA, ms.Exposure(1e-3, 150.0), SCENE, 0.02)
    assert "dark current" not in kept(cold) and "shot noise" in kept(cold)


def test_the_effect_of_a_stage_is_its_own_size_in_digital_numbers() -> None:
    """DSNU_col 4.096 DN whatever else there is; PRNU 0.5 % of 2048 DN; dark current 21.6 DN of mean; shot noise √N."""
    effects = effects_of(ms.plan(CAMERA, EXPOSURE, np.full((100, 120), 27_500.0)))
    assert effects["DSNU column"].spatial_dn == pytest.approx(4.096, rel=0.07)
    assert effects["DSNU column"].structure_dn == pytest.approx(4.096 * np.sqrt(100), rel=0.07)
    assert effects["DSNU column"].temporal_dn < 1e-3
    assert effects["PRNU"].spatial_dn == pytest.approx(0.005 * 16_500 * 4096 / 33_000, rel=0.02)
    assert effects["PRNU"].structure_dn < 0.1 * effects["PRNU"].spatial_dn * np.sqrt(120)
    assert effects["dark current"].mean_dn == pytest.approx(21.6167, rel=1e-3)
    sigma_dn = np.sqrt(16_500 + 174.0) * 4096 / 33_000
    assert effects["shot noise"].temporal_dn == pytest.approx(sigma_dn, rel=0.01)


def test_offsets_of_columns_are_judged_by_their_lines_and_rare_pixels_by_their_number() -> None:
    """Row noise of 0.06 DN in rows of 400 pixels, like 1.2 DN in a pixel; telegraph pixels, one in 400."""
    quiet = {"readout.dsnu_col": 0.0, "pixel.prnu": 0.0, "readout.row_noise_e": 0.5}
    shape, tolerance = (40, 400), 0.5
    effect = effects_of(
        ms.plan(CAMERA.replace(**quiet), EXPOSURE, np.full(shape, 1000.0), tolerance)
    )["temporal row noise"]
    assert effect.kept and effect.temporal_dn < 0.1 and effect.pixels_beyond == 0
    assert effect.structure_dn == pytest.approx(0.5 * 4096 / 33_000 * 20, rel=0.15)
    rare = {"dark_current.rts_fraction": 1 / 400, "dark_current.rts_amplitude_e_per_s": 2000.0}
    plan = ms.plan(CAMERA.replace(**quiet | rare), EXPOSURE, np.full(shape, 1000.0), tolerance)
    effect = effects_of(plan)["RTS pixels"]
    assert effect.kept and 10 < effect.pixels_beyond < 60


def test_one_hot_pixel_of_a_measured_map_keeps_its_stage() -> None:
    """1 of 160 000 pixels: maps are looked at with all of their values, at every level of light."""
    offsets = np.zeros((400, 400))
    offsets[317, 41] = 50.0
    maps = {"dsnu_pixel_e": offsets}
    camera = CAMERA.replace(**{"pixel.dsnu_e": 0.01})
    plan = ms.plan(camera, EXPOSURE, np.full((400, 400), 500.0), 0.5, maps=maps)
    assert "DSNU pixel" in kept(plan)
    assert "DSNU pixel" not in kept(ms.plan(camera, EXPOSURE, np.full((400, 400), 500.0), 0.5))


def test_each_filter_of_a_mosaic_counts() -> None:
    """Light that only the blue pixels see still needs the full well: every level is looked at under every filter."""
    camera = ms.load_camera("bayer_2mp").replace(**{"adc.full_scale_v": 1.5})
    plan = ms.plan(camera, EXPOSURE, np.full((2, 2, 1), 80_000.0), 0.01, wavelengths_nm=[460.0])
    assert "full well" in kept(plan)


def test_one_bright_pixel_is_looked_at_under_every_filter() -> None:
    """460 nm: the well of one bright blue pixel is full, that of a red one as bright is not."""
    camera = ms.load_camera("bayer_2mp").replace(**{"adc.full_scale_v": 1.5})
    for size in (9, 10):
        light = np.zeros((size, size, 1))
        light[3, 3] = 80_000.0
        assert "full well" in kept(
            ms.plan(camera, EXPOSURE, light, 0.01, wavelengths_nm=[460.0])
        )
    red = np.zeros((1, 4, 1))
    red[0, 0] = 80_000.0
    assert "full well" not in kept(ms.plan(camera, EXPOSURE, red, 0.01, wavelengths_nm=[460.0]))


def test_explain_is_a_table_with_every_stage_and_the_range_and_to_dict_is_json() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, SCENE, 0.5)
    text = plan.explain()
    assert CAMERA.name in text and "0.5 DN" in text and max(map(len, text.splitlines())) <= 120
    _, held, _, _, *lines, clipped, single = text.splitlines()
    assert (
        "0.5994 … 2.402e+04 mean photoelectrons per pixel, 0.1 s at 298.15 K, 30 × 20 pixels"
        in held
    )
    assert single.startswith("float32: ")
    assert (
        clipped
        == f"Of {plan.pixels} sampled pixels 0 % are clipped: their changes are only counted."
    )
    for effect, line in zip(plan.effects, lines, strict=True):
        assert line.startswith(effect.stage + " ") and ("left out" in line) == (not effect.kept)
    again = json.loads(json.dumps(plan.to_dict(), allow_nan=False))
    assert again["tolerance_dn"] == 0.5 and [s["stage"] for s in again["stages"]] == [
        e.stage for e in plan.effects
    ]
    assert (
        again["range"]["exposure"]["time_s"] == 0.1 and again["range"]["brightest_e"] > 24_000
    )


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
        for ask in (
            lambda x: ms.plan(CAMERA, EXPOSURE, x),
            lambda x: ms.expose(x, CAMERA, EXPOSURE),
        ):
            with pytest.raises(ms.InputError, match="photons"):
                ask(bad)
