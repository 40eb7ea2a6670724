"""The sensor side of error against time: laws against closed forms, frames against each other, and the bookkeeping.

Seeds are fixed. Where chance could fail a test under other seeds, its docstring says how often.
"""

from __future__ import annotations

import copy
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.marks import exhaustive
from helpers.study_pages import faults, through_files
from scipy import special, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32
from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.lab.statistics.estimators import Spread, ratio, spread
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.checks import as_photons
from mitsuba_sensor.sensor.effects.shot_noise import ShotNoise
from mitsuba_sensor.study import frames as study_frames
from mitsuba_sensor.study import kit as study_kit
from mitsuba_sensor.study.frames import Replicas, averages, expected_moments, resized
from mitsuba_sensor.study.kit import Kit, Step, Subject, one_turn
from mitsuba_sensor.study.page import Plot, Section, Table, study_of
from mitsuba_sensor.study.work_precision import sensor as measured
from mitsuba_sensor.study.work_precision.sensor import Results, Sensor, change
from mitsuba_sensor.study.work_precision.sensor_page import findings, sensor_section
from mitsuba_sensor.study.work_precision.settings import (
    EXACT,
    GAUSSIAN,
    GENERATOR,
    MEAN_ONLY,
    OWN,
    QUANTILE,
    REFERENCE,
    FrameSetting,
    Law,
    counts_of,
    law_of,
    law_of_counts,
)

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
SUBJECT = Subject("", CAMERA, EXPOSURE)
LIGHT = as_photons(np.geomspace(3.0, 40_000.0, 24 * 32).reshape(24, 32), CAMERA)
NUMPY = {sampler: FrameSetting("numpy", "float32", sampler) for sampler in (QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)}
DOCS = ROOT / "docs" / "backends.md"
TOLERANCES_DN = (0.0, 1.0)

needs_llvm = pytest.mark.skipif(bool(backend_problem("llvm")), reason="no LLVM here")


def law(setting: FrameSetting, mean: float) -> Law:
    backend = setting.backend()
    return law_of(lambda integers: counts_of(backend, integers, mean), mean)


# The Poisson law


@pytest.mark.parametrize("mean", [1.0, 10.0, 100.0, 1e4])
def test_the_gaussian_law_is_as_far_off_as_its_closed_form_says(mean: float) -> None:
    """P(n) = Φ((n + ½ − λ)/√λ) − Φ((n − ½ − λ)/√λ), and all below ½ is 0: 4e-2 at a mean of 10."""
    n = np.arange(0, math.ceil(mean + 12 * math.sqrt(mean) + 30))
    edges = (np.append(n - 0.5, n[-1] + 0.5) - mean) / math.sqrt(mean)
    edges[0] = -np.inf
    variation = 0.5 * np.abs(np.diff(special.ndtr(edges)) - stats.poisson.pmf(n, mean)).sum()
    assert law(NUMPY[GAUSSIAN], mean)["variation"] == pytest.approx(variation, rel=2e-3)
    if mean == 10:
        assert variation == pytest.approx(4.02e-2, rel=1e-2)


def test_the_law_by_bisection_is_that_of_all_integers() -> None:
    """The documentation's table counted all 2³² integers, in a quarter of an hour; 2 % and its two digits apart."""
    rows = re.findall(r"^\| (1[0e2]\S*|30) \| (\S+) \| \S+ \| (\S+) \|$", DOCS.read_text(encoding="utf-8"), re.M)
    table = {float(mean): (float(one), float(two.replace("−", "-"))) for mean, one, two in rows}
    assert {10.0, 30.0, 100.0, 1e4, 1e6} <= set(table)
    for mean, (variation, variance) in table.items():
        if mean >= 10:
            found = law(NUMPY[QUANTILE], mean)
            assert found["variation"] == pytest.approx(variation, rel=0.03)
            assert found["variance"] == pytest.approx(variance, rel=0.03)


@pytest.mark.parametrize("mean", [0.5, 12.0, 300.0])
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN])
def test_the_law_by_bisection_is_that_of_evenly_spaced_integers(sampler: str, mean: float) -> None:
    """Mean and variance of a million of them, each of which stands for 4096."""
    integers = (np.arange(2**20, dtype=np.uint64) * 2**12 + 2**11).astype(np.uint32)
    counts = counts_of(NUMPY[sampler].backend(), integers, mean)
    found, cells = law(NUMPY[sampler], mean), 12 * math.sqrt(mean) + 10
    assert found["mean"] == pytest.approx(counts.mean() / mean - 1, abs=cells / (mean * 2**20))
    assert found["variance"] == pytest.approx(counts.var() / mean - 1, abs=cells**2 / (mean * 2**20))
    assert found["variation"] == pytest.approx(law_of_counts(counts, mean)["variation"], abs=cells / 2**20)


def test_the_quantile_law_at_30_is_the_poisson_law() -> None:
    found = law(NUMPY[QUANTILE], 30.0)
    assert found["variation"] < 1e-5 + found["resolution"]
    assert max(abs(found["mean"]), abs(found["variance"])) < 1e-5
    assert abs(found["skewness"] or 1) < 1e-3


@pytest.mark.parametrize("mean", [0.01, 10.0, 1e4])
def test_the_exact_law_is_exact_as_far_as_integers_can_tell(mean: float) -> None:
    found = law(REFERENCE, mean)
    assert found["variation"] <= found["resolution"]
    assert max(abs(found["mean"]), abs(found["variance"])) < 1e-7


@pytest.mark.parametrize("mean", [0.5, 10.0])
def test_the_mean_alone_has_no_variance(mean: float) -> None:
    """One value: all but its own probability is misplaced, and all where it is no whole number."""
    found = law(NUMPY[MEAN_ONLY], mean)
    assert (found["mean"], found["variance"], found["skewness"]) == (0.0, -1.0, None)
    assert found["variation"] == pytest.approx(1 - stats.poisson.pmf(mean, mean), rel=1e-12)


@pytest.mark.parametrize("mean", [0.1, 10.0, 1e4])
def test_a_third_partys_draws_are_as_far_off_as_chance_says(mean: float) -> None:
    """Five standard deviations of the total variation, at most 0.3/√draws: once in 7000 under other seeds."""
    integers = np.random.default_rng(3).integers(0, 2**32, 2**18, dtype=np.uint32)
    found = law_of_counts(counts_of(NUMPY[GENERATOR].backend(), integers, mean), mean)
    assert found["variation"] == pytest.approx(found["resolution"], abs=1.5 / math.sqrt(integers.size))
    assert found["mean"] == pytest.approx(0, abs=5 / math.sqrt(mean * integers.size))


@needs_llvm
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN, MEAN_ONLY])
def test_the_compiled_engine_draws_the_same_law(sampler: str) -> None:
    for mean in (0.5, 30.0, 1e4):
        assert law(FrameSetting("drjit", "float32", sampler), mean) == law(NUMPY[sampler], mean)


# Samplers and settings


def test_another_law_changes_the_counts_and_nothing_else() -> None:
    integers = np.random.default_rng(5).integers(0, 2**32, 1000, dtype=np.uint32)
    before = NUMPY_FLOAT32.poisson(integers, np.float32(20.0))
    other = NUMPY[GAUSSIAN].backend()
    assert not np.array_equal(other.poisson(integers, np.float32(20.0)), before)
    np.testing.assert_array_equal(other.normal(integers), NUMPY_FLOAT32.normal(integers))
    np.testing.assert_array_equal(
        NUMPY_FLOAT32.poisson(integers, np.float32(20.0)), before
    )  # the package's backends are as before


def test_only_exact_and_quantile_are_offered() -> None:
    assert tuple(one.sampler for one in (REFERENCE, *NUMPY.values()) if one.sampler in OWN) == OWN == (EXACT, QUANTILE)


# Frames


@pytest.fixture
def sensor(monkeypatch: pytest.MonkeyPatch) -> Sensor:
    monkeypatch.setattr(measured, "LARGE", (192, 256))
    monkeypatch.setattr(measured, "TOLERANCES_DN", TOLERANCES_DN)
    return Sensor(Kit(), SUBJECT, LIGHT)


def planned(sensor: Sensor, here: list[str], precisions: dict[float, str]) -> list[FrameSetting]:
    engines = {engine: None if engine in here else "not here" for engine in measured.ENGINES}
    plans = {f"plan: {dn}": ({"precision": precision}, 0.0) for dn, precision in precisions.items()}
    sensor.kit.known |= {"engines": (engines, 0.0), **plans}
    return sensor.settings


def test_settings_of_different_kind_have_different_names(sensor: Sensor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measured, "TOLERANCES_DN", (0.0, 0.02, 5.0))
    settings = planned(sensor, ["numpy", "drjit"], {0.0: "float32", 0.02: "float32", 5.0: "float64"})
    assert len({setting.name for setting in settings}) == len(settings)
    assert [s.engine for s in settings if s.tolerance_dn == 0.02] == ["numpy", "drjit"]
    assert [s for s in settings if s.tolerance_dn == 5.0] == [FrameSetting("numpy", "float64", EXACT, 5.0)]


@needs_llvm
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN, MEAN_ONLY])
@pytest.mark.parametrize("tolerance_dn", [exhaustive(None), 1.0])
def test_with_equal_random_bits_drjit_and_numpy_differ_nowhere(
    sensor: Sensor, sampler: str, tolerance_dn: float | None
) -> None:
    assert sensor.pixels(FrameSetting("drjit", "float32", sampler, tolerance_dn))["share_of_numpy"] == 0


def test_a_kernel_that_differs_from_numpy_is_found_out(sensor: Sensor, monkeypatch: pytest.MonkeyPatch) -> None:
    """One pixel in four differs from NumPy, and that is 3 DN off."""

    def stream(_: Sensor, setting: FrameSetting) -> Any:
        return iter([np.array([[3 if setting.compiled else 0, 0], [0, 0]])])

    monkeypatch.setattr(Sensor, "stream", stream)
    found = sensor.pixels(FrameSetting("drjit", "float32", QUANTILE))
    assert found == {"share_of_pixels": 0.25, "largest_dn": 3.0, "rms_dn": 1.5, "share_of_numpy": 0.25}


def test_the_reference_differs_from_itself_nowhere_and_float32_hardly(sensor: Sensor) -> None:
    assert set(sensor.pixels(REFERENCE).values()) == {0.0}
    found = sensor.pixels(NUMPY[QUANTILE])
    assert 0 <= found["share_of_pixels"] < 1e-3
    assert found["largest_dn"] <= 1
    assert sensor.pixels(NUMPY[MEAN_ONLY])["rms_dn"] > 1


def test_frames_of_the_study_are_those_of_the_package(sensor: Sensor) -> None:
    large = resized(LIGHT, measured.LARGE)
    frame = ms.expose(large, CAMERA, EXPOSURE, engine="numpy", precision="float64").digital[0]
    np.testing.assert_array_equal(next(sensor.stream(REFERENCE)), frame)


def test_a_scene_fills_a_window_of_any_size_with_its_own_light() -> None:
    light = ms.Photons(np.arange(12.0).reshape(3, 4), variance_e2=np.ones((3, 4)), origin=(5, 7))
    large, small = resized(light, (30, 40)), resized(light, (2, 2))
    assert large.mean.shape == (30, 40)
    assert set(large.mean.ravel()) == set(range(12))
    np.testing.assert_array_equal(resized(light, (1, 10)).mean, [[0, 0, 1, 1, 1, 2, 2, 2, 3, 3]])
    np.testing.assert_array_equal(small.mean, [[0, 3], [8, 11]])
    assert (large.variance_e2, large.origin) == (None, (0, 0))


def test_moments_of_frames_are_those_that_numpy_finds_in_their_stack() -> None:
    """Three frames of each of two sensors: mean, variance, and what the means are off their theory, less the noise."""
    photons = resized(LIGHT, (12, 16))
    light = study_frames.Illuminated(photons, CAMERA, EXPOSURE, REFERENCE.backend())
    stages, group = chain(CAMERA), {"all": np.arange(12 * 16)}
    expected = expected_moments(stages, photons, EXPOSURE)
    found = light.measured_moments(stages, Replicas(sensors=2, frames=3, seed=5, serial=4), expected, group)["all"]
    for k in range(2):
        frames = [
            ms.expose(photons, CAMERA, EXPOSURE, seed=5 + 3 * k + i, serial=4 + k, precision="float64").digital[0]
            for i in range(3)
        ]
        stack = np.array(frames, dtype=float)
        mean, temporal = stack.mean(axis=0), stack.var(axis=0, ddof=1)
        assert found[0, k] == pytest.approx(mean.mean(), rel=1e-12)
        assert found[1, k] == pytest.approx(temporal.mean(), rel=1e-9)
        assert found[2, k] == pytest.approx(np.mean((mean - expected[0]) ** 2 - temporal / 3), rel=1e-6)


def test_frames_have_the_moments_of_theory(sensor: Sensor) -> None:
    """Fifteen values against theory, once in a thousand outside under other seeds; and no value is loose."""
    theory = sensor.plan(None)["moments"]
    off = change(sensor.moments(REFERENCE), theory, theory, theory)
    assert off.within(0.0)
    assert (off.error_dn[1] < 0.02 * np.sqrt(theory[1]) + 1e-6).all()


def test_without_draws_only_the_rest_of_the_noise_is_left(sensor: Sensor) -> None:
    """Temporal σ falls to that of the chain without its shot noise; once in a thousand outside under other seeds."""
    stages = tuple(stage for stage in chain(CAMERA) if not isinstance(stage, ShotNoise))
    pixels = expected_moments(stages, resized(LIGHT, measured.SMALL), EXPOSURE)
    left = np.stack([*averages(pixels, sensor.groups).values()], axis=1)
    off = change(sensor.moments(NUMPY[MEAN_ONLY]), left, left, left)
    assert (np.abs(off.value_dn[1]) <= off.chance_dn[1]).all()


def test_pixels_are_in_the_level_of_their_brightness(sensor: Sensor) -> None:
    means = sensor.plan(None)["moments"][0]
    assert len(means) == measured.LEVELS and (np.diff(means) > 0).all()
    assert {len(group) for group in sensor.groups.values()} <= {3276, 3277}


# Changes


def levels(mean: Any, temporal: Any, spatial: Any) -> Any:
    return np.array([[mean], [temporal], [spatial]])


def test_changes_of_roots_are_differences_of_standard_deviations() -> None:
    ones = np.ones(8)
    found, other = levels(7 * ones, 9 * ones, 4 * ones), levels(5 * ones, 4 * ones, 1 * ones)
    off = change(found, other, levels(7.0, 9.0, 4.0), levels(5.0, 4.0, 1.0))
    np.testing.assert_allclose(off.value_dn, [[2], [1], [1]])
    assert off.worst == (2.0, 0.0, "mean of level 1")
    assert off.within(2.0) and not off.within(1.999)


def test_a_variance_that_is_not_resolved_has_a_root_that_is_not() -> None:
    """Where theory says 0, noise of ±1e-2 DN² is ±0.1 DN and not infinitely many."""
    noise, zero = np.random.default_rng(1).normal(0, 1e-2, 400), np.zeros(400)
    none = levels(0.0, 0.0, 0.0)
    off = change(levels(zero, zero, noise), levels(zero, zero, zero), none, none)
    assert off.within(0.0)
    assert abs(off.value_dn[2, 0]) <= math.sqrt(abs(noise.mean())) + 1e-12
    assert off.value_dn[1, 0] == 0


def test_the_limit_is_that_of_students_t_for_all_values_together() -> None:
    found, theory = np.random.default_rng(2).normal(9, 1, (3, 5, 32)), np.full((3, 5), 9.0)
    off = change(found, theory, theory, theory)
    np.testing.assert_allclose(2 * 15 * stats.t.sf(off.chance_dn / off.error_dn, 31), 1e-3)


# The kit


def test_steps_that_are_known_are_not_measured_again_and_the_estimate_follows_the_clock() -> None:
    """Three steps of ten seconds each, which take next to none: the second estimate is that of a quick machine."""
    told: list[tuple[float, float, str]] = []
    kit = Kit({"b": ("kept", 3.0)}, lambda *now: told.append(now))
    kit.take((Step(key, 10.0, lambda key=key: key) for key in "abc"), after_s=5.0)  # type: ignore[misc]
    assert [kit[key] for key in "abc"] == ["a", "kept", "c"] and kit.new == 2
    assert told[0][1] == pytest.approx(25.0) and told[0][2] == "a"  # two of three are left, ten seconds each
    assert told[1][1] < 6.0  # the first took next to nothing
    assert [key for *_, key in told] == ["a", "c", "done"]
    assert 3.0 <= kit.seconds < 4.0, "of this run and those before"


def test_seconds_of_a_second_part_follow_those_of_the_first() -> None:
    told: list[tuple[float, float, str]] = []
    kit = Kit(progress=lambda *now: told.append(now))
    assert kit.measure("a", 1.0, lambda: 7) == 7 and kit.measure("a", 1.0, lambda: 8) == 7
    kit.take([Step("b", 2.0, lambda: 8)])
    assert told[-2][1] == pytest.approx(told[-2][0] + 2.0) and told[-2][0] == pytest.approx(kit.known["a"][1])


def test_tasks_take_turns_in_ever_new_orders() -> None:
    order: list[str] = []
    tasks = {name: lambda name=name: order.append(name) or 1 for name in "abc"}  # type: ignore[misc]
    found = study_kit.in_turns(tasks, 8)  # type: ignore[arg-type]
    turns = [tuple(order[i : i + 3]) for i in range(0, 27, 3)]
    assert all(set(turn) == set("abc") for turn in turns), "each once in every turn"
    assert len(set(turns)) > 3
    assert {name: len(seconds) for name, seconds in found.items()} == dict.fromkeys("abc", 8), "the first one compiles"


def test_a_task_that_works_several_times_is_divided() -> None:
    clock = iter([0.0, 8.0, 8.0, 16.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_kit.time, "perf_counter", lambda: next(clock))
        assert one_turn({"eight": lambda: 8, "two": lambda: 2}, 0) == {"eight": 1.0, "two": 4.0}


def test_a_ratio_is_the_median_of_the_turns_own_and_a_spread_has_their_quartiles() -> None:
    assert ratio([2.0, 30.0, 4.0], [1.0, 10.0, 1.0]) == 3.0
    assert spread([1.0, 2.0, 3.0, 4.0, 5.0]) == Spread(2.0, 3.0, 4.0)


# The whole side


@pytest.fixture(scope="module")
def small() -> Any:
    """The study in small: windows of 256 × 256, 16 sensors, two turns, three means."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measured, "LARGE", (256, 256))
        patch.setattr(measured, "REPLICAS", Replicas(sensors=16, frames=2, seed=2))
        patch.setattr(measured, "TURNS", 2)
        patch.setattr(measured, "TOLERANCES_DN", TOLERANCES_DN)
        patch.setattr(measured, "MEANS", (1.0, 10.0, 1e6))
        yield patch


Known = dict[str, Any]


def results_of(known: Known, told: Any = None) -> Results:
    sensor = Sensor(Kit(known, told), SUBJECT, LIGHT)
    sensor.measure()
    return Results(sensor)


def run(known: Known, told: Any = None) -> Section:
    return sensor_section(results_of(known, told))


@pytest.fixture(scope="module")
def known(small: Any) -> Known:
    done: Known = {}
    run(done)
    return done


def test_a_resumed_study_measures_nothing_twice(known: Known, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """From measurements that went through files comes the same study, though nothing can be measured any more."""
    for module, name in ((measured, "one_turn"), (study_frames, "sample"), (study_frames, "FrameRunner")):
        monkeypatch.setattr(module, name, None)
    monkeypatch.setattr(measured, "drawn_law", lambda *_: 1 / 0)
    again, once = run(through_files(known, (), tmp_path)), run(known)
    assert again.findings == once.findings and again.parts == once.parts


def test_an_interrupted_study_goes_on_where_it_was(known: Known) -> None:
    """All but the last third is there: that third is told, measured and, where it is not a time, the same again."""
    keys, told = list(known), []
    done = {key: known[key] for key in keys[: 2 * len(keys) // 3]}
    run(done, lambda *now: told.append(now))
    assert list(done) == keys
    assert [now[2] for now in told if now[2] != "done"] == keys[2 * len(keys) // 3 :]
    for key in keys:
        if "turn" not in key:
            np.testing.assert_equal(done[key][0], known[key][0], err_msg=key)


def test_everything_that_must_hold_does(known: Known) -> None:
    assert run(known).passed, run(known).findings
    assert len(list(results_of(known).requirements())) >= 5


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ("Poisson law, mean 10: numpy float32, quantile", "total variation"),
        ("pixels: numpy float32, quantile", "float32"),
        ("moments: numpy float32, quantile, plan 1 DN", "the plan for 1 DN"),
    ],
)
def test_what_does_not_hold_is_said_first(known: Known, part: str, said: str) -> None:
    """A law off by 3e-5, 2 % of the pixels moved, a plan that moves the mean by 1.5 DN."""
    broken = copy.deepcopy(known)
    value = broken[part][0]
    if "law" in part:
        value["variation"] = 3e-5
    elif "pixels" in part:
        value["share_of_pixels"] = 0.02
    else:
        value[0] += 1.5
    side = run(broken)
    assert not side.passed
    assert side.findings[0].startswith("Not as it must be") and said in side.findings[0]


def test_nothing_on_the_front_is_beaten(known: Known) -> None:
    results = results_of(known)
    points = {setting: (row.ns.median, row.error_dn) for setting, row in results.rows.items()}
    for setting, (x, y) in points.items():
        beaten = any(a <= x and b <= y and (a, b) != (x, y) for a, b in points.values())
        assert (setting in results.front) != beaten


def test_what_is_recommended_is_offered_keeps_the_tolerance_and_is_fastest(known: Known) -> None:
    results = results_of(known)
    for dn in results.plans:
        best = results.recommended(dn)
        assert best.setting.sampler in OWN and best.change.within(dn)
        for row in results.rows.values():
            if row.setting.sampler in OWN and (row.setting.tolerance_dn or 0) <= dn:
                assert best.ns.median <= row.ns.high or not row.change.within(dn)


def test_where_a_plan_asks_for_float64_no_float32_is_recommended(known: Known) -> None:
    results = results_of(known)
    results.plans[1.0] = {**results.plans[1.0], "precision": "float64"}
    assert results.recommended(1.0).setting == REFERENCE


def test_every_engine_has_its_rows_or_is_said_not_to_be_here(known: Known) -> None:
    table = next(p for p in run(known).parts if isinstance(p, Table) and p.title == "Settings of the sensor")
    names = [row[0] for row in table.rows]
    for engine, problem in known["engines"][0].items():
        said = f"{engine} float32, quantile" if problem is None else f"{engine}: not here ({problem})"
        assert said in names
    assert results_of(known).rows[NUMPY[GENERATOR]].pixels == {}  # its random bits are others
    assert len(table.marks) == len(table.rows)
    assert {len(row) for row in table.rows} == {len(table.columns)}


def test_plots_have_a_line_per_sampler_and_rings_on_the_front(known: Known) -> None:
    side, results = run(known), results_of(known)
    errors, _, laws = (part for part in side.parts if isinstance(part, Plot))
    assert sum(len(line.ringed) for line in errors.lines) == len(results.front)
    assert sum(len(line.x) for line in errors.lines) == len(results.rows)
    wanted = {REFERENCE.name, *(setting.name for setting in NUMPY.values())}
    assert wanted <= {line.label for line in laws.lines}
    assert all(min(line.x) > 0 and min(line.y) > 0 for line in (*errors.lines, *laws.lines))


def test_a_plan_that_leaves_out_more_is_predicted_and_measured_to_change_the_same(known: Known) -> None:
    """1 DN leaves out the noise of the source follower, 0.8 DN by itself; a false alarm in a thousand."""
    results = results_of(known)
    plan, row = results.plans[1.0], results.rows[FrameSetting("numpy", "float32", QUANTILE, 1.0)]
    assert "source follower noise" in plan["left_out"]
    assert np.abs(plan["predicted_dn"]).max() > 0.1
    assert (np.abs(row.of_plan.value_dn - plan["predicted_dn"]) <= row.of_plan.chance_dn + 1e-6).all()


def test_findings_are_sentences_with_numbers(known: Known) -> None:
    for finding in findings(results_of(known)):
        assert finding[0].isupper() and finding.endswith(".")
    assert any(re.search(r"ns/pixel", finding) for finding in run(known).findings)


def test_series_colours_and_units_of_the_page_are_as_they_must_be(known: Known) -> None:
    assert not faults(study_of("work-precision", "title", [run(known)]))


def test_photons_that_expose_would_refuse_are_refused() -> None:
    with pytest.raises(InputError, match="photons"):
        Sensor(Kit(), SUBJECT, np.full((2, 2), -1.0))  # type: ignore[arg-type]
