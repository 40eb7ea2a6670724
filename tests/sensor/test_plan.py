"""The plan: what is left out cannot be seen, what is kept can, and the numbers are those of the frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from helpers import EACH_KIND

import mitsuba_sensor as ms
from mitsuba_sensor.theory.plan_trial import Effect

EXPOSURE = ms.Exposure(0.1)
CAMERA = ms.load_camera("konnik_table1")
SCENE = np.geomspace(1.0, 40_000.0, 600).reshape(20, 30)
DIM = np.linspace(1.0, 100.0, 30 * 40).reshape(30, 40)
few = pytest.mark.usefixtures("few_windows")


def kept(plan: ms.Plan) -> set[str]:
    return {effect.stage for effect in plan.effects if effect.kept}


def effects_of(plan: ms.Plan) -> dict[str, Effect]:
    return {effect.stage: effect for effect in plan.effects}


# -- what is left out --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "light"), zip(EACH_KIND[:2], [0.0, 1e5], strict=True))
@few
def test_without_tolerance_the_planned_frame_is_the_whole_frame_bit_for_bit(
    name: str, light: float
) -> None:
    camera, picture = ms.load_camera(name), np.full((20, 30), light)
    plan = ms.plan(camera, EXPOSURE, picture)
    whole, planned = (
        ms.expose(picture, camera, EXPOSURE, frames=2, plan=one) for one in (None, plan)
    )
    np.testing.assert_array_equal(planned.digital, whole.digital)
    assert all(one.largest_dn == 0 for one in plan.effects if not one.kept)
    assert {one.reason for one in plan.effects if not one.kept} <= {"has no effect here"}


@pytest.mark.parametrize(("name", "tolerance"), [("konnik_table1", 0.02), ("eev_44_82", 50.0)])
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
            ms.expose(scene, camera, EXPOSURE, plan=one, serial=serial, frames=4)
            for one in (None, plan)
        )
        moved = np.abs(whole.digital.astype(float) - rest.digital)
        beyond += int((moved > tolerance + 1).sum())
    assert beyond <= 3
    assert not plan.left_out or abs((whole.digital - 1.0 * rest.digital).mean()) < 2 * tolerance


@few
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
    both = ("reset noise", "source follower noise")
    for name in both:
        assert effects_of(plan)[name].temporal_dn == pytest.approx(8.9, abs=0.2)
    assert len({*both} & kept(plan)) == 1


@few
def test_a_picture_in_the_dark_needs_no_prnu_and_no_full_well_and_a_bright_one_does() -> None:
    """The full well shows only where the converter reaches beyond it; by default the ADC clips first."""
    dark = kept(ms.plan(CAMERA, EXPOSURE, np.zeros((4, 4)), 0.01))
    assert not {"PRNU", "full well"} & dark
    assert {"dark current", "shot noise", "DSNU column", "source follower noise"} <= dark
    bright = np.full((4, 4), 54_000.0)
    assert {"PRNU", "full well"} <= kept(
        ms.plan(CAMERA.replace(**{"adc.full_scale_v": 0.25}), EXPOSURE, bright, 0.01)
    )
    cold = kept(ms.plan(CAMERA, ms.Exposure(1e-3, 150.0), SCENE, 0.02))
    assert "dark current" not in cold and "shot noise" in cold


# -- the numbers -------------------------------------------------------------------------------------------------------


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


@few
def test_lines_are_judged_by_their_length_and_rare_pixels_by_their_number() -> None:
    """Row noise of 0.06 DN in rows of 400 pixels, like 1.2 DN in a pixel; telegraph pixels, one in 400."""
    camera = CAMERA.replace(
        **{
            "readout.dsnu_col": 0.0,
            "pixel.prnu": 0.0,
            "readout.row_noise_e": 0.5,
            "dark_current.rts_fraction": 1 / 400,
            "dark_current.rts_amplitude_e_per_s": 2000.0,
        }
    )
    effects = effects_of(ms.plan(camera, EXPOSURE, np.full((40, 400), 1000.0), 0.5))
    rows, rare = effects["temporal row noise"], effects["RTS pixels"]
    assert rows.kept and rows.temporal_dn < 0.1 and rows.pixels_beyond == 0
    assert rows.structure_dn == pytest.approx(0.5 * 4096 / 33_000 * 20, rel=0.15)
    assert rare.kept and 10 < rare.pixels_beyond < 60


@few
def test_one_hot_pixel_of_a_measured_map_keeps_its_stage() -> None:
    """1 of 40 000 pixels: maps are looked at with all of their values, at every level of light."""
    offsets, light = np.zeros((200, 200)), np.full((200, 200), 500.0)
    offsets[117, 41] = 50.0
    camera = CAMERA.replace(**{"pixel.dsnu_e": 0.01})
    maps = {"dsnu_pixel_e": offsets}
    assert "DSNU pixel" in kept(ms.plan(camera, EXPOSURE, light, 0.5, maps=maps))
    assert "DSNU pixel" not in kept(ms.plan(camera, EXPOSURE, light, 0.5))


@pytest.mark.parametrize(
    ("shape", "place", "is_kept"),
    [((9, 9), (3, 3), True), ((1, 4), (0, 0), False)],
)
@few
def test_one_bright_pixel_is_looked_at_under_every_filter(
    shape: tuple[int, int], place: tuple[int, int], is_kept: bool
) -> None:
    """460 nm: the well of one bright blue pixel is full, that of a red one as bright is not."""
    camera, light = (
        ms.load_camera("bayer_2mp").replace(**{"adc.full_scale_v": 1.5}),
        np.zeros((*shape, 1)),
    )
    light[place] = 80_000.0
    plan = ms.plan(camera, EXPOSURE, light, 0.01, wavelengths_nm=[460.0])
    assert ("full well" in kept(plan)) == is_kept


@dataclass(frozen=True)
class Glow(ms.Stage):
    """Dark electrons about one pixel, 1/e of them length_px further."""

    electrons: float
    row: int
    column: int
    length_px: float = 10.0
    domain = "electrons"

    def glow_e(self, rows: Any, columns: Any) -> Any:
        distance_px = np.hypot(rows - self.row, columns - self.column)
        return self.electrons * np.exp(-distance_px / self.length_px)

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        glow_e = self.glow_e(*np.ix_(frame.window.rows, frame.window.columns))
        glow = frame.window.backend.from_numpy(glow_e, frame.window)
        return replace(electrons, dark=electrons.dark + glow)


@pytest.mark.parametrize(
    ("glow", "shape", "is_kept"),
    [
        (Glow(0.01, 95, 0), (96, 128), False),
        (Glow(500.0, 33, 77, 0.01), (96, 128), True),
        (Glow(2000.0, 0, 1199), (800, 1200), True),
    ],
)
@few
def test_one_pixel_and_the_corner_of_a_large_frame_are_seen(
    glow: Glow, shape: tuple[int, int], is_kept: bool
) -> None:
    camera = CAMERA.with_stage(glow, after="dark_current")
    plan = ms.plan(camera, EXPOSURE, np.full(shape, 1000.0), 0.5)
    assert effects_of(plan)["glow"].kept == is_kept


# -- what a plan holds for ---------------------------------------------------------------------------------------------


@few
def test_a_plan_is_of_its_camera_and_serves_the_same_light_in_another_order() -> None:
    """Another sensor's gain, or 16 bits in an 8-bit file, would go unseen."""
    plan = ms.plan(CAMERA, EXPOSURE, DIM, 0.02)
    for light in (DIM, DIM[::-1], DIM[:10, 5:20], np.full((30, 40), 50.0)):
        assert ms.expose(light, CAMERA, EXPOSURE, plan=plan).plan is plan
    for other in (ms.load_camera("bayer_2mp"), CAMERA.replace(**{"adc.bits": 16})):
        with pytest.raises(ms.InputError, match="another camera"):
            ms.expose(DIM, other, EXPOSURE, plan=plan)


@few
def test_tolerance_dn_is_the_plan_of_that_light_and_its_report_that_of_the_frame() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, DIM, 2.0)
    frames = ms.expose(DIM, CAMERA, EXPOSURE, tolerance_dn=2.0, frames=2)
    assert frames.plan is not None and frames.plan.left_out == plan.left_out
    planned = ms.expose(DIM, CAMERA, EXPOSURE, plan=plan, frames=2)
    np.testing.assert_array_equal(frames.digital, planned.digital)
    streamed = list(ms.stream(DIM, CAMERA, EXPOSURE, tolerance_dn=2.0, frames=2))
    np.testing.assert_array_equal(frames.digital, streamed)
    assert {stage["name"] for stage in frames.report["stages"]} == kept(plan)
    whole = ms.expose(DIM, CAMERA, EXPOSURE)
    assert whole.plan is None and whole.stages == CAMERA.stages
