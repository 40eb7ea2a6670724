"""Steps of the ADC: equal steps, steps of given widths, missing codes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import StageTests, backend_of

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.adc import Adc, AdcWithDnl
from mitsuba_sensor.stages.gains import gain_dn_per_e

TABLE1 = ms.load_camera("konnik_table1")
DARKNESS = {"dark_current.fom_na_per_cm2": 0.0}
HERE = ms.Frame(ms.Exposure(0.1), SensorWindow(3, (1, 1)))
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


@pytest.mark.parametrize("bits", range(1, 17))
def test_quantisation_error_on_a_ramp_is_0_288675_lsb_at_every_resolution(bits: int) -> None:
    """1/√12 of a step, mean 0, no code outside 0 … 2^bits − 1: an exact sum over the ramp (100 places per code)."""
    x = ramp(bits, 100)
    codes = Adc(bits, 1.0, 0.0).sample(x, HERE)
    assert np.std(codes - x) == pytest.approx(0.288675, rel=1e-4)
    assert abs(np.mean(codes - x)) < 1e-9
    np.testing.assert_array_equal(np.bincount(codes.astype(int)), 100)


@pytest.mark.parametrize("bits", range(1, 17))
def test_steps_of_no_dnl_are_the_equal_steps_bit_for_bit(bits: int) -> None:
    gain, x = 2.0**bits / 0.165, np.linspace(-0.01, 0.18, 20_001)
    steps = AdcWithDnl(bits, gain, 3.0, (0.0,) * 2**bits)
    np.testing.assert_array_equal(steps.sample(x, HERE), Adc(bits, gain, 3.0).sample(x, HERE))


@pytest.mark.parametrize("bits", [2, 4, 8, 10])
def test_a_code_density_ramp_gives_the_dnl_back(bits: int) -> None:
    """Hits per code over the hits of an ideal step, less one: exact for widths that are whole places of the ramp.

    (To two places: transitions and ramp are sums of decimal fractions and may round to either side.)
    """
    dnl, x = some_dnl(bits), ramp(bits)
    codes = AdcWithDnl(bits, 1.0, 0.0, dnl).sample(x, HERE).astype(int)
    hits = np.bincount(codes, minlength=2**bits)
    np.testing.assert_allclose(hits / PER_CODE - 1, dnl, atol=2.1 / PER_CODE)
    assert (np.diff(codes) >= 0).all()


def test_transitions_lie_at_k_less_a_half_plus_the_running_sum_of_the_dnl() -> None:
    """T_k = (k − ½ + INL_k)·LSB, written out for three bits."""
    dnl = (0.5, 0.0, -0.5, 0.25, 0.0, -0.25, 0.0, 0.0)
    adc = AdcWithDnl(3, 2.0, 1.0, dnl)
    transitions = [1.0, 2.0, 2.5, 3.75, 4.75, 5.5, 6.5]
    for code, level in enumerate(transitions):
        for above in (0, 1):
            swing = (level + (above - 0.5) * 2e-9 - 1.0) / 2.0
            assert float(adc.sample(np.array([[swing]]), HERE)[0, 0]) == code + above


@pytest.mark.parametrize("missing", [1, 7, 100, 254])
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


def test_the_camera_refuses_a_step_narrower_than_nothing_and_a_code_without_two_edges() -> None:
    """The first and the last code take all that lies beyond them: they have no width (IEEE 1241)."""
    with pytest.raises(
        ms.InputError,
        match=r"adc\.dnl_lsb\.7 is -1\.01; it must be at least -1",
    ):
        TABLE1.replace(**{"adc.dnl_lsb": {"7": -1.01}})
    for code in ("0", "4095", "4096", "-1", "seven", "1.5"):
        with pytest.raises(
            ms.InputError, match=f"dnl_lsb names the code '{code}'; .* run from 1 to 4094"
        ):
            TABLE1.replace(**{"adc.dnl_lsb": {code: 0.5}})


def test_codes_keep_their_range_and_type_at_every_resolution() -> None:
    """A ramp from darkness to twice the full well, 1 to 16 bits and 24: first and last code, and a type that fits."""
    light = np.linspace(0, 110_000, 4000)[None]
    for bits in (*range(1, 17), 24):
        camera = TABLE1.replace(
            **{"adc.bits": bits, "adc.black_level_dn": 0.0, "adc.full_scale_v": 0.1} | DARKNESS
        )
        digital = ms.expose(light, camera, ms.Exposure(0.1)).digital
        assert digital.dtype == (
            np.uint8 if bits <= 8 else np.uint16 if bits <= 16 else np.uint32
        )
        assert digital.min() == 0 and digital.max() == 2**bits - 1


@pytest.mark.parametrize("engine", ["float64", "numpy", "drjit"])
def test_24_bits_deliver_every_code_even_and_odd_in_every_precision(engine: str) -> None:
    """x + ½ is a tie from 2^23 on in float32, which would leave the even codes alone; whole numbers stay what they are.

    1000 codes on both sides of 2^23, of 3·2^22 and below the last one, given as whole numbers of codes.
    """
    backend = backend_of(engine)
    starts = (2**22 - 500, 2**23 - 500, 3 * 2**22, 2**24 - 1000)
    codes = np.concatenate([np.arange(start, start + 1000.0) for start in starts])[None]
    frame = ms.Frame(ms.Exposure(0.1), SensorWindow(3, codes.shape, backend=backend))
    swing = backend.from_numpy(codes, frame.window)
    np.testing.assert_array_equal(
        backend.to_numpy(Adc(24, 1.0, 0.0).sample(swing, frame), frame.window), codes
    )


def test_24_bits_are_rounded_half_up_in_float64() -> None:
    x = np.array([[2.0**23 - 0.5, 2.0**23 + 0.25, 2.0**23 + 0.5, 2.0**24 - 1.75, 2.0**24 + 9]])
    expected = [[2**23, 2**23, 2**23 + 1, 2**24 - 2, 2**24 - 1]]
    np.testing.assert_array_equal(Adc(24, 1.0, 0.0).sample(x, HERE), expected)


def test_a_camera_of_24_bits_takes_float64_unless_float32_is_asked_for_and_then_has_odd_codes_too() -> (
    None
):
    """Half of the codes are odd, within 5 standard errors of 20 000 noisy pixels at 0.75 of the range."""
    camera, light = (
        TABLE1.replace(**{"adc.bits": 24}),
        np.full((2, 10_000), 0.75 * 33_000 / 0.6),
    )
    assert (
        ms.expose(light, camera, ms.Exposure(0.0)).first.window.backend.precision == "float64"
    )
    for bits, precision in ((23, "float32"), (24, "float64")):
        given = ms.expose(light[:, :4], TABLE1.replace(**{"adc.bits": bits}), ms.Exposure(0.0))
        assert given.first.window.backend.precision == precision
    for precision in ("float32", "float64"):
        digital = ms.expose(light, camera, ms.Exposure(0.0), precision=precision).digital
        assert digital.min() > 2**23
        assert np.mean(digital % 2) == pytest.approx(0.5, abs=5 * 0.5 / math.sqrt(digital.size))


def test_steps_of_unequal_width_at_24_bits_are_refused_in_float32_and_made_in_float64() -> None:
    """An edge at k − ½ has no float32 from 2^23 on."""
    camera = TABLE1.replace(**{"adc.bits": 24, "adc.dnl_lsb": {"7": 0.5}})
    light = np.full((4, 4), 1000.0)
    with pytest.raises(
        ms.InputError,
        match=r"no halves between codes from 8388608 on, .*adc\.dnl_lsb and 24 bits; .*23",
    ):
        ms.expose(light, camera, ms.Exposure(0.01), precision="float32")
    assert ms.expose(light, camera, ms.Exposure(0.01)).backend.precision == "float64"


@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_unequal_steps_keep_the_moments_that_they_say(level: float) -> None:
    """Noise of ten codes over small random steps: mean within 0.15 DN of the theory, variance within 5 %.

    The theory moves the mean by the INL of one code, where noise averages the INL of forty; that is the difference.
    """
    dnl = tuple(float(x) for x in np.random.default_rng(2).normal(0, 0.02, 1024))
    adc, mean, sigma = AdcWithDnl(10, 1.0, 0.0, dnl), 1024 * level, 10.0
    x = mean + sigma * np.random.default_rng(3).standard_normal(200_000)
    m = adc.moments(ms.Moments(mean, sigma**2, 0.0, HERE))
    codes = adc.sample(x, HERE)
    assert codes.mean() == pytest.approx(
        float(m.mean), abs=0.15 + 5 * sigma / math.sqrt(x.size)
    )
    assert codes.var() == pytest.approx(float(m.temporal), rel=0.05)


class TestAdc(StageTests):
    stage = Adc
    camera = TABLE1.replace(**{"adc.bits": 16})


class TestAdcOf8Bits(TestAdc):
    camera = TABLE1.replace(**{"adc.bits": 8})
    level = 0.5


class TestAdcWithoutABlackLevel(TestAdc):
    camera = TABLE1.replace(**{"adc.black_level_dn": 0.0, "adc.bits": 14})
    level = 0.0


class TestAdcThatClipsBeforeTheWell(TestAdc):
    camera = TABLE1.replace(**{"pixel.full_well_e": 50_000.0, "adc.full_scale_v": 0.165})
    level = 0.657


class TestAdcWithSteps(StageTests):
    """A wide step, a missing code and a narrow one; the noise covers many codes, so the moments hold."""

    stage = AdcWithDnl
    camera = TABLE1.replace(**{"adc.dnl_lsb": {"100": 0.5, "511": -1.0, "900": 0.3}})


def test_the_full_well_spans_the_whole_code_range_whatever_the_gains() -> None:
    """K = A_SN·A_SF·A_CDS·2^bits/V_FS, and V_FS is the swing of a full well unless the datasheet says otherwise."""
    camera = ms.load_camera("konnik_table1")
    assert gain_dn_per_e(camera) == pytest.approx(0.1241212, rel=1e-6)
    gains = camera.replace(
        **{"source_follower.gain": 0.8, "readout.cds_gain": 4.0, "adc.bits": 14}
    )
    assert gain_dn_per_e(gains) == pytest.approx(2**14 / 33_000, rel=1e-12)
    fixed = gains.replace(**{"adc.full_scale_v": 1.0})
    assert gain_dn_per_e(fixed) == pytest.approx(5e-6 * 0.8 * 4 * 2**14, rel=1e-12)


def test_the_converter_rounds_half_up_and_stops_at_both_ends() -> None:
    adc = Adc(4, 1.0, 2.0)
    volts = np.array(
        [[-9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, np.inf, -np.inf]]
    )
    np.testing.assert_array_equal(
        adc.sample(volts, HERE), [[0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15, 0]]
    )


@pytest.mark.parametrize("name", WITHOUT_BLACK_LEVEL)
@pytest.mark.parametrize(
    "change", [{}, {"readout.reset": "hard"}, {"adc.bits": 16}, {"adc.bits": 8}], ids=str
)
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
