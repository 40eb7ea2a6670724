"""Saturation at the maximum of the temporal variance, absolute sensitivity threshold, dynamic range, largest SNR."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.series import Series
from ..quantity import Quantity, hidden_by_clipping, product, quotient, unknown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Limit = Literal["well", "ADC", "not reached"]
SECTION = "EMVA 1288 R4 2.4"


@dataclass(frozen=True, eq=False)
class Peak:
    """Maximum of the temporal variance over a curve: (value, low, high) of the mean, its index, and what limits there.

    limited_by : "ADC" where values gather at the largest code, "well" where the variance falls below it,
    "not reached" where it does not fall.
    """

    index: int
    mean: tuple[float, float, float]
    limited_by: Limit

    def at(self, means: Float64Array, values: Float64Array) -> tuple[float, float, float]:
        """The same in another unit, by interpolation between the points of the curve; high is inf if not reached."""
        order = np.argsort(means, kind="stable")
        value, low, high = (
            float(np.interp(one, means[order], values[order])) for one in self.mean
        )
        found = value, min(low, value), max(high, value)
        return found if self.limited_by != "not reached" else (value, value, math.inf)


def peak(
    mean: Float64Array,
    variance: Float64Array,
    error: Float64Array,
    top: float | None,
    spread: float = 0.0,
) -> Peak:
    """Of points in ascending order of light: the point with the largest variance, made finer by a model.

    top : largest mean that the ADC can give [DN, as the means], None where the frames must tell.
    spread : relative standard deviation of the pixels' responses.
    The interval holds the neighbours, and points whose variances noise cannot tell from the largest. The model is
    noise whose variance is proportional to the signal, cut at the mean of the brightest points; where its largest
    variance lies within the interval, that is taken.
    """
    index = int(np.argmax(variance))
    after = variance[index + 1 :]
    limited: Limit = "not reached"
    if after.size and float(after.min()) < 0.5 * variance[index]:
        last = float(mean[index:].max())
        clips = (
            float(after.min()) <= 1e-12
            if top is None
            else last > top - max(0.5, 1e-3 * abs(top))
        )
        limited = "ADC" if clips else "well"
    tied = np.flatnonzero(
        variance + 2.8 * error >= variance[index]
    )  # 2.8: 1.96 times the root of 2
    ends = [
        max(0, min(index - 1, int(tied.min()))),
        min(len(mean) - 1, max(index + 1, int(tied.max()))),
    ]
    low, high = float(mean[ends].min()), float(mean[ends].max())
    value = _cut(mean, variance, spread) if limited != "not reached" else math.nan
    value = value if low < value < high else float(mean[index])
    return Peak(index, (value, min(low, value), max(high, value)), limited)


def _cut(mean: Float64Array, variance: Float64Array, spread: float) -> float:
    """Mean at the largest variance of normal signals that are cut at the largest mean."""
    end = float(mean.max())
    straight = (mean > 0.4 * end) & (mean < 0.85 * end)
    if not straight.any():
        return math.nan
    per_mean = float(np.median(variance[straight] / mean[straight]))
    level = np.linspace(0.7, 1.1, 801) * end
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    light = level[:, None] * np.maximum(1 + spread * nodes, 1e-3)
    scale = np.sqrt(max(per_mean, 1e-12) * light)
    z = (end - light) / scale
    below, density = scipy.special.ndtr(z), np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    missing = scale * (density + z * below)  # mean of the end minus the signal that is left
    square = scale**2 * ((1 + z**2) * below + z * density)
    best = int(np.argmax((square - missing**2) @ weights))
    return end - float(missing[best] @ weights / weights.sum())


@dataclass(frozen=True, eq=False)
class Saturation:
    """Ends of the usable range, EMVA 1288 R4 2.4 and 6.6.

    signal : µ_y.sat - µ_y.dark [DN].  photons, electrons : µ_p.sat, µ_e.sat.  threshold_photons, threshold_electrons :
    µ_p.min, µ_e.min, where the SNR is 1.  dynamic_range, snr_max : as ratios.  peak : the maximum of the variance.
    """

    signal: Quantity
    photons: Quantity
    electrons: Quantity
    threshold_photons: Quantity
    threshold_electrons: Quantity
    dynamic_range: Quantity
    snr_max: Quantity
    peak: Peak
    points: tuple[Float64Array, Float64Array]

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All of them."""
        ends = (
            self.signal,
            self.photons,
            self.electrons,
            self.threshold_photons,
            self.threshold_electrons,
        )
        return *ends, self.dynamic_range, self.snr_max

    def plot(self, axes: Axes) -> None:
        """Temporal variance against the mean, with the interval of its maximum."""
        axes.plot(*self.points, "o-", markersize=3, linewidth=1, label="temporal variance")
        axes.axvspan(
            self.signal.low,
            min(self.signal.high, float(self.points[0].max())),
            alpha=0.2,
            label="saturation",
        )
        axes.set(xlabel="mean − dark mean [DN]", ylabel="variance − dark variance [DN²]")


def find_peak(measured: Series) -> Peak:
    """Of a series, over the signal."""
    top = (
        None
        if measured.top_code is None
        else float(measured.top_code - measured.of_darks("mean").max())
    )
    lit = measured.signal > 0.4 * measured.signal.max()
    spread = (
        float(np.median(measured.of_flats("spread")[lit] / measured.signal[lit]))
        if lit.any()
        else 0.0
    )
    return peak(
        measured.signal, measured.excess, measured.of_flats("variance_error"), top, spread
    )


def saturation(
    measured: Series, gain: Quantity, efficiency: Quantity | None, dark_noise: Quantity
) -> Saturation:
    """From a series, K [DN/e-], QE [1] or None, and σ_y.dark [DN]. Electrons come of photons where QE is known."""
    found = find_peak(measured)

    def empty(symbol: str, name: str, unit: str) -> Quantity:
        return Quantity(symbol, name, math.nan, math.nan, math.nan, unit, SECTION, _note(found))

    signal = _at(
        found, measured, measured.signal, empty("µ_y.sat − µ_y.dark", "saturation signal", "DN")
    )
    no_light = "photons are not known"
    photons = empty("µ_p.sat", "saturation capacity", "p")
    electrons = empty("µ_e.sat", "saturation capacity", "e-")
    if efficiency is None:
        photons, electrons = unknown(photons, no_light), quotient(signal, gain, electrons)
    else:
        photons = _at(found, measured, measured.light, photons)
        electrons = product(photons, efficiency, electrons)
    least = _threshold(
        dark_noise,
        gain,
        replace(empty("µ_e.min", "absolute sensitivity threshold", "e-"), note=""),
    )
    fewest = replace(empty("µ_p.min", "absolute sensitivity threshold", "p"), note="")
    fewest = (
        unknown(fewest, no_light) if efficiency is None else quotient(least, efficiency, fewest)
    )
    root = replace(electrons, symbol="SNR_max", name="maximum signal-to-noise ratio", unit="1")
    value, low, high = (
        math.sqrt(one) for one in (electrons.value, electrons.low, electrons.high)
    )
    return Saturation(
        signal,
        photons,
        electrons,
        fewest,
        least,
        quotient(electrons, least, empty("DR", "dynamic range", "1")),
        replace(root, value=value, low=low, high=high),
        found,
        (measured.signal, measured.excess),
    )


def _at(found: Peak, measured: Series, values: Float64Array, like: Quantity) -> Quantity:
    value, low, high = found.at(measured.signal, values)
    if found.mean[0] <= 0:
        return unknown(like, "no flat field is brighter than the dark frames")
    if measured.clipped_darks:
        return hidden_by_clipping(like, measured.clipped_darks)
    return replace(like, value=value, low=low, high=high)


def _threshold(dark_noise: Quantity, gain: Quantity, like: Quantity) -> Quantity:
    """µ_e.min = sqrt(σ_y.dark²/K² + 1/4) + 1/2, where the signal equals its noise (EMVA 1288 R4 2.4)."""
    noise = quotient(dark_noise, gain, like)
    value, low, high = (
        math.sqrt(one**2 + 0.25) + 0.5 for one in (noise.value, noise.low, noise.high)
    )
    return replace(noise, value=value, low=low, high=high)


def _note(found: Peak) -> str:
    if found.limited_by == "ADC":
        return "the largest code ends the range, not the full well"
    return (
        ""
        if found.limited_by == "well"
        else "the variance does not fall at the brightest level: a lower limit"
    )
