"""Distance of simulated frames from frames of the real camera: histograms, spectra of lines, figures."""

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
"""Number of values of each side in a Kolmogorov–Smirnov test, and their seed: enough to see D above 0.02. With all
pixels, the test would distinguish any two sensor units."""

SIGNIFICANCE = 0.01
"""Fraction of exact twins that fail a test."""


class Distance(NamedTuple):
    """One comparison.

    statistic : D of Kolmogorov and Smirnov, the largest difference of the cumulative distributions.
    probability : of such a difference between samples of one distribution.  detail : what was compared.
    """

    name: str
    statistic: float
    probability: float
    detail: str

    @property
    def passed(self) -> bool:
        """Return True if the difference is not significant."""
        return self.probability >= SIGNIFICANCE


@dataclass(frozen=True)
class FigureDistance:
    """A figure of the real camera and of its twin."""

    real: Quantity
    twin: Quantity

    @property
    def z(self) -> float:
        """Difference in standard errors of both; NaN if one of them could not be measured."""
        error = math.hypot(self.real.standard_error, self.twin.standard_error)
        difference = self.twin.value - self.real.value
        if error > 0:
            return difference / error
        return math.nan if difference else 0.0


def frame_distances(real: Stack, twin: Stack) -> tuple[Distance, ...]:
    """Compare histograms of codes, and power spectra of temporal row and column noise, of two stacks of one setting.

    Raises InputError for stacks of different shape, exposure time or mosaic.
    """
    if real.shape != twin.shape or real.exposure_s != twin.exposure_s or real.tile != twin.tile:
        raise InputError(
            f"{real.source}: shape {real.shape} at {real.exposure_s:g} s, {twin.source}: {twin.shape} at "
            f"{twin.exposure_s:g} s; pass frames of one size, mosaic and exposure time."
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
    """Return the distance of each figure that both sides have."""
    by_symbol = {quantity.symbol: quantity for quantity in twin}
    return tuple(
        FigureDistance(quantity, by_symbol[quantity.symbol])
        for quantity in real
        if quantity.symbol in by_symbol
    )


def _compare(name: str, real: Float64Array, twin: Float64Array, detail: str) -> Distance:
    """Return the Kolmogorov–Smirnov test of two samples."""
    test = scipy.stats.ks_2samp(real, twin, method="asymp")
    return Distance(name, float(test.statistic), float(test.pvalue), detail)


def _draw_codes(stack: Stack) -> Float64Array:
    """Return values of random pixels of all frames."""
    codes = stack.frames.reshape(-1)
    places = np.random.default_rng(SEED).integers(0, codes.size, SAMPLE)
    return codes[places].astype(np.float64)


def _line_power(stack: Stack, axis: int) -> Float64Array:
    """Return |FFT|² of the temporal fluctuation of line means without frequency 0 [DN²].

    N frames have N − 1 independent differences (Helmert's); their N deviations from the mean are dependent.
    """
    lines = stack.frames.mean(axis=axis, dtype=np.float64)
    differences = scipy.linalg.helmert(len(stack)) @ lines
    power = np.abs(np.fft.rfft(differences, axis=1)) ** 2 / lines.shape[1]
    return np.asarray(power[:, 1:].ravel())
