"""The twin of a camera: what is put into frames comes back, with intervals, or a sentence or a mark says why not."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import scipy
from helpers import BENCHMARKS

import mitsuba_sensor as ms
from mitsuba_sensor.bench.virtual_bench import Setup, virtual_bench
from mitsuba_sensor.camera.camera_file import camera_from
from mitsuba_sensor.core.noise_distributions import TukeyLambda
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.twin import fit
from mitsuba_sensor.lab.twin.dark import frame_noise
from mitsuba_sensor.lab.twin.fit import held_out
from mitsuba_sensor.lab.twin.read_law import (
    NORMAL_TAU4,
    read_law,
    sample_l_moments,
    tukey_shape,
)
from mitsuba_sensor.stages.gains import gain_dn_per_e

RNG = np.random.default_rng(16)


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


@pytest.mark.exhaustive
@pytest.mark.parametrize("seeds", [range(20, 22), range(22, 24)], ids=str)
def test_random_cameras_come_back(seeds: range, trips: ModuleType) -> None:
    """Cameras of 12 or 13 parameters: no error of more than 2 half intervals (chance: once in 250 suites), and all but
    5 of 25 intervals cover (chance of fewer: 1 in 500)."""
    found = list(trips.results(seeds, size=56, frames=16))
    for _, name, truth, q in found:
        half = q.value - q.low if truth < q.value else q.high - q.value
        assert abs(q.value - truth) <= 2 * half + 1e-9, name
        assert name not in ("K", "σ_read") or q.value == pytest.approx(truth, rel=0.03)
    assert sum(q.covers(truth) for _, _, truth, q in found) >= len(found) - 5


def test_a_twin_stands_next_to_its_datasheet(bench: Bench, trips: ModuleType) -> None:
    """16 figures: z of all but black level, dark current and D_N, which the chip has, below 4; K 5 % off is found."""
    camera = trips.random_trip(3, 40, 12).camera
    twin = fit(replace(bench, wavelength_nm=550.0))
    rows = {row.twin.symbol: row for row in twin.beside(camera)}
    assert len(rows) == 16 and f"datasheet {gain_dn_per_e(camera):.4g}" in str(rows["K"])
    chip = {"black", "µ_I", "D_N", "DSNU_row", "DSNU_col"}
    assert all(abs(row.z) < 4 for symbol, row in rows.items() if symbol not in chip), rows
    wrong = camera.replace(**{"adc.full_scale_v": 1.05 * camera.adc.full_scale_v})
    assert {row.twin.symbol: row.z for row in twin.beside(wrong)}["K"] > 4
    with pytest.raises(ms.InputError, match=r"read-?outs"):
        twin.beside("scmos_dual_gain")


def test_the_tables_make_a_camera_of_the_fitted_gain(bench: Bench) -> None:
    kept, held = held_out(bench)
    assert [len(one) for one in (*kept.darks, *held.darks)] == [9, 9, 9, 3, 3, 3]
    assert np.shares_memory(kept.darks[0].frames, bench.darks[0].frames)
    twin = fit(bench)
    camera = camera_from(twin.tables(), "twin")
    assert gain_dn_per_e(camera) == pytest.approx(twin.base.gain.quantity.value, rel=1e-9)
    assert camera.sources["source_follower.read_noise_e"].startswith("fit: ")
    assert "12 frames dark_0s" in camera.sources["source_follower.read_noise_e"]
    assert camera.sources["pixel.pitch_x_um"].startswith("assumed: ")
    frames = ms.expose(0.0, camera, ms.Exposure(0.0), maps=twin.maps, frames=12)
    assert frames.digital.mean() == pytest.approx(bench.biases[0].frames.mean(), abs=0.5)


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
        signal = 2 * (stack.frames.astype(float) - black)
        if not stack.photons:
            signal = 0.125 * signal + RNG.normal(0, 0.3, signal.shape)
        frames = np.clip(np.round(signal + black), 0, 2**16 - 1)
        return replace(stack, frames=frames, gain="800", bits=16)

    def both(stacks: Sequence[Stack]) -> list[Stack]:
        return [*(replace(stack, gain="100") for stack in stacks), *map(louder, stacks)]

    twin = fit(bench.change(both))
    assert [one.name for one in twin.settings] == ["100", "800"]
    rungs = twin.tables()["gains"]
    assert [rung["iso"] for rung in rungs] == [100.0, 800.0]
    assert rungs[1]["gain_dn_per_e"] > 1.5 * rungs[0]["gain_dn_per_e"]
    assert any("conversion gain changes from 100 to 800" in note for note in twin.notes)


@pytest.mark.parametrize(
    ("shape", "sigma"), [(-0.2, 4.0), (0.0, 1.2), (0.19, 1.2), (None, 1.2)]
)
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
    jitter = frame_noise([Stack(frames + chance.normal(size=(20, 1, 1)), 0.0, 0.0)]).quantity
    assert jitter.covers(1.0) and frame_noise([Stack(frames, 0.0, 0.0)]).quantity.low == 0
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


def test_what_frames_do_not_show_is_taken_from_another_camera_or_assumed(bench: Bench) -> None:
    """Pitch and the like of another camera; dark current of one exposure time; a full well that no flat reaches."""
    like = ms.load_camera("konnik_table1")
    twin = fit(bench)
    camera = camera_from(twin.tables(like.model_dump()), "twin")
    assert camera.pixel.pitch_x_um == like.pixel.pitch_x_um
    assert camera.sources["pixel.pitch_x_um"].startswith("of konnik_table1: ")
    assert gain_dn_per_e(camera) == pytest.approx(twin.base.gain.quantity.value, rel=1e-9)
    with pytest.raises(ms.InputError, match="is a CCD, which has none; pass as like="):
        twin.tables(ms.load_camera("eso_feros").model_dump())
    like = like.replace(**{"readout.gain_dn_per_e": 0.368, "adc.full_scale_v": None})
    camera = camera_from(twin.tables(like.model_dump()), "twin")
    assert camera.readout.gain_dn_per_e == twin.base.gain.quantity.value
    assert camera.sources["readout.gain_dn_per_e"].startswith("fit: ")
    with pytest.raises(ms.InputError, match="RG / GB, the frames have none"):
        twin.tables(ms.load_camera("bayer_2mp").model_dump())
    with pytest.raises(ms.InputError, match="two or more"):
        ms.lab.fit_readouts({"high": bench})
    short = fit(replace(bench, biases=(), darks=bench.darks[:1], flats=bench.flats[:9]))
    sources = short.tables()["sources"]
    assert "one exposure time" in sources["dark_current.rate_e_per_s"]
    assert "one exposure time" in short.base.dark.black.quantity.note
    assert math.isinf(short.base.brightest.end.quantity.high)
    assert sources["pixel.full_well_e"].startswith("assumed: 2 times")


@pytest.mark.exhaustive
def test_the_twin_of_two_readouts_combines_like_the_camera() -> None:
    """Electrons of the linear code within 2 %, their noise within 3 %, on both sides of the hand-over."""
    kelvin, size = 228.15, {"sensor.rows": 96, "sensor.columns": 96}
    camera = ms.load_camera("scmos_dual_gain").replace(**size)
    benches = {
        name: virtual_bench(one, Setup(kelvin)) for name, one in camera.readout_cameras.items()
    }
    twins = ms.lab.fit_readouts(benches)
    for name, figures in twins.figures().items():
        read_noise_e = camera.at_readout(name).source_follower.read_noise_e
        assert figures["σ_read"].quantity.value == pytest.approx(read_noise_e, rel=0.1)
    assert [one.of for one in ms.load_camera(twins.tables()).readouts] == ["charge"] * 2
    with pytest.raises(ms.InputError, match="the frames have a readout 'high'"):
        twins.tables(ms.load_camera("sony_imx490").model_dump())
    twin = ms.load_camera(twins.tables(camera.model_dump()))
    assert ms.load_camera(twin.to_toml()).combined_readouts == twin.combined_readouts
    assert twin.readouts[1].name == "low" and twin.sources["readouts"].startswith("fit")
    light = ms.Photons(
        np.tile([[100.0], [1_000.0], [20_000.0], [60_000.0]], (1, 96)), detected=True
    )
    mean_e, sigma_e = [], []
    for one in (camera, twin):
        frames = ms.expose(light, one, ms.Exposure(0.01, kelvin))
        stage = one.combined_readouts
        mean_e.append((frames.clean.mean(axis=1) - stage.black_level_dn) / stage.nominal_gain)
        variance = frames.temporal_variance.mean(axis=1)
        sigma_e.append(np.sqrt(variance) / stage.nominal_gain)
    np.testing.assert_allclose(mean_e[1], mean_e[0], rtol=0.02)
    np.testing.assert_allclose(sigma_e[1], sigma_e[0], rtol=0.03)
