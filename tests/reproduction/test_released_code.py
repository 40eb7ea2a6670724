"""The published chain against the released code: every record, every stage, mean and standard deviation.

The records are one frame of 1300 × 1900 pixels each. Ours have fewer rows, and all 1900 columns, because the column
pattern has only one sample per column. Standard errors come from our own frame, in blocks of ten columns (so that
neither column patterns nor kurtosis nor autoregression is assumed away), and are carried over to the record's rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers import DATA, ROOT
from konnik2014 import Konnik2014Settings, chain_of
from konnik2014.electrons import (
    PublishedDarkMean,
    PublishedDarkSignal,
    PublishedFollowerSpectrum,
    PublishedFpnDistribution,
    PublishedWell,
    fpn_map,
)
from konnik2014.volts import (
    PublishedAdc,
    PublishedExponentialNode,
    PublishedFollower,
    PublishedResetNoise,
)

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.dark_current_models import FigureOfMerit
from mitsuba_sensor.stages.effects.reset_noise import ResetNoise as SignedResetNoise
from mitsuba_sensor.stages.effects.source_follower_noise import CdsNoise

REFERENCE = json.loads((DATA / "released_code.json").read_text("utf-8"))
RECORDS = REFERENCE["full_chain"] + REFERENCE["single_source"]
EXPOSURE = ms.Exposure(0.1, 298.15)
ROWS, COLUMNS, RECORD_ROWS = 130, 1900, 1300
LIMIT = 4.0
ROUNDING = 1e-10
"""Octave's mean of 2.47 million equal numbers is wrong by up to this much, relative."""

SIMPLE = Konnik2014Settings()
ADVANCED = replace(
    SIMPLE,
    dark_fpn="lognormal",
    dark_fpn_parameter=0.4,
    source_follower_e=PublishedFollowerSpectrum().sigma_e(5.0),
)
OFF = replace(
    SIMPLE,
    photon_shot=False,
    prnu=0.0,
    dark_fom_na_per_cm2=0.0,
    dark_shot=False,
    dark_fpn_factor=0.0,
    reset_factor=0.0,
    column_fpn_factor=0.0,
)


def dark(name: str, parameter: float, factor: float) -> dict[str, Any]:
    return {
        "dark_fom_na_per_cm2": 1.0,
        "dark_fpn": name,
        "dark_fpn_parameter": parameter,
        "dark_fpn_factor": factor,
    }


def column(name: str, parameter: float) -> dict[str, Any]:
    return {"column_fpn": name, "column_fpn_parameter": parameter, "column_fpn_factor": 0.001}


FULL = {
    "full/simple": SIMPLE,
    "full/advanced": ADVANCED,
    "full/advanced+paper_nonlinear_VV1.05_ADC1.04": replace(
        ADVANCED, vv_gamma=1.05, adc_gamma=1.04
    ),
    "full/advanced+Ve_only_0.05": replace(ADVANCED, ve_alpha=0.05),
    "full/advanced+VV_only_1.05": replace(ADVANCED, vv_gamma=1.05),
    "full/advanced+ADC_only_1.04": replace(ADVANCED, adc_gamma=1.04),
}
ALONE: dict[str, dict[str, Any]] = {
    "none(quantisation only)": {},
    "photonshot": {"photon_shot": True},
    "PRNU": {"prnu": 0.005},
    "dark_mean_only": {"dark_fom_na_per_cm2": 1.0},
    "dark_shot": {"dark_fom_na_per_cm2": 1.0, "dark_shot": True},
    "dark_mean+FPN_gauss_DN0.01": dark("gaussian", 0.0, 0.01),
    "dark_mean+FPN_lognormal(0,0.4)_DN0.01": dark("lognormal", 0.4, 0.01),
    "dark_mean+FPN_gauss_DN0.3": dark("gaussian", 0.0, 0.3),
    "dark_mean+FPN_lognormal(0,0.4)_DN0.3": dark("lognormal", 0.4, 0.3),
    "dark_mean+FPN_wald2_DN0.3": dark("wald", 2.0, 0.3),
    "dark_mean+FPN_AR[1 0.5]_DN0.3": dark("ar", 0.5, 0.3),
    "source_follower": {"source_follower_e": PublishedFollowerSpectrum().sigma_e(5.0)},
    "kTC_factor1": {"reset_factor": 1.0},
    "kTC_factor0.8": {"reset_factor": 0.8},
    "column_gauss_0.001": column("gaussian", 0.0),
    "column_AR[1 0.5]_0.001": column("ar", 0.5),
    "column_lognormal(0,0.4)_0.001": column("lognormal", 0.4),
    "Ve_nonlin_0.05": {"ve_alpha": 0.05},
    "VV_nonlin_1.05": {"vv_gamma": 1.05},
    "ADC_nonlin_1.04": {"adc_gamma": 1.04},
    "ADC_nonlin_1.1": {"adc_gamma": 1.1},
}
SETTINGS = FULL | {f"alone/{name}": replace(OFF, **changes) for name, changes in ALONE.items()}
LEAVES = {
    "PublishedPhotons": ("photons", "light_e", "light_e_prnu"),
    "PublishedPhotonShot": ("photons",),
    "PublishedQuantumEfficiency": ("light_e", "light_e_prnu", "electrons_raw"),
    "PublishedPrnu": ("light_e_prnu", "electrons_raw"),
    "PublishedDarkMean": ("dark_shot", "dark_fpn", "dark_total"),
    "PublishedDarkShot": ("dark_shot", "dark_fpn", "dark_total"),
    "PublishedDarkFpn": ("dark_fpn", "dark_total"),
    "PublishedReadNoise": ("dark_total",),
    "PublishedDarkSignal": ("electrons_raw",),
    "PublishedWell": ("electrons",),
    "PublishedSenseNode": ("volts_sense_node", "volts_source_follower", "volts_cds"),
    "PublishedExponentialNode": ("volts_sense_node", "volts_source_follower", "volts_cds"),
    "PublishedFollower": ("volts_source_follower", "volts_cds"),
    "PublishedColumnFpn": ("volts_cds",),
    "PublishedAdc": ("DN",),
}
"""What leaves a stage, in the names of the records; a stage that is off leaves what entered."""


@dataclass(frozen=True)
class Deviation:
    """One comparison: how far ours is from the record, in standard errors of the difference."""

    record: str
    what: str
    ours: float
    theirs: float
    sigma: float


def settings_of(record: dict[str, Any]) -> Konnik2014Settings:
    changes: dict[str, Any] = {"technology": record["sensor"].lower()}
    if record["sensor"] == "CCD" and "advanced" in record["config"]:
        changes["source_follower_e"] = PublishedFollowerSpectrum(rtn_step=0.0).sigma_e(5.0)
    return replace(SETTINGS[record["config"]], **changes)


def photons_of(record: dict[str, Any], shape: tuple[int, int]) -> ms.Photons:
    """The records' CCD has a fill factor of 1: at the same level its irradiance is half that of the CMOS sensor."""
    fill = (
        1.0 if record["sensor"] == "CCD" else REFERENCE["parameters"]["table1"]["fill_factor"]
    )
    per_irradiance = (
        REFERENCE["derived"]["photons_per_W_m2_table1"]
        / REFERENCE["parameters"]["table1"]["fill_factor"]
    )
    return ms.Photons(np.full(shape, record["irradiance_W_m2"] * per_irradiance * fill))


@cache
def window_of(config: str, rows: int, serial: int) -> SensorWindow:
    """Like the records: the levels of one configuration share their fixed patterns."""
    return SensorWindow(serial + 1000 * list(SETTINGS).index(config), (rows, COLUMNS))


def trace(
    stages: tuple[Any, ...], photons: ms.Photons, frame: ms.stages.Frame
) -> dict[str, Any]:
    """Every intermediate signal of one frame under the names of the records."""
    seen: dict[str, Any] = {}
    signal: Any = photons
    for stage in stages:
        if isinstance(stage, PublishedDarkSignal):
            step_signal: Any = 0.0
            for step in stage.steps:
                step_signal = step.sample(step_signal, frame)
                seen |= dict.fromkeys(LEAVES[type(step).__name__], step_signal)
            signal = signal + step_signal
        else:
            signal = stage.sample(signal, frame)
        seen |= dict.fromkeys(LEAVES[type(stage).__name__], signal)
    full_well = next(stage.full_well_e for stage in stages if isinstance(stage, PublishedWell))
    seen["frac_fullwell"] = seen["electrons_raw"] >= full_well
    seen["frac_neg_e"] = seen["electrons_raw"] < 0
    seen["frac_DN_0"] = seen["DN"] <= 0
    seen["frac_DN_Nmax"] = seen["DN"] >= stages[-1].highest
    return {
        name: np.broadcast_to(x, frame.window.shape).astype(float) for name, x in seen.items()
    }


def squared_errors(x: Any) -> tuple[float, float]:
    """Squared standard errors of the mean of ``x``: of our frame, and of one with the record's number of rows."""
    blocks = x.reshape(x.shape[0], -1, 10).mean(axis=2)
    within = float(np.mean(np.var(blocks, axis=0, ddof=1)))
    between = float(np.var(blocks.mean(axis=0), ddof=1))
    stripes = max(between - within / x.shape[0], 0.0)
    return between / blocks.shape[1], (stripes + within / RECORD_ROWS) / blocks.shape[1]


def compare(label: str, what: str, x: Any, stats: Any) -> Iterator[Deviation]:
    """Mean and standard deviation, or the one fraction, against the record."""
    mean = float(x.mean())
    rounding = (ROUNDING * abs(mean)) ** 2
    theirs = stats if isinstance(stats, list) else [stats]
    variance = sum(squared_errors(x)) + rounding
    if what.startswith("frac"):
        p = (mean * ROWS + theirs[0] * RECORD_ROWS) / (ROWS + RECORD_ROWS)
        variance = max(variance, p * (1 - p) * (1 / x.size + 1 / (RECORD_ROWS * COLUMNS)))
    yield Deviation(
        label, f"{what} mean", mean, theirs[0], in_sigma(mean - theirs[0], variance)
    )
    if len(theirs) > 1:
        squares = (x - mean) ** 2
        std = math.sqrt(squares.mean())
        error = sum(squared_errors(squares)) / (4 * std**2) if std > 0 else 0.0
        yield Deviation(
            label, f"{what} std", std, theirs[1], in_sigma(std - theirs[1], error + rounding)
        )


def in_sigma(difference: float, variance: float) -> float:
    if variance == 0:
        return 0.0 if abs(difference) < ROUNDING else math.inf
    return abs(difference) / math.sqrt(variance)


def deviations(
    rows: int = ROWS, seed: int = 1, records: list[dict[str, Any]] = RECORDS
) -> Iterator[Deviation]:
    """All comparisons of all records; with rows=1300 the frames are as large as the records'."""
    for number, record in enumerate(records):
        stages = chain_of(settings_of(record))
        frame = ms.stages.Frame(
            EXPOSURE, window_of(record["config"], rows, seed), seed=seed + 1000 * number
        )
        seen = trace(stages, photons_of(record, (rows, COLUMNS)), frame)
        label = f"{record['config']} {record['sensor']} {record['level']:g}"
        for what, stats in record["stats"].items():
            if what in seen:
                yield from compare(label, what, seen[what], stats)


def confirmed(found: list[Deviation], seed: int = 99) -> list[Deviation]:
    """Those beyond the limit that are still beyond it in a full-size frame of another seed and another camera."""
    suspects = {d.record for d in found if d.sigma > LIMIT}
    names = {(d.record, d.what) for d in found if d.sigma > LIMIT}
    again = [r for r in RECORDS if f"{r['config']} {r['sensor']} {r['level']:g}" in suspects]
    return [
        d
        for d in deviations(RECORD_ROWS, seed, again)
        if (d.record, d.what) in names and d.sigma > LIMIT
    ]


@pytest.mark.exhaustive
def test_every_stage_of_every_record_is_met_within_4_standard_errors() -> None:
    """153 records, 3730 comparisons: 1364 of them exact (nothing random in them), 1263 different, the rest repetitions
    of an earlier stage.

    Chance puts one comparison in 16 000 beyond 4 σ, so one choice of the seed in twelve has such a one. It is asked
    again, ten times sharper and with other random numbers; chance alone fails that in 1 of 100 000 choices.
    """
    found = list(deviations())
    worst = max(found, key=lambda d: d.sigma)
    beyond = [d for d in found if d.sigma > LIMIT]
    print(
        f"\n{len(found)} comparisons of {len(RECORDS)} records; {len(beyond)} beyond {LIMIT:g} σ, largest: {worst}"
    )
    assert len(RECORDS) == 48 + 105
    assert len(found) == 3730
    assert len(beyond) <= 8, beyond
    assert not confirmed(found)


@pytest.mark.parametrize(
    ("what", "changes", "record"),
    [
        ("light_e mean", {"quantum_efficiency": 0.606}, "full/simple CMOS 0.5"),
        ("light_e_prnu std", {"prnu": 0.0051}, "alone/PRNU CMOS 0.5"),
        ("dark_shot mean", {"dark_fom_na_per_cm2": 1.01}, "full/simple CMOS 0"),
        ("dark_fpn std", {"dark_fpn_factor": 0.303}, "alone/dark_mean+FPN_gauss_DN0.3 CMOS 0"),
        ("dark_total std", {"source_follower_e": 6.156}, "alone/source_follower CMOS 0"),
        ("volts_sense_node std", {"reset_factor": 0.808}, "alone/kTC_factor0.8 CMOS 0.5"),
        ("volts_sense_node mean", {"ve_alpha": 0.0505}, "alone/Ve_nonlin_0.05 CMOS 0.5"),
        ("volts_source_follower mean", {"vv_gamma": 1.0505}, "alone/VV_nonlin_1.05 CMOS 0.5"),
        ("DN mean", {"adc_gamma": 1.0404}, "alone/ADC_nonlin_1.04 CMOS 1"),
        ("volts_cds std", {"column_fpn_factor": 0.00115}, "alone/column_gauss_0.001 CMOS 0.5"),
    ],
)
def test_an_error_of_1_percent_is_seen(what: str, changes: dict[str, Any], record: str) -> None:
    """… of 2 % in the PRNU, and of 15 % in the column pattern, which has only 1900 samples."""
    chosen = [r for r in RECORDS if f"{r['config']} {r['sensor']} {r['level']:g}" == record]
    config = chosen[0]["config"]
    right, wrong = SETTINGS[config], replace(SETTINGS[config], **changes)
    SETTINGS[config] = wrong
    try:
        found = {d.what: d.sigma for d in deviations(records=chosen)}
    finally:
        SETTINGS[config] = right
    assert found[what] > LIMIT


def test_the_constants_are_the_released_ones_to_the_last_digit() -> None:
    derived, parameters = REFERENCE["derived"], REFERENCE["parameters"]["chosen_not_in_table1"]
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(1, (1, 1)))
    assert SIMPLE.full_well_v == pytest.approx(derived["V_FW"], rel=1e-14)
    assert SIMPLE.adc_gain_dn_per_v == pytest.approx(REFERENCE["A_ADC_DN_per_V"], rel=1e-14)
    assert SIMPLE.reference_v == parameters["V_REF"]
    assert SIMPLE.reset_factor == parameters["sn_reset_Factor"]
    dark_e = RECORDS[0]["stats"]["dark_mean_e"]
    assert PublishedDarkMean(1.0, SIMPLE.pixel_area_cm2).mean_e(frame) == pytest.approx(
        dark_e, rel=1e-14
    )
    assert PublishedResetNoise(5e-6, 1.0).sigma(frame) == pytest.approx(
        derived["sigma_ktc_V_298K"], rel=1e-14
    )
    assert PublishedFollowerSpectrum().sigma_e(5.0) == pytest.approx(
        derived["sigma_SF_e"]["code_10kHz_grid"], rel=1e-14
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dark_fpn": "paper_eq18"}, "941 e- where 174 is meant"),
        ({"reset": "paper_eq27"}, "rises by a volt"),
        ({"adc_reference": "paper_eq35"}, "every pixel reads 0"),
    ],
)
def test_a_formula_of_the_paper_that_gives_no_image_is_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ms.InputError, match=message):
        replace(SIMPLE, **changes)


def test_colours_are_refused() -> None:
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(1, (2, 2)))
    with pytest.raises(ms.InputError, match="has one wavelength"):
        chain_of(SIMPLE)[0].sample(
            ms.Photons(np.ones((2, 2, 3)), np.array([450.0, 550.0, 650.0])), frame
        )


def test_a_crop_of_a_frame_is_the_frame_of_the_crop() -> None:
    """… with autoregressive patterns too, to the last bit: their past reaches out of the crop."""
    settings = replace(
        ADVANCED,
        dark_fpn="ar",
        dark_fpn_parameter=0.5,
        column_fpn="ar",
        column_fpn_parameter=-0.4,
    )
    whole = SensorWindow(7, (40, 90), (0, 4060))
    crop = SensorWindow(7, (12, 30), (20, 4090))

    def render_frames(window: SensorWindow, stage_count: int) -> Any:
        signal: Any = ms.Photons(np.full(window.shape, 27500.0))
        for stage in chain_of(settings)[:stage_count]:
            signal = stage.sample(signal, ms.stages.Frame(EXPOSURE, window, seed=3))
        return signal

    count = len(chain_of(settings))
    assert np.array_equal(render_frames(whole, count)[20:32, 30:60], render_frames(crop, count))
    assert np.array_equal(
        render_frames(whole, count - 1)[20:32, 30:60], render_frames(crop, count - 1)
    )


@pytest.mark.parametrize(
    "distribution",
    [
        PublishedFpnDistribution("gaussian"),
        PublishedFpnDistribution("lognormal", 0.4),
        PublishedFpnDistribution("wald", 2.0),
        PublishedFpnDistribution("wald", 0.2),
        PublishedFpnDistribution("ar", 0.5),
    ],
    ids=repr,
)
def test_a_pattern_has_its_mean_and_variance(distribution: Any) -> None:
    """Half a million samples, 4 standard errors of mean and variance; chance fails a case in 1 of 8000 seeds."""
    x = fpn_map(SensorWindow(11, (500, 1000)), "dark_fpn", distribution).ravel()
    correlated = 1.3 if distribution.name == "ar" else 1.0
    squares = (x - distribution.mean) ** 2
    assert abs(x.mean() - distribution.mean) < LIMIT * x.std() / math.sqrt(x.size)
    assert abs(
        squares.mean() - distribution.variance
    ) < LIMIT * correlated * squares.std() / math.sqrt(x.size)


FRAME = ms.stages.Frame(EXPOSURE, SensorWindow(1, (1, 1)))
FULL_SWING = PublishedFollower(3.1, 0.165, 1.05)
DARK_MEAN = PublishedDarkMean(1.0, 3.249e-7).mean_e(FRAME)
OURS_DARK = FigureOfMerit(1.0, 3.249e-7)
LOGNORMAL = PublishedFpnDistribution("lognormal", 0.4)


def physical_dark_e(kelvin: float) -> float:
    return OURS_DARK.rate_e_per_s(kelvin)


def published_dark_e(kelvin: float) -> float:
    return PublishedDarkMean(1.0, 3.249e-7).mean_e(
        ms.stages.Frame(ms.Exposure(1.0, kelvin), SensorWindow(1, (1, 1)))
    )


def clipped_noise(part: int) -> float:
    """Mean (0) and σ (1) of max(0, σ_SF·z) floored, as quantiles of a fine grid of the normal."""
    from scipy.special import ndtri

    x = np.floor(
        np.maximum(
            0,
            PublishedFollowerSpectrum().sigma_e(5.0)
            * ndtri((np.arange(2_000_000) + 0.5) / 2_000_000),
        )
    )
    return float((x.mean(), x.std())[part])


def signal_kept(level: float) -> float:
    return (3.1 - float(FULL_SWING.sample(3.1 - 0.165 * level, FRAME))) / (0.165 * level)


def exponential(electrons: float) -> float:
    node = PublishedExponentialNode(3.1, 0.05, PublishedResetNoise(5e-6, 0.0))
    return (3.1 - float(node.sample(electrons, FRAME))) / (5e-6 * electrons)


PAGE = {
    "99.50": lambda: math.sqrt(27500) * 0.6,
    "128.45": lambda: math.sqrt(16500),
    "0.6126": lambda: math.exp(-0.49),
    "1727.42": lambda: published_dark_e(298.15),
    "1741.58": lambda: physical_dark_e(298.15),
    "2011.37": lambda: published_dark_e(300.0),
    "2027.87": lambda: physical_dark_e(300.0),
    "0.81 %": lambda: 100 * (1 - published_dark_e(298.15) / physical_dark_e(298.15)),
    "941": lambda: DARK_MEAN * (1 + math.exp((0.01 * DARK_MEAN) ** 2 / 2)),
    "174.61": lambda: DARK_MEAN * (1 + 0.01 * LOGNORMAL.mean),
    "0.7795": lambda: DARK_MEAN * 0.01 * math.sqrt(LOGNORMAL.variance),
    "1.7416": lambda: 0.01 * 0.1 * physical_dark_e(298.15),
    "250.48": lambda: DARK_MEAN * (1 + 0.3 * PublishedFpnDistribution("wald", 2.0).mean),
    "1.60": lambda: 1 + 0.3 * 2,
    "6.0945": lambda: PublishedFollowerSpectrum().sigma_e(5.0),
    "6.1051": lambda: CdsNoise(15.0, 1e6, 1e-6, 0.5e-6).sigma_v / 5e-6,
    "0.218": lambda: PublishedFollowerSpectrum(
        sample_s=1e-4, dominant_s=0.5e-4, rtn_step=0.0
    ).sigma_e(5.0),
    "5.193": lambda: CdsNoise(15.0, 1e6, 1e-4, 0.5e-4).sigma_v / 5e-6,
    "2.19": lambda: clipped_noise(0),
    "3.39": lambda: clipped_noise(1),
    "57.3": lambda: math.sqrt(PublishedResetNoise(5e-6, 0.8).moments(FRAME)[1]) / 5e-6,
    "71.7": lambda: SignedResetNoise(5e-6, 1.0).sigma_v(FRAME.exposure) / 5e-6,
    "0.0103": lambda: PublishedResetNoise(5e-6, 0.8).moments(FRAME)[0] / 5e-6,
    "0.455": lambda: exponential(3300),
    "0.450": lambda: exponential(33000),
    "0.699": lambda: signal_kept(0.1),
    "0.713": lambda: signal_kept(1.0),
    "12.70": lambda: 3.1 * 0.001 * 0.165 * 4096 / 0.165,
    "12.02": lambda: 2.935 * 0.001 * 0.165 * 4096 / 0.165,
    "4.096": lambda: 0.001 * 4096,
    "4096": lambda: float(PublishedAdc(12, 24824.0, 3.1, 0.165).highest),
    "7.54 %": lambda: 100 * RECORDS[0]["stats"]["frac_DN_0"],
}
"""Every number on the page, as printed there, and where it comes from."""


@pytest.mark.parametrize("printed", PAGE)
def test_the_numbers_of_the_page(printed: str) -> None:
    """docs/stages.md says what the code does, to the last digit printed."""
    page = (ROOT / "docs" / "stages.md").read_text("utf-8")
    number, digits = float(printed.rstrip(" %")), len(printed.rstrip(" %").partition(".")[2])
    assert printed in page
    assert PAGE[printed]() == pytest.approx(number, abs=0.5000001 * 10.0**-digits)
