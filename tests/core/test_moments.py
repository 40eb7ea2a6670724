"""Moments of sums, products and clipped normal signals, against quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.moments import rectified_normal
from mitsuba_sensor.core.sensor_window import SensorWindow

FRAME = ms.Frame(ms.Exposure(0.1), SensorWindow(1, (1, 1)))


def of(mean: float, temporal: float, fixed: float) -> ms.Moments:
    return ms.Moments(mean, temporal, fixed, FRAME)


def cut_moments(m: ms.Moments, low: float, high: float) -> tuple[float, float, float]:
    """Mean, temporal and fixed variance by brute force: a sum over the fixed part of exact normal moments."""
    z = np.linspace(-8, 8, 4001)
    weight = stats.norm.pdf(z)
    weight /= weight.sum()
    centre, sigma = m.mean + math.sqrt(m.spatial) * z, math.sqrt(m.temporal)
    a, b = (low - centre) / sigma, (high - centre) / sigma
    inside, pa, pb = stats.norm.cdf(b) - stats.norm.cdf(a), stats.norm.pdf(a), stats.norm.pdf(b)
    first = (
        centre * inside + sigma * (pa - pb) + low * stats.norm.cdf(a) + high * stats.norm.sf(b)
    )
    second = (centre**2 + sigma**2) * inside + sigma * (
        pa * (centre + low) - pb * (centre + high)
    )
    second = second + low**2 * stats.norm.cdf(a) + high**2 * stats.norm.sf(b)
    mean = np.sum(weight * first)
    return (
        float(mean),
        float(np.sum(weight * (second - first**2))),
        float(np.sum(weight * (first - mean) ** 2)),
    )


@pytest.mark.parametrize("sigma", [0.0, 1e-200, 1e-12, 1e-3, 0.0999, 0.1001, 0.4, 1.0, 10.0])
def test_rectified_normal_has_the_moments_of_its_definition(sigma: float) -> None:
    """max(0, 1 + σz), by quadrature of its survival function; a tiny σ keeps its variance to the last digit."""
    mean, variance = rectified_normal(sigma)
    if sigma < 0.05:
        assert mean == 1.0 and variance == sigma * sigma
        return
    top = 1 + 40 * sigma
    first = integrate.quad(
        lambda x: stats.norm.sf((x - 1) / sigma), 0, top, points=[1], epsabs=1e-12, limit=200
    )[0]
    second = integrate.quad(
        lambda x: 2 * x * stats.norm.sf((x - 1) / sigma), 0, top, points=[1], limit=200
    )[0]
    assert mean == pytest.approx(first, rel=1e-9)
    assert variance == pytest.approx(second - first**2, rel=1e-7)


@pytest.mark.parametrize("ratio", [0.01, 0.5, 0.99])
@pytest.mark.parametrize("centre", [-4.0, -1.0, 0.0, 1.0, 3.0])
@pytest.mark.parametrize("side", ["above", "below"])
def test_a_normal_signal_cut_at_one_edge_has_exact_moments(
    centre: float, ratio: float, side: str
) -> None:
    """The edge ``centre`` standard deviations from the mean, a share ``ratio`` of the variance fixed."""
    m = of(50.0, 4.0 * (1 - ratio), 4.0 * ratio)
    edges = (-1e3, 50.0 + 2 * centre) if side == "above" else (50.0 - 2 * centre, 1e3)
    cut = m.clip(*edges)
    mean, temporal, fixed = cut_moments(m, *edges)
    assert float(cut.mean) == pytest.approx(mean, rel=1e-12)
    assert float(cut.temporal) == pytest.approx(temporal, rel=1e-5, abs=1e-9)
    assert float(cut.spatial) == pytest.approx(fixed, rel=1e-5, abs=1e-9)


def test_cutting_far_away_changes_nothing_and_cutting_everything_leaves_the_edge() -> None:
    m = of(50.0, 4.0, 1.0)
    far = m.clip(0.0, 100.0)
    assert (float(far.mean), float(far.temporal), float(far.spatial)) == (50.0, 4.0, 1.0)
    for edges, edge in (((-9e3, -1e3), -1e3), ((1e3, 9e3), 1e3)):
        cut = m.clip(*edges)
        assert float(cut.mean) == pytest.approx(edge, rel=1e-9)
        assert 0 <= float(cut.temporal) < 1e-9 and 0 <= float(cut.spatial) < 1e-9


@pytest.mark.parametrize("mean", [math.inf, 1e300])
def test_an_infinite_signal_is_cut_to_its_edge_without_nan(mean: float) -> None:
    for m in (of(mean, mean, 0.0), of(mean, mean, math.inf), of(mean, mean, math.nan)):
        cut = m.clip(0.0, 4095.0)
        assert float(cut.mean) == 4095.0
        assert float(cut.temporal) == 0.0 and float(cut.spatial) == 0.0


def test_a_signal_without_noise_is_cut_like_a_number() -> None:
    for value, expected in ((-3.0, 0.0), (0.0, 0.0), (7.0, 7.0), (20.0, 10.0)):
        cut = of(value, 0.0, 0.0).clip(0.0, 10.0)
        assert float(cut.mean) == expected and cut.sigma == 0.0


def test_gain_multiplies_sigma_and_independent_parts_add_their_variance() -> None:
    m = of(10.0, 4.0, 9.0).scale(3.0).add(mean=5.0, temporal=1.0, spatial=2.0)
    assert (m.mean, m.temporal, m.spatial) == (35.0, 37.0, 83.0)
    assert m.sigma == pytest.approx(math.sqrt(120))
