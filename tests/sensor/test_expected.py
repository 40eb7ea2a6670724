"""What is expected of frames, by samples of them, against closed forms and against the frames of many sensor units.

The random numbers are the same in every run: what passes once passes always. Of right code one bound of four standard
errors in 15 000 fails; there are about a hundred.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from helpers.amp_glow import AmpGlow
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.stages.gains import gain_dn_per_e

EXPOSURE = ms.Exposure(0.1)
TABLE1 = ms.load_camera("konnik_table1").replace(
    **{
        "pixel.prnu": 0.0,
        "readout.dsnu_col": 0.0,
        "dark_current.fom_na_per_cm2": 0.0,
        "source_follower.white_nv_per_rthz": 0.0,
        "adc.black_level_dn": 64.0,
    }
)
"""Shot noise and rounding alone."""
K = gain_dn_per_e(TABLE1)
SHAPE = (128, 128)
few = pytest.mark.usefixtures("few_windows")


def light_of(level_e: float, shape: tuple[int, int] = SHAPE) -> ms.Photons:
    """A flat field of so many mean photoelectrons."""
    return ms.Photons(np.full(shape, level_e), detected=True)


def require_within_errors(found: Any, expected: tuple[float, float, float]) -> None:
    """Mean, temporal and spatial variance within 4 standard errors, 0.02 σ of the mean or 1 % of σ."""
    sigma = math.sqrt(expected[1] + expected[2])
    rooms = (0.02 * sigma, 0.02 * expected[1], 0.02 * expected[2])
    for value, closed, error, room in zip(
        found[:3], expected, found.errors, rooms, strict=True
    ):
        assert abs(value - closed) <= max(4 * error, room, 1e-9), (found, expected)


# Closed forms


@dataclass(frozen=True)
class Drift(ms.Stage):
    """The swing grows from frame to frame."""

    volts: float = 5e-4
    domain = "volts"

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(self.volts * frame.index)


def changed(**fields: Any) -> ms.Camera:
    return TABLE1.replace(**{name.replace("__", "."): x for name, x in fields.items()})


GLOW_E = AmpGlow().rate_e_per_s * 0.1 * np.exp(-np.add.outer(*map(np.arange, SHAPE)) / 40.0)
FORMS: dict[str, tuple[ms.Camera, float, Callable[[], tuple[float, float, float]]]] = {
    "shot noise": (TABLE1, 3000.0, lambda: (64 + K * 3000, K**2 * 3000 + 1 / 12, 0.0)),
    "PRNU": (
        changed(pixel__prnu=0.01),
        10_000.0,
        lambda: (64 + K * 1e4, K**2 * 1e4 + 1 / 12, (K * 100) ** 2),
    ),
    "read noise": (
        changed(source_follower__white_nv_per_rthz=None, source_follower__read_noise_e=20.0),
        0.0,
        lambda: (64.0, (K * 20.0) ** 2 + 1 / 12, 0.0),
    ),
    "column offsets": (
        changed(readout__dsnu_col=0.001),
        0.0,
        lambda: (64.0, 0.0, (0.001 * 33_000 * K) ** 2 + 1 / 12),
    ),
    "a full well": (  # the larger half of a normal is cut; the last count is on a whole code
        changed(adc__full_scale_v=0.25, adc__black_level_dn=64.64),
        33_000.0,
        lambda: (
            64.64 + k8() * (33_000 - math.sqrt(33_000 / (2 * math.pi))),
            k8() ** 2 * 33_000 * (0.5 - 1 / (2 * math.pi)) + 1 / 24,
            0.0,
        ),
    ),
    "no noise at all": (TABLE1, 0.0, lambda: (64.0, 0.0, 0.0)),
    "beyond saturation": (TABLE1, 1e9, lambda: (4095.0, 0.0, 0.0)),
    "light without end": (TABLE1, math.inf, lambda: (4095.0, 0.0, 0.0)),
    "coupled neighbours": (
        changed(readout__ipc_coupling=0.02),
        5000.0,
        lambda: (64 + K * 5000, 0.848 * K**2 * 5000 + 1 / 12, 0.0),
    ),
    "a user's glow": (  # the same on all sensor units: a part of the image
        TABLE1.with_stage(AmpGlow(), after="dark_current"),
        0.0,
        lambda: (64 + K * GLOW_E.mean(), K**2 * GLOW_E.mean() + 1 / 12, 0.0),
    ),
}


def k8() -> float:
    return gain_dn_per_e(changed(adc__full_scale_v=0.25))


@pytest.mark.parametrize("name", FORMS)
def test_mean_and_variances_are_those_of_closed_forms(name: str) -> None:
    camera, level_e, closed = FORMS[name]
    frames = ms.expose(light_of(level_e), camera, EXPOSURE)
    require_within_errors(frames.theory.averages(frames.stages[-1]), closed())


def test_a_drift_from_frame_to_frame_is_that_of_the_frames_that_were_asked_for() -> None:
    """σ² of a straight drift over N frames: step²·N(N + 1)/12, with that of the shot noise; of one frame: none."""
    camera = TABLE1.with_stage(Drift(), after="sense_node")
    step_dn = Drift().volts * camera.stages[-1].gain_dn_per_v
    for count in (1, 16):
        frames = ms.expose(light_of(1000.0), camera, EXPOSURE, frames=count, first_frame=3)
        drift_dn2 = step_dn**2 * count * (count + 1) / 12 if count > 1 else 0.0
        mean = 64 + K * 1000 + step_dn * (3 + (count - 1) / 2)
        closed = (mean, K**2 * 1000 + 1 / 12 + drift_dn2, 0.0)
        found = frames.theory.averages(frames.stages[-1])
        require_within_errors(found, closed)
        assert found.temporal == pytest.approx(closed[1], rel=0.05)
        measured = frames.digital.astype(float)
        assert abs(found.mean - measured.mean()) < 4 * found.errors[0] < 3 * step_dn
    assert measured.var(axis=0, ddof=1).mean() == pytest.approx(closed[1], rel=0.02)


@few
def test_standard_errors_are_the_spread_of_other_sensor_units() -> None:
    """24 places on the sensor: other random numbers. The spread of χ² of 23 is 15 %; three times of that is allowed."""
    camera = changed(pixel__prnu=0.01)
    found, errors = [], []
    for place in range(24):
        frames = ms.expose(light_of(8000.0, (32, 32)), camera, EXPOSURE, origin=(32 * place, 0))
        one = frames.theory.averages(frames.stages[-1])
        found.append(one[:3])
        errors.append(one.errors)
    spread, told = np.std(found, axis=0, ddof=1), np.sqrt(np.mean(np.square(errors), axis=0))
    assert spread == pytest.approx(told, rel=0.45)


# Frames of many sensor units


ROWS, COLUMNS = np.mgrid[:48, :64]
CHECKERED = 10_000.0 + 15_000.0 * ((ROWS // 8 + COLUMNS // 8) % 2)
STAR = np.where((abs(ROWS - 20) < 2) & (abs(COLUMNS - 30) < 2), 8e5, 0.2 * CHECKERED)
BLOOMING = ms.load_camera("konnik_table1").replace(
    **{"pixel.prnu": 0.01, "pixel.blooming": 1.0}
)
CHIPS, FRAMES = 24, 4


def noise_of_units(camera: ms.Camera, scene: np.ndarray) -> tuple[float, float, float]:
    """Mean, temporal and spatial σ of each pixel over units and frames, averaged over the pixels [DN]."""
    units = [
        ms.expose(scene, camera, EXPOSURE, serial=serial, frames=FRAMES).digital
        for serial in range(100, 100 + CHIPS)
    ]
    codes = np.array(units, float)
    temporal = codes.var(axis=1, ddof=1).mean()
    spatial = codes.mean(axis=1).var(axis=0, ddof=1).mean() - temporal / FRAMES
    return float(codes.mean()), float(temporal**0.5), float(max(spatial, 0.0) ** 0.5)


def test_the_image_that_a_scene_becomes_is_no_noise() -> None:
    """σ within 1.5 % or 4 standard errors: that of 24 units is 0.3 % temporal and 0.7 % spatial, in streaks more."""
    last = ms.expose(STAR, BLOOMING, EXPOSURE).report["stages"][-1]
    mean, temporal, spatial = noise_of_units(BLOOMING, STAR)
    assert abs(last["mean_expected"] - mean) < 0.02 * temporal + 4 * last["mean_error"]
    for part, measured in (("temporal", temporal), ("spatial", spatial)):
        error = last[f"sigma_{part}_error"]
        room = max(0.015 * measured, 4 * math.hypot(error, 0.007 * measured))
        assert abs(last[f"sigma_{part}_expected"] - measured) < room + 0.05


Z = np.linspace(-8, 8, 2001)
NORMAL = np.exp(-0.5 * Z**2) / np.exp(-0.5 * Z**2).sum()
LIGHT_E, SCALE_E, READ_E = 30.0, 20.0, 21.0


def by_quadrature(gamma: float, dsnu_e: float) -> tuple[float, float, float]:
    """Mean, temporal and spatial variance of the codes: counts, read noise, and offsets at 41 places."""
    counts = np.arange(*np.round(LIGHT_E + np.array([-9, 9]) * np.sqrt(LIGHT_E)).clip(0))
    chances = stats.poisson.pmf(counts, LIGHT_E)
    rate, gain = np.log(gamma) / SCALE_E, 4096 / SCALE_E
    offsets = Z[::50] if dsnu_e else np.zeros(1)
    weights = np.exp(-0.5 * offsets**2) / np.exp(-0.5 * offsets**2).sum()
    signal = counts[:, None, None] + dsnu_e * offsets[:, None] + READ_E * Z
    codes = np.floor(np.clip(gain * signal * np.exp(-rate * signal) + 0.5, 0, 4095))
    means, squares = (np.tensordot(chances, x @ NORMAL, 1) for x in (codes, codes**2))
    mean = means @ weights
    return mean, (squares - means**2) @ weights, (means - mean) ** 2 @ weights


@pytest.mark.parametrize(("gamma", "dsnu_e"), [(0.8, 25.0), (1.05, 0.0)])
def test_noise_wider_than_the_converter_and_its_curve_are_those_of_a_quadrature(
    gamma: float, dsnu_e: float
) -> None:
    """30 e- on a scale of 20 e-, noise of 21 e-: both clips and the curve between them."""
    camera = changed(
        pixel__dsnu_e=dsnu_e, source_follower__white_nv_per_rthz=None, source_follower__read_noise_e=READ_E,
        adc__gamma=gamma, adc__full_scale_v=SCALE_E * 5e-6, adc__black_level_dn=0.0,
    )  # fmt: skip
    frames = ms.expose(light_of(LIGHT_E, (64, 64)), camera, EXPOSURE)
    found = frames.theory.averages(frames.stages[-1])
    require_within_errors(found, by_quadrature(gamma, dsnu_e))


def test_measured_maps_are_spatial_noise_in_a_scene_with_and_without_a_coupling() -> None:
    """A map of 5 % of white noise; a coupling of 2 % leaves √0.848 of it."""
    white = np.random.default_rng(2).standard_normal(CHECKERED.shape)
    found = []
    for coupling in (0.0, 0.02):
        camera = TABLE1.replace(**{"readout.ipc_coupling": coupling})
        frames = ms.expose(CHECKERED, camera, EXPOSURE, maps={"prnu": 1 + 0.05 * white})
        found.append(frames.report["stages"][-1]["sigma_spatial_expected"])
    light_e = ms.expose(CHECKERED, TABLE1, EXPOSURE).detected.mean_e
    assert found[0] == pytest.approx(0.05 * K * math.sqrt(np.mean(light_e**2)), rel=0.03)
    assert found[1] / found[0] == pytest.approx(0.848**0.5, rel=0.03)


# The report


def test_a_report_has_the_frame_beside_what_is_expected_of_it() -> None:
    """600 × 700 pixels, of which a part is sampled: the mean follows the light of all of them."""
    ramp = np.broadcast_to(np.linspace(0.0, 20_000.0, 700), (600, 700))
    frames = ms.expose(
        ms.Photons(ramp, detected=True), ms.load_camera("konnik_table1"), EXPOSURE
    )
    report = frames.report
    assert report["theory"] == {
        "pixels": report["sampled_pixels"],
        "windows": 16,
        "samples_of_each": 4,
    }
    for stage in report["stages"]:
        sigma, error = (
            stage["sigma_expected"],
            math.hypot(stage["sigma_temporal_error"], stage["sigma_spatial_error"]),
        )
        assert abs(stage["sigma_frame"] - sigma) <= 5 * error + 0.01 * sigma
    last = report["stages"][-1]
    assert abs(last["mean_frame"] - frames.digital.mean()) < 6 * last["mean_error"] + 0.1
    assert abs(last["mean_expected"] - frames.digital.mean()) < 6 * last["mean_error"] + 0.1
    json.dumps(report, allow_nan=False)


@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (200, 1)])
@few
def test_frames_of_any_size_have_finite_figures(shape: tuple[int, int]) -> None:
    frames = ms.expose(light_of(1000.0, shape), ms.load_camera("konnik_table1"), EXPOSURE)
    json.dumps(
        [frames.report, *(row._asdict() for row in frames.noise_budget().rows)], allow_nan=False
    )
    ms.plan("konnik_table1", EXPOSURE, np.full(shape, 1000.0), 0.1).explain()


@pytest.mark.parametrize("kelvin", [4.0, 500.0])
@pytest.mark.parametrize("photons", [0.0, 1e300])
@few
def test_extreme_light_and_temperature_have_finite_figures(
    photons: float, kelvin: float
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of saturation, and of temperatures that are unusual
        frames = ms.expose(np.full((8, 8), photons), "konnik_table1", ms.Exposure(1.0, kelvin))
    json.dumps(frames.report, allow_nan=False)
    assert "nan" not in frames.noise_budget().explain()


class NoNumber(Drift):
    """Returns NaN in one pixel."""

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        broken = np.where(np.asarray(frame.window.columns)[None, :] == 5, np.nan, 0.0)
        return swing + frame.window.backend.from_numpy(
            broken + np.zeros(frame.window.shape), frame.window
        )


def test_a_stage_that_returns_no_number_is_named() -> None:
    camera = TABLE1.with_stage(NoNumber(), after="sense_node")
    with pytest.warns(RuntimeWarning, match="invalid value"):  # NumPy makes no code of NaN
        frames = ms.expose(light_of(10.0, (8, 8)), camera, EXPOSURE)
        with pytest.raises(ms.InputError, match="NoNumber returns NaN"):
            _ = frames.report
