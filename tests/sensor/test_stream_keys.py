"""What temporal noise and fixed patterns depend on: two frames share them where they must, and nowhere else.

Correlations are of n = 2^16 pixels; |ρ| < 5/√n fails by chance in 6e-7 of the comparisons.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.counter_rng import key_of
from mitsuba_sensor.core.sensor_window import SensorWindow

SHAPE, LIMIT = (256, 256), 5 / 2**8
EXPOSURE = ms.Exposure(0.1)
# No fixed pattern, and a step of the converter of half an electron: what differs from frame to frame is all there is.
CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "pixel.prnu": 0.0,
        "readout.dsnu_col": 0.0,
        "dark_current.cv": 0.0,
        "adc.bits": 16,
        "adc.black_level_dn": 200,
    },
    **{"readout.reset": "hard"},
)
OTHERS: dict[str, tuple[ms.Camera, ms.Exposure, dict[str, int]]] = {
    "serial": (CAMERA, EXPOSURE, {"serial": 2}),
    "camera": (CAMERA.replace(name="another"), EXPOSURE, {}),
    "time": (CAMERA, ms.Exposure(0.2), {}),
    "zero exposure": (CAMERA, ms.Exposure(0.0), {}),
    "temperature": (CAMERA, ms.Exposure(0.1, 300.15), {}),
    "seed": (CAMERA, EXPOSURE, {"seed": 2}),
    "frame": (CAMERA, EXPOSURE, {"first_frame": 1}),
    "seed and serial exchanged": (CAMERA, EXPOSURE, {"seed": 7, "serial": 1}),
}
SERIAL_7 = {"seed and serial exchanged": {"seed": 1, "serial": 7}}


def correlation(a: Any, b: Any) -> float:
    return float(np.corrcoef(np.ravel(a), np.ravel(b))[0, 1])


@pytest.mark.parametrize("photons", [0.0, 1000.0])
def test_no_two_frames_of_another_chip_camera_exposure_seed_or_number_share_noise(
    photons: float,
) -> None:
    """In darkness read and kTC noise, in light shot noise: with the same seed they were shared, ρ 0.95 to 1."""
    light = np.full(SHAPE, photons)
    for name, (camera, exposure, options) in OTHERS.items():
        one = ms.expose(light, CAMERA, EXPOSURE, **SERIAL_7.get(name, {})).digital
        other = ms.expose(light, camera, exposure, **options).digital
        assert one.std() > 5
        assert abs(correlation(one, other)) < LIMIT, name


CONDITIONS: tuple[tuple[str, Any], ...] = (
    ("window", SensorWindow(5, SHAPE, camera="a")),
    ("window", SensorWindow(4, SHAPE, camera="b")),
    ("exposure", ms.Exposure(0.1 * (1 + 1e-8))),
    ("exposure", ms.Exposure(0.1, 298.16)),
    ("gain", "800"),
    ("seed", 5),
    ("index", 1),
)


@pytest.mark.parametrize("source", ["photon_shot", "source_follower"])
def test_no_source_has_the_same_numbers_under_other_conditions(source: str) -> None:
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(4, SHAPE, camera="a"), seed=4)
    for name, value in CONDITIONS:
        assert (
            abs(
                correlation(
                    frame.normal(source),
                    replace(frame, **{name: value}, _blocks={}).normal(source),
                )
            )
            < LIMIT
        )


def fixed(source: str, serial: int, camera: str) -> Any:
    window = SensorWindow(serial, SHAPE, camera=camera)
    return window.fixed_map(source, lambda backend, bits: backend.normal(bits))


@pytest.mark.parametrize("source", ["prnu", "dsnu_col"])
def test_fixed_patterns_are_those_of_one_chip_of_one_camera(source: str) -> None:
    maps = [fixed(source, *one) for one in ((1, "a"), (2, "a"), (1, "b"), (11, ""))]
    for one, other in itertools.combinations(maps, 2):
        assert abs(correlation(one, other)) < LIMIT
    lines = [SensorWindow(1, (1, 2**16), camera=name).line_map(source, 0.25) for name in "ab"]
    assert (
        abs(correlation(*lines)) < LIMIT * 3**0.5
    )  # neighbours are coupled: fewer independent values


def test_a_key_is_of_values_and_not_of_how_they_are_written() -> None:
    """Whole numbers, NumPy's, −0, and the last bits of an exposure make no other frame."""

    def key(time_s: Any, kelvin: Any = 298.15, seed: Any = 1, serial: Any = 1) -> int:
        return ms.stages.Frame(
            ms.Exposure(time_s, kelvin), SensorWindow(serial, (1, 1), camera="a"), seed
        ).key

    assert (
        key(1)
        == key(1.0)
        == key(np.float32(1.0))
        == key(np.int64(1), np.float64(298.15), np.uint8(1), np.int16(1))
    )
    assert (
        key(0.0) == key(-0.0)
        and key(0.3) == key(0.1 + 0.2)
        and key(33.3 / 1000) == key(33.3e-3)
    )
    keys = {
        key(t, k, seed, serial)
        for t in (0, 1, 1e-12)
        for k in (0, 1)
        for seed in (0, 2**63)
        for serial in (0, 1)
    }
    assert len(keys) == 24 and all(0 <= one < 2**64 for one in keys)
    assert (
        len(
            {
                key_of("a", "b"),
                key_of("ab", ""),
                key_of("a", 1),
                key_of("a", "1"),
                key_of("a1"),
                key_of(1.0),
            }
        )
        == 6
    )
