"""Random streams by name: a noise source never depends on the others, on the window or on other frames."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import normals as normals_of
from mitsuba_sensor.core.counter_rng import FIXED_PATTERN, STREAMS, stream_of
from mitsuba_sensor.core.distributions import AR_BLOCK
from mitsuba_sensor.core.sensor_window import SensorWindow

CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "readout.reset": "hard",
        "readout.dsnu_col_coupling": 0.25,
        "dark_current.cv": 0.4,
        "pixel.prnu": 0.01,
    },
    **{"adc.black_level_dn": 64},
)
"""Every source on; the black level given, because by default it depends on the noise."""
EXPOSURE = ms.Exposure(0.1)
SHAPE = (24, 40)
LIGHT = np.linspace(100.0, 20_000.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)

OFF: dict[str, dict[str, Any]] = {
    "Prnu": {"pixel.prnu": 0.0},
    "DarkCurrent": {"dark_current.fom_na_per_cm2": 0.0},
    "dark FPN": {"dark_current.cv": 0.0},
    "ResetNoise": {"readout.reset": "true_cds"},
    "SourceFollowerNoise": {"source_follower.white_nv_per_rthz": 0.0},
    "DsnuColumn": {"readout.dsnu_col": 0.0},
}
"""Noise source → how a datasheet switches it off. (The shot noise of light goes with the light.)"""


def bits_used(
    camera: ms.Camera, light: Any = LIGHT, monkey: Any = None
) -> dict[str, NDArray[Any]]:
    """The random bits of each source in one frame, before any arithmetic."""
    drawn: dict[str, NDArray[Any]] = {}
    temporal, fixed, line, at = (
        ms.Frame.random_bits,
        SensorWindow.fixed_map,
        SensorWindow.line_map,
        ms.Frame.random_bits_at,
    )

    def temporal_bits(self: ms.Frame, source: str) -> Any:
        drawn[source] = temporal(self, source)
        return drawn[source]

    def pattern(self: SensorWindow, source: str, distribution: Any) -> Any:
        drawn[source] = fixed(self, source, lambda backend, bits: bits)
        return fixed(self, source, distribution)

    def line_pattern(self: SensorWindow, source: str, coupling: float, axis: int = 1) -> Any:
        drawn[source] = line(self, source, coupling, axis)
        return drawn[source]

    def bits_at(self: ms.Frame, source: str, *place: Any) -> Any:
        drawn.setdefault(source, at(self, source, *place))
        return at(self, source, *place)

    monkey.setattr(ms.Frame, "random_bits", temporal_bits)
    monkey.setattr(SensorWindow, "fixed_map", pattern)
    monkey.setattr(SensorWindow, "line_map", line_pattern)
    monkey.setattr(ms.Frame, "random_bits_at", bits_at)
    ms.expose(light, camera, EXPOSURE, seed=4, serial=9)
    monkey.undo()
    return drawn


def test_the_chain_draws_from_every_listed_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera with every effect draws from every listed stream and from no other; "compensation" is no longer drawn,
    and keeps its number so that the others keep theirs."""
    everything = CAMERA.replace(
        **{
            "readout.dsnu_row": 1e-3,
            "readout.prnu_col": 1e-3,
            "pixel.dsnu_e": 2.0,
            "dark_current.distribution": "wald",
            "dark_current.components": [
                {"weight": 0.1, "family": "uniform", "low": 1, "high": 9, "unit": "e"}
            ],
            "dark_current.rts_fraction": 0.5,
            "dark_current.rts_amplitude_e_per_s": 100.0,
            "source_follower.read_noise_cv": 0.3,
            "source_follower.noisy_pixel_fraction": 0.5,
            "source_follower.noisy_pixel_factor": 2.0,
            "source_follower.rtn_pixel_fraction": 0.5,
            "source_follower.rtn_pixel_amplitude_e": 10.0,
            "quantum_efficiency.quantum_yield": [2.0, 1.0],
            "pixel.hits_per_cm2_s": 1.0,
        }
    )
    asked = set(bits_used(everything, monkey=monkeypatch))
    assert asked == set(STREAMS) - {"compensation"}


@pytest.mark.parametrize("source", OFF)
def test_switching_a_source_off_leaves_every_bit_of_the_others(
    source: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The datasheet without it draws the same random bits for all other sources, and fewer of them."""
    whole = bits_used(CAMERA, monkey=monkeypatch)
    rest = bits_used(CAMERA.replace(**OFF[source]), monkey=monkeypatch)
    assert set(rest) < set(whole)
    for name, drawn in rest.items():
        np.testing.assert_array_equal(drawn, whole[name])


def test_a_crop_across_a_block_of_coupled_columns_is_the_frame_of_the_crop() -> None:
    """The stripes are made in blocks of 4096 columns: windows inside, across and beyond a border see the same bits."""
    light = np.full((2, 2 * AR_BLOCK + 50), 1000.0)
    whole = ms.expose(light, CAMERA, EXPOSURE, keep=("volts",)).volts
    for first, width in (
        (0, 10),
        (AR_BLOCK - 5, 10),
        (AR_BLOCK, 3),
        (AR_BLOCK - 1, AR_BLOCK + 2),
        (2 * AR_BLOCK - 1, 20),
    ):
        part = ms.expose(
            light[:, :width], CAMERA, EXPOSURE, keep=("volts",), origin=(0, first)
        ).volts
        np.testing.assert_array_equal(part, whole[:, :, first : first + width])


LINES = {"dsnu_col": 1, "prnu_col": 1, "dsnu_row": 0}
"""Sources with one value per line, and the axis along which they change."""


def normals(source: str, window: SensorWindow, seed: int = 4, index: int = 0) -> NDArray[Any]:
    """The normal values of any source, temporal or fixed."""
    if source in LINES:
        return window.line_map(source, 0.0, LINES[source])
    if STREAMS[source][0] & FIXED_PATTERN:
        return window.fixed_map(source, lambda backend, bits: backend.normal(bits))
    return ms.Frame(EXPOSURE, window, seed, index).normal(source)


@pytest.mark.parametrize(
    ("one", "two"),
    one_in(4, itertools.combinations(STREAMS, 2), several=True),
    ids=lambda name: name,
)
def test_two_sources_are_uncorrelated(one: str, two: str) -> None:
    """|ρ| < 5/√n over 2^16 pixels, seed and serial of the same number: 6e-7 false alarms a pair."""
    axes = {LINES[name] for name in (one, two) if name in LINES}
    if len(axes) == 2:  # a row and a column: compare them as two vectors
        a, b = (
            normals(name, SensorWindow(4, ((2**16, 1), (1, 2**16))[LINES[name]])).ravel()
            for name in (one, two)
        )
        assert abs(np.mean(a * b)) < 5 / 2**8
        return
    shape = {None: (256, 256), 1: (1, 2**16), 0: (2**16, 1)}[axes.pop() if axes else None]
    window = SensorWindow(4, shape)
    a, b = normals(one, window).ravel(), normals(two, window).ravel()
    assert abs(np.mean(a * b)) < 5 / 2**8


def test_a_source_of_ones_own_has_a_stream_of_its_own() -> None:
    """A name that the package does not list: a block outside the listed ones, FPN apart from temporal noise."""
    assert stream_of("photon_shot") == STREAMS["photon_shot"]
    block, slot = stream_of("banding")
    assert 0x4000_0000 <= block < 0x8000_0000 and slot == 0
    assert stream_of("banding", fixed=True) == (block | FIXED_PATTERN, 0)
    assert len({stream_of(f"source {i}") for i in range(1000)}) == 1000
    window = SensorWindow(4, (64, 64))
    frame = ms.Frame(EXPOSURE, window, 4)
    own, fixed = frame.normal("banding"), window.fixed_map("banding", normals_of)
    correlated = window.correlated("banding of pixels", 0.2)
    for a, b in itertools.combinations(
        (own, fixed, correlated, frame.normal("photon_shot")), 2
    ):
        assert abs(np.mean(a * b)) < 5 / 64


def test_nothing_is_drawn_from_numpys_global_state_or_the_clock() -> None:
    np.random.seed(1)
    one = ms.expose(LIGHT, CAMERA, EXPOSURE).digital
    state = np.random.get_state()[1].copy()
    np.random.seed(2)
    np.testing.assert_array_equal(ms.expose(LIGHT, CAMERA, EXPOSURE).digital, one)
    np.random.seed(1)
    np.testing.assert_array_equal(np.random.get_state()[1], state)
