"""Noise of the source follower after CDS: printed values, limits, and the integrals that the closed forms stand for."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from decimal import Decimal, getcontext

import numpy as np
import pytest
from scipy import integrate

from mitsuba_sensor.core.special import two_term_remainder
from mitsuba_sensor.stages.effects.source_follower_noise import CdsNoise, flicker_integral

PAPER = CdsNoise(white_nv_per_rthz=15.0, corner_hz=1e6, sample_s=1e-6, dominant_s=0.5e-6)
VOLTS_PER_E = 5e-6
RTN = replace(PAPER, white_nv_per_rthz=0.0, rtn_uv=200.0)


WHITE = replace(PAPER, corner_hz=0.0)
PRINTED = [  # electrons; a frequency grid of 10 kHz gives 0.218 e- for the third
    (WHITE, 3.226245),
    (PAPER, 6.105069),
    (replace(PAPER, sample_s=1e-4, dominant_s=0.5e-4), 5.19300),
    (replace(RTN, rtn_s=50e-9), 6.6102),
    (replace(RTN, rtn_s=1e-6), 17.8268),
    (replace(RTN, rtn_s=10e-6), 10.1226),
    (replace(RTN, rtn_s=1e-3), 1.1012),
    (replace(RTN, rtn_s=1.0), 0.034855),
    (replace(PAPER, white_nv_per_rthz=0.0), 0.0),
]


@pytest.mark.parametrize(("noise", "expected"), PRINTED)
def test_the_noise_has_its_printed_value(noise: CdsNoise, expected: float) -> None:
    assert noise.sigma_v / VOLTS_PER_E == pytest.approx(expected, rel=3e-5)
    assert flicker_integral(2.0) == pytest.approx(1.115785799, abs=5e-10)


@pytest.mark.parametrize("a", [1e-3, 0.02, 0.1, 1.0, 2.0, 10.0, 40.0])
def test_the_flicker_integral_is_the_integral_that_it_stands_for(a: float) -> None:
    """J(a) = ∫₀^∞ (1 − cos(a·u))/(u·(1 + u²)) du, by quadrature over half-periods and a tail."""
    edges = np.concatenate([[0], np.arange(1, 400) * np.pi / a])
    body = sum(
        integrate.quad(lambda u: (1 - math.cos(a * u)) / (u * (1 + u * u)), p, q)[0]
        for p, q in itertools.pairwise(edges)
    )
    tail = 0.5 * math.log1p(edges[-1] ** -2)
    assert flicker_integral(a) == pytest.approx(body + tail, rel=1e-5)


@pytest.mark.parametrize("a", np.logspace(-9, 9, 19))
def test_noise_is_finite_at_every_ratio_of_sample_to_dominant_time(a: float) -> None:
    """t_s/τ_D from 1e-9 to 1e9: the plain forms are NaN from 710 up and lose all digits below 1e-4."""
    noise = replace(PAPER, sample_s=a * 0.5e-6, rtn_uv=200.0)
    assert noise.white_v2 > 0 and noise.flicker_v2 > 0 and noise.rtn_v2 > 0
    assert math.isfinite(noise.sigma_v)
    twice = replace(noise, rtn_s=2 * noise.dominant_s)
    assert twice.rtn_v2 > 0 and math.isfinite(twice.sigma_v)


@pytest.mark.parametrize("rtn_s", np.logspace(-9, -4, 11))
def test_telegraph_noise_is_the_integral_that_it_stands_for(rtn_s: float) -> None:
    """∫ ΔV²·r/(1 + ω²r²) · (2 − 2cos ωt_s)/(1 + ω²τ_D²) df with r = τ_RTN/2, by parts that quadrature can do.

    Both factors are Lorentzian: ∫₀^∞ (2 − 2cos ωt)/((1 + ω²r²)(1 + ω²τ²)) df, scaled to u = ωτ_D.
    """
    noise = replace(RTN, rtn_s=rtn_s)
    r, tau, t = rtn_s / 2, noise.dominant_s, noise.sample_s
    value = integrate.quad(
        lambda u: 1 / ((1 + (u * r / tau) ** 2) * (1 + u * u)), 0, np.inf, limit=500
    )[0]
    # ∫ cos(k·u) with QUADPACK's Fourier weight, which needs no half-periods.
    k = t / tau
    wave = integrate.quad(
        lambda u: 1 / ((1 + (u * r / tau) ** 2) * (1 + u * u)), 0, np.inf, weight="cos", wvar=k
    )[0]
    expected = (200e-6) ** 2 * r * 2 * (value - wave) / (2 * math.pi * tau)
    assert noise.rtn_v2 == pytest.approx(expected, rel=2e-4)


@pytest.mark.parametrize("x", [1e-12, 1e-9, 1e-5, 0.99e-3, 1.01e-3, 0.1, 2.0, 1e3])
def test_the_remainder_of_two_terms_keeps_its_digits(x: float) -> None:
    """1 − e^(−x)·(1 + x), which cancels to x²/2 when x is small, against 60 decimal digits."""
    getcontext().prec = 60
    exact = 1 - (-Decimal(x)).exp() * (1 + Decimal(x))
    assert two_term_remainder(x) == pytest.approx(float(exact), rel=1e-9)
