"""Benches that used to be measured wrongly without a word: refused, or right with a note."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy
from helpers.small_cameras import SmallCamera

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.defects import defects
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity
from mitsuba_sensor.lab.measure.stray_levels import stray_levels
from mitsuba_sensor.lab.statistics.mean_squares import MeanSquare, root

CAMERA, SHAPE = SmallCamera(prnu=0.01), (64, 64)
TILE = np.tile([[0.5, 1.0], [1.0, 0.4]], (32, 32))
Change = Callable[[Stack], Stack]


def bench(seed: int = 1, change: Change = lambda flat: flat) -> Bench:
    """Dark frames of three exposures, flat fields of 12 levels, 4 frames each."""
    rng = np.random.default_rng(seed)
    darks, flats = CAMERA.bench(rng, 4, SHAPE, 12)
    darks += [
        replace(CAMERA.stack(rng, 200.0 * time, 4, SHAPE), exposure_s=time, photons=0.0)
        for time in (1.0, 4.0)
    ]
    return Bench((), tuple(darks), tuple(map(change, flats)))


def smooth(flat: Stack) -> Stack:
    averaged = scipy.ndimage.uniform_filter(flat.frames.astype(float), (0, 3, 3))
    return replace(flat, frames=np.rint(averaged).astype(np.uint16))


def one_copy(flat: Stack) -> Stack:
    return replace(flat, frames=flat.frames[[0, 1, 2, 1]])


def behind_filters(flat: Stack) -> Stack:
    light = CAMERA.stack(np.random.default_rng(7), TILE * flat.photons, 4, SHAPE)
    return replace(light, photons=flat.photons)


@pytest.mark.parametrize("measure", [ms.lab.measure_bench, ms.lab.fit])
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (one_copy, "frames 2 and 4 are identical"),
        (behind_filters, r"signals of 16[0-9]{2}, 3000, 3000, 13[0-9]{2} DN.*tile"),
    ],
)
def test_copies_and_mosaics_without_a_tile_are_refused(
    measure: Callable[[Bench], object], change: Change, sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        measure(bench(change=change))


def test_denoised_frames_have_no_k_and_a_reason() -> None:
    """The mean of 3 × 3 pixels: horizontal neighbours share 6 of 9, so they are correlated by 0.67."""
    smoothed = bench(change=smooth)
    (found,) = ms.lab.measure_bench(smoothed)
    for symbol in ("K", "η", "σ_d", "µ_e.sat"):
        assert math.isnan(found.figures[symbol].value), symbol
    assert "correlated by 0.6" in found.figures["K"].note
    with pytest.raises(ms.InputError, match="correlated by"):
        ms.lab.fit(smoothed)
    (raw,) = ms.lab.measure_bench(bench())
    assert raw.figures["K"].covers(0.3)


def test_dark_frames_at_the_full_well_are_left_out_and_named() -> None:
    sound = bench()
    full = CAMERA.stack(np.random.default_rng(2), 60_000.0, 4, SHAPE)
    full = replace(full, exposure_s=600.0, photons=0.0)
    (found,) = ms.lab.measure_bench(replace(sound, darks=(*sound.darks, full)))
    assert "dark frames of 600 s are saturated" in " ".join(found.notes)
    assert found.figures["µ_I.mean"].covers(120)
    twin = ms.lab.fit(replace(sound, darks=(*sound.darks, full)))
    assert twin.figures()["µ_I"].quantity.covers(120)


@pytest.mark.parametrize("fall", [0.0, 0.05, 0.2])
def test_uneven_light_is_filtered_out_of_prnu_and_out_of_the_map_of_a_twin(fall: float) -> None:
    """Light that falls off to the corners; PRNU 1 %. A window too small for the filter has a note."""
    y, x = np.meshgrid(np.linspace(-1, 1, 100), np.linspace(-1, 1, 120), indexing="ij")
    rng = np.random.default_rng(3)
    light = 8000 * (1 - 0.5 * fall * (x**2 + y**2))
    lit, dark = (CAMERA.stack(rng, photons, 16, (100, 120)) for photons in (light, 0.0))
    found = nonuniformity(dark, lit)
    assert found.prnu.value == pytest.approx(1.0, rel=0.04)
    assert found.prnu_col.value < 0.1 and ("uneven by" in found.prnu.note) == bool(fall)
    assert found.difference.std() / found.difference.mean() < 0.0125
    corner = [one.window(slice(0, 30), slice(0, 30)) for one in (dark, lit)]
    assert ("which is part of it" in nonuniformity(*corner).prnu.note) == bool(fall)


@pytest.mark.parametrize("number", [0, 3, 19])
def test_a_stray_level_is_named_with_its_own_share(number: int) -> None:
    light = np.linspace(0.05, 0.7, 20)
    signal = 3000 * light + 0.05 * np.random.default_rng(4).normal(size=20)
    signal[number] *= 1.05
    (found,) = stray_levels(light, signal, np.full(20, 0.05)).items()
    assert found == (number, pytest.approx(0.05, abs=0.002))


def test_defects_have_the_stated_false_alarms() -> None:
    """200 sensors of 60 × 60, one in ten may name a pixel: more than 38 once in 10⁴."""
    rng = np.random.default_rng(5)
    images = (Stack(100 + 3 * rng.normal(size=(1, 60, 60)), 0.1) for _ in range(200))
    assert 5 < sum(bool(defects(one, false_alarm=0.1).hot.any()) for one in images) < 38


def test_no_interval_has_no_width_and_no_unit_is_1() -> None:
    assert root([MeanSquare(1.0, 50.0), MeanSquare(-4.0, 50.0)])[2] > 0
    (found,) = ms.lab.measure_bench(bench())
    for figure in found.figures.values():
        assert figure.unit != "1" and figure.low != figure.high, figure
    assert "dB (" in str(found.figures["DR"]) and str(found.figures["η"]).split()[3][0] == "("


def test_an_instrument_of_ones_own_is_one_function_and_one_row() -> None:
    def warmest(dark: Stack) -> tuple[float, float, float]:
        return float(dark.mean.max()), float(dark.mean.min()), float(dark.mean.max())

    row = ms.lab.Instrument(
        "warmest pixel", lambda found: found.bench.darks[:1], warmest, "e-", "our rule"
    )
    exact = ms.lab.Instrument(
        "columns", lambda found: [found.results["warmest pixel"]], lambda _: (3, 3, 3), "", ""
    )
    (found,) = ms.lab.measure_bench(
        bench(), instruments=[*ms.lab.INSTRUMENTS, row._replace(unit="DN"), exact]
    )
    figure = found.figures["warmest pixel"]
    assert figure.value == pytest.approx(found.bench.darks[0].mean.max())
    assert figure.section == "our rule"
    assert "do not scatter" in found.figures["columns"].note


@pytest.mark.parametrize(("sigma_dn", "shown"), [(0.05, False), (0.15, False), (1.0, True)])
def test_a_step_chart_has_speeds_and_a_dynamic_range_only_where_noise_shows(
    sigma_dn: float, shown: bool
) -> None:
    """K 0.25 DN/e-: SNR 10 is where N² = 100·(N + (σ² + 1/12)/K²); patches of one code are no error."""
    rng, gain, black = np.random.default_rng(6), 0.25, 64.2
    steps_e = np.array([0.0, 20, 100, 400, 1500, 4000, 8000, 12_000])
    light = np.repeat(steps_e, 24) * np.ones((8, 24, 1))
    values = black + gain * rng.poisson(light) + sigma_dn * rng.normal(size=light.shape)
    stack = Stack(np.rint(values).astype(np.uint16), 0.1, bits=12)
    regions = [(0, 24 * k, 24, 24) for k in range(8)]
    chart = ms.lab.step_chart(stack, regions, steps_e / 1000, black_dn=black)
    read_e2 = (sigma_dn**2 + 1 / 12) / gain**2
    signal_e = 50 + math.sqrt(2500 + 100 * read_e2)
    assert chart.noise_speed_10.value == pytest.approx(10_000 / signal_e, rel=0.04)
    assert math.isfinite(chart.dynamic_range.value) == shown
    if shown:
        least_e = 0.5 + math.sqrt(0.25 + read_e2)
        decibel = 20 * math.log10((4095 - black) / gain / least_e)
        assert chart.dynamic_range.value == pytest.approx(decibel, abs=0.3)


def test_a_clipped_edge_is_told() -> None:
    rows, columns = np.mgrid[:48, :48]
    place = np.clip(columns - 24 - 0.1 * (rows - 24), 0, 1)
    edge = 100 + 800 * place + 3 * np.random.default_rng(8).normal(size=place.shape)
    told = [
        "clipped" in ms.lab.slanted_edge(picture).quantities[0].note
        for picture in (edge, 100 + 800 * place, np.minimum(edge, 700), np.maximum(edge, 300))
    ]
    assert told == [False, False, True, True]


def test_an_instrument_that_returns_nothing_is_refused_and_the_others_measure() -> None:
    nothing = ms.lab.Instrument("nothing", lambda found: (), lambda: None, "", "")
    (found,) = ms.lab.measure_bench(bench(), instruments=[nothing, *ms.lab.INSTRUMENTS])
    assert "returned NoneType" in found.refused["nothing"] and found.figures["K"].covers(0.3)
