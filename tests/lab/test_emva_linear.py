"""The temporal figures of EMVA 1288: right within intervals that hold, and marked where frames cannot give them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.small_cameras import SmallCamera

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import EmvaLinear, emva_linear

CAMERA = SmallCamera()
TRUE = {"K": 0.3, "η": 0.6, "R": 0.18, "σ_d": 6.0, "σ_y.dark": (1.8**2 + 1 / 12) ** 0.5}


def bench(seed: int = 0, **of: Any) -> tuple[list[Stack], list[Stack]]:
    return CAMERA.bench(np.random.default_rng(seed), **of)


def assert_marked_or_right(found: EmvaLinear) -> None:
    """Every figure holds the true value, or is unknown or restricted with a note."""
    for symbol, true in TRUE.items():
        one = found[symbol]
        assert (math.isnan(one.value) and one.note) or one.covers(true) or one.note, str(one)


def test_the_figures_of_a_linear_camera_are_those_that_it_was_made_with() -> None:
    """16 frames of 64 × 64 pixels: each within its interval, and these are narrow."""
    found = emva_linear(*bench(1, count=16, shape=(64, 64)))
    for symbol, true in TRUE.items():
        assert found[symbol].covers(true), str(found[symbol])
    assert (
        found["K"].high < 1.012 * found["K"].low and found["σ_d"].high < 1.02 * found["σ_d"].low
    )
    assert found["LE"].value < 0.05 and found["LE"].low == 0
    assert found.saturation.peak.limited_by == "well"
    assert found["µ_e.sat"].low <= 10_000 <= 1.05 * found["µ_e.sat"].value
    # EMVA 1288 R4 2.4, of the true figures
    least = (TRUE["σ_y.dark"] ** 2 / 0.09 + 0.25) ** 0.5 + 0.5
    assert found["µ_e.min"].covers(least) and found["µ_p.min"].covers(least / 0.6)
    assert found["DR"].value == pytest.approx(found["µ_p.sat"].value / found["µ_p.min"].value)
    assert found["SNR_max"].value == pytest.approx(found["µ_e.sat"].value ** 0.5)
    assert not found.notes


@pytest.mark.parametrize(("cameras", "fewest", "most"), [(25, 0, 6), exhaustive(300, 4, 27)])
def test_intervals_of_k_qe_and_dark_noise_cover_95_of_100_cameras(
    cameras: int, fewest: int, most: int
) -> None:
    """Random cameras. Right 95 % intervals are missed in 1.3 ± 1.1 of 25 (more than 6: chance 1 in 6000 for each
    figure), in 15 ± 3.8 of 300 (fewer than 4, more than 27: 1 in 250), and the seed is fixed."""
    rng, missed = np.random.default_rng(2), dict.fromkeys(("K", "η", "σ_d"), 0)
    for number in range(cameras):
        gain, efficiency = rng.uniform(0.05, 2), rng.uniform(0.2, 0.9)
        noise = rng.uniform(0.75, 6) / gain
        camera = SmallCamera(
            gain, efficiency, noise, 3500 / gain, 100, dsnu_dn=float(rng.choice([0, 0.1, 3]))
        )
        found = emva_linear(*camera.bench(rng, (2, 2, 4)[number % 3], (16, 16), 8))
        for symbol, true in (("K", gain), ("η", efficiency), ("σ_d", noise)):
            missed[symbol] += not found[symbol].covers(true)
    assert all(fewest <= count <= most for count in missed.values()), missed


def test_light_that_drifts_by_1_percent_is_found_and_does_not_move_k() -> None:
    found = emva_linear(*bench(3, count=16, shape=(48, 48), drift=0.01))
    assert found["K"].covers(0.3) and found["K"].value == pytest.approx(0.3, rel=0.02)
    assert found["η"].value == pytest.approx(0.6, rel=0.02) and found["η"].covers(0.6)
    assert (
        any("frame means drift by" in note for note in found.notes)
        and "notes of the series" in found["K"].note
    )


def test_without_photons_k_stays_and_what_needs_photons_says_why() -> None:
    darks, flats = bench(5)
    times = np.linspace(0.001, 0.03, len(flats))
    unknown = [
        replace(one, photons=None, exposure_s=float(time))
        for one, time in zip(flats, times, strict=True)
    ]
    found = emva_linear([replace(darks[0], photons=None)], unknown)
    assert (
        found["K"].covers(0.3) and found["R"].unit == "DN/s" and found["µ_e.sat"].value > 9000
    )
    for symbol in ("η", "µ_p.sat", "µ_p.min"):
        assert math.isnan(found[symbol].value) and "photons are not known" in found[symbol].note
    assert "no dark frames at" in found.notes[0]
    alike = emva_linear(darks, [replace(one, photons=None) for one in flats])
    assert alike["K"].covers(0.3) and "tell the levels apart" in alike["R"].note


@pytest.mark.parametrize("code", [0, 64, 4095])
def test_frames_of_one_code_have_no_gain_and_say_so(code: int) -> None:
    def stack(photons: float) -> Stack:
        return Stack(np.full((4, 20, 20), code, np.uint16), 0.01, photons=photons, bits=12)

    found = emva_linear([stack(0.0)], [stack(float(one)) for one in range(1, 9)])
    for one in found.quantities:
        assert (math.isnan(one.value) or one.value == 0) and one.note, str(one)


def test_float_frames_and_averages_are_measured_with_their_own_rounding() -> None:
    darks, flats = bench(7, shape=(48, 48), count=4)
    whole = emva_linear(darks, flats)
    same = emva_linear(
        *(
            [replace(one, frames=one.frames.astype(np.float32)) for one in part]
            for part in (darks, flats)
        )
    )
    assert [one.value for one in same.quantities] == pytest.approx(
        [one.value for one in whole.quantities], rel=1e-6
    )
    half = [
        [replace(one, frames=one.frames / 2 + 0.25) for one in part] for part in (darks, flats)
    ]
    found = emva_linear(*half)
    assert found["K"].value == pytest.approx(whole["K"].value / 2, rel=1e-6)
    assert any("no rounding was subtracted" in note for note in found.notes)


@pytest.mark.parametrize(
    ("bits", "gain"), one_in(2, [(8, 0.022), (10, 0.08), (14, 1.3), (16, 6.0)], several=True)
)
def test_8_to_16_bits(bits: int, gain: float) -> None:
    """With 8 bits the dark noise of 6 e- is 0.13 DN, of which there is a bound."""
    camera = SmallCamera(
        gain=gain, bits=bits, black_dn=8.0 + 40 * gain, dsnu_dn=0.8 if bits == 8 else 0.0
    )
    found = emva_linear(*camera.bench(np.random.default_rng(bits), 8, (64, 64), 25))
    for symbol, true in (("K", gain), ("η", 0.6), ("σ_d", 6.0)):
        assert found[symbol].covers(true) or found[symbol].value == pytest.approx(
            true, rel=0.05
        ), str(found[symbol])
    assert found["σ_d"].is_bound == (bits == 8)


def test_a_black_level_that_cuts_the_dark_frames_leaves_no_figure_that_needs_them() -> None:
    camera = replace(CAMERA, black_dn=0.0)
    found = emva_linear(*camera.bench(np.random.default_rng(8)))
    assert "of the values are 0: the black level is too low" in found.notes[0]
    for symbol in ("K", "η", "σ_y.dark", "σ_d", "µ_e.min", "µ_p.min", "DR", "SNR_max"):
        assert math.isnan(found[symbol].value) and found[symbol].clipped, str(found[symbol])
        assert "the black level is too low" in found[symbol].note


def test_codes_of_12_bits_that_lie_in_16_are_noted() -> None:
    darks, flats = (
        [replace(one, frames=16 * one.frames, bits=16) for one in part] for part in bench(15)
    )
    assert "multiples of 16: divide" in "".join(emva_linear(darks, flats).notes)


def test_each_filter_of_a_mosaic_is_measured_apart() -> None:
    darks, flats = (
        [replace(one, tile=(("R", "G"), ("G", "B"))) for one in part]
        for part in bench(9, shape=(64, 64))
    )
    with pytest.raises(ms.InputError, match=r"of Stack.of_filters\(\)"):
        emva_linear(darks, flats)
    of = [[one.of_filters()["G (2)"] for one in part] for part in (darks, flats)]
    assert_marked_or_right(emva_linear(*of))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda darks, flats: ([], flats), "0 dark stacks and 30 flat stacks"),
        (lambda darks, flats: (darks, []), "1 dark stacks and 0 flat stacks"),
        (
            lambda darks, flats: (darks, [flats[0].window(slice(20), slice(20)), *flats]),
            "differ in shape",
        ),
        (
            lambda darks, flats: (darks, [replace(flats[0], gain="ISO 800"), *flats]),
            "differ in gain",
        ),
        (lambda darks, flats: (darks, [replace(flats[0], bits=13), *flats]), "differ in bits"),
        (
            lambda darks, flats: (darks, [replace(flats[9], bits=8), *flats]),
            "is beyond 8 bits; pass the bits of",
        ),
        (
            lambda darks, flats: (darks, [replace(flats[0], photons=None), *flats]),
            "give all of them or none",
        ),
        (
            lambda darks, flats: ([replace(darks[0], frames=darks[0].frames[:1])], flats),
            "one frame has no temporal",
        ),
        (
            lambda darks, flats: (darks, [replace(flats[0], photons=np.ones((32, 32)))]),
            "photons are an array",
        ),
    ],
)
def test_stacks_that_do_not_belong_together_are_refused(change: Any, said: str) -> None:
    with pytest.raises(ms.InputError) as error:
        emva_linear(*change(*bench(10)))
    assert said in str(error.value)


def test_a_window_measures_the_centre() -> None:
    darks, flats = bench(11, shape=(64, 64))
    edge = [replace(one, frames=one.frames.copy()) for one in flats]
    for one in edge:
        one.frames[:, :8] = 0  # vignetting, at its worst
    found = emva_linear(darks, edge, window=40)
    assert found["K"].covers(0.3) and found["R"].covers(0.18) and not found.notes


def test_the_measured_snr_is_that_of_the_model_up_to_saturation() -> None:
    """16 frames of 48 × 48 pixels: 1 % in the noise, and less than an ideal sensor's."""
    found = emva_linear(*bench(13, count=16, shape=(48, 48))).snr
    below = found.light < 0.9 * 10_000 / 0.6
    assert found.measured[below] == pytest.approx(found.model[below], rel=0.02)
    assert (found.measured < found.ideal)[below].all()


@pytest.mark.parametrize("prnu", [0.0, 0.02])
def test_saturation_is_where_the_variance_of_many_levels_is_largest(prnu: float) -> None:
    """EMVA 1288 R4 2.4 by brute force: 200 frames at levels 0.2 % apart; a series of 30 levels finds it within 1 %."""
    camera, rng = replace(CAMERA, prnu=prnu), np.random.default_rng(14)
    levels = np.arange(0.92, 1.03, 0.002) * 10_000 / 0.6
    variances = [
        np.var(camera.frames(rng, one, 200, (16, 16)), axis=0, ddof=1).mean() for one in levels
    ]
    smooth = np.polynomial.Polynomial.fit(levels, variances, 7)(levels)
    found = emva_linear(*camera.bench(rng, 4, (48, 48), 30))
    assert found["µ_p.sat"].value == pytest.approx(levels[np.argmax(smooth)], rel=0.01)
    assert found["µ_p.sat"].covers(levels[np.argmax(smooth)])


@pytest.mark.parametrize("bend", one_in(2, [-0.04, 0.0, 0.005, 0.04]))
def test_k_of_a_curved_response_is_that_of_small_signals_and_that_of_the_fit(
    bend: float,
) -> None:
    """Gain at full well is 1 + bend times that at zero. Of a line through the curve K would be 8 % off at 0.04."""
    camera = SmallCamera(curve=lambda electrons: electrons * (1 + bend * electrons / 10_000))
    darks, flats = camera.bench(np.random.default_rng(9), count=4, shape=(64, 64))
    found = emva_linear(darks, flats)
    assert found["K"].covers(0.3) and found["K"].value == pytest.approx(0.3, rel=0.02)
    assert found["η"].covers(0.6) and found["R"].value == pytest.approx(0.18, rel=0.002)
    assert ("of small signals" in found["K"].note) == bool(bend)
    if bend:
        assert found["K_line"].value == pytest.approx(found.as_measured.gain.value)
        assert "the response is curved" in found.notes[-1]
    assert found.curve.kappa == pytest.approx(bend / 3000, abs=2e-7)


def test_k_of_a_response_of_the_fourth_power_is_that_of_small_signals() -> None:
    """y = s(1 − 0.02 (s/s_end)³), as the simulated reference set of EMVA 1288 has it: of a parabola K is 0.8 % off."""
    camera = SmallCamera(
        curve=lambda electrons: electrons * (1 - 0.02 * (electrons / 10_000) ** 3)
    )
    darks, flats = camera.bench(
        np.random.default_rng(10), count=16, shape=(160, 160), levels=30
    )
    found = emva_linear(darks, flats)
    assert found["K"].covers(0.3) and found["K"].value == pytest.approx(0.3, rel=0.004)
    assert found["η"].covers(0.6) and found["R"].value == pytest.approx(0.18, rel=0.001)
