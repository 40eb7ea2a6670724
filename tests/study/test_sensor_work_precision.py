"""The sensor side of error against time: laws against closed forms, frames against each other, and the bookkeeping.

Seeds are fixed. Where chance could fail a test under other seeds, its docstring says how often.
"""

from __future__ import annotations

import copy
import json
import math
import re
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from scipy import special, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32
from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.checks import as_photons
from mitsuba_sensor.sensor.electrons import ShotNoise
from mitsuba_sensor.sensor.theory import final_moments
from mitsuba_sensor.study import timing
from mitsuba_sensor.study.page import Plot, Table
from mitsuba_sensor.study.sensor import changes
from mitsuba_sensor.study.sensor import frames as sensor_frames
from mitsuba_sensor.study.sensor import measure as sensor_time
from mitsuba_sensor.study.sensor import page as sensor_page
from mitsuba_sensor.study.sensor import results as sensor_results
from mitsuba_sensor.study.sensor.frames import REFERENCE, Chains
from mitsuba_sensor.study.sensor.poisson_law import Law, law_of, law_of_counts
from mitsuba_sensor.study.sensor.samplers import EXACT, GAUSSIAN, GENERATOR, MEAN_ONLY, QUANTILE, Setting, draws_of
from mitsuba_sensor.study.side import Side

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
LIGHT = as_photons(np.geomspace(3.0, 40_000.0, 24 * 32).reshape(24, 32), CAMERA)
NUMPY = {sampler: Setting("numpy", "float32", sampler) for sampler in (QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)}
DOCS = ROOT / "docs" / "backends.md"
TOLERANCES_DN = (0.0, 0.2)

needs_llvm = pytest.mark.skipif(bool(backend_problem("llvm")), reason="no LLVM here")


def law(setting: Setting, mean: float) -> Law:
    backend = setting.backend()
    return law_of(lambda words: draws_of(backend, words, mean), mean)


# The Poisson law


@pytest.mark.parametrize("mean", [1.0, 10.0, 100.0, 1e4])
def test_the_gaussian_law_is_as_far_off_as_its_closed_form_says(mean: float) -> None:
    """P(n) = Φ((n + ½ − λ)/√λ) − Φ((n − ½ − λ)/√λ), and all below ½ is 0: 4e-2 at a mean of 10."""
    n = np.arange(0, math.ceil(mean + 12 * math.sqrt(mean) + 30))
    edges = (np.append(n - 0.5, n[-1] + 0.5) - mean) / math.sqrt(mean)
    edges[0] = -np.inf
    variation = 0.5 * np.abs(np.diff(special.ndtr(edges)) - stats.poisson.pmf(n, mean)).sum()
    assert law(NUMPY[GAUSSIAN], mean).variation == pytest.approx(variation, rel=2e-3)
    if mean == 10:
        assert variation == pytest.approx(4.02e-2, rel=1e-2)


def test_the_law_by_bisection_is_that_of_all_words() -> None:
    """The documentation's table counted all 2³² words, in a quarter of an hour; 2 % and its two digits apart."""
    rows = re.findall(r"^\| (1[0e2]\S*|30) \| (\S+) \| \S+ \| (\S+) \|$", DOCS.read_text(encoding="utf-8"), re.M)
    table = {float(mean): (float(one), float(two.replace("−", "-"))) for mean, one, two in rows}
    assert {10.0, 30.0, 100.0, 1e4, 1e6} <= set(table)
    for mean, (variation, variance) in table.items():
        if mean >= 10:
            found = law(NUMPY[QUANTILE], mean)
            assert found.variation == pytest.approx(variation, rel=0.03)
            assert found.variance == pytest.approx(variance, rel=0.03)


@pytest.mark.parametrize("mean", [0.5, 12.0, 300.0])
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN])
def test_the_law_by_bisection_is_that_of_evenly_spaced_words(sampler: str, mean: float) -> None:
    """Mean and variance of a million of them, each of which stands for 4096."""
    words = (np.arange(2**20, dtype=np.uint64) * 2**12 + 2**11).astype(np.uint32)
    counts = draws_of(NUMPY[sampler].backend(), words, mean)
    found, cells = law(NUMPY[sampler], mean), 12 * math.sqrt(mean) + 10
    assert found.mean == pytest.approx(counts.mean() / mean - 1, abs=cells / (mean * 2**20))
    assert found.variance == pytest.approx(counts.var() / mean - 1, abs=cells**2 / (mean * 2**20))
    assert found.variation == pytest.approx(law_of_counts(counts, mean).variation, abs=cells / 2**20)


def test_the_quantile_law_at_30_is_the_poisson_law() -> None:
    found = law(NUMPY[QUANTILE], 30.0)
    assert found.variation < 1e-5 + found.resolution
    assert max(abs(found.mean), abs(found.variance)) < 1e-5
    assert abs(found.skewness or 1) < 1e-3


@pytest.mark.parametrize("mean", [0.01, 10.0, 1e4])
def test_the_exact_law_is_exact_as_far_as_words_can_tell(mean: float) -> None:
    found = law(REFERENCE, mean)
    assert found.variation <= found.resolution
    assert max(abs(found.mean), abs(found.variance)) < 1e-7


@pytest.mark.parametrize("mean", [0.5, 10.0])
def test_the_mean_alone_has_no_variance(mean: float) -> None:
    """One value: all but its own probability is misplaced, and all where it is no whole number."""
    found = law(NUMPY[MEAN_ONLY], mean)
    assert (found.mean, found.variance, found.skewness) == (0.0, -1.0, None)
    assert found.variation == pytest.approx(1 - stats.poisson.pmf(mean, mean), rel=1e-12)


@pytest.mark.parametrize("mean", [0.1, 10.0, 1e4])
def test_a_third_partys_draws_are_as_far_off_as_chance_says(mean: float) -> None:
    """Five standard deviations of the total variation, at most 0.3/√draws: once in 7000 under other seeds."""
    words = np.random.default_rng(3).integers(0, 2**32, 2**18, dtype=np.uint32)
    found = law_of_counts(draws_of(NUMPY[GENERATOR].backend(), words, mean), mean)
    assert found.variation == pytest.approx(found.resolution, abs=1.5 / math.sqrt(words.size))
    assert found.mean == pytest.approx(0, abs=5 / math.sqrt(mean * words.size))


@needs_llvm
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN, MEAN_ONLY])
def test_the_compiled_engine_draws_the_same_law(sampler: str) -> None:
    for mean in (0.5, 30.0, 1e4):
        assert law(Setting("drjit", "float32", sampler), mean) == law(NUMPY[sampler], mean)


# Samplers and settings


def test_another_law_changes_the_counts_and_nothing_else() -> None:
    words = np.random.default_rng(5).integers(0, 2**32, 1000, dtype=np.uint32)
    before = NUMPY_FLOAT32.poisson(words, np.float32(20.0))
    other = NUMPY[GAUSSIAN].backend()
    assert not np.array_equal(other.poisson(words, np.float32(20.0)), before)
    np.testing.assert_array_equal(other.normal(words), NUMPY_FLOAT32.normal(words))
    np.testing.assert_array_equal(
        NUMPY_FLOAT32.poisson(words, np.float32(20.0)), before
    )  # the product's lanes are as before


def test_only_exact_and_quantile_are_offered() -> None:
    assert [REFERENCE.offered, *(NUMPY[s].offered for s in NUMPY)] == [True, True, False, False, False]


def test_settings_of_different_kind_have_different_names() -> None:
    settings = sensor_time.all_settings(["numpy", "drjit"], {0.0: "float32", 0.02: "float32", 5.0: "float64"})
    assert len({setting.name for setting in settings}) == len(settings)
    assert [s.engine for s in settings if s.tolerance_dn == 0.02] == ["numpy", "drjit"]
    assert [s for s in settings if s.tolerance_dn == 5.0] == [Setting("numpy", "float64", EXACT, 5.0)]


# Frames


@pytest.fixture
def chains(monkeypatch: pytest.MonkeyPatch) -> Chains:
    monkeypatch.setattr(sensor_frames, "LARGE", (192, 256))
    return Chains(CAMERA, EXPOSURE, LIGHT)


@needs_llvm
@pytest.mark.parametrize("sampler", [QUANTILE, GAUSSIAN, MEAN_ONLY])
@pytest.mark.parametrize("tolerance_dn", [None, 0.2])
def test_with_equal_words_drjit_and_numpy_differ_nowhere(
    chains: Chains, sampler: str, tolerance_dn: float | None
) -> None:
    setting = Setting("drjit", "float32", sampler, tolerance_dn)
    assert sensor_frames.difference(chains, setting)["share_of_numpy"] == 0


def test_a_kernel_that_differs_from_numpy_is_found_out(chains: Chains, monkeypatch: pytest.MonkeyPatch) -> None:
    """One pixel in four differs from NumPy, and that is 3 DN off."""

    def frame(_: Chains, setting: Setting) -> Any:
        return np.array([[3 if setting.compiled else 0, 0], [0, 0]])

    monkeypatch.setattr(Chains, "frame", frame)
    found = sensor_frames.difference(chains, Setting("drjit", "float32", QUANTILE))
    assert found == {"share_of_pixels": 0.25, "largest_dn": 3.0, "rms_dn": 1.5, "share_of_numpy": 0.25}


def test_the_reference_differs_from_itself_nowhere_and_float32_hardly(chains: Chains) -> None:
    assert set(sensor_frames.difference(chains, REFERENCE).values()) == {0.0}
    found = sensor_frames.difference(chains, NUMPY[QUANTILE])
    assert 0 <= found["share_of_pixels"] < 1e-3
    assert found["largest_dn"] <= 1
    assert sensor_frames.difference(chains, NUMPY[MEAN_ONLY])["rms_dn"] > 1


def test_frames_of_the_study_are_those_of_the_product(chains: Chains) -> None:
    large = sensor_frames.filled(LIGHT, sensor_frames.LARGE)
    frame = ms.expose(large, CAMERA, EXPOSURE, engine="numpy", precision="float64").digital[0]
    np.testing.assert_array_equal(chains.reference_frame, frame)


def test_a_scene_fills_a_window_of_any_size_with_its_own_light() -> None:
    light = ms.Photons(np.arange(12.0).reshape(3, 4), variance_e2=np.ones((3, 4)), origin=(5, 7))
    large, small = sensor_frames.filled(light, (30, 40)), sensor_frames.filled(light, (2, 2))
    assert large.mean.shape == (30, 40)
    assert set(large.mean.ravel()) == set(range(12))
    np.testing.assert_array_equal(sensor_frames.filled(light, (1, 10)).mean, [[0, 0, 1, 1, 1, 2, 2, 2, 3, 3]])
    np.testing.assert_array_equal(small.mean, [[0, 3], [8, 11]])
    assert (large.variance_e2, large.origin) == (None, (0, 0))


def test_frames_have_the_moments_of_theory(chains: Chains) -> None:
    """Fifteen values against moments(), once in a thousand outside under other seeds; and no value is loose."""
    theory = sensor_frames.predicted(chains, None)
    off = changes.from_theory(sensor_frames.measured(chains, REFERENCE), theory)
    assert off.within(0.0)
    assert (off.error_dn[1] < 0.02 * np.sqrt(theory["temporal_dn2"]) + 1e-6).all()


def test_without_draws_only_the_rest_of_the_noise_is_left(chains: Chains) -> None:
    """Temporal σ falls to that of the chain without its shot noise; once in a thousand outside under other seeds."""
    stages = tuple(stage for stage in chain(CAMERA) if not isinstance(stage, ShotNoise))
    _, m = final_moments(stages, chains.small, Frame(EXPOSURE, SensorWindow(0, sensor_frames.SMALL)))
    left_dn2 = np.broadcast_to(m.temporal, sensor_frames.SMALL)
    found = sensor_frames.measured(chains, NUMPY[MEAN_ONLY])
    theory = sensor_frames.predicted(chains, None) | {"temporal_dn2": chains.by_level(left_dn2)}
    off = changes.from_theory(found, theory)
    assert (np.abs(off.value_dn[1]) <= off.limit * off.error_dn[1]).all()


# Changes


def test_changes_of_roots_are_differences_of_standard_deviations() -> None:
    ones = np.ones((8, 1))
    found = {"mean_dn": 7 * ones, "temporal_dn2": 9 * ones, "spatial_dn2": 4 * ones}
    other = {"mean_dn": 5 * ones, "temporal_dn2": 4 * ones, "spatial_dn2": 1 * ones}
    off = changes.change(found, other, ([4.0], [1.0]))
    np.testing.assert_allclose(off.value_dn, [[2], [1], [1]])
    assert off.worst == (2.0, 0.0, "mean of level 1")
    assert off.within(2.0) and not off.within(1.999)


def test_a_variance_that_is_not_resolved_has_a_root_that_is_not() -> None:
    """Where theory says 0, noise of ±1e-2 DN² is ±0.1 DN and not infinitely many."""
    noise = np.random.default_rng(1).normal(0, 1e-2, (400, 1))
    zero = np.zeros((400, 1))
    found = {"mean_dn": zero, "temporal_dn2": zero, "spatial_dn2": noise}
    off = changes.change(found, dict.fromkeys(found, zero), ([0.0], [0.0]))
    assert off.within(0.0)
    assert abs(off.value_dn[2, 0]) <= math.sqrt(abs(noise.mean())) + 1e-12
    assert off.value_dn[1, 0] == 0


def test_the_limit_is_that_of_students_t_for_all_values_together() -> None:
    off = changes.Change(np.zeros((3, 5)), np.ones((3, 5)), 32)
    assert 2 * 15 * stats.t.sf(off.limit, 31) == pytest.approx(1e-3)


# Bookkeeping


def test_steps_that_are_done_are_not_measured_again_and_the_estimate_follows_the_clock() -> None:
    calls: list[str] = []
    told: list[tuple[float, float, str]] = []
    steps = [timing.Step(key, 10.0, key, lambda key=key: calls.append(key) or key) for key in "abc"]  # type: ignore
    done: dict[str, Any] = {"b": "kept"}
    timing.take_steps(steps, done, lambda *words: told.append(words))
    assert calls == ["a", "c"]
    assert done == {"a": "a", "b": "kept", "c": "c"}
    assert told[0][1] == pytest.approx(20.0, rel=1e-3)  # two of three are left, ten seconds each
    assert told[1][1] < 1.0  # the first took next to nothing
    assert [words for *_, words in told] == ["a", "c", "done"]
    assert told[-1][0] == told[-1][1]


def test_timings_take_turns_in_ever_new_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    settings, order = [NUMPY[QUANTILE], NUMPY[GAUSSIAN], NUMPY[MEAN_ONLY]], []

    def frames(_: Chains, setting: Setting, count: int) -> Any:
        for _ in range(count):
            order.append(setting.sampler)
            yield None

    monkeypatch.setattr(Chains, "frames", frames)
    streams = sensor_time.Streams(Chains(CAMERA, EXPOSURE, LIGHT))
    for setting in settings:
        streams.first(setting)
    order.clear()
    for turn in range(8):
        assert set(streams.turn(turn, settings)) == {setting.name for setting in settings}
    turns = [tuple(order[i : i + 3]) for i in range(0, 24, 3)]
    assert all(set(turn) == {setting.sampler for setting in settings} for turn in turns)  # each once in every turn
    assert len(set(turns)) > 3


def test_a_task_that_works_several_times_is_divided() -> None:
    clock = iter([0.0, 8.0, 8.0, 9.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing.time, "perf_counter", lambda: next(clock))
        assert timing.one_turn({"eight": lambda: 8, "one": lambda: 1}) == {"eight": 1.0, "one": 1.0}


# The whole side


Told = list[tuple[float, float, str]]


@pytest.fixture(scope="module")
def small() -> Any:
    """The study in small: windows of 256 × 256, 16 devices, two turns, three means."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensor_frames, "LARGE", (256, 256))
        patch.setattr(sensor_results, "PIXELS", 2**16)
        patch.setattr(sensor_frames, "DEVICES", 16)
        patch.setattr(sensor_time, "TURNS", 2)
        patch.setattr(sensor_time, "MEANS", (1.0, 10.0, 1e6))
        yield patch


def run(done: dict[str, Any], told: Told | None = None) -> Side:
    progress = (lambda *_: None) if told is None else lambda *words: told.append(words)
    return sensor_time.sensor_side(
        LIGHT, CAMERA, EXPOSURE, tolerances_dn=TOLERANCES_DN, done=done, progress=progress
    )  # fmt: skip


@pytest.fixture(scope="module")
def journal(small: Any) -> dict[str, Any]:
    done: dict[str, Any] = {}
    run(done)
    return done


def results_of(journal: dict[str, Any]) -> sensor_results.Results:
    here = [engine for engine, problem in journal[sensor_results.ENGINES_KEY].items() if problem is None]
    precisions = {x: journal[sensor_results.plan_key(x)]["precision"] for x in TOLERANCES_DN}
    settings = sensor_time.all_settings(here, precisions)
    return sensor_results.gather(journal, settings, TOLERANCES_DN, sensor_time.MEANS, sensor_time.TURNS)


def test_a_resumed_study_measures_nothing_twice(journal: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """From a journal that went through JSON comes the same study, though nothing can be measured any more."""
    for module, name in ((timing, "one_turn"), (sensor_frames, "run_chain"), (sensor_frames, "Run")):
        monkeypatch.setattr(module, name, None)
    monkeypatch.setattr(sensor_time, "law_of", None)
    again = run(json.loads(json.dumps(journal)))
    assert json.dumps(again.data, allow_nan=False) == json.dumps(run(journal).data)
    assert again.findings == run(journal).findings


def test_an_interrupted_study_goes_on_where_it_was(journal: dict[str, Any]) -> None:
    """All but the last third is there: that third is told, measured and, where it is not a time, the same again."""
    keys = list(journal)
    done = {key: journal[key] for key in keys[: 2 * len(keys) // 3]}
    told: Told = []
    run(done, told)
    assert list(done) == keys
    assert len(told) == len(keys) - 2 * len(keys) // 3 + 1
    assert {key: x for key, x in done.items() if "turn" not in key} == {
        key: x for key, x in journal.items() if "turn" not in key
    }


def test_everything_that_must_hold_does(journal: dict[str, Any]) -> None:
    side = run(journal)
    assert side.passed, side.findings
    assert len(side.data["sensor"]["promises"]) >= 5


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("sensor/law/numpy float32, quantile/10", "total variation"),
        ("sensor/pixels/numpy float32, quantile", "float32"),
        ("sensor/moments/numpy float32, quantile, plan 0.2 DN", "the plan for 0.2 DN"),
    ],
)
def test_what_does_not_hold_is_said_first(journal: dict[str, Any], part: str, words: str) -> None:
    """A law off by 3e-5, 2 % of the pixels moved, a plan that moves the mean by 0.3 DN."""
    broken = copy.deepcopy(journal)
    if "law" in part:
        broken[part]["variation"] = 3e-5
    elif "pixels" in part:
        broken[part]["share_of_pixels"] = 0.02
    else:
        broken[part]["mean_dn"] = (np.asarray(broken[part]["mean_dn"]) + 0.3).tolist()
    side = run(broken)
    assert not side.passed
    assert side.findings[0].startswith("Not as it must be") and words in side.findings[0]


def test_nothing_on_the_front_is_beaten(journal: dict[str, Any]) -> None:
    results = results_of(journal)
    points = [(row.ns.median, row.error_dn) for row in results.rows]
    for i, (x, y) in enumerate(points):
        beaten = any(a <= x and b <= y and (a, b) != (x, y) for a, b in points)
        assert (i in results.front) != beaten


def test_what_is_recommended_is_offered_keeps_the_tolerance_and_is_fastest(journal: dict[str, Any]) -> None:
    results = results_of(journal)
    for plan in results.plans:
        best = results.recommended(plan)
        assert best.setting.offered and best.change.within(plan.tolerance_dn)
        for row in results.rows:
            if row.setting.offered and (row.setting.tolerance_dn or 0) <= plan.tolerance_dn:
                assert best.ns.median <= row.ns.high or not row.change.within(plan.tolerance_dn)


def test_where_a_plan_asks_for_float64_no_float32_is_recommended(journal: dict[str, Any]) -> None:
    results = results_of(journal)
    strict = sensor_results.Planned(0.2, (), 15, "float64", np.zeros((3, 5)), 0.0)
    assert results.recommended(strict).setting == REFERENCE


def test_every_engine_has_its_rows_or_is_said_not_to_be_here(journal: dict[str, Any]) -> None:
    table = next(p for p in run(journal).parts if isinstance(p, Table) and p.title == "Settings of the sensor")
    names = [row[0] for row in table.rows]
    for engine, problem in journal[sensor_results.ENGINES_KEY].items():
        words = f"{engine} float32, quantile" if problem is None else f"{engine}: not here ({problem})"
        assert words in names
    assert results_of(journal).row(NUMPY[GENERATOR]).pixels is None  # its words are others
    assert len(table.marks) == len(table.rows)
    assert {len(row) for row in table.rows} == {len(table.columns)}


def test_plots_have_a_line_per_sampler_and_rings_on_the_front(journal: dict[str, Any]) -> None:
    side, results = run(journal), results_of(journal)
    errors, _, laws = (part for part in side.parts if isinstance(part, Plot))
    assert sum(len(line.ringed) for line in errors.lines) == len(results.front)
    assert sum(len(line.x) for line in errors.lines) == len(results.rows)
    wanted = {REFERENCE.name, *(setting.name for setting in NUMPY.values())}
    assert wanted <= {line.label for line in laws.lines}
    assert all(min(line.x) > 0 and min(line.y) > 0 for line in (*errors.lines, *laws.lines))


def test_a_plan_that_leaves_out_more_is_predicted_and_measured_to_change_the_same(journal: dict[str, Any]) -> None:
    """0.2 DN leaves out noise of the source follower; theory and frames agree within the limit of one in a thousand."""
    results = results_of(journal)
    plan = results.plans[1]
    row = results.row(Setting("numpy", "float32", QUANTILE, 0.2))
    assert "source follower noise" in plan.left_out
    assert np.abs(plan.predicted).max() > 0.1
    assert (np.abs(row.of_plan.value_dn - plan.predicted) <= row.of_plan.limit * row.of_plan.error_dn + 1e-6).all()


def test_findings_are_sentences_with_numbers(journal: dict[str, Any]) -> None:
    for finding in sensor_page.findings(results_of(journal), ()):
        assert finding[0].isupper() and finding.endswith(".")
    assert any(re.search(r"ns/pixel", finding) for finding in run(journal).findings)


@pytest.mark.parametrize("bad", [-0.1, math.nan])
def test_a_tolerance_below_zero_is_refused(bad: float) -> None:
    with pytest.raises(InputError, match="tolerances_dn"):
        sensor_time.sensor_side(
            LIGHT, CAMERA, EXPOSURE, tolerances_dn=(bad,), done={}, progress=lambda *_: None
        )  # fmt: skip


def test_photons_that_expose_would_refuse_are_refused() -> None:
    with pytest.raises(InputError, match="photons"):
        sensor_time.sensor_side(np.full((2, 2), -1.0), CAMERA, EXPOSURE, done={}, progress=lambda *_: None)
