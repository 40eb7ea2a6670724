"""Derivatives of photoelectrons and dark electrons apart, where one Poisson count of both is split by thinning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor import differentiable
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.stages.gains import gain_dn_per_e

problem = backend_problem("llvm")
pytestmark = pytest.mark.skipif(problem is not None, reason=f"derivatives need LLVM: {problem}")

SHAPE, LIGHT_E, DARK_E, SURE = (32, 512), 400.0, 150.0, 5.0
CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "pixel.prnu": 0.0,
        "readout.dsnu_col": 0.0,
        "dark_current": {"rate_e_per_s": DARK_E, "at_temperature_k": 298.15},
        "source_follower": {"read_noise_e": 12.0},
        "quantum_efficiency.value": 0.5,
        "adc.black_level_dn": 100.0,
    }
)


@dataclass(frozen=True)
class Weighted(ms.Stage):
    """Photoelectrons and dark electrons with a weight each."""

    light: float
    dark: float
    domain = "electrons"

    def sample(self, signal: ms.stages.Electrons, frame: ms.core.Frame) -> ms.stages.Array:
        return ms.stages.Electrons(signal.light * self.light, signal.dark * self.dark)


PARTS = [(1.0, 3.0), (1.0, 0.0), (0.0, 1.0), (2.0, 1.0)]


@pytest.mark.parametrize(("light", "dark"), one_in(4, PARTS, several=True))
def test_each_part_has_the_derivatives_of_its_own_poisson_law(
    light: float, dark: float
) -> None:
    """Mean and variance of w·n are w·λ and w²·λ. By chance beyond 5 standard errors, one of 16 in 100 000 runs."""
    camera = CAMERA.with_stage(Weighted(light, dark), after="shot_noise")
    names = {"photons": (LIGHT_E, light), "dark_current.rate_e_per_s": (DARK_E, dark)}
    photons = np.full(SHAPE, LIGHT_E / 0.5)
    frame = differentiable(
        photons, camera, ms.Exposure(1.0), tuple(names), seed=3, serial=5
    ).frame(1)
    frame.store()
    gain, codes = gain_dn_per_e(camera), frame.codes.astype(np.float64)
    off = codes - codes.mean()
    for name, (electrons, weight) in names.items():
        per_log = frame.forward(name).astype(np.float64) * (
            LIGHT_E / 0.5 if name == "photons" else DARK_E
        )
        for found, expected in (
            (per_log, gain * weight * electrons),
            (2 * off * (per_log - per_log.mean()), gain**2 * weight**2 * electrons),
        ):
            error = found.std() / np.sqrt(found.size)
            assert abs(found.mean() - expected) <= SURE * error + 1e-4 * expected, (
                name,
                found.mean(),
                expected,
            )
            # A chain without closed form: the derivative of the variance scatters as the square of the noise.
            variance = gain**2 * (light**2 * LIGHT_E + dark**2 * DARK_E)
            assert error <= 0.15 * max(expected, variance, gain**2 * electrons)
