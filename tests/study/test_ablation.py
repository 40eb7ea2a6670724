"""Ablation: each stage and each feature off in turn, in theory and in frames."""

from __future__ import annotations

import copy
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import EACH_KIND
from helpers.marks import one_in
from helpers.scenes import PERSPECTIVE, SKY, scene_text, write_scene
from helpers.study_pages import faults, through_files

import mitsuba_sensor as ms
from mitsuba_sensor.core.signals import Photons
from mitsuba_sensor.sensor.effects.dark_current import mean_dark_e
from mitsuba_sensor.sensor.gains import gain_dn_per_e
from mitsuba_sensor.study import ablation as package
from mitsuba_sensor.study.ablation.render import compared
from mitsuba_sensor.study.ablation.sensor import PLAN, SENSORS, WHOLE, SensorAblation, SensorResults
from mitsuba_sensor.study.frames import Replicas
from mitsuba_sensor.study.kit import Kit, Subject
from mitsuba_sensor.study.page import Bars, Study, Table

EXPOSURE = ms.Exposure(0.1)
REPLICAS = Replicas(SENSORS, frames=2, seed=1)
RAMP = np.tile(np.geomspace(30.0, 50_000.0, 24), (24, 1))
TABLE1 = ms.load_camera("konnik_table1")


def ablation(
    camera: ms.Camera, light: Any = RAMP, tolerance_dn: float = 0.02, kit: Kit | None = None
) -> SensorAblation:
    """Untimed, of half the light as electrons behind every filter."""
    filters = len(camera.filter_names)
    mean = np.repeat(0.5 * np.asarray(light)[..., None], filters, axis=2)
    found = SensorAblation(kit or Kit(), Subject("none.xml", camera, EXPOSURE), None, tolerance_dn, REPLICAS)
    vars(found)["photons"] = Photons(mean, np.full(filters, 550.0), detected=True)
    found.engines = []
    return found


def results(found: SensorAblation, cases: tuple[str, ...] | None = None) -> SensorResults:
    """Theory and frames of these chains."""
    found.names = found.names if cases is None else [WHOLE, *cases]
    found.kit.take(found.steps(RAMP.size))
    return SensorResults(found)


@lru_cache
def shipped(name: str) -> dict[str, Any]:
    """What is measured of a shipped camera under the ramp."""
    found = ablation(ms.load_camera(name))
    results(found)
    return found.kit.known


def results_of(name: str, known: dict[str, Any] | None = None) -> SensorResults:
    return SensorResults(ablation(ms.load_camera(name), kit=Kit(known or shipped(name))))


@pytest.mark.parametrize("name", one_in(4, (*EACH_KIND, "hamamatsu_orca_quest_2", "moravian_c1_5000")))
def test_theory_and_frames_agree_for_every_stage_of_every_shipped_camera(name: str) -> None:
    """From 15 to 25 000 e-, with the read noise on and off: in one run of a hundred chance would raise one alarm.

    The last two have a converter that ends within a σ of the well, and counts that lie on its transitions.
    """
    found = results_of(name)
    assert len(found.compared) >= 15
    assert found.agree and abs(found.furthest.z) <= found.limit, found.furthest
    assert 3.3 < found.limit < 3.8


def test_a_stage_that_changes_nothing_is_left_out_and_its_frames_are_the_same_bytes() -> None:
    found = results_of("konnik_table1")
    for stage in ("CDS gain", "source follower", "reset noise", "DSNU row"):
        assert stage in found.left_out
    assert found.looked["CDS gain"]["share_of_pixels"] == found.looked["full well"]["largest_dn"] == 0
    assert all(one.measured_dn == one.error_dn == one.z == 0 for one in found.changes["CDS gain"])


@pytest.mark.parametrize(
    ("case", "moment", "wrong"),
    [("source follower noise", 0, 0.05), ("source follower noise", 1, 0.8), ("PRNU", 2, 10.0)],
)
def test_a_theory_that_is_wrong_is_found_out(case: str, moment: int, wrong: float) -> None:
    """A mean that is 0.05 DN off; a temporal variance by 0.8 of 110 DN²; a spatial one by 10 of 17 DN²."""
    known = copy.deepcopy(shipped("konnik_table1"))
    known["moments of every pixel"][0]["cases"][case]["moments"][WHOLE][moment] += wrong
    found = results_of("konnik_table1", known)
    assert abs(found.furthest.z) > found.limit and found.furthest.case == case and not found.agree


def test_without_shot_noise_the_temporal_variance_falls_by_what_poisson_says() -> None:
    """K²·(light + dark), averaged over a picture that saturates nowhere; 4 standard errors, false alarm 6e-5."""
    light = np.tile(np.geomspace(30.0, 20_000.0, 24), (24, 1))
    one = results(ablation(TABLE1, light), cases=("shot noise",)).changes
    (_, temporal, _), (_, whole, _) = one["shot noise"], one[WHOLE]
    poisson_dn2 = gain_dn_per_e(TABLE1) ** 2 * (0.5 * light.mean() + mean_dark_e(TABLE1, EXPOSURE))
    left_dn2 = (whole.measured_dn + temporal.measured_dn) ** 2
    assert whole.measured_dn**2 - left_dn2 == pytest.approx(
        poisson_dn2, abs=4 * 2 * whole.measured_dn * (whole.error_dn + temporal.error_dn)
    )
    assert temporal.predicted_dn < -4


def test_a_stage_that_moves_the_mean_is_seen_to_move_it() -> None:
    """Dark electrons are K·t·D_R of the mean where nothing saturates: 21.6 DN; 4 standard errors."""
    found = results(ablation(TABLE1, 0.1 * RAMP), cases=("dark current",))
    mean = found.changes["dark current"][0]
    expected_dn = -gain_dn_per_e(TABLE1) * mean_dark_e(TABLE1, EXPOSURE)
    assert mean.measured_dn == pytest.approx(expected_dn, abs=4 * mean.error_dn)
    assert mean.error_dn < 0.05 and mean.predicted_dn == pytest.approx(expected_dn, rel=1e-4)
    assert found.theory["cases"]["dark current"]["of"] == "mean"


@pytest.mark.exhaustive
def test_pixels_with_a_random_telegraph_signal_are_measured_as_theory_means_them() -> None:
    """States of neighbouring frames are alike; every frame is the first of a seed of its own, so here they are not."""
    camera = TABLE1.replace(**{
        "dark_current.rts_fraction": 0.3, "dark_current.rts_amplitude_e_per_s": 5e3,
        "dark_current.rts_switching": 0.01, "dark_current.rts_duty": 0.5,
    })  # fmt: skip
    found = results(ablation(camera), cases=("RTS pixels",))
    assert found.changes["RTS pixels"][1].predicted_dn < -0.5
    assert abs(found.furthest.z) <= found.limit


@pytest.mark.exhaustive
def test_the_plan_holds_at_every_pixel() -> None:
    for tolerance_dn in (0.2, 5.0):
        found = results(ablation(TABLE1, tolerance_dn=tolerance_dn), cases=(PLAN,))
        assert found.theory["cases"][PLAN]["worst_dn"] <= 1.05 * tolerance_dn
        worst = found.worst[PLAN]
        assert abs(worst.measured_dn) <= 1.05 * tolerance_dn + 4 * worst.error_dn


def test_the_rms_of_a_change_is_freed_of_the_noise_and_the_worst_pixels_are_not_picked_for_it() -> None:
    """Noise alone, then a change of 5 DN in 20 of 400 pixels; 4 standard errors."""
    chance = np.random.default_rng(3)
    base = 100 + chance.normal(0, 1, (16, 20, 20))
    noisy = base + chance.normal(0, 10, base.shape)
    found = compared(base, noisy, None, 1e9)
    assert found["rms_dn"] < 1.5 and abs(found["worst_dn"]) < 4 * found["worst_error"]
    noisy[:, :2, :10] += 5
    found = compared(base, noisy, None, 1e9)
    assert found["rms_dn"] == pytest.approx(5 * np.sqrt(0.05), abs=4 * found["rms_error"])
    assert found["mean_dn"] == pytest.approx(0.25, abs=4 * found["mean_error"])


def test_what_is_above_the_full_well_does_not_count() -> None:
    base, changed = np.full((4, 2, 2), 50.0), np.full((4, 2, 2), 60.0)
    found = compared(base, changed, None, 40.0)
    assert found["mean_dn"] == found["rms_dn"] == found["mean_error"] == 0
    assert compared(base, changed, None, 55.0)["mean_dn"] == 5


INDOORS = scene_text(
    '<integrator type="path"><integer name="max_depth" value="6"/></integrator>', SKY,
    '<shape type="sphere"><point name="center" value="0, 0, 4"/><bsdf type="diffuse">'
    '<spectrum name="reflectance" value="400:0.2, 700:0.8"/></bsdf></shape>'
    '<shape type="rectangle"><transform name="to_world"><scale value="20"/><rotate x="1" angle="-90"/>'
    '<translate y="-1"/></transform></shape>',
    sensor=PERSPECTIVE.replace('"perspective"', '"thinlens"'),
    more='<float name="aperture_radius" value="0.2"/><float name="focus_distance" value="2"/>'
    '<transform name="to_world"><lookat origin="0, 0, 0" target="0, 0, 4" up="0, 1, 0"/></transform>',
)  # fmt: skip


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], Study]:
    """A whole study of 12 × 8 pixels, what was measured and the study."""
    scene, known = write_scene(tmp_path_factory.mktemp("indoors"), INDOORS), dict[str, Any]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(package.sensor, "SHAPE", {"numpy": (64, 64), "drjit": (64, 64)})
        return scene, known, study_of(scene, known)


def study_of(scene: Path, known: dict[str, Any], progress: Any = None, **given: Any) -> Study:
    camera = TABLE1.replace(**{"quantum_efficiency.curves": {"mono": [0.3, 0.6]}})
    subject = Subject(scene, camera, ms.Exposure(0.02), {"spp": 64, "variant": "scalar_spectral"})
    return package.ablation(Kit(known, progress), subject, **{"frames": 2, **given})


@pytest.mark.exhaustive
def test_a_study_says_what_the_plan_saves_and_what_it_costs(studied: Any) -> None:
    study = studied[2]
    assert study.passed and study.name == "ablation"
    assert study.findings[0].startswith("The plan at 0.02 DN leaves out ") and "% " in study.findings[0]
    kinds = [type(part) for part in study.parts]
    assert kinds.count(Table) == 3 and kinds.count(Bars) == 4
    json.dumps(study.to_dict(), allow_nan=False)
    assert [row[0] for row in study.parts[0].rows][:3] == [WHOLE, "PRNU", "dark current"]
    assert "Detecting the light takes" in study.parts[1].note
    assert {len(row) for row in study.parts[1].rows} == {len(study.parts[1].columns)}


def test_series_colours_and_units_of_the_page_are_as_they_must_be(studied: Any) -> None:
    assert not faults(studied[2])


def test_a_resumed_study_measures_nothing_twice_and_is_the_same_study(
    studied: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scene, known, study = studied
    kept = through_files(known, (), tmp_path)
    monkeypatch.setattr("mitsuba_sensor.study.kit.prepare", None)
    assert json.dumps(study_of(scene, kept).to_dict()) == json.dumps(study.to_dict())
    monkeypatch.undo()
    key, told = f"frames of {SENSORS} sensors: PRNU", list[str]()
    del kept[key]
    again = study_of(scene, kept, lambda elapsed, expected, now: told.append(now))
    assert [now for now in told if now != "done"] == [key]
    np.testing.assert_equal(kept[key][0], known[key][0])
    assert again.to_dict() == study.to_dict()


def test_the_time_is_estimated_before_anything_is_measured(studied: Any) -> None:
    class Enough(Exception):
        pass

    told: list[tuple[float, float]] = []

    def progress(elapsed_s: float, expected_s: float, now: str) -> None:
        told.append((elapsed_s, expected_s))
        if now == "moments of every pixel":
            raise Enough

    with pytest.raises(Enough):
        study_of(studied[0], {}, progress)
    assert told[0][0] == 0 and told[2][1] > 10


def test_features_of_the_render_change_the_picture_as_theory_says(studied: Any) -> None:
    """Fewer bands change nothing, since the filters are integrated beside them; the corners are darker by
    cos⁴; without the light that comes by way of the floor the ball is darker; equal seeds cancel the noise of both."""
    features = {k.removeprefix("render: "): v for k, (v, _) in studied[1].items() if k.startswith("render: ")}
    found = features["lens fall-off"]
    assert found["mean_dn"] == pytest.approx(found["predicted"]["mean_dn"], abs=4 * found["mean_error"] + 1e-9)
    for name in ("15 bands", "5 bands", "one band"):
        assert abs(features[name]["mean_dn"]) < 1e-3 * features[name]["signal_dn"]
    assert features["lens fall-off"]["mean_dn"] > 0 > features["indirect light"]["mean_dn"]
    assert features["depth of field"]["rms_dn"] > 3 * features["depth of field"]["rms_error"]
    assert abs(features["channels instead of bands"]["mean_dn"]) < 0.01 * features["15 bands"]["signal_dn"]
    assert features["AOVs"]["rms_dn"] == 0


def test_a_render_that_theory_does_not_explain_fails_and_the_sentence_says_so(studied: Any) -> None:
    scene, known, study = studied
    assert any(", renders agree: largest |z| " in finding for finding in study.findings)
    wrong = copy.deepcopy(known)
    wrong["render: lens fall-off"][0]["predicted"]["z_mean"] = 60.0
    again = study_of(scene, wrong)
    assert not again.passed
    assert any(", renders do not agree (limit " in finding for finding in again.findings)


def test_what_a_scene_has_not_is_said_in_one_line(studied: Any) -> None:
    missing = studied[1]["loading the scene"][0]["missing"]
    assert set(missing) == {"lens distortion", "lens transmission curve", "lens prescription", "motion and subframes"}
    (table,) = (part for part in studied[2].parts if part.title.startswith("What changes when the render"))
    said = {row[0]: row[-1] for row in table.rows}
    assert said["AOVs"].startswith("left out: ") and said["depth of field"].startswith("kept: ")
    assert said["error bars"].startswith("kept: ")
    assert "Not in this scene: lens distortion" in table.note


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"frames": 1}, "frames is 1"),
        ({"tolerance_dn": -1.0}, "tolerance_dn is"),
        ({"spp": 0}, "spp is"),
        ({"spp": 3}, "spp is 3"),
        ({"seed": -1}, "seed is"),
        ({"serial": 0.5}, "serial is"),
    ],
)
def test_what_cannot_be_studied_is_refused_before_anything_is_loaded(given: dict[str, Any], what: str) -> None:
    options = {"spp": given.pop("spp")} if "spp" in given else {}
    with pytest.raises(ms.InputError, match=what):
        package.ablation(Kit(), Subject("no_such_scene.xml", TABLE1, EXPOSURE, options), **given)
