"""Dark current over time and temperature against what went in and against the simulator's closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_current import dark_current, dark_temperature
from mitsuba_sensor.lab.quantity import Quantity

RATE, GAIN, READ_DN = 200.0, 0.5, 2.0
"""Electrons per second, DN per electron, and the read noise [DN] of the NumPy camera."""
TIMES_S = (0.1, 0.5, 1.0, 2.0)
SHAPE = (20, 24)
BOLTZMANN_EV_PER_K = 8.617333262e-5


def dark_stacks(
    rng: np.random.Generator, pattern: np.ndarray, drift_dn: float = 0.0
) -> list[Stack]:
    """6 frames with Poisson electrons of a dark-current pattern, and a black level that drifts."""
    stacks = []
    for time in TIMES_S:
        electrons = rng.poisson(RATE * time * pattern, (6, *SHAPE))
        read = READ_DN * rng.normal(size=electrons.shape) + drift_dn * rng.normal(
            size=(6, 1, 1)
        )
        codes = np.floor(GAIN * electrons + 100 + read + 0.5).astype(np.uint16)
        stacks.append(Stack(codes, time, photons=0))
    return stacks


@pytest.mark.parametrize(
    ("drift_dn", "runs"), one_in(2, [(0.0, 200), (1.0, 300)], several=True)
)
def test_intervals_cover_the_dark_current_95_times_in_100(drift_dn: float, runs: int) -> None:
    """Shares within 6 %, which chance leaves once in 9000 runs; the pattern of a chip is part of its dark current."""
    rng, covered = np.random.default_rng(1), np.zeros(2)
    for _ in range(runs):
        pattern = 1 + 0.05 * rng.normal(size=SHAPE)
        found = dark_current(dark_stacks(rng, pattern, drift_dn)).quantities
        covered += [x.in_electrons(GAIN).covers(RATE * float(pattern.mean())) for x in found]
    assert covered / runs == pytest.approx([0.95, 0.95], abs=0.06)


def test_table_1s_camera_has_1741_58_electrons_per_second_at_298_k() -> None:
    """Of a camera with dark-current FPN of 1 %: 4 standard errors; both of EMVA's estimates."""
    camera, dark = ms.load_camera("konnik_table1"), np.zeros((100, 120))
    stacks = [
        Stack(ms.expose(dark, camera, ms.Exposure(t), frames=8, seed=i).digital, t)
        for i, t in enumerate((0.1, 1.0, 4.0))
    ]
    from_mean, from_variance = (
        x.in_electrons(0.1241212) for x in dark_current(stacks).quantities
    )
    assert from_mean.value == pytest.approx(1741.58, rel=0.0006)
    assert from_variance.value == pytest.approx(1741.58, rel=4 * 0.0045)


def test_points_of_a_curve_are_not_on_a_line() -> None:
    rng = np.random.default_rng(3)
    means = {t: np.full((20, 20), 100 + 50 * t**2) for t in (0.5, 1.0, 2.0, 3.0)}
    bent = [Stack(frames(rng, mean, 6, Sigmas(0, 0, 2)), t) for t, mean in means.items()]
    found = dark_current(bent).from_mean
    assert "straight line" in found.note and found.high - found.low > 100


def measured(value: float, relative: float = 0.01) -> Quantity:
    ends = (value * (1 + sign * 1.96 * relative) for sign in (-1, 1))
    return Quantity("µ_I.mean", "", value, *ends, "e-/s", "")


def test_the_doubling_temperature_and_the_activation_energy_are_those_of_the_law() -> None:
    """300 sets of 6 temperatures with errors of 1 %: shares within 4.2 % of 95 %, beyond once in 1000 runs."""
    rng, t, covered = np.random.default_rng(7), np.linspace(290, 330, 6), np.zeros(2)
    laws = 100 * 2 ** ((t - 300) / 7.5), 1e12 * np.exp(-0.63 / (BOLTZMANN_EV_PER_K * t))
    for _ in range(300):
        error = np.exp(0.01 * rng.normal(size=6))
        doubling, arrhenius = (
            dark_temperature({k: measured(x) for k, x in zip(t, law * error, strict=True)})
            for law in laws
        )
        covered += [doubling.doubling.covers(7.5), arrhenius.activation.covers(0.63)]
    assert covered / 300 == pytest.approx([0.95, 0.95], abs=0.042)


def test_the_simulators_dark_current_has_half_the_band_gap() -> None:
    """D ∝ T^1.5·exp(−E_g/2kT): E_a = E_g/2 + 1.5·kT, and E_g falls by its own derivative; at 300 K and
    308 K gives 2027.87 e-/s and 1.8930 times as much, so T_d = 8/log2(1.8930)."""
    currents = {300.0: measured(2027.87, 1e-4), 308.0: measured(2027.87 * 1.8930, 1e-4)}
    found = dark_temperature(currents)
    assert found.doubling.covers(8 / math.log2(1.8930))
    derivative = 7.021e-4 * 304 * (304 + 2 * 1108) / (304 + 1108) ** 2
    gap = 1.1557 - 7.021e-4 * 304**2 / (304 + 1108)
    energy = (gap + derivative * 304) / 2 + 1.5 * BOLTZMANN_EV_PER_K * 304
    assert found.activation.value == pytest.approx(energy, rel=0.001)


def test_currents_at_zero_are_left_out_and_one_temperature_is_too_few() -> None:
    nothing = Quantity("µ_I.mean", "", 0.0, -1.0, 1.0, "e-/s", "")
    found = dark_temperature({280.0: nothing, 300.0: measured(10.0), 310.0: measured(20.0)})
    assert found.doubling.covers(10) and "280 K left out" in found.doubling.note
    for wrong in (
        {280.0: nothing, 300.0: measured(1.0)},
        {-5.0: measured(5.0), 300.0: measured(9.0)},
    ):
        with pytest.raises(ms.InputError, match="temperatures"):
            dark_temperature(wrong)
    falling = dark_temperature({300.0: measured(20.0), 310.0: measured(10.0)}).doubling
    assert math.isnan(falling.value) and falling.note


def test_stacks_that_show_less_are_marked_or_refused() -> None:
    """Single frames have a mean and no variance; clipped exposures are left out; a falling black level is named."""
    stacks = dark_stacks(np.random.default_rng(5), np.ones(SHAPE))
    found = dark_current([Stack(x.frames[:1], x.exposure_s) for x in stacks])
    assert found.from_mean.value == pytest.approx(RATE * GAIN, rel=0.012)
    assert math.isnan(found.from_variance.value) and found.from_variance.note
    full = Stack(np.full_like(stacks[0].frames, 4095), 100.0, bits=12)
    left_out = dark_current([*stacks, full]).from_mean
    assert "100 s left out (every value is 4095 DN)" in left_out.note and left_out.covers(100)
    rng = np.random.default_rng(2)
    falling = [Stack(100 - 5 * t + rng.normal(size=(4, 30, 30)), t) for t in TIMES_S]
    current = dark_current(falling).from_mean
    assert current.high < 0 and "negative" in current.note
    one, other, *_ = stacks
    for wrong, named in (
        (full, "there are 1"),
        (one, "there are 1"),
        (Stack(other.frames, 0.5, temperature_k=300), "300 K"),
        (Stack(other.frames, 0.5, gain="ISO 200"), "ISO 200"),
        (other.window(slice(0, 4), slice(0, 4)), "4 × 4"),
    ):
        with pytest.raises(ms.InputError, match=named):
            dark_current([one, wrong])
