"""Stages whose law nobody has written: they are measured by their own samples, and everything that is said says so.

Closed forms are the oracles. The random numbers are the same in every run: what passes once passes always.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from helpers.amp_glow import AmpGlow
from helpers.marks import exhaustive
from helpers.stage_tests import backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import emva_figures
from mitsuba_sensor.core.backend import Backend

TABLE1 = ms.load_camera("konnik_table1")
SHOT_NOISE_ALONE = TABLE1.replace(
    **{
        "pixel.prnu": 0.0,
        "dark_current.cv": 0.0,
        "readout.dsnu_col": 0.0,
        "source_follower.white_nv_per_rthz": 0.0,
        "adc.black_level_dn": 16.0,
    }
)
SHORT = ms.Exposure(0.1)
SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))


@dataclass(frozen=True)
class Ipc(ms.Stage):
    """Inter-pixel capacitance: each pixel gives a share ``alpha`` of its signal to each of its four neighbours."""

    alpha: float = 0.02
    domain = "electrons"
    reach_px = 1

    def coupled(self, signal: ms.Array, frame: ms.Frame) -> ms.Array:
        sides = [frame.neighbour(signal, *side) for side in SIDES]
        return frame.number(1 - 4 * self.alpha) * signal + frame.number(self.alpha) * sum(sides)

    def sample(self, electrons: ms.Electrons, frame: ms.Frame) -> ms.Electrons:
        light, dark = (self.coupled(x, frame) for x in (electrons.light, electrons.dark))
        return replace(electrons, light=light, dark=dark)


class FarIpc(Ipc):
    """Couples pixels that are further away than it says."""

    def coupled(self, signal: ms.Array, frame: ms.Frame) -> ms.Array:
        return super().coupled(super().coupled(signal, frame), frame)


@dataclass(frozen=True)
class Hum(ms.Stage):
    """Temporal noise of the swing."""

    sigma_v: float = 1e-3
    domain = "volts"

    def sample(self, swing: ms.Array, frame: ms.Frame) -> ms.Array:
        return swing + frame.number(self.sigma_v) * frame.normal("hum")


class HumWithMoments(Hum):
    """The same noise, with its law."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(temporal=self.sigma_v**2)


COUPLED = SHOT_NOISE_ALONE.with_stage(Ipc(), after="shot_noise")
GLOWING = SHOT_NOISE_ALONE.with_stage(AmpGlow(), after="dark_current")
SCENE = np.random.default_rng(1).uniform(0.0, 30_000.0, (70, 90))


def electrons(camera: ms.Camera, photons: float) -> tuple[float, ms.Array]:
    """Mean of two frames, and half their difference, of which the variance is half the temporal one."""
    light = np.full((512, 512), photons)
    found = ms.expose(light, camera, SHORT, frames=2, keep=("electrons",), engine="numpy")
    assert found.electrons is not None
    return float(found.electrons.mean()), (found.electrons[1] - found.electrons[0]) / 2**0.5


def test_a_coupling_of_2_percent_makes_the_photon_transfer_slope_0_848_and_keeps_the_mean() -> (
    None
):
    """Σk² = (1 − 4α)² + 4α². The same counts enter, so that the ratio of slopes is known to 0.1 %: 5 σ.

    Covariance of two neighbours 2α(1 − 4α) of the variance that enters, within 5 of its standard errors of 1/512.
    """
    slopes, noise = {}, {}
    for name, camera in (("apart", SHOT_NOISE_ALONE), ("coupled", COUPLED)):
        (dim, dim_noise), (bright, noise[name]) = (electrons(camera, x) for x in (2e3, 3e4))
        slopes[name] = (noise[name].var() - dim_noise.var()) / (bright - dim)
        slopes[f"mean {name}"] = bright
    assert slopes["coupled"] / slopes["apart"] == pytest.approx(0.848, rel=0.005)
    assert slopes["mean coupled"] == pytest.approx(slopes["mean apart"], rel=1e-6)
    beside = (noise["coupled"][:, 1:] * noise["coupled"][:, :-1]).mean()
    assert beside / noise["apart"].var() == pytest.approx(2 * 0.02 * 0.92, abs=5 / 512)


def test_report_and_frame_json_have_standard_errors_and_the_number_of_pixels(
    tmp_path: Path,
) -> None:
    frames = ms.expose(SCENE, COUPLED, SHORT)
    theory, last = frames.report["theory"], frames.report["stages"][-1]
    assert theory["pixels"] == frames.report["sampled_pixels"] > 2**15
    assert abs(last["mean_expected"] - frames.digital.mean()) < 4 * last["mean_error"] + 0.3
    assert 0 < last["sigma_temporal_error"] < 0.01 * last["sigma_temporal_expected"]
    frames.save(tmp_path)
    assert json.loads((tmp_path / "frame.json").read_text())["theory"] == theory


def test_a_noise_budget_has_what_the_coupling_takes_away() -> None:
    """−0.152 of the shot noise, of which 0.848 are left behind it; within 1 % of it."""
    frames = ms.expose(np.full((64, 64), 20_000.0), COUPLED, SHORT)
    found = {x.source: x.temporal_dn2 for x in frames.noise_budget().entries}
    shot = found["photon shot noise"] + found["dark shot noise"]
    assert found["ipc"] / shot == pytest.approx((0.848 - 1.0) / 0.848, abs=0.01)


@pytest.mark.parametrize("engine", [exhaustive("float64"), "numpy", exhaustive("drjit")])
def test_no_byte_of_coupled_pixels_depends_on_strips_engines_and_streams(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a crop of the frame is the frame of the crop but for the pixels at its edges."""
    backend_of(engine)
    options = {"precision": "float64"} if engine == "float64" else {"engine": engine}
    whole = ms.expose(SCENE, COUPLED, SHORT, **options).digital[0]  # type: ignore[arg-type]
    if engine != "float64":
        numpy = ms.expose(SCENE, COUPLED, SHORT, engine="numpy").digital[0]
        np.testing.assert_array_equal(whole, numpy)
    report = ms.expose(SCENE, COUPLED, SHORT, **options).report  # type: ignore[arg-type]
    monkeypatch.setattr(Backend, "strip_pixels", 1)  # less than the neighbours: one strip
    at_once = ms.expose(SCENE, COUPLED, SHORT, **options).digital[0]  # type: ignore[arg-type]
    np.testing.assert_array_equal(at_once, whole)
    monkeypatch.setattr(Backend, "strip_pixels", 4 * SCENE.shape[1] + 3)
    in_strips = ms.expose(SCENE, COUPLED, SHORT, **options)  # type: ignore[arg-type]
    assert in_strips.report["counts"] == report["counts"]
    for parts, alone in zip(in_strips.report["stages"], report["stages"], strict=True):
        for name in ("mean_frame", "sigma_frame", "mean_expected", "sigma_expected"):
            assert parts[name] == pytest.approx(alone[name], rel=1e-9)
    (streamed,) = ms.stream(SCENE, COUPLED, SHORT, **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(streamed, whole)
    sensor = ms.Sensor(COUPLED)
    sensor.expose(SCENE, SHORT, **options)  # type: ignore[arg-type]
    again = sensor.expose(SCENE, SHORT, first_frame=0, **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.digital[0], whole)
    crop = ms.expose(SCENE[20:50, 30:80], COUPLED, SHORT, origin=(20, 30), **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(crop.digital[0, 1:-1, 1:-1], whole[21:49, 31:79])


def test_check_stage_says_that_there_is_nothing_to_compare_and_checks_the_rest() -> None:
    check = ms.check_stage(Ipc(), camera=TABLE1, after="shot_noise")
    assert not check.comparisons and "no moments" in check.explain()
    with pytest.raises(ms.InputError, match=r"is not the crop of.*reach_px"):
        ms.check_stage(FarIpc(), camera=TABLE1, after="shot_noise")


def test_a_plan_of_a_stage_without_moments_is_that_of_any_other() -> None:
    plan = ms.plan(GLOWING, SHORT, SCENE, tolerance_dn=50.0)
    effects = {effect.stage: effect for effect in plan.effects}
    assert effects["amp glow"].kept and effects["amp glow"].pixels_beyond > 100
    assert "PRNU" in plan.left_out and "amp glow" not in plan.left_out


def test_derivatives_of_such_a_chain_are_refused_with_the_way_out() -> None:
    with pytest.raises(
        ms.InputError, match="couples neighbouring pixels; differentiate by fields"
    ):
        ms.differentiable(SCENE, COUPLED, SHORT, parameters="photons")


def test_figures_and_black_level_of_a_noise_without_moments_are_those_of_its_law() -> None:
    """65 536 pixels in two frames: σ is known to 0.2 %; 1 % is 5 of that. The black level is 4σ, rounded up."""
    known, measured = (
        TABLE1.with_stage(noise, after="reset_noise") for noise in (HumWithMoments(), Hum())
    )
    law, found = (emva_figures(camera, SHORT) for camera in (known, measured))
    assert found.temporal_dark_noise_e == pytest.approx(law.temporal_dark_noise_e, rel=0.01)
    assert measured.stages[-1] == known.stages[-1]
