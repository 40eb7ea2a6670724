"""Saturation at the maximum of the temporal variance, absolute sensitivity threshold, dynamic range, maximum SNR."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.series import Series
from ..quantity import Figures, Quantity, no_value, product, quotient

Limit = Literal["well", "ADC", "not reached"]
SECTION = "EMVA 1288 R4 2.4"
NO_PHOTONS = "photons are unknown"
NOTES: dict[Limit, str] = {
    "well": "",
    "ADC": "the ADC saturates before the full well",
    "not reached": "the variance does not fall at the brightest level",
}
"""Notes on the limit of the range."""
TIED_SIGMAS = 2.8
"""Difference of two variances that noise explains [standard errors]: 1.96·√2."""


@dataclass(frozen=True, eq=False)
class Peak:
    """Maximum of the temporal variance over a curve.

    mean : (value, low, high) of the mean at the maximum [DN].
    limited_by : "ADC" if values gather at the full-scale code, "well" if the variance falls below that code,
    "not reached" if the variance does not fall.
    """

    mean: tuple[float, float, float]
    limited_by: Limit

    def convert(self, means: Float64Array, values: Float64Array) -> tuple[float, float, float]:
        """Return (value, low, high) in another unit, interpolated between the points; a lower bound if not reached."""
        points, first = np.unique(means, return_index=True)
        value, low, high = (float(np.interp(mean, points, values[first])) for mean in self.mean)
        if self.limited_by == "not reached":
            return value, value, math.inf
        return value, min(low, value), max(high, value)


def peak(
    mean: Float64Array,
    variance: Float64Array,
    error: Float64Array,
    top: float | None,
    spread: float = 0.0,
) -> Peak:
    """Find the peak of points in ascending order of light.

    top : largest mean that the ADC can give [DN, as the means], or None if unknown.
    spread : relative standard deviation of the pixels' responses.
    The interval includes the neighbours, and points whose variances noise cannot distinguish from the largest. The
    value is refined by a model: noise with a variance proportional to the signal, clipped at the mean of the brightest
    points.
    """
    index = int(np.argmax(variance))
    limited = _what_limits(mean, variance, top)
    tied = np.flatnonzero(variance + TIED_SIGMAS * error >= variance[index])
    first = max(0, min(index - 1, int(tied.min())))
    last = min(len(mean) - 1, max(index + 1, int(tied.max())))
    low, high = float(mean[[first, last]].min()), float(mean[[first, last]].max())
    value = float(mean[index])
    if limited != "not reached":
        refined = _mean_at_clipped_peak(mean, variance, spread)
        value = refined if low < refined < high else value
    return Peak((value, min(low, value), max(high, value)), limited)


def _what_limits(mean: Float64Array, variance: Float64Array, top: float | None) -> Limit:
    """Return what ends the range: the variance falls below half of its maximum at the full-scale code, or below it."""
    index = int(np.argmax(variance))
    after = variance[index + 1 :]
    if not after.size or float(after.min()) >= 0.5 * variance[index]:
        return "not reached"
    if top is None:
        clips = float(after.min()) <= 1e-12
    else:
        clips = float(mean[index:].max()) > top - max(0.5, 1e-3 * abs(top))
    return "ADC" if clips else "well"


def _mean_at_clipped_peak(mean: Float64Array, variance: Float64Array, spread: float) -> float:
    """Return the mean at the largest variance of normal signals that are clipped at the largest mean."""
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
    missing = scale * (density + z * below)  # mean of end minus clipped signal
    square = scale**2 * ((1 + z**2) * below + z * density)
    best = int(np.argmax((square - missing**2) @ weights))
    return end - float(missing[best] @ weights / weights.sum())


@dataclass(frozen=True, eq=False)
class Saturation(Figures):
    """Ends of the usable range (EMVA 1288 R4 2.4 and 6.6).

    signal : µ_y.sat − µ_y.dark [DN].  photons, electrons : µ_p.sat, µ_e.sat.  threshold_photons, threshold_electrons :
    µ_p.min, µ_e.min at an SNR of 1.  dynamic_range, snr_max : ratios.  peak : maximum of the variance.
    """

    signal: Quantity
    photons: Quantity
    electrons: Quantity
    threshold_photons: Quantity
    threshold_electrons: Quantity
    dynamic_range: Quantity
    snr_max: Quantity
    peak: Peak


def find_peak(measured: Series) -> Peak:
    """Return the peak of the temporal variance of a series over the signal."""
    top = None
    if measured.top_code is not None:
        top = float(measured.top_code - measured.of_darks("mean").max())
    spread = 0.0
    lit = measured.signal > 0.4 * measured.signal.max()
    if lit.any():
        spread = float(np.median(measured.of_flats("spread")[lit] / measured.signal[lit]))
    errors = measured.of_flats("variance_error")
    return peak(measured.signal, measured.excess, errors, top, spread)


def saturation(
    measured: Series, gain: Quantity, efficiency: Quantity | None, dark_noise: Quantity
) -> Saturation:
    """Measure the range of a series from K [DN/e-], QE or None, and σ_y.dark [DN].

    Electrons come from photons if QE is known, else from the signal. A range that is not reached gives lower bounds.
    """
    ends = find_peak(measured)

    def figure(symbol: str, name: str, unit: str, note: str = "") -> Quantity:
        return no_value(symbol, name, unit, SECTION, note)

    def at_peak(values: Float64Array, like: Quantity) -> Quantity:
        if ends.mean[0] <= 0:
            return like.noted("no flat field is brighter than the dark frames")
        if measured.clipped_darks:
            return like.without_value(measured.clipped_darks, clipped=True)
        return like.with_interval(ends.convert(measured.signal, values)).noted(
            NOTES[ends.limited_by]
        )

    signal = at_peak(measured.signal, figure("µ_y.sat − µ_y.dark", "saturation signal", "DN"))
    electrons = figure("µ_e.sat", "saturation capacity", "e-")
    photons = figure("µ_p.sat", "saturation capacity", "p")
    name = "absolute sensitivity threshold"
    # µ_e.min = √(σ_y.dark²/K² + 1/4) + 1/2, where the signal equals its noise (EMVA 1288 R4 2.4).
    least_electrons = quotient(dark_noise, gain, figure("µ_e.min", name, "e-")).mapped(
        lambda sigma_e: math.sqrt(sigma_e**2 + 0.25) + 0.5
    )
    least_photons = figure("µ_p.min", name, "p")
    if efficiency is None:
        photons, least_photons = photons.noted(NO_PHOTONS), least_photons.noted(NO_PHOTONS)
        electrons = quotient(signal, gain, electrons)
    else:
        photons = at_peak(measured.light, photons)
        electrons = product(photons, efficiency, electrons)
        least_photons = quotient(least_electrons, efficiency, least_photons)
    return Saturation(
        signal=signal,
        photons=photons,
        electrons=electrons,
        threshold_photons=least_photons,
        threshold_electrons=least_electrons,
        dynamic_range=quotient(electrons, least_electrons, figure("DR", "dynamic range", "")),
        snr_max=electrons.mapped(
            math.sqrt, symbol="SNR_max", name="maximum signal-to-noise ratio", unit=""
        ),
        peak=ends,
    )
