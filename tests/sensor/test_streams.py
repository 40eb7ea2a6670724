"""Random streams by name: a noise source never depends on the others, on the window or on other frames."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
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
    return ms.stages.Frame(EXPOSURE, window, seed, index).normal(source)


def test_any_two_sources_are_uncorrelated() -> None:
    """|ρ| < 5.5/√n over 2^16 pixels or lines, seed and serial of the same number: 4e-8 false alarms a pair."""
    shapes = {None: (256, 256), 0: (2**16, 1), 1: (1, 2**16)}
    drawn = [
        normals(name, SensorWindow(4, shapes[LINES.get(name)])).ravel() for name in STREAMS
    ]
    rho = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(rho).max() < 5.5 / 2**8


def test_a_source_of_ones_own_has_a_stream_of_its_own() -> None:
    """A name that the package does not list: a block outside the listed ones, FPN apart from temporal noise."""
    assert stream_of("photon_shot") == STREAMS["photon_shot"]
    block, slot = stream_of("banding")
    assert 0x4000_0000 <= block < 0x8000_0000 and slot == 0
    assert stream_of("banding", fixed=True) == (block | FIXED_PATTERN, 0)
    assert len({stream_of(f"source {i}") for i in range(1000)}) == 1000
    window = SensorWindow(4, (64, 64))
    frame = ms.stages.Frame(EXPOSURE, window, 4)
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
