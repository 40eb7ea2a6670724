"""Staggered exposures: each read-out sees what moves and what flickers at its own time, one behind the other."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import HEIGHT, WIDTH, wall_that_moves, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.camera.exposure_times import frame_span_s, later_exposures
from mitsuba_sensor.optics.waveform import Waveform

PLAIN = ms.load_camera("sony_imx174").replace(
    **{"pixel.prnu": 0.0, "adc.bits": 12, "adc.black_level_dn": 64.0}
)
EXPOSURE = ms.Exposure(0.008)
GAP_US = 500.0
READOUTS = [
    {"name": "long", "fields": {"pixel.full_well_e": 9_000.0, "readout.gain_dn_per_e": 0.4}},
    {
        "name": "short",
        "of": "exposure",
        "exposure_ratio": 0.25,
        "gap_us": GAP_US,
        "fields": {"pixel.full_well_e": 9_000.0, "readout.gain_dn_per_e": 0.4},
    },
    {
        "name": "shortest",
        "of": "exposure",
        "exposure_ratio": 1 / 16,
        "fields": {"pixel.full_well_e": 9_000.0, "readout.gain_dn_per_e": 0.4},
    },
]
CAMERA = PLAIN.replace(readouts=READOUTS, **{"combine.bits": 18})
ROLLING = CAMERA.replace(**{"sensor.shutter": "rolling", "sensor.row_time_us": 30.0})
SPEED_PX_PER_S = 1_000.0
SCENE, MOTION = wall_that_moves(0.005, SPEED_PX_PER_S)
QUICK: dict[str, Any] = {
    "progress": False,
    "wavelength_nm": 550.0,
    "spp": 32,
    "denoise": False,
    "variant": "scalar_spectral",
}


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> ms.Irradiance:
    """A wall that fills the picture, with the light of one lamp."""
    text = SCENE.replace("translate x", "translate y")
    text = text.replace('y="-10"', 'y="0"')
    scene = write_scene(tmp_path_factory.mktemp("flat"), text)
    groups = {"lamp": "lamp"}
    return ms.render(scene, CAMERA, EXPOSURE, light_groups=groups, seed=1, **QUICK)


def opens_s(camera: ms.Camera, start_s: float) -> dict[str, tuple[float, float]]:
    """When each read-out opens and for how long, written out."""
    long_s = EXPOSURE.time_s
    short_s = start_s + long_s + GAP_US * 1e-6
    return {
        "long": (start_s, long_s),
        "short": (short_s, long_s / 4),
        "shortest": (short_s + long_s / 4, long_s / 16),
    }


@pytest.mark.parametrize("camera", one_in(2, [ROLLING, CAMERA]), ids=["rolling", "global"])
@pytest.mark.parametrize("waveform", [ms.pwm(310, 0.2), ms.sine(120, 0.9, 0.3)])
def test_each_readout_has_the_mean_of_the_waveform_over_its_own_exposure(
    camera: ms.Camera, waveform: Waveform, flat: ms.Irradiance
) -> None:
    """Within 0.1 %, against a sum over 20 000 instants of the exposure of each row."""
    steady = ms.collect(flat, camera, EXPOSURE)
    assert steady.by_readout is None
    photons = ms.collect(flat.with_lights(lamp=waveform), camera, EXPOSURE, start_s=0.0123)
    assert photons.by_readout is not None
    rows = np.arange(HEIGHT) * (camera.sensor.row_time_us or 0.0) * 1e-6
    for name, (start_s, time_s) in opens_s(camera, 0.0123).items():
        own = photons if name == "long" else photons.by_readout[name]
        instants = start_s + rows[:, None] + (np.arange(20_000) + 0.5) * time_s / 20_000
        weights = waveform.mean_over(instants, 0.0).mean(axis=1)
        share = time_s / EXPOSURE.time_s
        expected = share * weights * steady.total.mean(axis=1)
        found = own.total.mean(axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-3 * max(expected.max(), 1e-9))


def test_a_strobe_in_one_exposure_is_dark_in_the_others(flat: ms.Irradiance) -> None:
    """A flash of 1 ms, 3 ms after the begin of the frame, every second."""
    strobe = ms.pwm(1.0, 0.001, 1 - 0.003, level=0.005)
    frames = ms.expose(flat.with_lights(lamp=strobe), CAMERA, EXPOSURE, precision="float64")
    means = {name: float(one.digital.mean()) - 64 for name, one in frames.readouts.items()}
    assert means["long"] > 500
    assert abs(means["short"]) < 5 and abs(means["shortest"]) < 5


def test_codes_theory_and_clean_frame_are_those_of_each_time(flat: ms.Irradiance) -> None:
    """Mean codes by read-out within five standard errors of gain times the electrons of its own exposure."""
    light = flat.with_lights(lamp=ms.pwm(310, 0.2, 0.4))
    frames = ms.expose(light, ROLLING, EXPOSURE, frames=30, start_s=0.002)
    photons = ms.collect(light, ROLLING, EXPOSURE, start_s=0.002)
    assert photons.by_readout is not None
    for name, one in frames.readouts.items():
        own = photons if name == "long" else photons.by_readout[name]
        alone = ms.expose(own.changed(by_readout=None), one.camera, one.first.exposure)
        np.testing.assert_allclose(one.clean, alone.clean, rtol=1e-6)
        error = np.sqrt(one.temporal_variance / 30)
        off = (one.digital.mean(axis=0) - one.clean) / error
        assert abs(off.mean()) < 5 / math.sqrt(off.size)
    off = (frames.digital.mean(axis=0) - frames.clean) / np.sqrt(frames.temporal_variance / 30)
    assert abs(off.mean()) < 5 / math.sqrt(off.size) and off.std() == pytest.approx(1, abs=0.1)
    line = frames.report["stages"][-1]
    assert line["mean_frame"] == pytest.approx(line["mean_expected"], rel=2e-3)
    assert line["sigma_frame"] == pytest.approx(line["sigma_expected"], rel=0.05)
    averages = frames.theory.averages(frames.stages[-1])
    assert averages.spatial < 0.2 * averages.temporal


def test_engines_crops_and_streams_of_flickering_light_are_the_same(
    flat: ms.Irradiance,
) -> None:
    light = flat.with_lights(lamp=ms.pwm(310, 0.2, 0.4))
    one, other = (
        ms.expose(light, ROLLING, EXPOSURE, start_s=0.002, engine=engine)
        for engine in ("numpy", "drjit")
    )
    assert np.array_equal(one.digital, other.digital)
    series = ms.expose(light, ROLLING, EXPOSURE, frames=3, fps=50)
    alone = ms.expose(light, ROLLING, EXPOSURE, first_frame=2, fps=50)
    assert np.array_equal(series.digital[2], alone.digital[0])
    streamed = list(ms.stream(light, ROLLING, EXPOSURE, frames=3, fps=50))
    assert np.array_equal(np.stack(streamed), series.digital)
    for name, readout in series.readouts.items():
        assert np.array_equal(readout.digital[2], alone.readouts[name].digital[0])


def edge_px(digital: np.ndarray, even: np.ndarray) -> float:
    """Columns that the bright side covers, by the area under the profile over that of an even wall."""
    profile = (digital.astype(float).mean(axis=0) - 64) / (even.mean(axis=0) - 64)
    return float(profile.sum() / profile[:8].mean())


@pytest.mark.exhaustive
def test_a_moving_edge_is_where_it_is_in_the_middle_of_each_exposure(
    tmp_path: Path, flat: ms.Irradiance
) -> None:
    """Within 0.25 px; from read-out to read-out by speed times the time between the middles."""
    scene = write_scene(tmp_path, SCENE)
    captured = ms.capture(scene, CAMERA, EXPOSURE, motion=MOTION, start_s=-0.01, **QUICK)
    even = ms.expose(flat, CAMERA, EXPOSURE).readouts
    found = dict[str, float]()
    for name, one in captured.frames.readouts.items():
        found[name] = edge_px(one.digital[0], even[name].clean)
    for name, (start_s, time_s) in opens_s(CAMERA, -0.01).items():
        expected = WIDTH / 2 + SPEED_PX_PER_S * (start_s + time_s / 2)
        assert found[name] == pytest.approx(expected, abs=0.25)
    assert found["shortest"] - found["long"] > 6
    captured.save(tmp_path / "out")
    said = json.loads((tmp_path / "out" / "frame.json").read_text())["readouts"]
    assert [one["begins_after_s"] for one in said] == pytest.approx([0, 0.0085, 0.0105])
    with pytest.raises(ms.InputError, match="is exposed at another time"):
        ms.expose(ms.read_irradiance(tmp_path / "out" / "irradiance.exr"))
    first = CAMERA.at_readout("long")
    ms.expose(ms.read_irradiance(tmp_path / "out" / "irradiance.exr"), first)


def test_a_small_photodiode_of_another_time_begins_with_the_frame(flat: ms.Irradiance) -> None:
    readouts = [
        READOUTS[0],
        {
            "name": "small",
            "of": "photodiode",
            "sensitivity": 0.01,
            "exposure_ratio": 2.0,
            "fields": {},
        },
    ]
    camera = PLAIN.replace(readouts=readouts)
    assert later_exposures(camera, EXPOSURE, 1.0)["small"] == (ms.Exposure(0.016), 1.0)
    waveform = ms.pwm(100, 0.5)
    photons = ms.collect(flat.with_lights(lamp=waveform), camera, EXPOSURE)
    assert photons.by_readout is not None
    ratio = waveform.mean_over([0.0], 0.016)[0] / waveform.mean_over([0.0], 0.008)[0]
    mean = photons.by_readout["small"].total / photons.total
    np.testing.assert_allclose(mean, 2 * ratio, rtol=1e-5)


def test_all_exposures_of_a_frame_fit_into_its_period(flat: ms.Irradiance) -> None:
    span_s = 0.008 * (1 + 1 / 4 + 1 / 16) + GAP_US * 1e-6
    assert frame_span_s(CAMERA, EXPOSURE) == pytest.approx(span_s)
    light = flat.with_lights(lamp=ms.pwm(100, 0.5))
    with pytest.raises(ms.InputError, match="with later exposures"):
        ms.expose(light, CAMERA, EXPOSURE, frames=2, frame_period_s=0.99 * span_s)
    ms.expose(light, CAMERA, EXPOSURE, frames=2, frame_period_s=1.01 * span_s)
    with pytest.raises(ms.InputError, match="gap_us needs a separate charge"):
        PLAIN.replace(readouts=[READOUTS[0], {"name": "low", "gap_us": 5.0}])


@pytest.mark.exhaustive
def test_automatic_exposure_leaves_time_for_the_later_exposures(flat: ms.Irradiance) -> None:
    captured = ms.capture(
        flat,
        CAMERA,
        ms.Exposure(0.001),
        frames=4,
        fps=100,
        auto_exposure="target 0.9, damping 1",
    )
    times = [one.frames.first.exposure.time_s for one in captured.timed]
    assert times[-1] == pytest.approx((0.01 - GAP_US * 1e-6) / (1 + 1 / 4 + 1 / 16))
