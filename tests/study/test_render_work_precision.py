"""Error of a render against its time: the blocks, the slopes, the frames, what is measured, and what is recommended.

The whole study is run once on a floor under an even sky in ``scalar_spectral``: six bands and a mosaic of three
colours, 24 × 16 pixels, 32 passes a run whatever the clock says. So its errors are the same in every run of the tests,
and the bounds below, which chance would break less than once in 100 with other seeds, either hold or do not.
"""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scene_text, write_scene
from helpers.study_pages import faults, through_files
from numpy.typing import NDArray
from rich.console import Console

import mitsuba_sensor as ms
from mitsuba_sensor.cli.study_sheet import study_sheet
from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.lab.statistics.estimators import slope_of_runs
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.passes.passes import MOST_IN_ALL, pass_plan
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.passes.renderer import Renderer
from mitsuba_sensor.render.passes.stop_criterion import StopCriterion
from mitsuba_sensor.render.variants import Variant
from mitsuba_sensor.study.kit import Kit, Subject
from mitsuba_sensor.study.page import Plot, Section, Study
from mitsuba_sensor.study.work_precision import RECORDS, work_precision
from mitsuba_sensor.study.work_precision import errors as errors_module
from mitsuba_sensor.study.work_precision import render as render_module
from mitsuba_sensor.study.work_precision import settings as settings_module
from mitsuba_sensor.study.work_precision.errors import FEWEST_COMPENSATED, Ladder
from mitsuba_sensor.study.work_precision.render import SAMPLE_COUNTS, Render, Result, choices, corrected, predict
from mitsuba_sensor.study.work_precision.settings import (
    Block,
    Choice,
    RenderSetting,
    Series,
    all_settings,
    in_blocks,
    usable_variants,
)

FLOOR = (
    '<shape type="rectangle"><transform name="to_world"><scale value="9"/></transform><bsdf type="diffuse">'
    '<spectrum name="reflectance" value="360:0.5, 830:0.5"/></bsdf></shape>'
    '<emitter type="constant"><spectrum name="radiance" value="360:2.5e-3, 830:2.5e-3"/></emitter>'
    '<integrator type="path"><integer name="max_depth" value="2"/></integrator>'
)
TELECENTRIC = """<sensor type="orthographic">{more}
<transform name="to_world"><lookat origin="0, 0, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/>{film}</film></sensor>"""
CAMERA = ms.load_camera("bayer_2mp")
EXPOSURE = ms.Exposure(0.05)
PASSES, SEEDS = 32, 3


def mosaic() -> ms.Camera:
    """Six bands of 10 nm behind three filters."""
    return CAMERA.replace(
        **{
            "quantum_efficiency.wavelengths_nm": [520, 580],
            "quantum_efficiency.curves": {"R": [0.1, 0.4], "G": [0.6, 0.5], "B": [0.2, 0.1]},
            "quantum_efficiency.reference_nm": 550,
        }
    )


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("floor"), scene_text(FLOOR, sensor=TELECENTRIC))


@pytest.fixture(scope="module")
def quick() -> Any:
    """Numbers of passes that no clock decides."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("FEWEST_PASSES", "FEWEST_FRAMED", "MOST_PASSES"):
            patch.setattr(render_module, name, PASSES)
        patch.setattr(errors_module, "REFERENCE_S", 0.0)
        patch.setattr(settings_module, "SIZES", (4, 36))
        patch.setattr(settings_module, "OTHERS", {"independent": 16})
        yield


Known = dict[str, Any]
Studied = tuple[Study, Known]


def study_of(scene: Path, known: Known, progress: Any = None, **given: Any) -> Study:
    given = {"seeds": SEEDS, "variants": ["scalar_spectral"], "sides": ["render"], **given}
    return work_precision(Kit(known, progress), Subject(scene, mosaic(), EXPOSURE), **given)


@pytest.fixture(scope="module")
def studied(floor: Path, quick: None) -> Studied:
    known: Known = {}
    return study_of(floor, known), known


def test_blocks_are_the_means_and_variances_of_their_passes() -> None:
    """Of 8 passes 8, 4, 2 and 1 blocks; NumPy says what is in them."""
    rng = np.random.default_rng(1)
    passes = rng.normal(5, 1, size=(8, 3, 2))
    blocks = list(in_blocks(Block(1, 0.1 * (k + 1), one[..., None] * 2, one) for k, one in enumerate(passes)))
    assert sorted(block.passes for block in blocks) == [1] * 8 + [2] * 4 + [4] * 2 + [8]
    last = blocks[-1]
    assert last.seconds == pytest.approx(3.6)
    np.testing.assert_allclose(last.electrons, passes.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(last.irradiance[..., 0], 2 * passes.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(last.squares, 7 * passes.var(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(next(b for b in blocks if b.passes == 4).electrons, passes[:4].mean(axis=0), rtol=1e-12)


def slope_of_blocks(runs: list[NDArray[np.float64]]) -> Any:
    """Of the rms error of blocks of passes (P, N) whose reference is 0, against passes."""
    found = []
    for passes in runs:
        squares = dict[int, list[float]]()
        for block in in_blocks(Block(1, 1.0, electrons, electrons) for electrons in passes):
            squares.setdefault(block.passes, []).append(float(np.mean(block.electrons**2)))
        found.append((list(squares), [math.sqrt(np.mean(many)) for many in squares.values()]))
    return slope_of_runs(found)


def test_passes_with_rare_bright_paths_have_the_slope_of_the_theory() -> None:
    """One value in 2000 is 300 times as large as the others: a fifth of the blocks of 4 × 500 would show none.

    Over 20 seeds the slope is −0.5 with a spread of 0.008: a bound of 0.03 is far above chance.
    """
    rng = np.random.default_rng(3)
    runs = [rng.normal(size=(64, 2000)) * np.where(rng.random((64, 2000)) < 5e-4, 300, 1) for _ in range(4)]
    assert slope_of_blocks(runs).value == pytest.approx(-0.5, abs=0.03)


def test_passes_that_repeat_each_other_do_not_get_better() -> None:
    """The slope is 0: what all passes share stays, be it one seed for all of them or a bias."""
    rng = np.random.default_rng(4)
    runs = [np.repeat(rng.normal(size=(1, 500)), 16, axis=0) for _ in range(2)]
    assert slope_of_blocks(runs).value == pytest.approx(0, abs=1e-12)


@pytest.fixture(scope="module")
def results(floor: Path, quick: None, studied: Studied) -> dict[str, Result]:
    """Every setting by its label, from what was measured."""
    render = Render(Kit(studied[1]), Subject(floor, mosaic(), EXPOSURE), 0.01, SEEDS, ["scalar_spectral"])
    render.measure()
    return {one.label: one for one in render.results}


def part_of(study: Study, title: str) -> Any:
    return next(part for part in study.parts if part.title == title)


def test_series_colours_and_units_of_the_page_are_as_they_must_be(studied: Studied) -> None:
    assert not faults(studied[0])


@pytest.mark.parametrize("width", [80, 100, 140])
def test_the_study_takes_at_most_40_lines_of_the_terminal(studied: Studied, width: int) -> None:
    console = Console(record=True, width=width, file=io.StringIO())
    console.print(study_sheet(studied[0], "study/work-precision/study.html", width))
    said = console.export_text()
    assert 20 < len(said.splitlines()) <= 40 and "more tables stand in the page" in said
    assert all(finding.split()[0] in said for finding in studied[0].findings)


def test_every_setting_is_compared_one_factor_at_a_time(studied: Studied, results: dict[str, Result]) -> None:
    labels = ["as shipped", "independent", "4 per pass", "36 per pass", "cube", "channels", "band by band"]
    assert [row[0] for row in part_of(studied[0], "Settings").rows] == list(results) == labels


def test_errors_fall_as_the_square_root_of_time(studied: Studied, results: dict[str, Result]) -> None:
    """Slopes of irradiance and electrons within 0.05 of −1/2 in every setting."""
    for label, one in results.items():
        for slope in one.slopes.values():
            assert slope.value == pytest.approx(-0.5, abs=0.05), label
        assert one.verdict == "holds"
    assert "irradiance" not in results["channels"].slopes
    assert all(row[-1] == "holds" for row in part_of(studied[0], "Settings").rows)


def test_compensated_frames_have_the_right_noise_where_plain_ones_have_too_much(results: dict[str, Result]) -> None:
    """With 8 passes, whose noise is a sixth of the shot noise: σ within three standard errors, and beyond them."""
    one = results["as shipped"]
    plain, compensated = one.sigma("plain")[0], one.sigma("compensated")[0]
    assert plain.passes == 8
    assert plain.error > 3 * plain.spread
    assert abs(compensated.error) < 3 * compensated.spread < 0.1


def test_runs_have_seeds_of_their_own(studied: Studied) -> None:
    runs = [studied[1][f"run {k}: scalar_spectral multijitter 16 auto"][0] for k in (1, 2, 3)]
    assert len({run["plain"][0]["electrons"] for run in runs}) == SEEDS


def test_a_denoised_render_does_not_follow_the_law(results: dict[str, Result]) -> None:
    """Its bias stays: from 1 to 32 passes the error falls by less than half of √32."""
    points = results["as shipped"].points("electrons", "denoised")
    assert points[0].error / points[-1].error < 0.5 * math.sqrt(32)


def test_recommended_options_keep_the_tolerance_when_rendered(studied: Studied) -> None:
    study, known = studied
    checks = {key: value for key, (value, _) in known.items() if key.startswith("check: ")}
    options, found = list(checks.items())[-1]
    assert found["error"] <= 0.01
    assert options.removeprefix("check: ") in study.findings[0] and options.startswith("check: --spp ")
    fewest = part_of(study, "What reaches 0.01")
    assert fewest.rows[0][0] == options.removeprefix("check: ") and fewest.marks[0] == "best"


def test_rings_are_on_points_that_no_other_beats(studied: Studied) -> None:
    plot = next(part for part in studied[0].parts if isinstance(part, Plot))
    every = [(x, y) for line in plot.lines for x, y in zip(line.x, line.y, strict=True)]
    ringed = {(line.x[k], line.y[k]) for line in plot.lines for k in line.ringed}
    assert ringed == {p for p in every if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in every)}


def test_a_study_that_goes_on_measures_nothing_twice(
    floor: Path, quick: None, studied: Studied, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """From measurements as files have them: the same study, and no pass is rendered."""
    study, known = studied

    def refuse(*_: Any) -> None:
        raise AssertionError("rendered again")

    monkeypatch.setattr(Renderer, "run", refuse)
    again = study_of(floor, through_files(known, RECORDS, tmp_path))
    assert json.dumps(again.to_dict()) == json.dumps(study.to_dict())


def test_a_study_that_was_stopped_measures_only_what_is_missing(floor: Path, quick: None, studied: Studied) -> None:
    study, known = studied
    less, told = dict(known), list[str]()
    missing = "run 2: scalar_spectral multijitter 4 auto"
    del less[missing]
    again = study_of(floor, less, lambda done_s, all_s, now: told.append(now))
    assert [now for now in told if now != "done"] == [missing]
    for name, value in less[missing][0]["plain"][0].items():
        if name != "seconds":
            assert value == pytest.approx(known[missing][0]["plain"][0][name], rel=1e-6), name
    assert set(less) == set(known) and again.passed == study.passed


def test_a_study_is_plain_json(studied: Studied) -> None:
    json.dumps(studied[0].to_dict(), allow_nan=False)


def test_both_sides_make_one_study_and_the_frames_get_the_light_of_the_reference(
    floor: Path, quick: None, studied: Studied, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What either side says stands in the order of the sides."""
    seen = list[Any]()

    class Frames:
        def __init__(self, kit: Kit, subject: Subject, photons: Any) -> None:
            seen.append(photons)

        def measure(self) -> None:
            """Nothing."""

    package = "mitsuba_sensor.study.work_precision."
    monkeypatch.setattr(package + "Sensor", Frames)
    monkeypatch.setattr(package + "Results", lambda sensor: sensor)
    monkeypatch.setattr(package + "sensor_section", lambda results: Section(("Frames are quick.",), False, ()))
    study = study_of(floor, dict(studied[1]), sides=["render", "sensor"])
    assert study.findings == (*studied[0].findings, "Frames are quick.") and not study.passed
    light = seen[0].mean.mean(axis=(0, 1)) / EXPOSURE.time_s
    assert light.shape == (6,) and (light > 0).all()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"variants": ["scalar_spectrum"]}, "variant is 'scalar_spectrum'; it must be one of .*scalar_spectral"),
        ({"variants": "scalar_spectral"}, "pass a list of names"),
        ({"seeds": 1}, "seeds is 1; it must be from 2 to 64"),
        ({"tolerance": 0.0}, "tolerance is 0.0; it must be from 1e-06 to 1"),
        ({"sides": ["lens"]}, "it must be one or both of render, sensor"),
    ],
)
def test_what_cannot_be_studied_is_one_sentence(floor: Path, arguments: dict[str, Any], told: str) -> None:
    given = {"variants": ["scalar_spectral"], "sides": ["render"], **arguments}
    with pytest.raises(InputError, match=told) as caught:
        work_precision(Kit(), Subject(floor, mosaic(), EXPOSURE), **given)  # type: ignore[arg-type]
    assert str(caught.value).count(".\n") == 0


def test_one_band_has_no_channels_and_no_loop() -> None:
    base, llvm = RenderSetting("scalar_spectral"), Variant("llvm_ad_spectral", "llvm", "")
    scalar = Variant("scalar_spectral", "scalar", "")
    one = all_settings(base, (scalar, llvm), choose_bands(mosaic(), 550.0, 10.0, "auto"), channels=False)
    assert {setting.banding for setting in one} == {"auto"}
    assert [setting.variant for setting in one].count("llvm_ad_spectral") == 1
    assert [variant.name for variant in usable_variants(["scalar_spectral"])] == ["scalar_spectral"]


def test_the_sampler_that_was_drawn_from_stands_in_the_statistics(floor: Path) -> None:
    job = prepare(floor, mosaic(), EXPOSURE, variant="scalar_spectral", sampler="independent")
    light = job.render(1, StopCriterion(2, 1))
    assert light.statistics.sampler == "independent"
    assert "Independent" in str(job.scene.sensor.sampler())


def test_band_by_band_finds_the_light_of_all_bands_together(floor: Path) -> None:
    """Two ways to the same mean: over the picture within 1 %, five standard errors of 16 samples in 384 pixels."""
    subject, means = Subject(floor, mosaic(), EXPOSURE), list[NDArray[np.float64]]()
    for banding in ("auto", "loop"):
        series = Series(subject, RenderSetting("scalar_spectral", banding=banding))
        means.append(np.mean([block.irradiance for block in series.passes(5, 2)], axis=(0, 1, 2)))
    np.testing.assert_allclose(means[0], means[1], rtol=0.01)


def predicted(spp: int) -> Any:
    """Passes of 4, 16 and 64 samples: a pass costs as many times more, and error² falls as n^−3/2."""
    results = [_result(samples) for samples in (4, 16, 64)]
    return predict(results[1], results, spp)


def _result(samples: int, floor: float = 0.0) -> Result:
    """A pass of n samples takes n ms and has error² = n^−3/2; floor : the variance of the reference."""
    rungs = [
        {"passes": k, "blocks": 1, "seconds": 1e-3 * samples * k, "electrons": samples**-1.5 / k + floor}
        for k in (1, 2, 4, 8)
    ]
    ladder = Ladder(samples, 1, 0.0, 1e-3 * samples, 8, None)
    own = dict.fromkeys(("irradiance", "electrons", "dn"), floor)
    setting = RenderSetting("scalar_spectral", samples=samples)
    return Result(setting, "", ladder, [{"plain": rungs}, {"plain": rungs}], own)


def test_the_references_own_error_is_taken_off() -> None:
    """16^−3/2 / k and a floor of 1/500: the slope is exact, and the rung whose error is below the floor is left out."""
    result = _result(16, floor=1 / 500)
    assert [point.passes for point in result.points("electrons")] == [1, 2, 4]
    assert result.points("electrons")[1].error == pytest.approx(math.sqrt(1 / 128), rel=1e-9)
    assert result.slopes["electrons"].value == pytest.approx(-0.5, abs=1e-9)


@pytest.mark.parametrize("spp", [16, 256, 512, 1024, 4096, 65536])
def test_predictions_follow_the_passes_that_a_number_of_samples_is_made_of(spp: int) -> None:
    """n ms for a pass of n samples, so spp ms; error² = n^−3/2 / passes, also between and beyond the sizes."""
    passes, samples = pass_plan(spp)
    seconds, error = predicted(spp)
    assert seconds == pytest.approx(1e-3 * passes * samples, rel=1e-9)
    assert error == pytest.approx(math.sqrt(samples**-1.5 / passes), rel=1e-9)


def test_a_missed_tolerance_asks_for_the_samples_that_its_error_says() -> None:
    """Twice the error: four times the samples and a margin, rounded up to what is tried."""
    choice = Choice("auto", 512, False, "scalar_spectral", True, 1.0, 0.01)
    more = corrected(choice, 0.02, 0.01)
    assert more.spp == next(count for count in SAMPLE_COUNTS if count >= 4 * 1.1 * 512)
    assert more.options == f"--spp {more.spp} --spectral auto --no-denoise"


def test_no_number_of_samples_is_tried_that_a_render_refuses() -> None:
    """Up to the most that a render takes, which is one of them; a tolerance that needs more is not reached."""
    assert sorted(SAMPLE_COUNTS) == SAMPLE_COUNTS and SAMPLE_COUNTS[:4] == [16, 24, 32, 48]
    assert SAMPLE_COUNTS[-1] == MOST_IN_ALL
    results = [_result(samples) for samples in (4, 16, 64)]
    assert choices(results, 1e-6, "scalar_spectral") == []
    assert corrected(Choice("auto", 512, False, "scalar_spectral", True, 1.0, 0.01), 1.0, 1e-6).spp == MOST_IN_ALL


def test_frames_are_dimmed_until_the_noise_of_their_renders_can_be_compensated(results: dict[str, Result]) -> None:
    """So that 8 passes, an eighth of a run or more, are just enough."""
    framed = results["as shipped"].ladder.framed
    assert framed is not None and framed.share < 1
    assert framed.exposure.time_s == pytest.approx(framed.share * EXPOSURE.time_s)
    assert framed.compensable == pytest.approx(FEWEST_COMPENSATED)
