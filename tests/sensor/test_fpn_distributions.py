"""Families of FPN maps against the distributions whose names they have.

Where a family is a quantile function its oracle is scipy's inverse survival function at evenly spread integers: no
chance at all. The rest has a fixed seed and 5 standard errors (one other seed in 2 million would fail a line).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from mitsuba_sensor.core import distributions
from mitsuba_sensor.core.backend import NUMPY_FLOAT64
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
CVS = [0.01, 0.4, 10.0]

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


@pytest.mark.parametrize("cv", CVS)
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


@pytest.mark.parametrize("cv", CVS)
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


@pytest.mark.parametrize("origin", [(37, 90), (37, 505)], ids=str)
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
