"""What few pixels, few columns and rare traps see is not left out: cases in which averages and orders mislead."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from scipy.special import ndtr
from scipy.stats import poisson

import mitsuba_sensor as ms
from mitsuba_sensor.core import SensorWindow
from mitsuba_sensor.stages.gains import gain_dn_per_e
from mitsuba_sensor.stages.stage import sample
from mitsuba_sensor.theory.frame_theory import FrameTheory
from mitsuba_sensor.theory.plan_effects import Effect

EXPOSURE, SHORT = ms.Exposure(0.1), ms.Exposure(1e-3)
TABLE1 = ms.load_camera("konnik_table1")


def effect(plan: ms.Plan, stage: str) -> Effect:
    (found,) = (one for one in plan.effects if one.stage == stage)
    return found


def both(
    light: Any,
    camera: ms.Camera,
    plan: ms.Plan,
    exposure: ms.Exposure = EXPOSURE,
    **options: Any,
) -> Any:
    """Frames with and without a plan, of equal seeds."""
    return [
        ms.expose(light, camera, exposure, plan=one, **options).digital.astype(np.float64)
        for one in (None, plan)
    ]


def test_prnu_of_few_bright_pixels_and_one_saturated_one_is_seen() -> None:
    """1.4 % of the pixels bright, one saturated: without PRNU they would move by tens of DN, at a tolerance of 0."""
    light = np.zeros((60, 60))
    light.ravel()[:: 3600 // 50] = 20_000.0
    light[7, 7] = 1e7
    plan = ms.plan(TABLE1, EXPOSURE, light)
    assert effect(plan, "PRNU").kept and effect(plan, "PRNU").spatial_dn > 5
    whole, planned = both(light, TABLE1, plan)
    np.testing.assert_array_equal(whole, planned)


@pytest.fixture
def few_green() -> ms.Camera:
    """One green pixel among 323 others; only green sees 900 nm."""
    tile = [["B"] * 18 for _ in range(18)]
    tile[4][9] = "G"
    curves = {"B": [0.5, 0.0], "G": [0.4, 0.4]}
    camera = ms.load_camera("bayer_2mp")
    return camera.replace(
        **{
            "quantum_efficiency.wavelengths_nm": [450.0, 900.0],
            "quantum_efficiency.curves": curves,
            "quantum_efficiency.tile": tile,
            "quantum_efficiency.reference_nm": 450.0,
        }
    )


def test_shot_noise_of_few_pixels_of_one_filter_is_seen(few_green: ms.Camera) -> None:
    """Under 900 nm 0.3 % of the pixels have light; the others are dark, and have as many photons."""
    light = ms.Photons(np.full((90, 90, 1), 10_000.0), np.array([900.0]))
    plan = ms.plan(few_green, SHORT, light, 0.02)
    assert effect(plan, "shot noise").kept
    sigma_dn = np.sqrt(4000.0) * gain_dn_per_e(few_green)
    assert effect(plan, "shot noise").temporal_dn == pytest.approx(sigma_dn, rel=0.02)
    whole, planned = (
        x[:, 4::18, 9::18].std(axis=0).mean()
        for x in both(light, few_green, plan, SHORT, frames=60)
    )
    assert planned == pytest.approx(whole, rel=0.01)


@pytest.mark.parametrize("black_level_dn", one_in(3, [2.0, 2.3, 2.5]))
def test_pixel_offsets_that_dither_the_offsets_of_columns_are_kept(
    black_level_dn: float,
) -> None:
    """6 bit, 0.013 DN of noise, pixel DSNU 0.013 DN: without it the column means follow the steps of the converter.

    The variance of the column means is ∫ (Σ Φ)² - (∫ Σ Φ)² over the offsets of the columns, by summing 40 000 of them.
    """
    fields = {
        "adc.bits": 6,
        "adc.black_level_dn": black_level_dn,
        "pixel.dsnu_e": 6.69,
        "readout.dsnu_col": 0.0044,
    }
    camera, rows = ms.load_camera("bayer_2mp").replace(**fields), 400
    dn_per_e = gain_dn_per_e(camera)
    noise, offset, column = 6.83 * dn_per_e, 6.69 * dn_per_e, 0.0044 * 64
    z = np.linspace(-6, 6, 40_001)
    chance = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    found = []
    for sigma in (noise, np.hypot(noise, offset)):
        ends = np.arange(1, 64) - 0.5
        code = ndtr((black_level_dn + column * z[:, None] - ends) / sigma).sum(axis=1)
        found.append(chance @ code**2 - (chance @ code) ** 2)
    moved = np.sqrt(rows * abs(found[1] - found[0]))
    alone = effect(
        ms.plan(camera, ms.Exposure(1e-3, 255.0), np.zeros((rows, 64)), 0.9 * moved),
        "DSNU pixel",
    )
    assert alone.kept and alone.spatial_dn < 0.2 * moved < moved < alone.structure_dn


def test_column_offsets_do_not_hide_behind_a_larger_prnu() -> None:
    """In quadrature with PRNU 2 % of 2048 DN the columns' 2.9 DN are 0.1 DN; in column means they are all there."""
    camera = TABLE1.replace(**{"pixel.prnu": 0.02, "readout.dsnu_col": 0.0007})
    light = np.full((200, 60), 27_500.0)
    alone = effect(ms.plan(camera, EXPOSURE, light, 0.2), "DSNU column")
    assert alone.kept and alone.spatial_dn == pytest.approx(2.87, rel=0.02)
    assert alone.structure_dn == pytest.approx(2.87 * np.sqrt(200), rel=0.02)
    plan = ms.plan(
        camera, EXPOSURE, light, 3.5
    )  # a pixel's own offset may go, a column's may not
    assert effect(plan, "DSNU column").spatial_dn < 3.5 and effect(plan, "DSNU column").kept
    whole, planned = (x.mean(axis=(0, 1)).std() for x in both(light, camera, plan))
    assert planned == pytest.approx(whole, rel=0.05)


def test_rows_are_judged_by_the_length_of_a_row() -> None:
    """Temporal row noise of 0.1 e-: 0.012 DN of a pixel, 0.25 DN beside the noise of a mean over 400 pixels."""
    camera = TABLE1.replace(**{"readout.row_noise_e": 0.1})
    dark = {
        n: effect(ms.plan(camera, EXPOSURE, np.zeros((8, n)), 0.1), "temporal row noise")
        for n in (16, 400)
    }
    assert not dark[16].kept and dark[400].kept
    assert dark[400].structure_dn == pytest.approx(20 * 0.1 * gain_dn_per_e(camera), rel=0.02)


def test_rare_telegraph_pixels_are_counted() -> None:
    """41 traps of 50 e- among 1e6 pixels: a spatial σ of 0.02 DN, and 41 pixels that jump by 6 DN."""
    fields = {
        "dark_current.rts_fraction": 41e-6,
        "dark_current.rts_amplitude_e_per_s": 500.0,
        "dark_current.fom_na_per_cm2": 0.0,
    }
    camera = TABLE1.replace(**fields)
    found = effect(ms.plan(camera, EXPOSURE, np.full((1000, 1000), 100.0), 0.1), "RTS pixels")
    assert found.largest_dn < 0.1 and found.kept
    assert 41 <= found.pixels_beyond < 60
    few = ms.plan(camera, EXPOSURE, np.full((50, 50), 100.0), 0.1)
    assert not effect(few, "RTS pixels").kept and effect(few, "RTS pixels").pixels_beyond < 1


def test_hot_pixels_keep_the_dark_current() -> None:
    """1e-5 of the pixels with 1000 e-: 0.0012 DN on average, and ten pixels of a megapixel."""
    part = {"weight": 1e-5, "family": "uniform", "low": 900.0, "high": 1100.0, "unit": "e"}
    camera = TABLE1.replace(
        **{"dark_current.components": [part], "dark_current.fom_na_per_cm2": 0.0}
    )
    found = effect(ms.plan(camera, EXPOSURE, np.zeros((1000, 1000)), 1.0), "dark current")
    assert found.kept and found.mean_dn < 0.01 and 10 <= found.pixels_beyond < 15


def test_a_camera_without_dark_current_and_traps_has_none_in_its_plan() -> None:
    """Neither in the plan, nor in the noise budget of the frames that it makes."""
    camera = TABLE1.replace(**{"dark_current.fom_na_per_cm2": 0.0})
    light = np.full((20, 20), 1000.0)
    plan = ms.plan(camera, EXPOSURE, light, 0.02)
    found = effect(plan, "dark current")
    assert (
        found.largest_dn == 0
        and found.pixels_beyond == 0
        and found.reason == "has no effect here"
    )
    budget = {
        one.source: one
        for one in ms.expose(light, camera, EXPOSURE, plan=plan).noise_budget().entries
    }
    assert "dark current" not in budget
    assert budget["dark shot noise"].temporal_dn2 == pytest.approx(0, abs=1e-9)
    assert budget["photon shot noise"].temporal_dn2 == pytest.approx(
        600 * gain_dn_per_e(camera) ** 2, rel=0.01
    )


def test_shot_noise_left_out_leaves_every_mean_where_it_was() -> None:
    """Two photoelectrons in the mean with and without, under a QE of 0.6: only their noise of 0.14 DN goes."""
    light = np.full((40, 40), 2.0)
    plan = ms.plan(TABLE1, ms.Exposure(1e-6), light, 0.5)
    found = effect(plan, "shot noise")
    assert not found.kept and found.mean_dn < 1e-4
    assert found.temporal_dn == pytest.approx(np.sqrt(1.2) * gain_dn_per_e(TABLE1), rel=0.01)
    whole, planned = (x.mean() for x in both(light, TABLE1, plan, ms.Exposure(1e-6), frames=16))
    assert planned == pytest.approx(whole, abs=0.05)


def test_the_pixels_that_several_laws_with_tails_move_are_bounded_together() -> None:
    """PRNU and a wide dark current that each stay within the tolerance, far out in their tails, may not both go."""
    fields = {
        "pixel.prnu": 0.001,
        "dark_current.cv": 0.5,
        "dark_current.distribution": "lognormal",
    }
    camera, light = TABLE1.replace(**fields), np.full((200, 200), 2000.0)
    exposure = ms.Exposure(0.0006)
    alone = ms.plan(camera, exposure, light, 1.0)
    found = {name: effect(alone, name) for name in ("PRNU", "dark current")}
    assert all(one.largest_dn < 1 and one.pixels_beyond < 1 for one in found.values())
    assert sum(not one.kept for one in found.values()) == 1


def measured(**pixels: float) -> dict[str, Any]:
    """A map of column offsets with one column that is off [e-]."""
    columns = np.zeros((1, 60))
    columns[0, 7] = pixels["column_e"]
    return {"dsnu_col_e": columns}


def test_a_measured_map_is_judged_as_it_is_pixel_by_pixel() -> None:
    """The datasheet has no column offsets; the map has one, of 500 e-, and it is kept."""
    camera, light = TABLE1.replace(**{"readout.dsnu_col": 0.0}), np.full((40, 60), 1000.0)
    for column_e, kept in ((500.0, True), (1e-5, False)):
        maps = measured(column_e=column_e)
        frames = ms.expose(light, camera, EXPOSURE, maps=maps, tolerance_dn=0.05)
        assert frames.plan is not None and effect(frames.plan, "DSNU column").kept == kept
        plan = ms.plan(camera, EXPOSURE, light, 0.05, maps=maps)
        np.testing.assert_array_equal(
            frames.digital, ms.expose(light, camera, EXPOSURE, maps=maps, plan=plan).digital
        )
    found = effect(
        ms.plan(camera, EXPOSURE, light, 0.05, maps=measured(column_e=3.0)), "DSNU column"
    )
    assert 40 <= found.pixels_beyond < 120


def test_one_hot_pixel_of_a_measured_map_is_counted() -> None:
    gains = np.ones((40, 60))
    gains[3, 3] = 1.05
    camera = TABLE1.replace(**{"pixel.prnu": 0.0})
    found = effect(
        ms.plan(camera, EXPOSURE, np.full((40, 60), 1000.0), 1.0, maps={"prnu": gains}), "PRNU"
    )
    assert found.kept and found.pixels_beyond >= 1


@pytest.mark.parametrize("photons", one_in(3, [2.0, 30_000.0, 70_000.0]))
def test_theory_without_shot_noise_is_that_of_frames_without_it(photons: float) -> None:
    """σ of the columns 4.1 DN, of a well at 0.25 V full scale; within 4 standard errors of 24 serials."""
    camera, light = TABLE1.replace(**{"adc.full_scale_v": 0.25}), np.full((24, 200), photons)
    plan = ms.plan(camera, EXPOSURE, light, 1e9)
    stages = tuple(stage for stage in plan.whole if not stage.counts_electrons)
    frames = np.stack(
        [
            sample(stages, ms.Photons(light), ms.Frame(EXPOSURE, SensorWindow(n, (24, 200)), n))
            for n in range(24)
        ]
    )
    expected = FrameTheory(stages, plan.light, plan.frame).averages(stages[-1])
    means = frames.mean(axis=(1, 2))
    error = np.hypot(means.std(ddof=1) / np.sqrt(24), expected.errors[0])
    assert abs(means.mean() - expected.mean) < 4 * error + 1e-6
    squares = ((frames - expected.mean) ** 2).mean(axis=(1, 2))
    error = np.hypot(squares.std(ddof=1) / np.sqrt(24), expected.errors[2])
    assert abs(squares.mean() - expected.temporal - expected.spatial) < 4 * error + 1e-6


@pytest.mark.parametrize("photons", [3.0, 900.0])
def test_electrons_that_photons_free_vary_without_shot_noise(photons: float) -> None:
    """Yield 2.5, Fano 0.5: temporal variance within 4 standard errors of 24 serials (chance of a miss 6e-5)."""
    yields = {"quantum_yield": [2.5, 2.5], "fano_factor": 0.5, "curves": {"mono": [0.6, 0.6]}}
    camera = TABLE1.replace(
        **{f"quantum_efficiency.{name}": value for name, value in yields.items()}
    )
    light = ms.Photons(np.full((24, 200, 1), photons), np.array([550.0]))
    plan = ms.plan(camera, EXPOSURE, light)
    stages = tuple(stage for stage in plan.whole if not stage.counts_electrons)
    windows = [SensorWindow(n, (24, 200)) for n in range(24)]
    frames = [
        [sample(stages, light, ms.Frame(EXPOSURE, window, n, k)) for k in range(2)]
        for n, window in enumerate(windows)
    ]
    found = 0.5 * np.diff(np.array(frames), axis=1)[:, 0] ** 2
    temporal = FrameTheory(stages, plan.light, plan.frame).averages(stages[-1]).temporal
    of_serials = found.mean(axis=(1, 2))
    assert abs(of_serials.mean() - temporal) < 4 * of_serials.std(ddof=1) / np.sqrt(24)


def test_noise_that_hides_whole_electrons_from_the_converter_is_kept() -> None:
    """Of steps 118.95 electrons wide some take 118 counts and others 119: without read noise the variance goes up and
    down by 0.01 DN² over 2 300 electrons, whatever the shot noise; here by SciPy's Poisson law and the steps alone.
    """
    changes = {
        "pixel.prnu": 0.0,
        "source_follower.read_noise_e": 4.0,
        "adc.bits": 10,
        "adc.full_scale_v": 0.73084,
    }
    camera, cold = ms.load_camera("eev_44_82").replace(**changes), ms.Exposure(1e-3, 200.0)
    per_e = gain_dn_per_e(camera)
    assert 1 / per_e == pytest.approx(118.95, abs=0.01)
    means = np.linspace(66_000.0, 70_000.0, 81)
    counts = np.arange(64_000, 72_000)
    chance, codes = poisson.pmf(counts, means[:, None]), np.floor(counts * per_e + 0.5)
    without = chance @ codes**2 - (chance @ codes) ** 2
    moved = np.abs(
        without - (per_e**2 * (means + 4.0**2) + 1 / 12)
    ).max()  # the noise hides the wave: K²σ² and 1/12
    assert moved > 0.009
    light = np.tile(means / camera.qe([camera.quantum_efficiency.reference_nm])[0, 0], (20, 1))
    plan = ms.plan(camera, cold, light, 0.9 * moved**0.5)
    assert effect(plan, "source follower noise").temporal_dn >= 0.95 * moved**0.5
    assert "source follower noise" not in plan.left_out
    assert "source follower noise" in ms.plan(camera, cold, light, 1.6 * moved**0.5).left_out


def test_the_report_of_a_frame_without_shot_noise_is_right() -> None:
    """Its light is in photoelectrons: the QE is not applied a second time."""
    light = np.full((40, 40), 2.0)
    frames = ms.expose(light, TABLE1, ms.Exposure(1e-6), tolerance_dn=0.5)
    assert "shot noise" in frames.plan.left_out  # type: ignore[union-attr]
    dark, *_ = [
        line for line in frames.report["stages"] if line["name"] == "quantum efficiency"
    ]
    assert dark["mean_expected"] == pytest.approx(1.2, rel=1e-3)
    last = frames.report["stages"][-1]
    assert last["mean_expected"] == pytest.approx(last["mean_frame"], abs=1.0)


def test_what_is_a_share_of_the_light_is_looked_at_where_a_pixel_is_about_full() -> None:
    """PRNU of 0.5 % moves a pixel of 250 DN by 5 DN at 4 σ; a straight camera has no other level of light there."""
    camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 8, "pixel.prnu": 0.005})
    ramp = np.tile(np.linspace(0, 70_000, 249), (87, 1))
    plan = ms.plan(camera, ms.Exposure(0.01), ramp, tolerance_dn=3.37)
    assert "PRNU" not in plan.left_out and "DSNU pixel" in plan.left_out


@pytest.mark.parametrize("name", [exhaustive("sony_a7s2"), "bayer_2mp"])
def test_more_light_never_makes_the_largest_effect_smaller(name: str) -> None:
    """Beyond saturation the largest shot noise is still that of a pixel that is about full."""
    camera = ms.load_camera(name)
    largest_dn = []
    for brightest in (1e3, 1e4, 1e5, 1e6):
        photons = np.tile(np.geomspace(1.0, brightest, 300), (20, 1))
        effects = ms.plan(camera, ms.Exposure(0.01), photons).effects
        largest_dn.append(
            next(effect.temporal_dn for effect in effects if effect.stage == "shot noise")
        )
    assert all(after > 0.9 * before for before, after in itertools.pairwise(largest_dn))


def test_a_gain_that_shows_in_hot_pixels_alone_is_kept() -> None:
    """12 pixels of 40 000 have 10 000 dark electrons, of which a column gain of 0.1 % is 1.2 DN at 1σ; in all others it
    is 0.02 DN. 9 of the 12 are expected to move by more than 0.4 DN."""
    camera = ms.load_camera("konnik_table1").replace(
        **{
            "pixel.prnu": 0.0,
            "dark_current.cv": 0.0,
            "dark_current.rts_fraction": 3e-4,
            "dark_current.rts_amplitude_e_per_s": 100_000.0,
            "dark_current.rts_duty": 1.0,
            "readout.prnu_col": 0.001,
        }
    )
    plan = ms.plan(camera, ms.Exposure(0.1), np.full((200, 200), 10.0), 0.4)
    gain = next(effect for effect in plan.effects if effect.stage == "PRNU column")
    assert gain.kept and 6 < gain.pixels_beyond < 24
