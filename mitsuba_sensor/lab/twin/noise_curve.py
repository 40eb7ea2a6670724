"""Response of a camera by its noise: where light is Poisson's, the variance at each mean is the square of the slope.

With y = f(N) of N electrons the variance is f′²·N, so that 2√N = ∫ dy/√v: the photon transfer curve alone is a
response, whatever is stated of the light. It is taken where a line and a parabola miss the variances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.types import Float64Array
from ..frames.rounding import ROUNDING_DN2
from ..frames.series import Series
from ..measure.curved_response import straight
from ..measure.saturation import Peak
from ..quantity import TWO_SIDED

MISSED, CLEARLY = 0.03, 5.0
"""Share of the variance by which a parabola misses a level, and standard errors of it, from which on it is none."""
FEWEST = 12
"""Levels of a curve."""
BELOW = 0.8
"""Of the signal at the largest variance, up to which the variance is that of the response, not of a well that fills."""
QUIETEST_DN2 = 0.25
"""Variance by light from which on rounding adds 1/12 DN²."""
FIRST = 0.35
"""Part of the curve from which the slope at zero is extrapolated."""
POINTS = 512


@dataclass(frozen=True, eq=False)
class NoiseCurve:
    """gain : f′(0) [DN/e-], and gain_error : its standard error.

    signal : y [DN], from 0 on.  electrons : N.  slope : f′(y)/f′(0).
    """

    gain: float
    gain_error: float
    signal: Float64Array
    electrons: Float64Array
    slope: Float64Array

    def electrons_of(self, signal: Float64Array) -> Float64Array:
        """N of a signal; beyond the curve as the last part of it goes on."""
        return _interpolate(signal, self.signal, self.electrons)

    def signal_of(self, electrons: Float64Array) -> Float64Array:
        """y of so many electrons [DN]."""
        return _interpolate(electrons, self.electrons, self.signal)

    def slope_of(self, signal: Float64Array) -> Float64Array:
        """f′(y)/f′(0)."""
        return np.interp(signal, self.signal, self.slope)

    def widths(self, black_dn: float, bits: int) -> dict[str, float]:
        """Differential non-linearity of the codes that this response is, code → width less one [LSB]."""
        codes = np.arange(1, 2**bits - 1)
        slopes = self.slope_of(codes - black_dn)
        return {
            str(code): round(float(1 / slope - 1), 4)
            for code, slope in zip(codes, slopes, strict=True)
        }


def noise_curve(
    measured: Series, end: Peak, gain_dn_per_e: float, kappa: float, noise_dn2: float
) -> NoiseCurve | None:
    """The response by the variances; None where K and κ give them, or too few levels show it.

    noise_dn2 : in the dark, without rounding.
    """
    analogue = measured.of_flats("variance") - ROUNDING_DN2 - noise_dn2
    used = (analogue > QUIETEST_DN2) & measured.inside & (measured.signal > 0)
    used &= measured.signal < BELOW * end.mean[0]
    if used.sum() < FEWEST or not measured.whole:
        return None
    y, v, error = (
        measured.signal[used],
        analogue[used],
        measured.of_flats("variance_error")[used],
    )
    order = np.argsort(y)
    y, v, error = y[order], v[order], error[order]
    if not _misses(y, v, error, gain_dn_per_e, kappa):
        return None
    return _curve_of(y, v / y, error / y, float(measured.of_flats("mean").max()))


def _misses(
    y: Float64Array, v: Float64Array, error: Float64Array, gain: float, kappa: float
) -> bool:
    """Whether a line or parabola misses levels one after the other, not one by chance."""
    linear = straight(y, kappa)
    model = gain * linear * (1 + 2 * kappa * linear) ** 2
    off = np.abs(v / model - 1)
    far: NDArray[np.bool_] = (off > MISSED) & (off > CLEARLY * error / model)
    return bool((far[1:] & far[:-1]).any())


def _curve_of(y: Float64Array, k: Float64Array, error: Float64Array, top: float) -> NoiseCurve:
    """The curve of v/y = k at these signals, up to the end of the range."""
    first = y < max(FIRST * y[-1], y[3])
    weights = 1 / np.hypot(error[first], 1e-3 * k[first])
    line, covariance = np.polyfit(y[first], k[first], 1, w=weights, cov="unscaled")
    k0, gain_error = float(line[1]), float(np.sqrt(covariance[1, 1]))
    upper = y > 0.6 * y[-1]
    trend = np.polyfit(y[upper], k[upper], 1)
    at_top = max(float(np.polyval(trend, top)), 0.5 * float(k[-1]))
    signal = np.linspace(0.0, np.sqrt(top), POINTS) ** 2
    k_of = np.interp(
        signal, np.concatenate([[0.0], y, [top]]), np.concatenate([[k0], k, [at_top]])
    )
    root = np.sqrt(signal)
    inverse = 1 / np.sqrt(k_of)
    integral = np.concatenate(
        [[0.0], np.cumsum(0.5 * (inverse[1:] + inverse[:-1]) * np.diff(root))]
    )
    electrons = integral**2
    slope = np.ones(POINTS)
    slope[1:] = root[1:] * np.sqrt(k_of[1:]) / integral[1:] / k0
    return NoiseCurve(k0, TWO_SIDED * gain_error, signal, electrons, slope)


def _interpolate(x: Float64Array, of: Float64Array, values: Float64Array) -> Float64Array:
    """By straight lines; beyond the last point as between the last two."""
    inside = np.interp(x, of, values)
    slope = (values[-1] - values[-2]) / (of[-1] - of[-2])
    return np.asarray(np.where(x > of[-1], values[-1] + slope * (x - of[-1]), inside))
