"""The ablation study: changes have their closed forms, laws and frames agree, nothing is measured twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import SKY, scene_text, write_scene
from helpers.study_pages import faults, through_files

import mitsuba_sensor as ms
from mitsuba_sensor.lab.statistics.estimators import z_limit
from mitsuba_sensor.pages.page import Study, Table
from mitsuba_sensor.study.ablation import RECORDS, ablation
from mitsuba_sensor.study.ablation import sensor as of_sensor
from mitsuba_sensor.study.ablation.render import Rendered, change_of, shared_rms
from mitsuba_sensor.study.ablation.sensor import PLAN, SENSORS, WHOLE, Moments, compare
from mitsuba_sensor.study.kit import Kit, Subject

EXPOSURE = ms.Exposure(0.1)


@pytest.fixture(scope="module")
def kit() -> Kit:
    return Kit()


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    scene = write_scene(tmp_path_factory.mktemp("scene"), scene_text(SKY))
    return Subject(
        scene,
        ms.load_camera("konnik_table1"),
        EXPOSURE,
        {"width": 12, "variant": "scalar_spectral"},
    )


@pytest.fixture(scope="module")
def study(kit: Kit, subject: Subject) -> Study:
    """Its seconds, which no test reads, are those of small frames."""
    with pytest.MonkeyPatch.context() as small:
        small.setattr(of_sensor, "TIMED_SHAPE", (32, 64))
        small.setattr(of_sensor, "TURNS", 3)
        return ablation(kit, subject, frames=4)


def rows(study: Study, title: str) -> dict[str, dict[str, object]]:
    table = next(
        part for part in study.parts if isinstance(part, Table) and part.title.startswith(title)
    )
    return {
        str(row[0]): dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows
    }


def test_laws_and_frames_agree_and_the_plan_keeps_its_tolerance(study: Study) -> None:
    """|z| beyond the limit is found by chance in 1 % of seeds."""
    assert study.passed and any(
        "Theory and frames agree" in finding for finding in study.findings
    )


def test_every_noise_source_of_the_camera_is_left_out_once(
    study: Study, subject: Subject
) -> None:
    shown = rows(study, "What changes when a noise source")
    assert next(iter(shown)) == "whole chain" and list(shown)[-1] == "the plan"
    assert {"PRNU", "dark current", "shot noise", "DSNU column"} <= set(shown)
    assert "ADC" not in shown and "full well" not in shown


def test_without_dark_current_the_mean_falls_by_its_closed_form(study: Study) -> None:
    """174.158 e- (paper eq. 1 at 25 °C in 0.1 s) times K = 4096/33 000 DN/e-."""
    change = rows(study, "What changes when a noise source")["dark current"]
    assert change["mean, predicted [DN]"] == pytest.approx(-174.158 * 4096 / 33_000, rel=2e-3)
    assert change["mean, measured [DN]"] == pytest.approx(
        change["mean, predicted [DN]"], rel=5e-3
    )


def test_a_stage_that_changes_nothing_saves_no_dn(study: Study) -> None:
    change = rows(study, "What changes when a noise source")["reset noise"]
    assert {
        name: value for name, value in change.items() if name.endswith("[DN]") and value
    } == {}


def test_a_sky_has_no_indirect_light_and_a_fall_off_of_its_lens(study: Study) -> None:
    shown = rows(study, "What changes when the render")
    assert (
        shown["no indirect light"]["rms [DN]"] < 4 * shown["no indirect light"]["± [DN]"]
    )  # of the rms, the last one
    assert {"one band", "channels instead of bands"} <= set(shown)


def test_the_page_has_units_and_one_colour_for_each_series(study: Study) -> None:
    assert not faults(study)


def test_nothing_is_measured_twice(
    kit: Kit, study: Study, subject: Subject, tmp_path: Path
) -> None:
    again = Kit(through_files(kit.known, RECORDS, tmp_path))
    assert ablation(again, subject, frames=4).findings == study.findings and again.new == 0


@pytest.mark.parametrize(
    ("options", "given", "sentence"),
    [({}, {"frames": 1}, "frames is 1"), ({"spp": 4}, {}, "spp is 4")],
)
def test_what_cannot_be_compared_is_refused(
    subject: Subject, options: dict[str, int], given: dict[str, int], sentence: str
) -> None:
    asked = Subject(
        subject.scene, subject.camera, subject.exposure, {**subject.options, **options}
    )
    with pytest.raises(ms.InputError, match=sentence):
        ablation(Kit(), asked, **given)


def test_a_law_that_is_off_by_ten_standard_errors_is_found() -> None:
    """Frames of 8 sensors scatter by 0.1 about means that are 0.35 DN above their law: t = 10 with 7 degrees."""
    rng = np.random.default_rng(3)
    predicted = np.tile([[100.0], [25.0], [4.0]], (1, SENSORS))
    noise = rng.normal(0.0, 0.1, predicted.shape)
    noise -= noise.mean(axis=1, keepdims=True)
    pixels = np.zeros((100, 100))
    right, wrong = (
        compare(Moments(predicted, predicted + noise + off, pixels), None, 8, 1.0)
        for off in (0.0, 0.35)
    )
    assert all(abs(one.z) < 1e-6 for one in right) and all(abs(one.z) > 3.5 for one in wrong)
    assert wrong[0].measured_dn - wrong[0].predicted_dn == pytest.approx(0.35)
    assert right[1].predicted_dn == pytest.approx(5.0) and right[
        2
    ].predicted_dn == pytest.approx(2.0)


@pytest.mark.parametrize("step_dn", [1.0, 30.0])
@pytest.mark.parametrize("electrons", [0.4, 3.0, 30.0, 100.0, 300.0, 3000.0])
def test_a_source_of_few_electrons_agrees_with_its_law_by_poissons_law(
    electrons: float, step_dn: float
) -> None:
    """Of 1000 right studies of one source 0.2 to 0.8 should differ by chance; more than 8 do in one test of 10 000."""
    rng = np.random.default_rng(int(10 * electrons))
    frames, pixels = 8, np.zeros((36, 48))
    each_dn = step_dn / (frames * pixels.size)  # of one electron, in the average of one sensor
    law = np.tile([[1000.0], [4.0], [0.0]], (1, SENSORS))
    whole = Moments(law, law, pixels)
    differ = 0
    for _ in range(1000):
        found, expected = law.copy(), law.copy()
        found[0] -= each_dn * rng.poisson(electrons / SENSORS, SENSORS)
        expected[0] -= each_dn * electrons / SENSORS
        change = compare(Moments(expected, found, pixels), whole, frames, step_dn)[0]
        differ += abs(change.z) > z_limit(18)
        assert change.too_few or electrons > 3
    assert differ <= 8
    stays = compare(Moments(expected, law, pixels), whole, frames, step_dn)[0]
    assert (abs(stays.z) > z_limit(18)) == (electrons > 99)  # frames that kept the source


def test_frames_of_almost_no_dark_electron_agree_with_their_law() -> None:
    """3 dark electrons are expected in 9.8 million pixels; one study in 100 would differ by chance."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(1e-7)
    light = ms.expose(np.full((24, 32), 3000.0), camera, exposure).light
    for seed in (1, 2):
        kit = Kit()
        asked = of_sensor.SensorAblation(
            kit, Subject("", camera, exposure), lambda: light, 0.02, (8, seed, seed)
        )
        asked.cameras = {
            name: asked.cameras[name] for name in (WHOLE, "dark current", "PRNU", PLAN)
        }
        kit.take(list(asked.steps())[:-1])
        kit.known["seconds of frames"] = {case: [1.0, 1.0] for case in asked.cameras}, 0.0
        results = of_sensor.SensorResults(asked)
        assert results.agree
        assert results.verdict("dark current") == ("dim", "too few to tell")
        assert results.verdict("PRNU") == ("good", "agree")


@pytest.mark.parametrize("source", ["PRNU", "dark current", "shot noise"])
def test_a_source_that_the_frames_kept_is_found(kit: Kit, study: Study, source: str) -> None:
    whole = kit[f"frames: {WHOLE}"]
    kept = kit[f"frames: {source}"]._replace(measured=whole.measured)
    assert max(abs(one.z) for one in compare(kept, whole, 4, 1.0)) > z_limit(18)


def test_the_rms_of_a_change_is_free_of_noise() -> None:
    """A pattern of 3 DN rms in noise of 10 DN: 3 within three standard errors, where the plain mean square has 5.8."""
    rng = np.random.default_rng(1)
    pattern = 3.0 * np.where(np.arange(10_000).reshape(100, 100) % 2, 1.0, -1.0)
    off = pattern + rng.normal(0.0, 10.0, (4, 100, 100))
    rms, error = shared_rms(off)
    assert rms == pytest.approx(3.0, abs=3 * error) and error < 0.3
    assert np.sqrt((off.mean(axis=0) ** 2).mean()) > 5.0


def test_renders_that_differ_by_noise_alone_have_not_changed() -> None:
    rng = np.random.default_rng(2)
    base = [Rendered(rng.normal(0.0, 1.0, (64, 64)), 2.0) for _ in range(4)]
    other = [Rendered(rng.normal(0.0, 1.0, (64, 64)), 1.0) for _ in range(4)]
    change = change_of(base, other)
    assert not change.is_change and (change.saved_s, change.saved_share) == (1.0, 0.5)
