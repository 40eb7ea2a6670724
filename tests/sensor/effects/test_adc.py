"""Steps of the ADC: equal steps, steps of given widths, missing codes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.engines import backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.adc import Adc, AdcWithDnl

TABLE1 = ms.load_camera("konnik_table1")
HERE = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, (1, 1)))
PER_CODE = 1000
WITHOUT_BLACK_LEVEL = [
    name for name in ms.list_cameras() if ms.load_camera(name).adc.black_level_dn is None
]
"""Cameras that have the default."""


def ramp(bits: int, per_code: int = PER_CODE) -> Any:
    """From half a code below 0 to half a code above the last [DN], at the middle of 1/per_code steps."""
    return (np.arange(per_code * 2**bits) + 0.5) / per_code - 0.5


def some_dnl(bits: int) -> tuple[float, ...]:
    """Random widths in pairs of +d and −d, one missing code beside one twice as wide; first and last code ideal."""
    pairs = np.random.default_rng(bits).integers(-500, 500, 2 ** (bits - 1) - 1) / PER_CODE
    pairs[len(pairs) // 3] = -1.0
    return (0.0, *np.stack([pairs, -pairs], axis=1).ravel().tolist(), 0.0)


def test_transitions_lie_at_k_less_a_half_plus_the_running_sum_of_the_dnl() -> None:
    """T_k = (k − ½ + INL_k)·LSB, written out for three bits."""
    dnl = (0.5, 0.0, -0.5, 0.25, 0.0, -0.25, 0.0, 0.0)
    adc = AdcWithDnl(3, 2.0, 1.0, dnl)
    transitions = [1.0, 2.0, 2.5, 3.75, 4.75, 5.5, 6.5]
    for code, level in enumerate(transitions):
        for above in (0, 1):
            swing = (level + (above - 0.5) * 2e-9 - 1.0) / 2.0
            assert float(adc.sample(np.array([[swing]]), HERE)[0, 0]) == code + above


@pytest.mark.parametrize("missing", [1, 100, 254])
def test_a_code_of_dnl_minus_one_never_appears_and_its_neighbours_do(missing: int) -> None:
    """On a ramp and through a whole camera, whose 20 000 noisy pixels cross all 256 codes."""
    camera = TABLE1.replace(
        **{"adc.bits": 8, "adc.dnl_lsb": {str(missing): -1.0}, "adc.black_level_dn": 2.0}
    )
    adc = chain(camera)[-1]
    seen = set(np.unique((adc.sample(np.linspace(-0.01, 0.2, 50_000), HERE)).astype(int)))
    assert set(range(256)) - seen == {missing}
    light = np.broadcast_to(np.linspace(0, 60_000, 2000), (10, 2000))
    digital = ms.expose(light, camera, ms.Exposure(0.1)).digital
    assert missing not in digital and digital.max() == 255


@pytest.mark.parametrize("engine", ["float64", "numpy", "drjit"])
def test_24_bits_deliver_every_code_even_and_odd_in_every_precision(engine: str) -> None:
    """x + ½ is a tie from 2^23 on in float32, which would leave the even codes alone; whole numbers stay what they are.

    1000 codes on both sides of 2^23, of 3·2^22 and below the last one, given as whole numbers of codes.
    """
    backend = backend_of(engine)
    starts = (2**22 - 500, 2**23 - 500, 3 * 2**22, 2**24 - 1000)
    codes = np.concatenate([np.arange(start, start + 1000.0) for start in starts])[None]
    frame = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, codes.shape, backend=backend))
    swing = backend.from_numpy(codes, frame.window)
    np.testing.assert_array_equal(
        backend.to_numpy(Adc(24, 1.0, 0.0).sample(swing, frame), frame.window), codes
    )


def test_the_converter_rounds_half_up_and_stops_at_both_ends() -> None:
    adc = Adc(4, 1.0, 2.0)
    volts = np.array(
        [[-9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, np.inf, -np.inf]]
    )
    np.testing.assert_array_equal(
        adc.sample(volts, HERE), [[0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15, 0]]
    )


@pytest.mark.parametrize("name", WITHOUT_BLACK_LEVEL)
@pytest.mark.parametrize("change", [{"readout.reset": "hard"}, {"adc.bits": 8}], ids=str)
def test_the_default_black_level_is_a_whole_number_that_keeps_the_dark_uncut(
    name: str, change: dict[str, Any]
) -> None:
    """≥ 4σ of a zero exposure: less than 1e-4 of the pixels read 0; without it the dark mean would be 0.4σ too high."""
    camera = ms.load_camera(name)
    if camera.sensor.technology == "ccd" and "readout.reset" in change:
        change = {"source_follower.read_noise_e": 70.0}
    camera = camera.replace(**change)
    black_level = camera.black_level_dn
    assert black_level == int(black_level) and black_level >= 1
    digital = ms.expose(np.zeros((4, 20_000)), camera, ms.Exposure(0.0)).digital
    assert np.mean(digital == 0) < 3e-4 or camera.adc.bits == 8
    assert digital.mean() == pytest.approx(black_level, abs=0.05 * digital.std() + 0.02)
