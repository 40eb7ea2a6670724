"""How far frames of a simulated camera are from those of the real one: histograms, spectra of lines, figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
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
        """NaN where one of them could not be measured."""
        error = math.hypot(self.real.standard_error, self.twin.standard_error)
        difference = self.twin.value - self.real.value
        return difference / error if error > 0 else math.nan if difference else 0.0


def frame_distances(real: Stack, twin: Stack) -> tuple[Distance, ...]:
    """Histogram of the codes, and power spectra of temporal row and column noise, of two stacks of one setting.

    Raises InputError for stacks that are not alike: another shape, exposure time or number of filters.
    """
    if real.shape != twin.shape or real.exposure_s != twin.exposure_s or real.tile != twin.tile:
        raise InputError(
            f"{real.source} is {real.shape} at {real.exposure_s:g} s and {twin.source} {twin.shape} at "
            f"{twin.exposure_s:g} s; compare frames of one size, mosaic and exposure time."
        )
    found = [
        _compared("histogram of codes", _codes(real), _codes(twin), f"{SAMPLE} pixels of each")
    ]
    if min(len(real), len(twin)) > 1:
        for name, axis in (("row", 2), ("column", 1)):
            one, other = _line_power(real, axis), _line_power(twin, axis)
            found.append(
                _compared(
                    f"spectrum of temporal {name} noise",
                    one,
                    other,
                    f"{len(one)} and {len(other)} lines",
                )
            )
    return tuple(found)


def figure_distances(
    real: Iterable[Quantity], twin: Iterable[Quantity]
) -> tuple[FigureDistance, ...]:
    """Of all figures that both have, by symbol."""
    others: Mapping[str, Quantity] = {one.symbol: one for one in twin}
    return tuple(
        FigureDistance(one, others[one.symbol]) for one in real if one.symbol in others
    )


def _compared(name: str, one: Float64Array, other: Float64Array, detail: str) -> Distance:
    test = scipy.stats.ks_2samp(one, other, method="asymp")
    return Distance(name, float(test.statistic), float(test.pvalue), detail)


def _codes(stack: Stack) -> Float64Array:
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
    power = (
        np.abs(np.fft.rfft(scipy.linalg.helmert(len(stack)) @ lines, axis=1)) ** 2
        / lines.shape[1]
    )
    return np.asarray(power[:, 1:].ravel())
