"""How far frames of a simulated camera are from those of the real one: histograms, spectra of lines, figures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import Quantity

SAMPLE, SEED = 10_000, 1288
"""Values of each side that a test of Kolmogorov and Smirnov compares, and which of them: enough to see D above 0.02.

With all pixels of a stack the test would find that no two chips are alike."""

SIGNIFICANCE = 0.01
"""Of every test: this share of twins that are exact fails it."""


class Distance(NamedTuple):
    """One comparison.

    statistic : D of Kolmogorov and Smirnov, the largest difference of the two cumulative distributions.
    probability : that two samples of one law differ by as much.  detail : what was compared.
    """

    name: str
    statistic: float
    probability: float
    detail: str

    @property
    def passed(self) -> bool:
        """Whether the difference may be chance."""
        return self.probability >= SIGNIFICANCE


@dataclass(frozen=True)
class FigureDistance:
    """A figure of the real camera beside that of its twin, and their difference in standard errors of both."""

    real: Quantity
    twin: Quantity

    @property
    def z(self) -> float:
        """Difference in standard errors of both; NaN where one of them could not be measured."""
        error = math.hypot(self.real.standard_error, self.twin.standard_error)
        difference = self.twin.value - self.real.value
        if error > 0:
            return difference / error
        if difference:
            return math.nan
        return 0.0


def frame_distances(real: Stack, twin: Stack) -> tuple[Distance, ...]:
    """Histogram of the codes, and power spectra of temporal row and column noise, of two stacks of one setting.

    Raises InputError for stacks that are not alike: another shape, exposure time or number of filters.
    """
    if real.shape != twin.shape or real.exposure_s != twin.exposure_s or real.tile != twin.tile:
        raise InputError(
            f"{real.source} is {real.shape} at {real.exposure_s:g} s and {twin.source} {twin.shape} at "
            f"{twin.exposure_s:g} s; compare frames of one size, mosaic and exposure time."
        )
    detail = f"{SAMPLE} pixels of each"
    distances = [_compare("histogram of codes", _draw_codes(real), _draw_codes(twin), detail)]
    if min(len(real), len(twin)) > 1:
        for name, axis in (("row", 2), ("column", 1)):
            real_power, twin_power = _line_power(real, axis), _line_power(twin, axis)
            detail = f"{len(real_power)} and {len(twin_power)} lines"
            title = f"spectrum of temporal {name} noise"
            distances.append(_compare(title, real_power, twin_power, detail))
    return tuple(distances)


def figure_distances(
    real: Iterable[Quantity], twin: Iterable[Quantity]
) -> tuple[FigureDistance, ...]:
    """Every figure that both have, by symbol, with its distance."""
    by_symbol = {quantity.symbol: quantity for quantity in twin}
    distances: list[FigureDistance] = []
    for quantity in real:
        if quantity.symbol in by_symbol:
            distances.append(FigureDistance(quantity, by_symbol[quantity.symbol]))
    return tuple(distances)


def _compare(name: str, real: Float64Array, twin: Float64Array, detail: str) -> Distance:
    """Test of Kolmogorov and Smirnov of two samples."""
    test = scipy.stats.ks_2samp(real, twin, method="asymp")
    return Distance(name, float(test.statistic), float(test.pvalue), detail)


def _draw_codes(stack: Stack) -> Float64Array:
    """Pixels drawn from all frames; of one place at most as often as there are frames."""
    codes = stack.frames.reshape(-1)
    places = np.random.default_rng(SEED).integers(0, codes.size, SAMPLE)
    return codes[places].astype(np.float64)


def _line_power(stack: Stack, axis: int) -> Float64Array:
    """|FFT|² of the line means, all but frequency 0 [DN²], of what changes from frame to frame.

    N frames leave N − 1 independent differences (Helmert's); deviations from their mean are N, of which two frames' are
    the same but for the sign.
    """
    lines = stack.frames.mean(axis=axis, dtype=np.float64)
    differences = scipy.linalg.helmert(len(stack)) @ lines
    power = np.abs(np.fft.rfft(differences, axis=1)) ** 2 / lines.shape[1]
    return np.asarray(power[:, 1:].ravel())
