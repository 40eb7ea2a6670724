"""Radiation hits: how many pixels are hit, how much charge they get, and what theory says of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.radiation_hits import SCALE, RadiationHits

BASE = ms.load_camera("eso_efosc2").replace(**{"pixel.prnu": 0.0, "adc.black_level_dn": 300.0})
FLUX, HIT_E = 1e4, 1500.0
HITS = {"pixel.hits_per_cm2_s": FLUX, "pixel.hit_e": HIT_E}
HIT = BASE.replace(**HITS)
COLD = ms.Exposure(2.0, 150.0)
CHANCE = 1 - math.exp(-FLUX * 15e-4**2 * 2.0)
"""4.4 % of the pixels of 15 µm in two seconds."""


def charges(index: int = 0, flux: float = FLUX) -> np.ndarray:
    """What a million pixels without electrons have behind the stage [e-]."""
    stage = RadiationHits(flux * 1e-8, HIT_E, 225.0)
    window = SensorWindow(1, (1000, 1000), backend=NUMPY_FLOAT32)
    dark = np.zeros((1000, 1000), np.float32)
    frame = ms.stages.Frame(COLD, window, index=index)
    return np.asarray(stage.sample(ms.stages.Electrons(dark, dark), frame).total, np.float64)


def test_as_many_pixels_are_hit_as_particles_cross_them() -> None:
    """p = 1 − e^(−flux·area·t), within 4 standard errors of a million pixels: chance fails 1 in 16 000."""
    hit = charges() > 0
    error = math.sqrt(CHANCE * (1 - CHANCE) / hit.size)
    assert hit.mean() == pytest.approx(CHANCE, abs=4 * error)


def test_the_charge_of_a_hit_has_the_distribution_of_moyal() -> None:
    """Kolmogorov's test against scipy's at 1 in 10 000, of 22 000 charges that are spread over their electron again; of
    these pixels 0.6 % are hit twice."""
    found = np.concatenate([charges(index, FLUX / 4).ravel() for index in range(2)])
    hits_e = found[found > 0] + np.random.default_rng(3).uniform(-0.5, 0.5, (found > 0).sum())
    law = scipy.stats.moyal(HIT_E, SCALE * HIT_E)
    assert hits_e.size > 15_000
    assert scipy.stats.kstest(hits_e, law.cdf).pvalue > 1e-4
    stage = RadiationHits(FLUX * 1e-8, HIT_E, 225.0)
    assert stage.mean_e == pytest.approx(law.mean(), rel=1e-12)


@pytest.mark.parametrize("hits", [0.5, 4.0, 300.0])
def test_many_particles_leave_the_charge_of_all(hits: float) -> None:
    """Mean λ·μ and variance λ·(σ² + μ²), within 5 standard errors of 250 000 pixels."""
    stage = RadiationHits(hits / 225.0 / 2.0, HIT_E, 225.0)
    frame = ms.stages.Frame(COLD, SensorWindow(1, (500, 500)))
    found = stage.sample(ms.stages.Electrons(np.zeros((500, 500)), 0.0), frame).total
    mean_e, square = hits * stage.mean_e, (found - hits * stage.mean_e) ** 2
    assert found.mean() == pytest.approx(mean_e, abs=5 * found.std() / 500)
    expected = hits * ((math.pi * SCALE * HIT_E) ** 2 / 2 + 1 / 12 + stage.mean_e**2)
    assert square.mean() == pytest.approx(expected, abs=5 * square.std() / 500)
    assert found.min() >= 0


def test_theory_and_noise_budget_have_what_frames_with_hits_show() -> None:
    """12 frames of 65 536 pixels have 35 000 hits: 4 standard errors of the mean are 1.5 DN, of the variance 3 %."""
    frames = ms.expose(np.full((256, 256), 500.0), HIT, COLD, frames=12)
    codes = frames.digital.astype(np.float64)
    last = frames.theory.averages(frames.stages[-1])
    assert codes.mean() == pytest.approx(last.mean, abs=1.5)
    assert codes.var(axis=0, ddof=1).mean() == pytest.approx(last.temporal, rel=0.03)
    named = {entry.source: entry for entry in frames.noise_budget().entries}
    law = scipy.stats.moyal(HIT_E, SCALE * HIT_E)
    added_e2 = -math.log(1 - CHANCE) * (law.var() + law.mean() ** 2)
    added_dn2 = HIT.system_gain_dn_per_e**2 * added_e2
    assert named["radiation hits"].temporal_dn2 == pytest.approx(added_dn2, rel=0.01)
