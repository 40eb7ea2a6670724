"""Families of FPN maps against the distributions whose names they have.

Where a family is a quantile function its oracle is scipy's inverse survival function at evenly spread integers: no
chance at all. The rest has a fixed seed and 5 standard errors (one other seed in 2 million would fail a line).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from scipy import integrate, stats

from mitsuba_sensor.core import distributions
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.fpn_distributions import (
    Autoregressive,
    AutoregressiveRectified,
    Gamma,
    Gaussian,
    Logistic,
    LogNormal,
    Rectified,
    Wald,
)

FAMILIES = [
    Gaussian,
    LogNormal,
    Gamma,
    Wald,
    Logistic,
    Rectified,
    Autoregressive,
    AutoregressiveRectified,
]
CVS = [0.0, 0.01, 0.4, 1.0, 10.0]

INTEGERS = ((np.arange(4000) + 0.5) / 4000 * 2**32).astype(np.uint32)
SURVIVAL = distributions.survival(INTEGERS)
SHAPE = (300, 500)


def pattern(family: Any, cv: float) -> Any:
    return (
        family(cv, coupling=0.25)
        if issubclass(family, Autoregressive | AutoregressiveRectified)
        else family(cv)
    )


def map_of(
    family: Any, cv: float, shape: tuple[int, int] = SHAPE, origin: tuple[int, int] = (0, 0)
) -> Any:
    return pattern(family, cv).map_of(SensorWindow(7, shape, origin), "dark_fpn")


@pytest.mark.parametrize("cv", CVS[1:])
@pytest.mark.parametrize(
    ("family", "law"),
    [
        (
            LogNormal,
            lambda cv: stats.lognorm(math.sqrt(math.log1p(cv**2)), scale=(1 + cv**2) ** -0.5),
        ),
        (Gamma, lambda cv: stats.gamma(cv**-2, scale=cv**2)),
        (Rectified, lambda cv: stats.norm(1, cv)),
        (Gaussian, lambda cv: stats.norm(1, cv)),
        (Logistic, lambda cv: stats.logistic(1, math.sqrt(3) * cv / math.pi)),
    ],
    ids=["LogNormal", "Gamma", "Rectified", "Gaussian", "Logistic"],
)
def test_a_family_is_the_quantile_function_of_its_law(family: Any, law: Any, cv: float) -> None:
    """Every integer gives scipy's quantile, cut at zero and over the mean of what is cut: no chance, 1e-9."""
    raw = np.maximum(law(cv).isf(SURVIVAL), 0.0)
    mean = 1.0
    if family in (Gaussian, Logistic):
        mean = (
            integrate.quad(law(cv).sf, 0, 1, epsabs=1e-13)[0]
            + integrate.quad(law(cv).sf, 1, math.inf)[0]
        )
    np.testing.assert_allclose(
        family(cv).from_bits(NUMPY_FLOAT64, INTEGERS), raw / mean, rtol=1e-7, atol=1e-12
    )


@pytest.mark.parametrize("cv", CVS[1:])
def test_wald_picks_its_two_roots_with_the_chances_of_the_inverse_gaussian(cv: float) -> None:
    """Given z, the small root r comes with chance 1/(1 + r), else 1/r; summed over all z that is scipy's law.

    20 000 evenly spread z: the sum is a cdf to 1e-4, and a scale that is 1 % off moves it by 2.4e-3 or more.
    """
    z = stats.norm.ppf((np.arange(20_000) + 0.5) / 20_000)
    small, large = (
        distributions.wald(z, np.zeros(z.size), cv),
        distributions.wald(z, np.ones(z.size), cv),
    )
    chance = 1 / (1 + small)
    np.testing.assert_allclose(small * large, 1.0, rtol=1e-12)
    np.testing.assert_array_equal(distributions.wald(z, chance * (1 - 1e-12), cv), small)
    np.testing.assert_array_equal(distributions.wald(z, chance * (1 + 1e-12), cv), large)
    law = stats.invgauss(cv**2, scale=cv**-2)
    for p in (0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999):
        x = law.ppf(p)
        assert np.mean(chance * (small <= x) + (1 - chance) * (large <= x)) == pytest.approx(
            p, abs=2e-4
        )


@pytest.mark.parametrize("origin", one_in(2, [(0, 0), (37, 90), (500, 505)]), ids=str)
@pytest.mark.parametrize("family", FAMILIES, ids=lambda f: f.__name__)
def test_the_map_of_a_crop_is_the_crop_of_the_map(family: Any, origin: tuple[int, int]) -> None:
    """Bit for bit, also across the edges of the blocks that an AR map is made in (512)."""
    y, x = origin
    whole = map_of(
        family,
        0.4,
        (y + 16 - max(y - 5, 0), x + 16 - max(x - 5, 0)),
        (max(y - 5, 0), max(x - 5, 0)),
    )
    np.testing.assert_array_equal(
        map_of(family, 0.4, (12, 14), origin), whole[min(y, 5) :, min(x, 5) :][:12, :14]
    )


@pytest.mark.parametrize(
    "family", [Autoregressive, AutoregressiveRectified], ids=lambda f: f.__name__
)
@pytest.mark.parametrize("coupling", [0.0, 0.25, 0.45])
def test_neighbours_along_rows_and_columns_correlate_by_twice_the_coupling(
    family: Any, coupling: float
) -> None:
    """On a map, whose seams between blocks must not show; 5 standard errors from 64 tiles (0.006 at a = 0.25)."""
    x = family(0.01, coupling=coupling).map_of(SensorWindow(5, (1024, 1024)), "prnu") / 0.01
    x = x - 1 / 0.01
    for pairs in (x[:, 1:] * x[:, :-1], (x[1:] * x[:-1]).T):
        tiles = pairs[:, :1016].reshape(8, 128, 8, 127).mean(axis=(1, 3)) - 2 * coupling
        assert abs(tiles.mean()) < 5 * tiles.std(ddof=1) / 8
    seam = np.concatenate([x[:, 511] * x[:, 512], x[511] * x[512]])
    assert seam.mean() == pytest.approx(
        2 * coupling, abs=5 * 1.5 * math.sqrt((1 + 2 * coupling) / 2048 * 4)
    )


WIDTHS = (0.4, 1.0, 5.0, 10.0, 30.0, 50.0, 100.0)
DRAWN = [
    (family, cv)
    for family in (LogNormal, Gamma, Logistic, Gaussian, Rectified)
    for cv in WIDTHS
    if cv <= family.largest_cv
]


def drawable_integers() -> tuple[Any, Any]:
    """Integers and their weights: the 4096 at each end one by one, Gauss-Legendre on strata in between."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    ranks, shares = [np.arange(4096.0)], [np.ones(4096)]
    for low, high in pairwise(np.geomspace(4096, 2**31, 60)):
        ranks.append(np.rint(low + (high - low) * (nodes + 1) / 2 - 0.5))
        shares.append(weights * (high - low) / 2)
    rank, share = np.concatenate(ranks), np.concatenate(shares) / 2**32
    return np.concatenate([rank, 2**32 - 1 - rank]).astype(np.uint32), np.concatenate(
        [share, share]
    )


@pytest.mark.parametrize("backend", [NUMPY_FLOAT64, NUMPY_FLOAT32], ids=["float64", "float32"])
@pytest.mark.parametrize(("family", "cv"), one_in(3, DRAWN, several=True))
def test_theory_is_that_of_the_factors_that_32_bits_draw(
    family: Any, cv: float, backend: Any
) -> None:
    """No chance: an integral over all integers. Without their end a log-normal law of cv 100 has 21 % more σ."""
    bits, share = drawable_integers()
    factors = np.asarray(family(cv).from_bits(backend, bits), np.float64)
    mean = float(share @ factors)
    sigma = math.sqrt(float(share @ np.square(factors - mean)))
    cut = stats.norm(1, cv)
    whole = [cut.expect(lambda x, power=power: x**power, lb=0) for power in (1, 2)]
    assert mean == pytest.approx(whole[0] if family is Rectified else 1.0, rel=1e-3)
    widths = {LogNormal: LogNormal(cv).drawn_cv, Gamma: cv}
    of_cut = math.sqrt(whole[1] - whole[0] ** 2)
    widths |= {Rectified: of_cut, Gaussian: of_cut / whole[0]}
    if family in widths:
        assert sigma == pytest.approx(widths[family], rel=1e-3)
