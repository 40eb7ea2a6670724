"""Every stage of cameras with every option against its own moments: test_stages.py, for what a datasheet may add.

Nothing here names a stage that must be tested: it walks ``chain(camera)`` over a dozen cameras rich in options.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Electrons, Photons
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.digital import AdcWithSteps, IntegralNonlinearity
from mitsuba_sensor.sensor.electrons import QuantumYield, RtsPixels
from mitsuba_sensor.sensor.volts import (
    DsnuColumn,
    DsnuPixel,
    DsnuRow,
    NonlinearSenseNode,
    NonlinearSourceFollower,
    PrnuColumn,
)

EXACT = 1e-9
INDICES = (0, 100, 200)
"""Frames so far apart that a blinking pixel has forgotten its state: 0.8^100 = 2e-10."""

WIDE, TALL, SQUARE = (2, 100_000), (100_000, 2), (480, 480)
"""What a window shows: many columns, many rows, or a map with neighbours both ways. Each is cut into 64 blocks whose
spread is the sampling error, so without assuming any law. 200 000 pixels in 3 frames: 5 standard errors are 1.1 % of
a temporal and 2.2 % of a column variance (0.6 and 1.1 % of a σ)."""

BASE = ms.load_camera("konnik_table1")
UNIFORM = [{"weight": 0.2, "family": "uniform", "low": 100, "high": 900, "unit": "e"}]
NORMAL = [{"weight": 0.1, "family": "normal", "mean": 60, "sigma": 20, "unit": "dn"},
          {"weight": 0.1, "family": "uniform", "low": 1000, "high": 3000, "unit": "e_per_s"}]  # fmt: skip
BLINKING = {"dark_current.rts_fraction": 0.5, "dark_current.rts_amplitude_e_per_s": 2000.0,
            "dark_current.rts_switching": 0.2, "dark_current.rts_duty": 0.3}  # fmt: skip
COLUMNS = {"readout.dsnu_col": 0.002, "readout.dsnu_col_coupling": 0.25, "readout.prnu_col": 0.005,
           "readout.prnu_col_coupling": 0.2}  # fmt: skip
DOUBLING = {"dark_current.fom_na_per_cm2": None, "dark_current.rate_e_per_s": 3000.0,
            "dark_current.at_temperature_k": 293.15, "dark_current.doubling_k": 8.0}  # fmt: skip

CASES: dict[str, tuple[tuple[int, int], float, dict[str, Any]]] = {
    "gamma dark, parts, columns": (WIDE, 0.3, COLUMNS | {
        "dark_current.distribution": "gamma", "dark_current.cv": 0.4, "dark_current.components": UNIFORM}),
    "wald dark, parts in dn and e_per_s, soft reset": (WIDE, 0.1, DOUBLING | {
        "dark_current.distribution": "wald", "dark_current.cv": 0.4, "dark_current.components": NORMAL,
        "readout.reset": "soft"}),
    "logistic dark, lognormal prnu, kTC residual": (WIDE, 0.4, {
        "dark_current.distribution": "logistic", "dark_current.cv": 0.4, "pixel.prnu_distribution": "lognormal",
        "pixel.prnu": 0.05, "readout.ktc_residual": 0.3}),
    "blinking, pixel offsets, residual": (WIDE, 0.2, BLINKING | {
        "pixel.dsnu_e": 50.0, "readout.dsnu_residual": 0.4, "readout.dsnu_col": 0.004}),
    "blinking in the dark": (WIDE, 0.0, BLINKING | {"readout.dsnu_col": 0.0}),
    "yield and mpp": (WIDE, 0.25, {
        "quantum_efficiency.quantum_yield": [1.8, 1.8], "quantum_efficiency.fano_factor": 0.2,
        "dark_current.diffusion_fom_na_per_cm2": 0.5, "pixel.prnu": 0.02}),
    "yield of two, blinking, parts": (WIDE, 0.2, BLINKING | {
        "quantum_efficiency.quantum_yield": [2.0, 2.0], "dark_current.components": UNIFORM}),
    "rows": (TALL, 0.3, {
        "readout.dsnu_row": 0.002, "readout.dsnu_row_coupling": 0.45, "readout.dsnu_col": 0.0}),
    "neighbours": (SQUARE, 0.3, {
        "pixel.prnu_distribution": "ar", "pixel.prnu": 0.03, "pixel.prnu_coupling": 0.25, "pixel.dsnu_e": 30.0,
        "pixel.dsnu_coupling": 0.25, "dark_current.distribution": "ar", "dark_current.cv": 0.4,
        "dark_current.coupling": 0.2, "readout.dsnu_col": 0.0}),
    "V/e and V/V": (WIDE, 0.6, {
        "readout.ve_nonlinearity": 1.0, "readout.v_ref_v": 1.0, "source_follower.vv_nonlinearity": 1.05,
        "source_follower.gain": 0.85, "pixel.prnu": 0.01}),
    "k1, ADC gamma, columns": (WIDE, 0.5, COLUMNS | {
        "readout.sense_gain_uv_per_e": None, "readout.ve_k1_c": 10.909e-15, "readout.ve_nonlinearity": 0.5,
        "pixel.full_well_e": 20_000.0, "adc.gamma": 1.16, "readout.cds_gain": 2.0}),
    "all curves, hard reset, 14 bit": (WIDE, 0.5, COLUMNS | BLINKING | {
        "readout.ve_nonlinearity": 0.8, "source_follower.vv_nonlinearity": 0.9, "adc.ile": 0.02, "adc.bits": 14,
        "readout.reset": "hard", "pixel.dsnu_e": 20.0}),
    "band, telegraph noise, 16 bit": (WIDE, 0.2, {
        "source_follower.band_hz": [10.0, 2e7], "source_follower.rtn_uv": 200.0, "source_follower.rtn_s": 1e-6,
        "adc.bits": 16}),
}  # fmt: skip


def camera_of(case: str) -> ms.Camera:
    return BASE.replace(**CASES[case][2])


def blocks(x: Any, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Averages over 64 blocks of the window."""
    whole = np.broadcast_to(x, shape)
    if shape == SQUARE:
        return whole.reshape(8, 60, 8, 60).mean(axis=(1, 3)).ravel()
    long = whole if shape == WIDE else whole.T
    return long[:, : 64 * 1562].reshape(2, 64, -1).mean(axis=(0, 2))


def assert_agrees(what: str, deviation: Any, scale: float, shape: tuple[int, int], exact: float = EXACT) -> None:
    parts = blocks(deviation, shape)
    error = 5 * parts.std(ddof=1) / 8 + exact * scale
    assert abs(parts.mean()) <= error, f"{what}: off by {parts.mean():.4g} ± {error:.2g} of {scale:.4g}"


@pytest.mark.parametrize("case", CASES)
def test_every_stage_has_the_moments_that_it_says(case: str, backend: Backend) -> None:
    """Mean, temporal and fixed variance after every stage, within 5 standard errors of 64 blocks.

    Chance: 3 × 16 comparisons in 13 cases at P(|t₆₃| > 5) = 5e-6: one other seed in 300 would fail somewhere.
    """
    shape, level, _ = CASES[case]
    camera = camera_of(case)
    light = Photons(np.full(shape, level * camera.pixel.full_well_e / 0.6 / camera_yield(camera)))
    window = SensorWindow(7, shape)
    theory = Frame(ms.Exposure(0.1), window, 5)
    window = SensorWindow(7, shape, backend=backend)
    frames = [Frame(ms.Exposure(0.1), window, 5, index) for index in INDICES]
    signals: list[Any] = [light] * len(frames)
    m = Moments(light, 0.0, 0.0, theory)
    exact = EXACT if backend is NUMPY_FLOAT64 else 3e-7
    for stage in chain(camera):
        signals = [stage(signal, frame) for signal, frame in zip(signals, frames, strict=True)]
        m = stage.moments(m)
        plain = [s.total if isinstance(s, Electrons) else s for s in signals]
        x = np.array([backend.to_numpy(s, window) for s in plain], dtype=np.float64)
        mean, temporal = x.mean(axis=0), x.var(axis=0, ddof=1)
        off = mean - m.mean
        fixed = off**2 - temporal / len(frames)
        size = float(np.max(m.mean))
        variance = float(np.mean(m.temporal) + np.mean(m.spatial)) + exact * size**2
        assert_agrees(f"mean after {stage}", off, size, shape, exact)
        assert_agrees(f"temporal variance after {stage}", temporal - m.temporal, variance, shape, exact)
        assert_agrees(f"fixed variance after {stage}", fixed - m.spatial, variance, shape, exact)


def camera_yield(camera: ms.Camera) -> float:
    return (camera.quantum_efficiency.quantum_yield or (1.0,))[0]


def test_the_cases_hold_every_optional_stage() -> None:
    """So that no option is only believed to be tested above; steps of an ADC have tests of their own."""
    seen = {type(stage) for case in CASES for stage in chain(camera_of(case))}
    assert {RtsPixels, QuantumYield, NonlinearSenseNode, NonlinearSourceFollower, IntegralNonlinearity} <= seen
    assert {DsnuColumn, DsnuRow, DsnuPixel, PrnuColumn} <= seen


SMALL = Frame(ms.Exposure(0.1), SensorWindow(3, (4, 50)))
SWING = np.linspace(0, 0.2, 200).reshape(4, 50)
CHARGE = Electrons(np.linspace(0, 4e4, 200).reshape(4, 50).round(), np.full((4, 50), 174.0))


@pytest.mark.parametrize(
    ("stage", "signal"),
    [
        (RtsPixels(0.0, 100.0, 0.1, 0.5), CHARGE),
        (RtsPixels(0.5, 0.0, 0.1, 0.5), CHARGE),
        (QuantumYield(0.1), CHARGE),
        (NonlinearSourceFollower(1.0, 1.0, 0.165), SWING),
        (DsnuRow(0.0, 5e-6, 0.25), SWING),
        (DsnuPixel(0.0, 5e-6, 0.25), SWING),
        (DsnuColumn(33.0, 5e-6, 0.25, residual=0.0), SWING),
        (PrnuColumn(0.0, 0.25), SWING),
        (IntegralNonlinearity(1.0, 0.165), SWING),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_neutral_value_changes_nothing_exactly(stage: Any, signal: Any) -> None:
    """Bit for bit, and in theory too."""
    after = stage(signal, SMALL)
    pairs = [(after, signal)] if signal is SWING else [(after.light, signal.light), (after.dark, signal.dark)]
    for out, into in pairs:
        np.testing.assert_array_equal(out, into)
    m = stage.moments(replace(Moments(0.1, 0.2, 0.3, SMALL)))
    assert (float(m.mean), float(m.temporal), float(m.spatial)) == (0.1, 0.2, 0.3)


NEUTRAL: dict[str, dict[str, Any]] = {
    "curves": {"source_follower.vv_nonlinearity": 1.0, "readout.ve_nonlinearity": 0.0, "adc.gamma": 1.0},
    "ile": {"adc.ile": 0.0},
    "dnl": {"adc.dnl_lsb": {"7": 0.0}},
    "offsets": {
        "readout.dsnu_row": 0.0,
        "readout.dsnu_row_coupling": 0.3,
        "pixel.dsnu_e": 0.0,
        "readout.prnu_col": 0.0,
    },
    "residual": {"readout.dsnu_residual": 1.0, "readout.ktc_residual": 0.0},
    "parts": {"dark_current.components": [{"weight": 0.0, "family": "uniform", "low": 5, "high": 6, "unit": "e"}]},
    "no blinking": {"dark_current.rts_fraction": 0.0, "dark_current.rts_amplitude_e_per_s": 500.0},
    "blinking by nothing": {"dark_current.rts_fraction": 0.5, "dark_current.rts_amplitude_e_per_s": 0.0},
    "uncoupled": {"pixel.prnu_coupling": 0.0, "pixel.dsnu_coupling": 0.0},
    "mpp without diffusion": {"dark_current.diffusion_fom_na_per_cm2": 0.0},
    "yield of one": {"quantum_efficiency.quantum_yield": [1.0, 1.0], "quantum_efficiency.fano_factor": 0.5},
    "no telegraph": {"source_follower.rtn_uv": 0.0, "source_follower.rtn_s": 1e-3},
}


@pytest.mark.parametrize("option", NEUTRAL)
def test_a_neutral_option_of_a_camera_gives_the_same_bytes(option: str) -> None:
    light = np.linspace(0, 60_000, 600).reshape(20, 30)
    frame = ms.expose(light, BASE.replace(**NEUTRAL[option]), ms.Exposure(0.1), frames=2).digital
    assert frame.tobytes() == ms.expose(light, BASE, ms.Exposure(0.1), frames=2).digital.tobytes()


@pytest.mark.parametrize("case", CASES)
def test_stages_are_equal_by_value_hashable_documented_and_in_the_order_of_the_rooms(case: str) -> None:
    one, two = chain(camera_of(case)), chain(camera_of(case))
    assert one == two and hash(one) == hash(two)
    rooms = [stage.domain for stage in one]
    assert rooms == sorted(rooms, key=["electrons", "volts", "DN"].index)
    for stage in one:
        assert type(stage).__doc__ and type(stage).__call__.__doc__ and stage.moments.__doc__


def test_a_crop_and_a_single_frame_of_the_richest_camera_are_cut_from_the_whole() -> None:
    """All options at once: window and frame number change no bit."""
    camera = camera_of("all curves, hard reset, 14 bit").replace(
        **{"dark_current.components": UNIFORM, "readout.dsnu_row": 0.002, "pixel.dsnu_coupling": 0.25,
           "quantum_efficiency.quantum_yield": [1.5, 1.5], "adc.dnl_lsb": {"700": -1.0}}
    )  # fmt: skip
    light = np.linspace(0, 20_000, 24 * 30).reshape(24, 30)
    whole = ms.expose(light, camera, ms.Exposure(0.1), frames=3, origin=(500, 4090)).digital
    part = ms.expose(light[5:20, 3:28], camera, ms.Exposure(0.1), first_frame=2, origin=(505, 4093)).digital
    np.testing.assert_array_equal(part[0], whole[2, 5:20, 3:28])
    assert any(isinstance(stage, AdcWithSteps) for stage in chain(camera))
