"""Every stage against its own theory: who writes the sample writes the moments below it, and here they meet.

Nothing in this file names a stage that must be tested: it walks ``chain(camera)``, so a new stage, camera file or
colour filter is tested without a new line.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments, rectified_normal
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Electrons, Photons
from mitsuba_sensor.sensor.chain import Stage, black_level_dn, chain, gain_dn_per_e
from mitsuba_sensor.sensor.dark_current_models import FigureOfMerit
from mitsuba_sensor.sensor.digital import Adc
from mitsuba_sensor.sensor.electrons import DarkCurrent, FullWell, Prnu, ShotNoise
from mitsuba_sensor.sensor.fpn_distributions import Gaussian, LogNormal, Rectified
from mitsuba_sensor.sensor.volts import CdsGain, DsnuColumn, ResetNoise, SourceFollower, SourceFollowerNoise

ROWS, COLUMNS, FRAMES, BLOCKS = 2, 96_000, 3, 64
"""192 000 pixels in 3 frames: 5 standard errors are 1.1 % of a temporal variance and 2.3 % of a column variance (0.6 %
and 1.1 % of a standard deviation), from the spread of 64 blocks of 1500 columns, so without assuming any law."""

EXACT = 1e-9
"""Relative error of what is not random at all."""

OVERRIDES: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "hard reset": {"readout.reset": "hard"},
    "soft reset": {"readout.reset": "soft"},
    "gains": {"source_follower.gain": 0.9, "readout.cds_gain": 2.0},
    "coupled columns": {"readout.dsnu_col_coupling": 0.25, "readout.dsnu_col": 0.002},
    "gaussian dark 0.4": {"dark_current.distribution": "gaussian", "dark_current.cv": 0.4},
    "gaussian dark 1": {"dark_current.distribution": "gaussian", "dark_current.cv": 1.0},
    "lognormal dark 1": {"dark_current.distribution": "lognormal", "dark_current.cv": 1.0},
    "strong prnu": {"pixel.prnu": 0.4, "pixel.full_well_e": 2e5},
    "8 bit": {"adc.bits": 8},
    "16 bit": {"adc.bits": 16},
    "no pedestal": {"adc.black_level_dn": 0.0, "adc.bits": 14},
    "one noise number": {"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 20.0},
}
FULL = {"adc.full_scale_v": 0.25}
"""Only the full well clips."""
CONVERTER = {"pixel.full_well_e": 50_000.0, "adc.full_scale_v": 0.165}
"""Only the converter clips."""
OVERRIDES |= {"full well": FULL, "converter": CONVERTER}

CASES = [(name, "as shipped", level) for name in ms.list_cameras() for level in (0.0, 0.1, 0.5)]
CASES += [("konnik_table1", change, 0.25) for change in OVERRIDES if change not in ("full well", "converter", "8 bit")]
CASES += [("konnik_table1", "8 bit", 0.5)]
CASES += [("konnik_table1", "full well", level) for level in (0.985, 1.0, 1.1)]
CASES += [("konnik_table1", "converter", 0.657), ("eev_44_82", "as shipped", 1.0)]
CASES += [("konnik_table1", "no pedestal", 0.0), ("konnik_table1", "hard reset", 0.0), ("bayer_2mp", "16 bit", 0.01)]


@dataclass(frozen=True)
class Seen:
    """What a sample shows, against its theory: per block of columns, so that their spread is the sampling error."""

    mean: NDArray[np.float64]
    temporal: NDArray[np.float64]
    spatial: NDArray[np.float64]

    @classmethod
    def of(cls, samples: list[Any], theory: Moments) -> Seen:
        """Deviations from theory of mean, temporal variance (ddof 1) and fixed variance in each block, (BLOCKS,)."""
        x = np.array([np.broadcast_to(sample, (ROWS, COLUMNS)) for sample in samples])
        mean, temporal = x.mean(axis=0), x.var(axis=0, ddof=1)
        off = mean - theory.mean
        fixed = off**2 - temporal / len(samples)
        return cls(blocks(off), blocks(temporal - theory.temporal), blocks(fixed - theory.spatial))


def blocks(x: Any) -> NDArray[np.float64]:
    """Averages over blocks of columns."""
    return np.broadcast_to(x, (ROWS, COLUMNS)).reshape(ROWS, BLOCKS, -1).mean(axis=(0, 2))


def photons_for(camera: ms.Camera, level: float) -> Photons:
    """Uniform light that fills ``level`` of the well of the most sensitive filter."""
    wavelength = camera.quantum_efficiency.reference_nm
    light = level * camera.pixel.full_well_e / camera.qe([wavelength]).max()
    return Photons(np.full((ROWS, COLUMNS), light))


@functools.cache
def samples_of(backend: Backend) -> list[Frame]:
    """The same three frames of one device for every case: they remember their words, which is half of the time."""
    window = SensorWindow(7, (ROWS, COLUMNS), backend=backend)
    return [Frame(ms.Exposure(0.1), window, 5, index) for index in range(FRAMES)]


def walk(camera: ms.Camera, light: Photons, backend: Backend = NUMPY_FLOAT64) -> list[tuple[Any, list[Any], Moments]]:
    """(stage, its output in every frame, its theory) along the chain; a stage that hands on what it got must say so.

    Such a neutral stage is not looked at again: what it hands on has been.
    """
    frames = samples_of(backend)
    signals: list[Any] = [light] * FRAMES
    moments = Moments(light, 0.0, 0.0, samples_of(NUMPY_FLOAT64)[0])
    steps = []
    for stage in chain(camera):
        before, signals = signals, [stage(signal, frame) for signal, frame in zip(signals, frames, strict=True)]
        theory, moments = moments, stage.moments(moments)
        if all(new is old for new, old in zip(signals, before, strict=True)):
            assert theory.mean is not light and same(theory, moments), f"{stage} does nothing and says otherwise"
        else:
            plain = [s.total if isinstance(s, Electrons) else s for s in signals]
            steps.append(
                (stage, [np.asarray(backend.to_numpy(s, frames[0].window), np.float64) for s in plain], moments)
            )
    return steps


def same(a: Moments, b: Moments) -> bool:
    return all(np.array_equal(getattr(a, part), getattr(b, part)) for part in ("mean", "temporal", "spatial"))


def assert_agrees(what: str, deviation: NDArray[np.float64], scale: float, exact: float = EXACT) -> None:
    error = 5 * deviation.std(ddof=1) / np.sqrt(BLOCKS) + exact * scale
    assert abs(deviation.mean()) <= error, f"{what}: off by {deviation.mean():.4g} ± {error:.2g} of {scale:.4g}"


@pytest.mark.parametrize(("name", "change", "level"), CASES, ids=lambda value: str(value))
def test_every_stage_has_the_moments_that_it_says(name: str, change: str, level: float, backend: Backend) -> None:
    """Mean, temporal and fixed variance after every stage of every camera, within 5 standard errors.

    Chance: 3 × 12 comparisons in 30 cases at P(|t₆₃| > 5) = 5e-6 each: one other seed in 200 would fail somewhere.
    (The engines are given the same words, so they do not add to that.) A float32 holds a mean to 3e-7.
    A sign, a factor √2 or a forgotten term is 10 to 1000 standard errors. Two things that the theory says are only
    nearly so are kept out: noise below half a code (rounding then is no noise) and two clips within a σ (next test).
    """
    camera = ms.load_camera(name).replace(**OVERRIDES[change])
    exact = EXACT if backend is NUMPY_FLOAT64 else 3e-7
    for stage, samples, theory in walk(camera, photons_for(camera, level), backend):
        seen = Seen.of(samples, theory)
        variance = float(np.mean(theory.temporal) + np.mean(theory.spatial))
        mean = float(np.max(theory.mean))
        assert_agrees(f"mean after {stage}", seen.mean, mean, exact)
        assert_agrees(f"temporal variance after {stage}", seen.temporal, variance + exact * mean**2, exact)
        assert_agrees(f"fixed variance after {stage}", seen.spatial, variance + exact * mean**2, exact)


def test_two_clips_in_a_row_are_within_5_percent_of_their_theory() -> None:
    """At 98 % of Table 1's well the full well clips and, a σ lower, the converter: what it clips is normal no more."""
    camera = ms.load_camera("konnik_table1")
    _, samples, theory = walk(camera, photons_for(camera, 0.98))[-1]
    seen = Seen.of(samples, theory)
    assert abs(seen.mean.mean()) < 0.05 * theory.sigma
    assert abs(seen.temporal.mean()) < 0.05 * np.mean(theory.temporal)
    assert abs(seen.spatial.mean()) < 0.05 * np.mean(theory.spatial)


# What follows looks at single stages: neutral values, exact values, and what no average shows.

SMALL = Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))
SWING = np.linspace(0, 0.2, 200).reshape(4, 50)
CHARGE = Electrons(np.linspace(0, 4e4, 200).reshape(4, 50), np.full((4, 50), 174.0))


@pytest.mark.parametrize(
    ("stage", "signal"),
    [
        (Prnu(Rectified(0.0)), CHARGE),
        (DarkCurrent(FigureOfMerit(0.0, 3e-7), LogNormal(0.4)), Electrons(CHARGE.light)),
        (FullWell(float("inf")), CHARGE),
        (ResetNoise(5e-6, 0.0), SWING),
        (SourceFollowerNoise(0.0), SWING),
        (SourceFollower(1.0), SWING),
        (DsnuColumn(0.0, 0.25), SWING),
        (CdsGain(1.0), SWING),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_neutral_value_changes_nothing_exactly(stage: Any, signal: Any) -> None:
    """Bit for bit, and in theory too."""
    after = stage(signal, SMALL)
    pairs = [(after, signal)]
    if isinstance(signal, Electrons):
        pairs = [(after.light, signal.light), (after.dark, signal.dark)]
    for out, into in pairs:
        np.testing.assert_array_equal(out, into)
    before = Moments(100.0, 20.0, 30.0, SMALL)
    m = stage.moments(before)
    assert (float(m.mean), float(m.temporal), float(m.spatial)) == (100.0, 20.0, 30.0)


@pytest.mark.parametrize("family", [Gaussian, LogNormal])
def test_a_dark_pattern_of_no_width_is_one_number(family: Any) -> None:
    dark = DarkCurrent(FigureOfMerit(1.0, 5.7e-4**2), family(0.0))
    after = dark(Electrons(CHARGE.light), SMALL)
    np.testing.assert_array_equal(after.dark, dark.mean_e(SMALL))
    assert float(np.mean(dark.moments(Moments(0.0, 0.0, 0.0, SMALL)).spatial)) == 0.0


@pytest.mark.parametrize("name", ms.list_cameras())
def test_stages_are_frozen_equal_by_value_hashable_and_say_what_they_do(name: str) -> None:
    """Two chains of two copies of a datasheet are the same chain: a plan can be kept and compared."""
    one, two = (chain(ms.load_camera(name)) for _ in range(2))
    assert one == two and hash(one) == hash(two)
    rooms = [stage.domain for stage in one]
    assert rooms == sorted(rooms, key=["electrons", "volts", "DN"].index)
    for stage in one:
        face: Stage = stage
        assert face.__doc__ and face.__call__.__doc__ and face.moments.__doc__
        with pytest.raises(AttributeError):
            stage.room_of_its_own = 1


def test_a_ccd_has_no_reset_noise_no_column_offsets_and_no_telegraph_noise() -> None:
    """One amplifier and true CDS; asking for them changes nothing."""
    ccd = ms.load_camera("eev_44_82")
    noisy = ccd.replace(**{"readout.reset": "hard", "readout.dsnu_col": 0.1, "source_follower.rtn_uv": 500.0})
    assert chain(noisy) == chain(ccd)
    assert not any(isinstance(stage, ResetNoise | DsnuColumn) for stage in chain(ccd))
    cmos = noisy.replace(**{"sensor.technology": "cmos"})
    assert sum(isinstance(stage, ResetNoise | DsnuColumn) for stage in chain(cmos)) == 2


def test_telegraph_noise_reaches_the_chain_of_a_cmos_sensor_only() -> None:
    """ΔV = 200 µV at 1 µs on Table 1: 17.8268 e- beside the 6.105 e- of the datasheet's white and flicker noise."""
    camera = ms.load_camera("konnik_table1").replace(**{"source_follower.rtn_uv": 200.0})
    alone = np.hypot(17.8268, 6.105069)
    sigma = {type(stage): stage for stage in chain(camera)}[SourceFollowerNoise].sigma_v / 5e-6
    assert sigma == pytest.approx(alone, rel=1e-5)
    ccd = camera.replace(**{"sensor.technology": "ccd"})
    assert {type(stage): stage for stage in chain(ccd)}[SourceFollowerNoise].sigma_v / 5e-6 == pytest.approx(
        6.105069, rel=1e-6
    )


def stage_of(camera: ms.Camera, kind: type) -> Any:
    """The one stage of that kind in a camera's chain."""
    return next(stage for stage in chain(camera) if isinstance(stage, kind))


@pytest.mark.parametrize(("reset", "electrons"), [("hard", 71.6835), ("soft", 50.6879), ("true_cds", 0.0)])
def test_reset_noise_is_ktc_or_what_the_reset_leaves_of_it(reset: str, electrons: float) -> None:
    """√(k_B·T/C_SN) at 298.15 K with C_SN = q/A_SN = 32.04 fF: 358.417 µV; 1/√2 of it after a soft reset."""
    stage = stage_of(ms.load_camera("konnik_table1").replace(**{"readout.reset": reset}), ResetNoise)
    assert stage.sigma_v(SMALL) / 5e-6 == pytest.approx(electrons, rel=1e-5)
    cold = Frame(ms.Exposure(0.1, 298.15 / 4), SensorWindow(3, (1, 1)))
    assert stage.sigma_v(cold) == pytest.approx(stage.sigma_v(SMALL) / 2, rel=1e-12)


@pytest.mark.parametrize("gain", [0.7, 0.9, 1.0])
def test_read_noise_in_electrons_follows_the_gain_of_the_follower_only_where_it_is_made(gain: float) -> None:
    """σ_SF[e-] = √(∫S·H)/(A_SN·A_SF·(1 − e^(−a))); a datasheet's read_noise_e is in electrons already."""
    camera = ms.load_camera("konnik_table1").replace(**{"source_follower.gain": gain})
    assert stage_of(camera, SourceFollowerNoise).sigma_v / 5e-6 == pytest.approx(6.105069 / gain, rel=1e-6)
    given = {"source_follower.white_nv_per_rthz": None, "source_follower.read_noise_e": 3.0}
    assert stage_of(camera.replace(**given), SourceFollowerNoise).sigma_v / 5e-6 == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize("change", [{}, {"source_follower.gain": 0.7}, {"readout.cds_gain": 3.0}], ids=str)
def test_column_offsets_are_a_share_of_the_full_well_swing_behind_every_gain(change: dict[str, Any]) -> None:
    """0.1 % of the full well is 33 e- = 4.096 DN, however the swing is amplified on its way."""
    camera = ms.load_camera("konnik_table1").replace(**change)
    m = Moments(0.0, 0.0, 0.0, SMALL)
    for stage in chain(camera)[chain(camera).index(stage_of(camera, DsnuColumn)) : -1]:
        m = stage.moments(m)
    assert np.sqrt(m.spatial) * chain(camera)[-1].gain_dn_per_v == pytest.approx(4.096, rel=1e-9)


def test_prnu_multiplies_light_and_leaves_the_dark_alone() -> None:
    after = Prnu(Rectified(0.1))(CHARGE, SMALL)
    assert after.dark is CHARGE.dark
    gain = after.light[CHARGE.light > 0] / CHARGE.light[CHARGE.light > 0]
    assert gain.std() == pytest.approx(0.1, rel=0.3)
    np.testing.assert_array_equal(after.light[CHARGE.light == 0], 0.0)


def test_no_pixel_has_negative_gain_however_strong_the_prnu() -> None:
    window = SensorWindow(3, (100, 100))
    after = Prnu(Rectified(10.0))(Electrons(np.ones((100, 100))), Frame(ms.Exposure(0.1), window))
    assert after.light.min() == 0.0 and np.isfinite(after.light).all()


def test_shot_noise_gives_whole_electrons_of_light_and_dark_apart() -> None:
    after = ShotNoise()(CHARGE, SMALL)
    for part in (after.light, after.dark):
        np.testing.assert_array_equal(part, np.floor(part))
    assert np.abs(np.corrcoef(after.light.ravel() - CHARGE.light.ravel(), after.dark.ravel())[0, 1]) < 5 / np.sqrt(200)


def test_a_pixel_twice_as_hot_has_twice_the_dark_shot_variance() -> None:
    """X = 2: temporal var/mean stays 1, because the map multiplies the mean before Poisson. 2e5 draws, 5 se = 1.6 %."""
    frame = Frame(ms.Exposure(0.1), SensorWindow(3, (1, 200_000)))
    dark = ShotNoise()(Electrons(np.zeros((1, 200_000)), 2 * 174.158), frame).dark
    assert dark.mean() == pytest.approx(2 * 174.158, rel=5e-4)
    assert dark.var() / dark.mean() == pytest.approx(1, abs=0.016)


@pytest.mark.parametrize("full_well_e", [1.0, 33_000.0, 5e7])
def test_the_full_well_is_cut_exactly_and_conserves_what_fits(full_well_e: float) -> None:
    """min(light + dark, full well) to the last bit of a whole number, whichever of the two overflows."""
    light = np.array([[0.0, 1.0, full_well_e - 1, full_well_e, full_well_e + 1, 1e12, np.inf, 0.0, 5.0]])
    dark = np.array([[0.0, 1.0, 1.0, 0.0, 3.0, 1e12, 7.0, full_well_e + 5, full_well_e]])
    after = FullWell(full_well_e)(Electrons(light, dark), SMALL)
    np.testing.assert_array_equal(after.total, np.minimum(light + dark, full_well_e))
    assert (after.light >= 0).all() and (after.dark >= 0).all()


def test_darkness_stays_at_the_pedestal_for_every_gain_of_the_follower() -> None:
    """A_SF acts on the swing: on the node voltage, 0.9 would move darkness by 0.31 V, most of the range."""
    for gain in (0.7, 0.9, 1.0):
        camera = ms.load_camera("konnik_table1").replace(**{"source_follower.gain": gain, "adc.black_level_dn": 100.0})
        digital = ms.expose(np.zeros((4, 4000)), camera, ms.Exposure(0.0)).digital
        assert digital.mean() == pytest.approx(100, abs=5 * 4.2 / np.sqrt(4000))


def test_the_full_well_spans_the_whole_code_range_whatever_the_gains() -> None:
    """K = A_SN·A_SF·A_CDS·2^bits/V_FS, and V_FS is the swing of a full well unless the datasheet says otherwise."""
    camera = ms.load_camera("konnik_table1")
    assert gain_dn_per_e(camera) == pytest.approx(0.1241212, rel=1e-6)
    gains = camera.replace(**{"source_follower.gain": 0.8, "readout.cds_gain": 4.0, "adc.bits": 14})
    assert gain_dn_per_e(gains) == pytest.approx(2**14 / 33_000, rel=1e-12)
    fixed = gains.replace(**{"adc.full_scale_v": 1.0})
    assert gain_dn_per_e(fixed) == pytest.approx(5e-6 * 0.8 * 4 * 2**14, rel=1e-12)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_quantisation_error_of_a_ramp_has_the_sigma_of_a_uniform_law(bits: int) -> None:
    """1/√12 = 0.288675 codes, mean 0; a ramp of 100 steps per code over the whole range."""
    adc = Adc(bits, 2.0**bits, 0.0)
    ramp = (np.arange(100 * (2**bits - 1)) + 0.5) / 100 / 2**bits
    error = adc(ramp[None], SMALL)[0] - ramp * 2**bits
    assert error.std() == pytest.approx(0.288675, rel=1e-3)
    assert abs(error.mean()) < 1e-9


def test_the_converter_rounds_half_up_and_stops_at_both_ends() -> None:
    adc = Adc(4, 1.0, 2.0)
    volts = np.array([[-9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, np.inf, -np.inf]])
    np.testing.assert_array_equal(adc(volts, SMALL), [[0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15, 0]])


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("change", [{}, {"readout.reset": "hard"}, {"adc.bits": 16}, {"adc.bits": 8}], ids=str)
def test_the_default_pedestal_is_a_whole_number_that_keeps_the_dark_uncut(name: str, change: dict[str, Any]) -> None:
    """≥ 4σ of a zero exposure: less than 1e-4 of the pixels read 0; without it the dark mean would be 0.4σ too high."""
    camera = ms.load_camera(name).replace(**change)
    pedestal = black_level_dn(camera)
    assert pedestal == int(pedestal) and pedestal >= 1
    digital = ms.expose(np.zeros((4, 20_000)), camera, ms.Exposure(0.0)).digital
    assert np.mean(digital == 0) < 3e-4 or camera.adc.bits == 8
    assert digital.mean() == pytest.approx(pedestal, abs=0.05 * digital.std() + 0.02)


@pytest.mark.parametrize("cv", [0.0, 1e-12, 0.01, 0.1, 0.4, 1.0, 10.0])
def test_dark_pattern_variance_is_that_of_the_rectified_law(cv: float) -> None:
    """A Gaussian cut at 0 and made unit-mean again: cv² as long as nothing is cut, and known when much is."""
    assert LogNormal(cv).variance == pytest.approx(cv**2)
    mean, variance = rectified_normal(cv)
    assert Gaussian(cv).variance == pytest.approx(variance / mean**2, abs=1e-300)
    if cv <= 0.1:
        assert Gaussian(cv).variance == pytest.approx(cv**2, rel=1e-6)
