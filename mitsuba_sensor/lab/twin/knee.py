"""Knee of the full well: the variance of flat fields that falls before a pixel or the converter is full."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...core.code_law import code_moments
from ...core.types import Float64Array
from ..frames.series import Series
from ..measure.saturation import Peak
from ..quantity import TWO_SIDED

FROM = 0.5
"""Of the signal at the largest variance, from which on levels are looked at."""
FULL = 0.5
"""Of the largest variance, below which pixels are full or clipped: the level says nothing of a knee."""
FEWEST = 8
"""Levels that a knee needs, of which FEWEST_BEHIND are not below the largest variance."""
FEWEST_BEHIND = 3
OF_MODEL = 0.01
"""Share of the variance that other causes may move."""
CLEARLY = 12.0
"""Fall of half the squared deviations, by one more number, from which on there is a knee."""
WIDEST = 0.1
"""Of the full well, as in a camera file."""
LIGHT = 80
NODES, SHARES = np.polynomial.hermite_e.hermegauss(9)
STARTS = (0.01, 0.04)


@dataclass(frozen=True)
class Knee:
    """(value, low, high) of the full well and of the width of its knee [e-]."""

    well_e: tuple[float, float, float]
    width_e: tuple[float, float, float]


class Electrons(NamedTuple):
    """Signal and slope of the response for so many electrons [DN, DN/e-]."""

    signal: Callable[[Float64Array], Float64Array]
    slope: Callable[[Float64Array], Float64Array]


def find_knee(
    measured: Series, end: Peak, response: Electrons, end_e: float, noise_dn2: float
) -> Knee | None:
    """Full well and knee of the levels about saturation; None where a clip gives them as well.

    end_e : electrons at the largest variance, about.  noise_dn2 : in the dark, without rounding.
    """
    levels = _Levels.of(measured, end, response, end_e, noise_dn2)
    if levels is None:
        return None
    clips = [levels.cost(np.array([share * end_e, 0.0])) for share in (0.95, 1.0, 1.05, 1e3)]
    fits = []
    for width in STARTS:
        start = np.log([1.05 * end_e, width * end_e])
        fits.append(
            scipy.optimize.least_squares(
                lambda p: levels.deviations(np.exp(p)), start, diff_step=1e-3, x_scale=0.05
            )
        )
    best = min(fits, key=lambda fit: float(fit.cost))
    well, width = map(float, np.exp(best.x))
    if float(best.cost) > levels.best_clip(min(clips)) - CLEARLY or width > WIDEST * well:
        return None
    scatter = max(1.0, 2 * float(best.cost) / max(levels.count - 2, 1))
    covariance = np.linalg.inv(best.jac.T @ best.jac) * scatter
    halves = TWO_SIDED * np.sqrt(np.diag(covariance))
    well_e, width_e = (
        (x, x * math.exp(-half), x * math.exp(half))
        for x, half in zip((well, width), halves, strict=True)
    )
    return Knee(well_e, width_e)


@dataclass(frozen=True, eq=False)
class _Levels:
    """The levels about saturation, and what a well would make of them.

    spread : of the gains of the pixels, relative.  noise_dn2 : in the dark, without rounding.
    """

    signal: Float64Array
    variance: Float64Array
    errors: Float64Array
    spread: float
    noise_dn2: float
    black: float
    top_code: int
    response: Electrons
    light_e: Float64Array

    @classmethod
    def of(
        cls,
        measured: Series,
        end: Peak,
        response: Electrons,
        end_e: float,
        noise_dn2: float,
    ) -> _Levels | None:
        """None where there are too few."""
        y, v = measured.signal, measured.of_flats("variance")
        largest = float(v.max())
        used = (y > FROM * end.mean[0]) & (v > FULL * largest)
        behind = used & (np.arange(y.size) > end.index)
        if (
            used.sum() < FEWEST
            or behind.sum() < FEWEST_BEHIND
            or end.limited_by == "not reached"
        ):
            return None
        middle = used & (np.arange(y.size) < end.index)
        spreads = measured.of_flats("spread")[middle] / y[middle]
        error = measured.of_flats("variance_error")[used]
        top = measured.top_code
        return cls(
            signal=y[used],
            variance=v[used],
            errors=np.hypot(error, OF_MODEL * v[used]),
            spread=float(np.median(spreads)),
            noise_dn2=noise_dn2,
            black=float(measured.darks[0].mean),
            top_code=2**24 if top is None else top,
            response=response,
            light_e=np.linspace(0.4, 1.6, LIGHT) * end_e,
        )

    @property
    def count(self) -> int:
        """How many there are."""
        return self.signal.size

    def cost(self, p: Float64Array) -> float:
        """Half of the squared deviations of a full well and a knee."""
        return 0.5 * float(np.square(self.deviations(p)).sum())

    def best_clip(self, start: float) -> float:
        """The least cost of a well that clips."""
        wells = self.light_e[:: max(1, LIGHT // 40)]
        return min(start, *(self.cost(np.array([well, 0.0])) for well in wells))

    def deviations(self, p: Float64Array) -> Float64Array:
        """Of the variances at the levels' means."""
        mean, variance = self._curve(float(p[0]), float(p[1]))
        order = np.argsort(mean)
        expected = np.interp(self.signal, mean[order], variance[order])
        return np.asarray((expected - self.variance) / self.errors)

    def _curve(self, well: float, width: float) -> tuple[Float64Array, Float64Array]:
        """Mean signal and temporal variance of the codes over the light."""
        light = self.light_e[:, None] * (1 + self.spread * NODES)
        if width > 0:
            kept = -width * np.logaddexp(-light / width, -well / width)
            passes = -np.expm1((kept - well) / width)
            variance = passes**2 * light + width * (1 - passes) * (1 + 2 * passes)
        else:
            kept, variance = np.minimum(light, well), np.where(light < well, light, 0.0)
        signal, slope = self.response.signal(kept), self.response.slope(kept)
        sigma = np.sqrt(slope**2 * variance + self.noise_dn2)
        mean, square = code_moments(self.black + signal, sigma, self.top_code)
        shares = SHARES / SHARES.sum()
        return mean @ shares - self.black, square @ shares
