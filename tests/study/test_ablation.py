"""study left-out: each stage and each feature off in turn, in theory and in frames."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import PERSPECTIVE, SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.signals import Photons
from mitsuba_sensor.optics.f_number_law import transmittance
from mitsuba_sensor.render.requirements import grouped_electrons
from mitsuba_sensor.sensor.chain import gain_dn_per_e, mean_dark_e
from mitsuba_sensor.study.ablation import seconds as ablation_seconds
from mitsuba_sensor.study.ablation.render import compared
from mitsuba_sensor.study.ablation.stages import EQUAL_WORDS, PLAN, THEORY, WHOLE, Ablation, Replicas
from mitsuba_sensor.study.ablation.stages_results import Results, as_normal, gather, is_whole, z_limit
from mitsuba_sensor.study.left_out import left_out
from mitsuba_sensor.study.page import Bars, Table

EXPOSURE = ms.Exposure(0.1)
REPLICAS = Replicas(frames=2, seed=1, serial=1)
RAMP = np.tile(np.geomspace(30.0, 50_000.0, 24), (24, 1))
TABLE1 = ms.load_camera("konnik_table1")


def ablation(camera: ms.Camera, light: Any = RAMP, tolerance_dn: float = 0.02) -> Ablation:
    filters = len(camera.filter_names)
    mean = np.repeat(0.5 * np.asarray(light)[..., None], filters, axis=2)
    photons = Photons(mean, np.full(filters, 550.0), detected=True)
    return Ablation(camera, EXPOSURE, lambda: photons, tolerance_dn, REPLICAS)


def journal_of(found: Ablation, cases: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Theory and frames of these chains, by way of a file; without seconds."""
    done: dict[str, Any] = {THEORY: found.theory(), EQUAL_WORDS: found.equal_words()}
    for case in found.cases:
        if cases is not None and case not in (WHOLE, *cases):
            del done[THEORY]["cases"][case]
        else:
            done[REPLICAS.key(case)] = None if case != WHOLE and is_whole(done, case) else found.measured(case)
    return json.loads(json.dumps(done))  # type: ignore[no-any-return]


def results(found: Ablation, cases: tuple[str, ...] | None = None) -> Results:
    return gather(journal_of(found, cases), REPLICAS, ())


@lru_cache
def shipped(name: str) -> str:
    """The journal of a shipped camera under the ramp, as text: measured once."""
    return json.dumps(journal_of(ablation(ms.load_camera(name))))


@pytest.mark.parametrize("name", ms.list_cameras())
def test_theory_and_frames_agree_for_every_stage_of_every_shipped_camera(name: str) -> None:
    """From 15 to 25 000 e-, with the read noise on and off: in one run of a hundred chance would raise one alarm."""
    found = gather(json.loads(shipped(name)), REPLICAS, ())
    assert len(found.compared) >= 15
    assert abs(found.furthest.z) <= found.limit, found.furthest
    assert 3.3 < found.limit < 3.8


def test_a_stage_that_changes_nothing_is_left_out_and_its_frames_are_the_same_bytes() -> None:
    found = gather(json.loads(shipped("konnik_table1")), REPLICAS, ())
    for stage in ("cds gain", "source follower", "reset noise", "dsnu row"):
        assert stage in found.left_out
    assert found.looked["cds gain"]["share_of_pixels"] == found.looked["full well"]["largest_dn"] == 0
    assert all(one.measured_dn == one.error_dn == one.z == 0 for one in found.changes["cds gain"])


@pytest.mark.parametrize("case, name, wrong", [
    ("source follower noise", "mean_dn", 0.05),
    ("source follower noise", "temporal_dn2", 0.8),
    ("prnu", "spatial_dn2", 10.0),
])  # fmt: skip
def test_a_theory_that_is_wrong_is_found_out(case: str, name: str, wrong: float) -> None:
    """A mean that is 0.05 DN off; a temporal variance by 0.8 of 110 DN²; a fixed one by 10 of 17 DN²."""
    done = json.loads(shipped("konnik_table1"))
    done[THEORY]["cases"][case]["moments"][WHOLE][name] += wrong
    found = gather(done, REPLICAS, ())
    assert abs(found.furthest.z) > found.limit and found.furthest.case == case


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


def test_pixels_that_blink_are_measured_as_theory_means_them() -> None:
    """States of neighbouring frames are alike; every frame is the first of a seed of its own, so here they are not."""
    camera = TABLE1.replace(**{
        "dark_current.rts_fraction": 0.3, "dark_current.rts_amplitude_e_per_s": 5e3,
        "dark_current.rts_switching": 0.01, "dark_current.rts_duty": 0.5,
    })  # fmt: skip
    found = results(ablation(camera), cases=("blinking pixels",))
    assert found.changes["blinking pixels"][1].predicted_dn < -0.5
    assert abs(found.furthest.z) <= found.limit


def test_the_plan_keeps_its_word_at_every_pixel() -> None:
    for tolerance_dn in (0.2, 5.0):
        found = results(ablation(TABLE1, tolerance_dn=tolerance_dn), cases=(PLAN,))
        assert found.theory["cases"][PLAN]["worst_dn"] <= 1.05 * tolerance_dn
        worst = found.worst[PLAN]
        assert abs(worst.measured_dn) <= 1.05 * tolerance_dn + 4 * worst.error_dn


def test_students_t_counts_as_the_normal_that_is_as_unlikely() -> None:
    """Tables: |t| > 3.460 has a chance of 0.1 % at 63 − 2 = 61 degrees of freedom; that of a normal law is 3.2905."""
    assert as_normal(-3.457, 63) == pytest.approx(-3.29, abs=0.02) and as_normal(0.0, 63) == 0
    assert z_limit(1) == pytest.approx(2.5758, abs=1e-4) and z_limit(45) == pytest.approx(3.69, abs=0.02)


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


ROOM = scene_text(
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
def journal(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], Any]:
    """A whole study of 12 × 8 pixels, its journal and the study."""
    scene, done = write_scene(tmp_path_factory.mktemp("room"), ROOM), dict[str, Any]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ablation_seconds, "SHAPE", {"numpy": (64, 64), "drjit": (64, 64)})
        patch.setattr("mitsuba_sensor.study.left_out.SHAPE", ablation_seconds.SHAPE)
        return scene, done, study_of(scene, done)


def study_of(scene: Path, done: dict[str, Any], **words: Any) -> Any:
    camera = TABLE1.replace(**{"quantum_efficiency.curves": {"mono": [0.3, 0.6]}})
    words = {"frames": 2, "spp": 64, "variant": "scalar_spectral", **words}
    return left_out(scene, camera, ms.Exposure(0.02), done=done, **words)


def test_a_study_says_what_the_plan_saves_and_what_it_costs(journal: Any) -> None:
    study = journal[2]
    assert study.passed and study.name == "left-out"
    assert study.findings[0].startswith("The plan at 0.02 DN leaves out ") and "% " in study.findings[0]
    kinds = [type(part) for part in study.parts]
    assert kinds.count(Table) == 3 and kinds.count(Bars) == 4
    json.dumps(study.to_dict(), allow_nan=False)
    assert [row[0] for row in study.parts[0].rows][:3] == [WHOLE, "prnu", "dark current"]
    assert study.data["sensor"]["detection_ns_per_pixel"]["median"] > 0


def test_a_resumed_study_measures_nothing_twice_and_is_the_same_study(
    journal: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, done, study = journal
    kept = json.loads(json.dumps(done))
    monkeypatch.setattr("mitsuba_sensor.study.ablation.features.prepare", None)
    assert json.dumps(study_of(scene, kept).to_dict()) == json.dumps(study.to_dict())
    monkeypatch.undo()
    key = REPLICAS.key("prnu")
    del kept[key]
    told: list[str] = []
    again = study_of(scene, kept, progress=lambda spent, expected, words: told.append(words))
    assert told == ["loading the scene", "frames of 64 devices: without prnu", "done"]
    assert kept[key] == done[key] and again.to_dict() == study.to_dict()


def test_the_time_is_estimated_before_anything_is_measured(journal: Any) -> None:
    class Enough(Exception):
        pass

    told: list[tuple[float, float]] = []

    def progress(spent_s: float, expected_s: float, words: str) -> None:
        told.append((spent_s, expected_s))
        if words == "moments of every pixel":
            raise Enough

    with pytest.raises(Enough):
        study_of(journal[0], {}, progress=progress)
    assert told[0][0] == 0 and told[1][1] > 10


def test_features_of_the_render_change_the_picture_as_theory_says(journal: Any) -> None:
    """A slope of reflectance and of QE: fewer bands move the mean, by the regrouped cube; the corners are darker by
    cos⁴; without the light that comes by way of the floor the ball is darker; equal seeds cancel the noise of both."""
    features = journal[2].data["render"]["features"]
    for name in ("15 bands", "5 bands", "one band", "lens fall-off"):
        found = features[name]
        assert found["mean_dn"] == pytest.approx(found["predicted"]["mean_dn"], abs=4 * found["mean_error"] + 1e-9)
    assert abs(features["one band"]["mean_dn"]) > 20 * features["one band"]["mean_error"]
    assert features["lens fall-off"]["mean_dn"] > 0 > features["indirect light"]["mean_dn"]
    assert features["depth of field"]["rms_dn"] > 3 * features["depth of field"]["rms_error"]
    assert abs(features["channels instead of bands"]["mean_dn"]) < 0.01 * features["15 bands"]["signal_dn"]
    assert features["ground truth"]["rms_dn"] == 0


def test_a_coarser_band_has_the_transmission_of_its_own_middle(light: Any) -> None:
    """A flat sky through a coloured lens, in bands of 10 nm that are joined by twos, and in bands of 20 nm."""
    camera = TABLE1.replace(**{
        "lens.transmission_curve": (0.5, 1.0, 0.7), "lens.transmission_wavelengths_nm": (380.0, 550.0, 720.0)
    })  # fmt: skip

    def sky(width_nm: float) -> Any:
        centres = np.arange(400 + width_nm / 2, 700, width_nm)
        data = np.broadcast_to(1e-5 * transmittance(camera, centres), (2, 2, len(centres)))
        return replace(light, data=data, wavelengths_nm=centres, bandwidths_nm=np.full(len(centres), width_nm))

    joined, coarse = (grouped_electrons(sky(width), camera, EXPOSURE, size) for width, size in ((10, 2), (20, 1)))
    np.testing.assert_allclose(joined, coarse, rtol=1e-12)


def test_what_a_scene_has_not_is_said_in_one_line(journal: Any) -> None:
    missing = journal[2].data["render"]["not_in_this_scene"]
    assert set(missing) == {"lens distortion", "lens transmission curve", "lens prescription", "motion and subframes"}
    (table,) = (part for part in journal[2].parts if part.title.startswith("What changes when the render"))
    assert "Not in this scene: lens distortion" in table.note


@pytest.mark.parametrize(
    "words, what",
    [({"frames": 1}, "frames is 1"), ({"tolerance_dn": -1.0}, "tolerance_dn is"), ({"spp": 0}, "spp is"),
     ({"spp": 3}, "spp is 3"), ({"seed": -1}, "seed is"), ({"serial": 0.5}, "serial is")],
)  # fmt: skip
def test_what_cannot_be_studied_is_refused_before_anything_is_loaded(words: dict[str, Any], what: str) -> None:
    with pytest.raises(ms.InputError, match=what):
        left_out("no_such_scene.xml", TABLE1, EXPOSURE, **words)
