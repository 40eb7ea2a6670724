"""The twin of a camera: what is put into frames comes back, with intervals, or a sentence or a mark says why not."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import scipy
from helpers import BENCHMARKS
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera_file import camera_from
from mitsuba_sensor.core.noise_distributions import TukeyLambda
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.lab.statistics.mean_squares import MeanSquare, MeanSquares
from mitsuba_sensor.lab.twin import fit
from mitsuba_sensor.lab.twin.dark import frame_noise
from mitsuba_sensor.lab.twin.evidence import Fitted
from mitsuba_sensor.lab.twin.fit import held_out
from mitsuba_sensor.lab.twin.maps import CombinedMap
from mitsuba_sensor.lab.twin.read_law import (
    NORMAL_TAU4,
    read_law,
    sample_l_moments,
    tukey_shape,
)
from mitsuba_sensor.lab.twin.setting import root_mean_square, weighted_mean
from mitsuba_sensor.stages.gains import gain_dn_per_e

RNG = np.random.default_rng(16)
Change = Callable[[Stack], Stack]


@pytest.fixture(scope="module")
def trips() -> ModuleType:
    """The benchmark, which makes random cameras and their benches."""
    spec = importlib.util.spec_from_file_location(
        "fit_round_trips", BENCHMARKS / "fit_round_trips.py"
    )
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    __import__("sys").modules["fit_round_trips"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def bench(trips: ModuleType) -> Bench:
    """Of one small camera whose well ends the range: 12 frames of bias and dark, 18 flat fields."""
    return trips.random_trip(3, 40, 12).bench()


def changed(bench: Bench, change: Change, kinds: str = "biases darks flats") -> Bench:
    """The same with these stacks changed."""
    return replace(
        bench, **{kind: tuple(map(change, getattr(bench, kind))) for kind in kinds.split()}
    )


# The parts, against closed forms


def test_a_map_has_the_spread_without_what_averaging_left_of_noise() -> None:
    """σ of rows 2, columns 1 and pixels 3 in noise of σ 4; 200 × 300 lines give σ within 15 % but once in 1000."""
    shape = 200, 300
    pattern = (
        2 * RNG.normal(size=(200, 1)) + RNG.normal(size=(1, 300)) + 3 * RNG.normal(size=shape)
    )
    one = MeanSquare(16.0, 59_000.0)
    squares = MeanSquares(one, one, one, shape)
    found = CombinedMap(pattern + 4 * RNG.normal(size=shape), ((squares, 1.0),))
    for (name, part), sigma in zip(found.parts().items(), (2.0, 1.0, 3.0), strict=True):
        assert part.std() == pytest.approx(sigma, rel=0.18), name
        assert part.std() == pytest.approx(found.spread()[name][0], rel=0.01)


def test_filters_are_averaged_by_their_errors() -> None:
    def one(value: float, half: float) -> Fitted:
        return Fitted(Quantity("K", "", value, value - half, value + half, "", ""), "files")

    found = weighted_mean([one(1.0, 0.1), one(1.3, 0.2)]).quantity
    assert found.value == pytest.approx((1.0 / 0.01 + 1.3 / 0.04) / (1 / 0.01 + 1 / 0.04))
    assert found.high - found.value == pytest.approx((1 / 0.01 + 1 / 0.04) ** -0.5, rel=1e-6)
    apart = weighted_mean([one(1.0, 0.1), one(2.0, 0.1)]).quantity
    assert "differ" in apart.note and apart.high - apart.low > 1
    assert root_mean_square(
        [one(3.0, 0.1).quantity, one(4.0, 0.1).quantity]
    ).value == pytest.approx(math.sqrt(12.5))


def test_a_quarter_of_the_frames_of_long_stacks_is_held_out(bench: Bench) -> None:
    kept, held = held_out(bench)
    assert [len(one) for one in kept.darks] == [9] * 3
    assert [len(one) for one in held.darks] == [3] * 3
    assert {len(one) for one in kept.flats} == {4, 9}
    assert np.shares_memory(kept.darks[0].frames, bench.darks[0].frames)


# Round trips


@pytest.mark.parametrize("seeds", [range(20, 22), exhaustive(range(22, 24))], ids=str)
def test_random_cameras_come_back(seeds: range, trips: ModuleType) -> None:
    """Cameras of 12 or 13 parameters: no error of more than 2 half intervals (chance: once in 250 suites), and all but
    5 of 25 intervals cover (chance of fewer: 1 in 500)."""
    found = list(trips.results(seeds, size=56, frames=16))
    half = {
        (seed, name): (q.value - q.low) if truth < q.value else (q.high - q.value)
        for seed, name, truth, q in found
    }
    far = [
        (seed, name)
        for seed, name, truth, q in found
        if abs(q.value - truth) > 2 * half[seed, name] + 1e-9
    ]
    assert not far
    assert sum(q.covers(truth) for _, _, truth, q in found) >= len(found) - 5
    errors = {
        name: max(abs(q.value / t - 1) for _, other, t, q in found if other == name)
        for name in ("K", "σ_read")
    }
    assert errors["K"] <= 0.01 and errors["σ_read"] <= 0.03


def test_the_tables_make_a_camera_of_the_fitted_gain(bench: Bench) -> None:
    twin = fit(bench)
    camera = camera_from(twin.tables(), "twin")
    assert gain_dn_per_e(camera) == pytest.approx(twin.base.gain.quantity.value, rel=1e-9)
    assert camera.sources["source_follower.read_noise_e"].startswith("fit: ")
    assert "12 frames dark_0s" in camera.sources["source_follower.read_noise_e"]
    assert camera.sources["pixel.pitch_x_um"].startswith("assumed: ")
    frames = ms.expose(0.0, camera, ms.Exposure(0.0), maps=twin.maps, frames=12)
    assert frames.digital.mean() == pytest.approx(bench.biases[0].frames.mean(), abs=0.5)


def test_what_frames_do_not_show_is_taken_from_another_camera(bench: Bench) -> None:
    like = ms.load_camera("konnik_table1")
    twin = fit(bench)
    camera = camera_from(twin.tables(like.model_dump()), "twin")
    assert camera.pixel.pitch_x_um == like.pixel.pitch_x_um
    assert camera.sources["pixel.pitch_x_um"].startswith("of konnik_table1: ")
    assert gain_dn_per_e(camera) == pytest.approx(twin.base.gain.quantity.value, rel=1e-9)
    assert camera.readout.reset == "true_cds" and camera.dark_current.fom_na_per_cm2 is None


def test_a_camera_of_another_mosaic_is_refused(bench: Bench) -> None:
    with pytest.raises(ms.InputError, match="RG / GB, the frames have none"):
        fit(bench).tables(ms.load_camera("bayer_2mp").model_dump())


def test_a_mosaic_is_fitted_filter_by_filter() -> None:
    """K of four filters together within 1.5 %; PRNU 1 % within 6 %; the QE of each within 3 %: 4 standard errors."""
    changes = {
        "sensor.rows": 48,
        "sensor.columns": 64,
        "readout.dsnu_col": 0.0,
        "adc.black_level_dn": 80.0,
    }
    camera = ms.load_camera("bayer_2mp").replace(**changes)
    tile = tuple(tuple(camera.filter_names[k] for k in row) for row in camera.tile)

    def stack(level: float, frames: int, seed: int) -> Stack:
        photons = level * camera.pixel.full_well_e / 0.55
        light = np.full((48, 64, 1), photons)
        made = ms.expose(
            light, camera, ms.Exposure(0.01), wavelengths_nm=[550.0], frames=frames, seed=seed
        )
        return Stack(made.digital, 0.01, photons, bits=12, tile=tile, source=f"level_{level:g}")

    levels = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.2, 2.5, 5, 8, 11, 14, 25)
    flats = tuple(
        stack(level, 24 if level in (0.5, 11) else 4, 10 + k) for k, level in enumerate(levels)
    )
    twin = fit(Bench((), (stack(0.0, 24, 1),), flats, (), 550.0))
    one = camera_from(twin.tables(), "twin")
    assert one.tile == camera.tile and one.filter_names == camera.filter_names
    assert twin.base.gain.quantity.value == pytest.approx(gain_dn_per_e(camera), rel=0.015)
    assert one.pixel.prnu == pytest.approx(0.01, rel=0.06)
    assert one.qe([550.0])[:, 0] == pytest.approx(camera.qe([550.0])[:, 0], rel=0.03)
    assert twin.maps["prnu"].shape == (48, 64)


def test_gain_settings_become_a_ladder_and_a_change_of_the_conversion_gain_is_found(
    bench: Bench,
) -> None:
    """The second setting has a quarter of the noise in DN at twice the gain, which one amplifier cannot do."""
    black = float(bench.biases[0].frames.mean())

    def louder(stack: Stack) -> Stack:
        frames = stack.frames.astype(float) - black
        dark = 0.0 if stack.photons else 0.125
        frames = (
            frames * 2
            if stack.photons
            else frames * dark * 2 + RNG.normal(0, 0.3, frames.shape)
        )
        return replace(
            stack, frames=np.clip(np.round(frames + black), 0, 2**16 - 1), gain="800", bits=16
        )

    low = changed(bench, lambda stack: replace(stack, gain="100"))
    high = changed(bench, louder)
    both = Bench(
        (*low.biases, *high.biases), (*low.darks, *high.darks), (*low.flats, *high.flats)
    )
    twin = fit(both)
    assert [one.name for one in twin.settings] == ["100", "800"]
    rungs = twin.tables()["gains"]
    assert [rung["iso"] for rung in rungs] == [100.0, 800.0]
    assert rungs[1]["gain_dn_per_e"] > 1.5 * rungs[0]["gain_dn_per_e"]
    assert any("conversion gain changes from 100 to 800" in note for note in twin.notes)


# Frames that do not show everything: a sentence, a wider interval or a mark


@pytest.mark.parametrize(
    ("change", "kinds", "sentence"),
    [
        (
            lambda s: replace(s, frames=s.frames[:1]),
            "biases darks",
            "no dark stack has 2 frames",
        ),
        (
            lambda s: replace(s, frames=s.frames[:1]),
            "flats",
            "single frames have no temporal variance",
        ),
        (
            lambda s: replace(s, frames=s.frames * 0),
            "biases darks flats",
            "every value is 0 DN",
        ),
        (
            lambda s: replace(s, frames=np.full_like(s.frames, 16383)),
            "biases darks flats",
            "every value is 16383 DN",
        ),
        (
            lambda s: replace(s, frames=np.full_like(s.frames, 16383)),
            "flats",
            "K cannot be measured",
        ),
        (lambda s: replace(s, frames=s.frames[:, :-1]), "darks", "the frames differ in size"),
        (
            lambda s: s.window(slice(0, 6), slice(0, 40)),
            "biases darks flats",
            "6 rows or columns per filter",
        ),
    ],
)
def test_frames_that_show_no_camera_are_refused(
    bench: Bench, change: Change, kinds: str, sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        fit(changed(bench, change, kinds))


@pytest.mark.parametrize("kind", ["darks", "flats"])
def test_a_bench_without_dark_or_flat_frames_is_refused(bench: Bench, kind: str) -> None:
    with pytest.raises(ms.InputError, match="there are no"):
        fit(replace(bench, biases=(), **{kind: ()}))


def test_light_that_drifts_is_no_noise(bench: Bench, trips: ModuleType) -> None:
    black = float(bench.biases[0].frames.mean())

    def drifting(stack: Stack) -> Stack:
        factor = 1 + 0.01 * RNG.normal(size=(len(stack), 1, 1))
        return replace(
            stack,
            frames=np.round((stack.frames - black) * factor + black)
            .clip(0, 16383)
            .astype(np.uint16),
        )

    twin = fit(changed(bench, drifting, "flats"))
    gain = twin.base.gain.quantity
    off = abs(gain.value - trips.random_trip(3, 40, 12).put_in()["K"])
    assert off < gain.high - gain.low < 0.06 * gain.value, (
        "two halves of its interval: chance fails once in 10 000"
    )
    assert any("drift" in note for note in twin.notes)


def test_float_frames_are_fitted_without_rounding_and_a_note_says_so(bench: Bench) -> None:
    def floats(stack: Stack) -> Stack:
        return replace(
            stack, frames=stack.frames + RNG.uniform(-0.5, 0.5, stack.frames.shape), bits=None
        )

    twin = fit(changed(bench, floats))
    assert any("fractions of codes" in note for note in twin.notes)
    noise, whole = (one.figures()["σ_read"].quantity for one in (twin, fit(bench)))
    assert noise.low < math.hypot(whole.value, 0.1) < noise.high


def test_one_dark_time_leaves_dark_current_in_the_black_level(bench: Bench) -> None:
    twin = fit(replace(bench, biases=(), darks=bench.darks[:1]))
    assert "one exposure time" in twin.tables()["sources"]["dark_current.rate_e_per_s"]
    assert "one exposure time" in twin.base.dark.black.quantity.note


def test_flats_that_stay_below_saturation_give_a_lower_limit(bench: Bench) -> None:
    twin = fit(replace(bench, flats=bench.flats[:9]))
    assert math.isinf(twin.base.brightest.end.quantity.high)
    assert twin.tables()["sources"]["pixel.full_well_e"].startswith("assumed: 2 times")


def test_codes_in_the_upper_bits_are_noted(bench: Bench) -> None:
    twin = fit(
        changed(
            bench,
            lambda s: replace(
                s, frames=(4 * s.frames.astype(np.uint32)).astype(np.uint16), bits=16
            ),
        )
    )
    assert any("multiples of 4: divide" in note for note in twin.notes)


def test_a_black_level_that_cuts_the_noise_gives_no_twin(bench: Bench) -> None:
    below = int(bench.biases[0].frames.mean())
    cut = changed(bench, lambda s: replace(s, frames=(s.frames.astype(int) - below).clip(0)))
    with pytest.raises(ms.InputError, match="the black level is too low"):
        fit(cut)


# Noise of frames and the tails of the read noise


@pytest.mark.parametrize("jitter_dn", [0.0, 0.5])
def test_jitter_is_told_from_the_noise_of_rows_and_pixels(jitter_dn: float) -> None:
    """20 rows of σ 0.4 DN move a frame's mean by 0.09 DN: 200 frames; 5 standard errors are 25 %."""
    chance = np.random.default_rng(2)
    frames = 50 + chance.normal(0, 2, (200, 20, 40)) + chance.normal(0, 0.4, (200, 20, 1))
    frames += jitter_dn * chance.normal(size=(200, 1, 1))
    figure = frame_noise([Stack(frames, 0.0, 0.0)]).quantity
    assert figure.value == pytest.approx(jitter_dn, rel=0.25, abs=0.08)
    assert bool(figure.low > 0) == bool(jitter_dn)


@pytest.mark.parametrize("shape", [-0.2, -0.1, 0.0, 0.19, None])
@pytest.mark.parametrize("sigma", [1.2, 4.0])
def test_tukeys_lambda_comes_back_from_frames_with_row_noise(
    shape: float | None, sigma: float
) -> None:
    """20 frames of 120 × 160 pixels: λ within 0.02, or normal, once in 700 not; σ differs by 30 % over the pixels."""
    chance = np.random.default_rng(7)
    z = chance.normal(size=(20, 120, 160))
    if shape is not None:
        quantile = TukeyLambda(shape).quantile(scipy.special.ndtr(-np.abs(z)))
        z = np.copysign(quantile, z)
    own = sigma * np.exp(0.3 * chance.normal(size=(120, 160)))
    frames = 200 + own * z + 0.5 * chance.normal(size=(20, 120, 1))
    found = read_law(Stack(np.round(frames), 0.0, 0.0))
    assert math.isnan(found.value) == (shape is None), found.note
    if shape is not None:
        assert found.value == pytest.approx(shape, abs=0.02)


def test_l_moments_and_lambda_are_their_closed_forms() -> None:
    """Hosking 1990: l₂ = 1/√π and τ₄ 0.1226 of a normal law; values at equal distances have l₄ = 0."""
    second, fourth = sample_l_moments(np.random.default_rng(3).normal(size=(50, 20_000)))
    assert second.mean() == pytest.approx(math.pi**-0.5, rel=2e-3)
    assert fourth.sum() / second.sum() == pytest.approx(NORMAL_TAU4, abs=1e-3)
    assert sample_l_moments(np.arange(9.0))[1] == pytest.approx(0, abs=1e-12)
    for shape in (-0.3, 0.0, 0.15):
        tau4 = (shape - 1) * (shape - 2) / ((shape + 3) * (shape + 4))
        assert tukey_shape(tau4) == pytest.approx(shape, abs=1e-12)
    few = read_law(Stack(np.zeros((5, 8, 8)), 0.0))
    assert "need 6" in few.note


def test_fit_and_characterize_have_one_estimate_of_each_figure(bench: Bench) -> None:
    twin, (measured,) = fit(bench).figures(), ms.lab.measure_bench(bench)
    pairs = {
        "K": "K", "µ_I": "µ_I.mean", "σ_row": "σ_row", "σ_col": "σ_col",
        "PRNU_pixel": "PRNU1288_pixel", "PRNU_col": "PRNU1288_col",
    }  # fmt: skip
    for mine, other in pairs.items():
        figure, same = twin[mine].quantity, measured.figures[other]
        scale = 100 if same.unit == "%" else 1
        ends = [scale * x for x in (figure.value, figure.low, figure.high)]
        assert ends == pytest.approx([same.value, same.low, same.high]), mine
