"""Stiff and extreme cases: every one gives the right number or one clear sentence, never a NaN, a hang or a wrap.

The cases are those of ``mitsuba-sensor study stress``, asked theme by theme of every engine on this machine. Seeds are
fixed. Of about 1700 comparisons of averages, each with 5 standard errors (6e-7), other seeds would fail one in 1000.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal, localcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.study_pages import faults, through_files
from scipy import integrate, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.units import BOLTZMANN_EV_PER_K
from mitsuba_sensor.render.variants import mitsuba
from mitsuba_sensor.sensor.dark_current_models import band_gap_ev
from mitsuba_sensor.sensor.effects.dark_current import mean_dark_e
from mitsuba_sensor.sensor.gains import adc_gain_dn_per_v, gain_dn_per_e
from mitsuba_sensor.study import stress as package
from mitsuba_sensor.study.kit import Kit
from mitsuba_sensor.study.stress import (
    THEMES,
    Sensitivity,
    Theme,
    nudged,
    of_camera,
    strongest,
    ulp,
    verdicts_of,
    volts,
)
from mitsuba_sensor.study.stress.case import ENGINES, NO_ENGINE, RENDERERS, Engine, Got, Rows, agree, refusal

ASKED = [
    (theme, engine) for theme in THEMES for engine in theme.asked if engine.compiler != "cuda" or not engine.problem
]
IDS = [f"{theme.name}, {getattr(theme.cases, '__name__', 'chains')} | {engine.name}" for theme, engine in ASKED]


@pytest.mark.parametrize(("theme", "engine"), one_in(9, ASKED, several=True), ids=IDS)
def test_every_case_of_a_theme_holds(theme: Theme, engine: Engine) -> None:
    if engine.problem:
        pytest.skip(engine.problem)
    verdicts = verdicts_of(theme, engine)
    failed = [f"{' | '.join(case)}\ngot: {got.text}" for case, got in verdicts if not got.passed]
    assert verdicts and not failed, "\n".join(failed)
    assert len({case[:3] for case, _ in verdicts}) == len(verdicts), "two cases have one name"


# Verdicts


def theme_of(check: Callable[[], Got], asked: tuple[Engine, ...] = (NO_ENGINE,), name: str = "made up") -> Theme:
    def cases(engine: Engine) -> Rows:
        yield "stage", "given", "nothing wrong", check()

    return Theme(name, cases, asked)


@pytest.mark.parametrize(
    ("check", "texts"),
    [
        (lambda: Got("what came", False), "what came"),
        (lambda: Got(str(np.array([-1.0]) ** 0.5), True), "invalid value"),
        (lambda: Got(str(np.float32(1e30) * np.array([1e30], np.float32)), True), "overflow"),
        (lambda: 1 / 0, "ZeroDivisionError"),
        (lambda: agree(math.nan, 1.0, 2.0), "nan"),
        (lambda: agree([1.0, math.nan], 1.0, 2.0), "nan"),
        (lambda: refusal("texts", lambda: None), "nothing was refused"),
        (lambda: refusal("another sentence", lambda: ms.Exposure(-1.0)), "time_s is -1.0"),
    ],
    ids=["no", "invalid", "overflow", "exception", "NaN", "largest NaN", "no refusal", "other texts"],
)
def test_a_warning_an_exception_a_nan_and_a_no_are_all_verdicts_against(check: Any, texts: str) -> None:
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        ((_, got),) = verdicts_of(theme_of(check), NO_ENGINE)
    assert got.passed is False and texts in got.text


def test_an_exception_keeps_the_cases_before_it_and_says_behind_which_one_it_came() -> None:
    def cases(engine: Engine) -> Rows:
        yield "stage", "given", "as it must", Got("as it must", True)
        raise OverflowError("too large")

    (_, good), (case, bad) = verdicts_of(Theme("made up", cases), NO_ENGINE)
    assert good.passed and not bad.passed
    assert bad.text == "OverflowError: too large" and case[2] == "behind given"


def test_the_study_says_what_holds_what_fails_and_who_is_not_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Three cases: one holds on every engine, one on none, one is asked of nobody who is here."""
    absent = Engine("CUDA float32", "cuda", compiler="cuda")
    monkeypatch.setattr(Engine, "problem", property(lambda self: "no such device" if self.compiler == "cuda" else None))
    good = theme_of(lambda: Got("as it must", True), (NO_ENGINE, *ENGINES), "first")
    bad = theme_of(lambda: Got("not as it must", False), name="second")
    third = theme_of(lambda: Got("", True), (absent,), "third")
    monkeypatch.setattr(package, "THEMES", (good, bad, third))
    monkeypatch.setattr(package, "sensitivities", lambda: sensitivities("konnik_table1"))
    told: list[tuple[float, float, str]] = []
    kit = Kit(progress=lambda *now: told.append(now))
    study = package.stress(kit)
    assert study.name == "stress" and not study.passed
    assert study.findings[0].startswith("1 of 2 cases hold on NumPy float64, NumPy float32, LLVM float32: 5 verdicts")
    assert "expected nothing wrong" in study.findings[1] and "no such device" in study.findings[2]
    grid, _, _, *tables = study.parts
    assert grid.rows == ("first", "second", "third")  # type: ignore[union-attr]
    names = tuple(engine.name for engine in (NO_ENGINE, *ENGINES, *RENDERERS))
    texts = [dict(zip(names, row, strict=True)) for row in grid.texts]  # type: ignore[union-attr]
    assert texts[0]["no engine"] == texts[0]["LLVM float32"] == "1/1" and texts[1]["no engine"] == "0/1"
    assert texts[2]["CUDA float32"] == "not here" and grid.marks[2][4] == "dim"  # type: ignore[union-attr]
    assert [table.marks for table in tables] == [("good",), ("bad",), ()]  # type: ignore[union-attr]
    engines = "no engine, NumPy float64, NumPy float32, LLVM float32"
    assert tables[0].rows[0][3:] == (engines, "as it must", "holds")  # type: ignore[union-attr]
    json.dumps(study.to_dict(), allow_nan=False)
    assert not faults(study)
    resumed = package.stress(Kit(through_files(kit.known, package.RECORDS, tmp_path)))
    assert resumed.to_dict() == study.to_dict()
    assert len(told) == 7 and all(elapsed <= expected for elapsed, expected, _ in told)


def test_a_render_of_the_study_leaves_the_variant_as_it_was() -> None:
    mi = mitsuba()
    first = mi.variant() or "scalar_spectral"
    for before in ("scalar_rgb", "scalar_spectral"):
        mi.set_variant(before)
        package.light.sky(RENDERERS[0], spp=2, wavelength_nm=550.0)
        assert mi.variant() == before
    mi.set_variant(first)


# The oracles


def test_the_series_of_the_flicker_integral_meet_each_other() -> None:
    """J with 120 digits: at 2 as printed, and smooth over the seam at 60, where the asymptotic series is good to 1e-25.

    J rises by 1/a − 2/a³ there.
    """
    with localcontext() as context:
        context.prec = volts.DIGITS
        assert float(volts.exact_flicker(Decimal(2))) == pytest.approx(1.115785799, abs=5e-10)
        low, high = (volts.exact_flicker(Decimal(60) + sign * Decimal("1e-9")) for sign in (-1, 1))
        assert float((high - low) / Decimal("2e-9")) == pytest.approx(1 / 60 + 2 / 60**3, rel=1e-4)


def test_the_exact_telegraph_noise_has_no_hole_at_twice_the_dominant_time() -> None:
    with localcontext() as context:
        context.prec = volts.DIGITS
        tiny = 2.0**-52
        low, at, high = (volts.exact_parts(replace(volts.PAPER, rtn_s=1e-6 * (1 + x)))[2] for x in (-tiny, 0, tiny))
    assert low < at < high and float((high - at) / (at - low)) == pytest.approx(1, abs=0.6)


# Condition numbers: closed forms of a straight camera


def sensitivities(name: str, time_s: float = 0.1, **change: Any) -> list[Sensitivity]:
    camera = ms.load_camera(name).replace(**change)
    return sorted(of_camera(name, camera, ms.Exposure(time_s)), key=lambda one: -one.largest_dn)


def found(rows: list[Sensitivity], field: str, level: str) -> Sensitivity:
    return next(one for one in rows if (one.field, one.level) == (field, level))


def test_a_step_of_the_light_moves_the_mean_by_k_times_qe_times_the_step() -> None:
    """27 500 photons are half a well; float32 is 0.001953125 apart there, so K·0.6·0.001953125 = 1.4546e-4 DN.

    Shot noise follows as ½Δσ²/σ, with σ² = K²·(N + dark + read²).
    """
    camera = ms.load_camera("konnik_table1")
    one, k = found(sensitivities("konnik_table1"), "photons", "50 %"), gain_dn_per_e(camera)
    electrons = 0.6 * 2.0**-9
    assert one.moved_dn[0] == pytest.approx(k * electrons, rel=1e-6)
    assert one.number == pytest.approx(k * 16_500 / one.mean_dn, rel=1e-6)
    sigma = k * math.sqrt(16_500 + mean_dark_e(camera, ms.Exposure(0.1)) + 6.105069**2)
    assert one.moved_dn[1] == pytest.approx(0.5 * k * k * electrons / sigma, rel=1e-4)


def test_the_condition_number_of_the_temperature_is_that_of_silicon() -> None:
    """d ln D/d ln T = 3/2 + (E_g − T·E_g′)/(2kT): 24.5 at 25 °C, times the share of the mean that is dark current."""
    camera, kelvin, step = ms.load_camera("konnik_table1"), 298.15, 1e-3
    slope = (band_gap_ev(kelvin + step) - band_gap_ev(kelvin - step)) / (2 * step)
    power = 1.5 + (band_gap_ev(kelvin) - kelvin * slope) / (2 * BOLTZMANN_EV_PER_K * kelvin)
    assert power == pytest.approx(24.5, abs=0.5)
    one = found(sensitivities("konnik_table1", 10.0), "temperature_k", "dark")
    dark_dn = gain_dn_per_e(camera) * mean_dark_e(camera, ms.Exposure(10.0))
    assert one.number == pytest.approx(power * dark_dn / one.mean_dn, rel=1e-4)
    assert one.moved_dn[0] == pytest.approx(power * dark_dn * 2.0**-15 / kelvin, rel=1e-4)


def test_gains_that_the_converter_follows_move_nothing_and_those_that_it_does_not_move_all() -> None:
    """V_FS is a full well's swing unless it is given: A_SN then cancels, but for the noise that is made in volts."""
    free = found(sensitivities("konnik_table1"), "readout.sense_gain_uv_per_e", "50 %")
    fixed = found(sensitivities("konnik_table1", **{"adc.full_scale_v": 0.165}), "readout.sense_gain_uv_per_e", "50 %")
    assert free.moved_dn[0] < 1e-9 < free.moved_dn[1]
    assert fixed.number == pytest.approx(1, abs=0.02)


def test_what_exceeds_a_tenth_of_a_code_says_why() -> None:
    """24 bits: a mean of 8.5 million DN has float32 steps of 1 DN; at 12 bits nothing comes near."""
    rows = strongest(sensitivities("konnik_table1", **{"adc.bits": 24}), 100)
    assert rows[0].largest_dn > 0.1 and all(bool(one.why) == (one.largest_dn > 0.1) for one in rows)
    assert "has float32 steps of 1 DN itself" in next(one for one in rows if one.field == "photons").why
    assert (
        "with power 24" in found(sensitivities("konnik_table1", 10.0, **{"adc.bits": 24}), "temperature_k", "dark").why
    )
    assert not any(one.why for one in sensitivities("konnik_table1"))


def test_a_nudge_moves_every_number_of_a_field_by_one_step_and_no_switch() -> None:
    assert nudged((1.0, 0.0, 3), 1) == (1 + 2.0**-23, 0.0, 3)
    assert nudged({"a": (0.5,)}, -1) == {"a": (0.5 - 2.0**-24,)}
    assert nudged("text", 1) == "text" and nudged(True, 1) is True and nudged(None, 1) is None
    assert ulp(-1.0) == 2.0**-23


# What the table found: a converter that float32 cannot hold


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_a_gain_beyond_float32_takes_float64_by_itself_or_says_why_not(engine: Any) -> None:
    """A_CDS = 1e-30 makes 2.5e34 DN of a volt; in float32 that was 1e30, and every pixel read the black level."""
    camera, light = ms.load_camera("konnik_table1").replace(**{"readout.cds_gain": 1e-30}), np.full((2, 40), 1000.0)
    assert adc_gain_dn_per_v(camera) == pytest.approx(2.48e34, rel=1e-3)
    if engine == "drjit":
        with pytest.raises(ms.InputError, match="precision float64"):
            ms.expose(light, camera, ms.Exposure(0.1), engine=engine)
        return
    plain = ms.expose(light, ms.load_camera("konnik_table1"), ms.Exposure(0.1), precision="float64").digital
    np.testing.assert_array_equal(ms.expose(light, camera, ms.Exposure(0.1), engine=engine).digital, plain)


def test_a_nonlinear_node_is_needed_even_in_the_dark() -> None:
    """It changes nothing of nothing, but the unit: a plan that left it out could not be run."""
    camera = ms.load_camera("konnik_table1").replace(**{"readout.ve_nonlinearity": 1.0})
    plan = ms.plan(camera, ms.Exposure(0.0), np.zeros((2, 2)))
    node = next(effect for effect in plan.effects if effect.stage == "nonlinear sense node")
    assert node.kept and ms.expose(np.zeros((2, 2)), camera, ms.Exposure(0.0), plan=plan).digital.shape == (1, 2, 2)


# … and the theory of a saturated well


@pytest.mark.parametrize(("time_s", "kelvin"), [(1e6, 298.15), (0.1, 600.0), (600.0, 350.0)])
def test_a_saturated_well_is_full_in_theory_too(time_s: float, kelvin: float) -> None:
    """A dark-current FPN of 40 % has no dark pixels 1000 wells high, where a normal law has 0.6 % below zero.

    With that one, frame.json expected -3.8e9 ± 6.6e10 e- at 600 K, and the plan a fixed pattern of as much.
    """
    camera = ms.load_camera("bayer_2mp")
    frames = ms.expose(np.zeros((4, 6)), camera, ms.Exposure(time_s, kelvin))
    well = next(line for line in frames.report["stages"] if line["name"] == "full well")
    assert well["mean_expected"] == pytest.approx(camera.pixel.full_well_e, rel=1e-9)
    assert well["sigma_expected"] < 0.01 and well["sigma_frame"] < 0.01
    effects = ms.plan(camera, ms.Exposure(time_s, kelvin), np.zeros((4, 6))).effects
    assert all(effect.spatial_dn < 4096 and effect.mean_dn < 4096 for effect in effects)


@pytest.mark.parametrize(("mean", "cv"), [(70.0, 0.4), (100.0, 0.4), (65.0, 1.0), (1e3, 1.0), (70.0, 0.1)])
def test_what_is_cut_deep_below_its_mean_has_the_moments_of_a_cut_lognormal(mean: float, cv: float) -> None:
    """∫ of min(x, 30) and its square over the law of the same mean and variance, a quarter of it temporal."""
    variance = (cv * mean) ** 2
    width = math.sqrt(math.log1p(cv * cv))
    law = stats.lognorm(width, scale=mean * math.exp(-(width**2) / 2))
    short, square = (integrate.quad(lambda x: (30 - x) ** k * law.pdf(x), 0, 30, epsabs=1e-13)[0] for k in (1, 2))  # noqa: B023
    m = Moments(mean, 0.25 * variance, 0.75 * variance, None).clip(-math.inf, 30.0)  # type: ignore[arg-type]
    assert float(m.mean) == pytest.approx(30 - short, rel=1e-10)
    assert float(m.temporal + m.spatial) == pytest.approx(square - short**2, rel=1e-6, abs=1e-10)
    assert float(m.spatial) == pytest.approx(3 * float(m.temporal), rel=1e-9)
