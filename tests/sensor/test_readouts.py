"""Read-outs of one pixel and their combination: the same electrons, hand-over, closed forms, what is refused.

Closed forms and conservation are the oracles. The random numbers are the same in every run: what passes once passes
always; bounds are five standard errors where none is stated.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import mitsuba_sensor as ms

SHORT = ms.Exposure(0.01)
PLAIN = ms.load_camera("sony_imx174").replace(
    **{"pixel.prnu": 0.0, "pixel.full_well_e": 32_000.0, "adc.bits": 12, "dark_current.cv": 0.0}
)
HIGH = {
    "readout.gain_dn_per_e": 1.6,
    "source_follower.read_noise_e": 1.2,
    "adc.black_level_dn": 64,
}
LOW = {
    "readout.gain_dn_per_e": 0.12,
    "source_follower.read_noise_e": 9.0,
    "adc.black_level_dn": 64,
}


def dual_gain(**changes: Any) -> ms.Camera:
    """A camera that reads every pixel at two gains."""
    readouts = [{"name": "high", "fields": HIGH}, {"name": "low", "fields": LOW}]
    return PLAIN.replace(**{"readouts": readouts, **changes})


def electrons(level_e: float, shape: tuple[int, int]) -> ms.Photons:
    """A flat field of so many mean photoelectrons."""
    return ms.Photons(np.full(shape, level_e), detected=True)


def codes_by_light(camera: ms.Camera, levels: np.ndarray, pixels: int = 256) -> tuple[Any, Any]:
    """Mean and variance of the linear code by clean frames, averaged over so many pixels of each level."""
    light = ms.Photons(np.tile(levels, (pixels, 1)), detected=True)
    frames = ms.expose(light, camera, SHORT)
    return (x.mean(axis=0, dtype=float) for x in (frames.clean, frames.temporal_variance))


@pytest.mark.parametrize("level_e", [20_000.0, 60_000.0])
def test_theory_has_the_noise_of_frames_where_the_gains_are_saturated(level_e: float) -> None:
    """The high gain at its largest code, then the full well too: σ within 1 %, where the low gain alone shows."""
    frames = ms.expose(electrons(level_e, (64, 64)), dual_gain(), SHORT, frames=25)
    sigma_dn = np.sqrt(frames.digital.astype(float).var(axis=0, ddof=1).mean())
    expected = frames.theory.averages(frames.stages[-1])
    assert sigma_dn == pytest.approx(np.sqrt(expected.temporal), rel=0.01)
    assert sigma_dn == pytest.approx(np.sqrt(frames.temporal_variance.mean()), rel=0.015)
    assert frames.digital.mean() == pytest.approx(expected.mean, abs=0.02 * sigma_dn)


def test_two_gains_read_the_same_electrons() -> None:
    frames = ms.expose(electrons(1500.0, (512, 512)), dual_gain(), SHORT, frames=2)
    high, low = (one.digital.astype(float).ravel() for one in frames.readouts.values())
    covariance_dn2 = np.cov(high, low)[0, 1]
    dark_e = frames.readouts["high"].clean.mean() / 1.6 - 64 / 1.6 - 1500
    # standard error of the ratio: 0.21 % of 2^19 pixels
    assert covariance_dn2 / (1.6 * 0.12) == pytest.approx(1500 + dark_e, rel=0.01)


def test_the_combination_hands_over_where_the_code_reaches_the_threshold() -> None:
    camera = dual_gain()
    light = ms.Photons(np.tile(np.geomspace(1, 30_000, 400), (64, 1)), detected=True)
    frames = ms.expose(light, camera, SHORT, precision="float64")
    high, low = (one.digital[0].astype(float) for one in frames.readouts.values())
    threshold = round(64 + 0.9 * (4095 - 64))
    expected_e = np.where(high >= threshold, (low - 64) / 0.12, (high - 64) / 1.6)
    expected = np.floor(64 + 1.6 * expected_e + 0.5 + 1e-9)
    assert np.array_equal(frames.digital[0], expected)
    assert 0.1 < (high >= threshold).mean() < 0.9


@pytest.mark.parametrize("combine", [{}, {"combine.blend_from": [0.5]}])
def test_mean_and_noise_of_the_combination_follow_the_closed_form(
    combine: dict[str, Any],
) -> None:
    """Also where half the pixels have handed over: 64 levels about the hand-over and far from it."""
    camera = dual_gain(**combine).without(
        "dsnu_pixel", "dsnu_column", "dsnu_row", "prnu_column"
    )
    levels = np.concatenate([np.geomspace(2, 30_000, 24), np.linspace(1_000, 2_600, 40)])
    frames = ms.expose(
        ms.Photons(np.tile(levels[:, None], (1, 20_000)), detected=True), camera, SHORT
    )
    mean, variance = codes_by_light(camera, levels)
    codes = frames.digital[0].astype(float)
    off = (codes.mean(axis=1) - mean) / np.sqrt(variance / codes.shape[1])
    assert np.abs(off).max() < 5
    ratio_db = 10 * np.log10(codes.var(axis=1) / variance)
    assert (
        np.abs(ratio_db).max() < 0.25
    )  # five standard errors of 20 000 pixels, of laws that are not normal


def test_readouts_of_one_charge_share_the_noise_of_a_quantum_yield() -> None:
    """An interaction frees three electrons, and both read-outs have all of them. Of 20 000 pixels, within 4 %: the
    variance is known to 1 %."""
    camera = dual_gain(
        **{
            "quantum_efficiency.quantum_yield": [3.0]
            * len(PLAIN.quantum_efficiency.wavelengths_nm),
            "combine.blend_from": [0.2],
        }
    ).without("dsnu_pixel", "dsnu_column", "dsnu_row", "prnu_column")
    photons = ms.Photons(np.full((100, 200, 1), 900.0 / 0.3), np.array([450.0]))
    frames = ms.expose(photons, camera, SHORT)
    assert frames.temporal_variance.mean() == pytest.approx(frames.digital.var(), rel=0.04)
    assert frames.clean.mean() == pytest.approx(
        frames.digital.mean(), abs=5 * frames.digital.std() / np.sqrt(20_000)
    )


def test_a_crop_of_combined_frames_is_the_frame_of_the_crop() -> None:
    light, camera = np.full((40, 60), 900.0), dual_gain(**{"pixel.prnu": 0.01})
    whole = ms.expose(ms.Photons(light, detected=True), camera, SHORT, frames=2)
    crop = ms.Photons(light[:10, :20], detected=True, origin=(5, 7))
    part = ms.expose(crop, camera, SHORT, first_frame=1)
    assert np.array_equal(part.digital[0], whole.digital[1, 5:15, 7:27])
    for name, one in part.readouts.items():
        assert np.array_equal(one.digital[0], whole.readouts[name].digital[1, 5:15, 7:27])


@pytest.mark.usefixtures("few_windows")
def test_files_hold_every_readout_and_their_combination(tmp_path: Path) -> None:
    frames = ms.expose(electrons(2_000.0, (32, 32)), dual_gain(), SHORT, frames=2)
    frames.save(tmp_path)
    with tifffile.TiffFile(tmp_path / "readouts.tiff") as tiff:
        pages = {page.tags[285].value: page.asarray() for page in tiff.pages}
    assert list(pages)[:3] == ["frame 0, high", "frame 0, low", "frame 0, combined"]
    assert np.array_equal(pages["frame 1, low"], frames.readouts["low"].digital[1])
    assert np.array_equal(pages["frame 1, combined"], frames.digital[1])
    assert np.array_equal(tifffile.imread(tmp_path / "frame.tiff"), frames.digital)
    said = json.loads((tmp_path / "frame.json").read_text())["readouts"]
    assert [one["name"] for one in said] == ["high", "low"]
    assert sum(one["share_of_pixels"] for one in said) == pytest.approx(1)
    ms.expose(electrons(2_000.0, (32, 32)), PLAIN, SHORT).save(tmp_path)
    assert not (tmp_path / "readouts.tiff").exists()


@pytest.mark.exhaustive
def test_a_plan_leaves_out_stages_of_each_readout_within_the_tolerance() -> None:
    """In steps of the linear code; nothing at all changes with a tolerance of 0."""
    camera = dual_gain(**{"pixel.prnu": 0.002})
    light = ms.Photons(np.tile(np.geomspace(5, 25_000, 60), (40, 1)), detected=True)
    frames = ms.expose(light, camera, SHORT)
    exact = ms.expose(light, camera, SHORT, tolerance_dn=0)
    assert np.array_equal(exact.digital, frames.digital)
    plan = ms.plan(camera, SHORT, light, tolerance_dn=2.0)
    assert {one.partition(": ")[0] for one in plan.left_out} == {"high", "low"}
    assert "low: PRNU" in plan.explain()
    planned = ms.expose(light, camera, SHORT, plan=plan)
    assert np.abs(planned.clean - frames.clean).max() < 2.0
    sigma, other = (np.sqrt(one.temporal_variance) for one in (planned, frames))
    assert np.abs(sigma - other).max() < 2.0
    assert np.array_equal(planned.readouts["high"].digital.shape, frames.digital.shape)
    with pytest.raises(ms.InputError, match="plan was made for"):
        ms.expose(light, camera, ms.Exposure(0.02), plan=plan)
