"""Noise behind a curve, wider than the scale of the converter, or from far beyond it onto it: by quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.marks import one_in
from scipy import stats

import mitsuba_sensor as ms

PER_E, HIGHEST = 5e-6, 4095  # V/e- of Table 1
Z = np.linspace(-8, 8, 2001)
NORMAL = np.exp(-0.5 * Z**2) / np.exp(-0.5 * Z**2).sum()


def camera(gamma: float, scale_e: float, read_e: float, dsnu_e: float) -> ms.Camera:
    """Black level 0; a full scale of so many electrons."""
    return ms.load_camera("konnik_table1").replace(
        **{
            "pixel.prnu": 0.0,
            "pixel.dsnu_e": dsnu_e,
            "dark_current.fom_na_per_cm2": 0.0,
            "readout.dsnu_col": 0.0,
            "source_follower.white_nv_per_rthz": None,
            "source_follower.read_noise_e": read_e,
            "adc.gamma": gamma,
            "adc.full_scale_v": scale_e * PER_E,
            "adc.black_level_dn": 0.0,
        }
    )


def by_quadrature(
    gamma: float, scale_e: float, read_e: float, dsnu_e: float, light_e: float
) -> tuple[float, float, float]:
    """Mean, temporal and spatial variance of the codes: all counts, read noise, and offsets at 41 places."""
    counts = np.arange(*np.round(light_e + np.array([-9, 9]) * np.sqrt(light_e)).clip(0))
    chances = stats.poisson.pmf(counts, light_e)
    rate, gain = np.log(gamma) / scale_e, HIGHEST / scale_e * (1 + 1 / HIGHEST)
    offsets = Z[::50] if dsnu_e else np.zeros(1)
    weights = np.exp(-0.5 * offsets**2) / np.exp(-0.5 * offsets**2).sum()
    means, squares = np.zeros((2, offsets.size))
    for k, offset in enumerate(offsets):
        for count, chance in zip(counts[::3], chances[::3] / chances[::3].sum(), strict=True):
            signal = count + dsnu_e * offset + read_e * Z
            code = np.floor(np.clip(gain * signal * np.exp(-rate * signal) + 0.5, 0, HIGHEST))
            means[k] += chance * (code @ NORMAL)
            squares[k] += chance * (code**2 @ NORMAL)
    mean = means @ weights
    return mean, (squares - means**2) @ weights, (means - mean) ** 2 @ weights


@pytest.mark.parametrize(
    ("gamma", "percent"),
    one_in(3, [(0.8, 2.5), (0.95, 1.0), (0.999, 0.5), (1.05, 1.0)], several=True),
)
@pytest.mark.parametrize("dsnu_e", one_in(2, [0.0, 25.0]))
def test_tails_come_onto_the_scale_along_the_curve_there(
    gamma: float, percent: float, dsnu_e: float
) -> None:
    """A scale of 20 e- under 21 e- of noise, and light of 1.5 and 6 scales: up to 4σ beyond its end."""
    asked = (gamma, 20.0, 21.0, dsnu_e)
    for electrons in (30.0, 120.0):
        frames = ms.expose(
            ms.Photons(np.full((1, 1), electrons), detected=True),
            camera(*asked),
            ms.Exposure(0.1),
        )
        found = frames.theory.averages(frames.stages[-1])
        mean, *variances = by_quadrature(*asked, electrons)
        far, errors = 0.03 * (electrons > 100), found.errors  # 4 σ beyond the end
        unseen = 3 / 96  # 95 % bound of what none of 24 × 4 samples shows (rule of three)
        short = HIGHEST - mean
        assert HIGHEST - found.mean == pytest.approx(
            short, rel=2 * percent / 100 + far, abs=unseen + 4 * errors[0]
        )
        if short < unseen:  # a tail that so few samples do not see: the page of theory says so
            continue
        for value, expected, error in zip(found[1:3], variances, errors[1:], strict=True):
            assert value == pytest.approx(
                expected, rel=2 * percent / 100 + 2 * far, abs=0.01 + 4 * error
            )
