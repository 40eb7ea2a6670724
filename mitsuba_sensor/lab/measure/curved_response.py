"""A curved response y = s(1 + κs + …), its linear signal s, and the levels that a linear response would have given.

EMVA 1288 R4 Linear assumes a linear response. If the levels show a curve, photon transfer uses the linear signal. Its
variance is the measured variance over the square of the slope dy/ds, which refers noise to the input of the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from ...core.types import Float64Array
from ..frames.series import Series
from ..frames.stack import rounding_shift_dn
from ..quantity import TWO_SIDED, normal_interval, student_interval
from .photon_transfer import PhotonTransfer, photon_transfer
from .radiometric import find_stray
from .saturation import Peak

FITTED = 0.02, 0.9
"""Fractions of the saturation signal between which the curvature is fitted."""
PEAK_LEVELS_MIN = 5
"""Number of levels from which those below the largest variance suffice. With fewer, levels below the largest mean are
used: a response that saturates softly has its largest variance far below saturation."""
CURVE_LEVELS_MIN = 2
"""Number of levels that distinguish a curve from a line if only noise moves them; three also show scatter."""
TERMS_MAX = 3
"""Largest number of terms of κs + κ₂s² + κ₃s³; more than one if the levels are not on a parabola."""
CURVED_SIGMAS = 3.3
"""Curvature from which on a response is curved [standard errors]: 0.1 % of the straight responses."""
FALSE_ALARM = 1e-3
"""The same probability for the scatter of the levels, which includes light that is not as stated."""
HIDDEN_MAX = 0.02
"""Largest hidden curvature without a note, relative to the largest signal."""
EARLY_NOISE = 0.0, 0.25, 0.5, 0.75, 1.0
"""Tried fractions of the dark noise variance that arise before the curve."""
GRID, SLOPE_MIN = 4097, 0.1
"""Points of a response that is inverted, and the slope at which it ends."""
SMALL_SIGNALS_NOTE = (
    "for small signals: the response is curved, and variances are divided by the square of its slope; EMVA 1288 Linear "
    "assumes a line"
)


@dataclass(frozen=True)
class Curve:
    """A response y = s(1 + κs + κ₂s² + …).

    kappa, low, high : κ of the nearest parabola y = s(1 + κs), with its interval [1/DN]; 0 for a linear response and if
    the light is unknown.  terms : κ, κ₂, … [1/DN, 1/DN², …].  levels : number of distinct levels.
    hidden : curvature relative to the largest signal that the levels do not exclude.  possible : a curve that is
    significant compared with noise, but not compared with scattering light.
    """

    kappa: float = 0.0
    low: float = 0.0
    high: float = 0.0
    terms: tuple[float, ...] = ()
    levels: int = 0
    hidden: float = math.inf
    possible: Curve | None = None

    @property
    def note(self) -> str:
        """Note for a figure that assumes this response."""
        if self.kappa:
            return SMALL_SIGNALS_NOTE
        if self.levels < CURVE_LEVELS_MIN:
            return (
                f"{self.levels} levels of known light below 90 % of the largest mean do not show whether the response "
                "is curved; take 3 or more"
            )
        percent = 100 * min(self.hidden, 1e6)
        if self.possible:
            return (
                f"{self.levels} levels do not distinguish a curve of {percent:.2g} % from light that is not as stated; "
                "the interval includes both"
            )
        if self.hidden > HIDDEN_MAX:
            return f"{self.levels} levels do not distinguish a curve of up to {percent:.2g} % from a line"
        return ""

    def __bool__(self) -> bool:
        return bool(self.kappa)

    def straight(self, signal: Float64Array) -> Float64Array:
        """Return s for y [DN]; signals above the end of the curve are set to its end."""
        grid = np.linspace(0.0, 2 * float(np.abs(signal).max()), GRID)
        grid = grid[: np.argmax(np.append(self.slope(grid), 0.0) < SLOPE_MIN)]
        curved = np.interp(signal, grid * polyval(grid, (1.0, *self.terms)), grid)
        return np.where(signal > 0, curved, signal)

    def slope(self, linear: Float64Array) -> Float64Array:
        """Return dy/ds at s [DN]."""
        return np.asarray(polyval(linear, polyder((0.0, 1.0, *self.terms))))

    def relative_slope(self, signal: float) -> float:
        """Return (dy/y)/(ds/s) at a signal y [DN]."""
        linear = self.straight(np.array(signal))
        return float(self.slope(linear) * linear) / signal

    def straighten(self, measured: Series, early: float = 0.0) -> Series:
        """Return the levels of a linear response.  early : fraction of the dark noise variance before the curve."""
        signal = self.straight(measured.signal)
        squares = self.slope(signal) ** 2
        dark_mean, dark_dn2 = measured.of_darks("mean"), measured.of_darks("variance")
        light_dn2 = measured.of_flats("variance") - (1 - early + early * squares) * dark_dn2
        variance = np.maximum(dark_dn2 + light_dn2 / squares, 0.0)
        columns = dark_mean + signal, variance, measured.of_flats("variance_error") / squares
        flats = [
            replace(flat, mean=mean, variance=variance, variance_error=error)
            for flat, mean, variance, error in zip(
                measured.flats, *(column.tolist() for column in columns), strict=True
            )
        ]
        return replace(measured, flats=tuple(flats))


def curvature(measured: Series, end: Peak) -> Curve:
    """Fit the curve of the levels; a line if they show no curve or their light is unknown."""
    used = _select_levels(measured, end)
    x, y = measured.light[used], measured.signal[used]
    levels = len(set(x.tolist()))
    if levels < CURVE_LEVELS_MIN:
        return Curve(levels=levels)
    errors, dark_shift = _errors(measured, used)
    x, largest = x / x.max(), float(y.max())
    (a, b), inverse, chi2, influence = _polynomial(x, y, errors, 2)
    bend, freedom = float(b / a**2), len(x) - 2
    slopes = np.array([-2 * bend / a, 1 / a**2])
    by_levels = math.sqrt(float(slopes @ inverse @ slopes))
    by_dark = float(slopes @ influence @ dark_shift)
    scatter = chi2 / freedom if freedom else 1.0
    by_noise = math.hypot(by_levels, by_dark)
    by_scatter = math.hypot(by_levels * math.sqrt(scatter), by_dark)
    hidden = CURVED_SIGMAS * by_noise * largest
    if abs(bend) * largest < hidden:
        return Curve(levels=levels, hidden=hidden)
    interval = normal_interval(bend, by_noise)
    if scatter > 1:
        interval = student_interval(bend, by_scatter, freedom)
    curve = Curve(*interval, _higher_terms(x, y, errors) or (bend,), levels)
    limit = float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2)) if freedom else math.inf
    if abs(bend) < limit * by_scatter:
        return Curve(levels=levels, hidden=abs(bend) * largest, possible=curve)
    return curve


def _polynomial(
    x: Float64Array, y: Float64Array, errors: Float64Array, terms: int
) -> tuple[Float64Array, Float64Array, float, Float64Array]:
    """Return factors of x, x², … by weighted least squares, their covariance, χ², and the influence of each y."""
    powers = x[:, None] ** np.arange(1, terms + 1) / errors[:, None]
    inverse = np.linalg.pinv(powers.T @ powers)
    influence = inverse @ powers.T / errors
    factors = influence @ y
    chi2 = float(np.square(powers @ factors - y / errors).sum())
    return factors, np.asarray(inverse), chi2, influence


def _select_levels(measured: Series, end: Peak) -> NDArray[np.bool_]:
    """Return a mask of the levels that the curvature is fitted to."""
    x, y = measured.light, measured.signal
    stray, _ = find_stray(measured, end)
    lit = measured.inside & (x > 0) & ~stray

    def below(top: float) -> NDArray[np.bool_]:
        return np.asarray(lit & (y > FITTED[0] * top) & (y < FITTED[1] * top))

    used = below(end.mean[0])
    largest = float(np.max(y, where=lit, initial=0.0))
    if len(set(x[used].tolist())) < PEAK_LEVELS_MIN and largest > end.mean[0]:
        used = below(largest)
    return used


def _higher_terms(x: Float64Array, y: Float64Array, errors: Float64Array) -> tuple[float, ...]:
    """Return κ, κ₂, … up to the last significant term (3.3 standard errors), or nothing if one term suffices."""
    terms: tuple[float, ...] = ()
    for count in range(3, TERMS_MAX + 2):
        freedom = len(x) - count
        if freedom < 3:
            break
        factors, inverse, chi2, _ = _polynomial(x, y, errors, count)
        scatter = max(1.0, chi2 / freedom)
        limit = CURVED_SIGMAS * float(scipy.special.stdtrit(freedom, 0.975)) / TWO_SIDED
        if abs(factors[-1]) > limit * math.sqrt(float(inverse[-1, -1]) * scatter):
            terms = tuple(float(a / factors[0] ** (k + 2)) for k, a in enumerate(factors[1:]))
    return terms


def _errors(measured: Series, used: NDArray[np.bool_]) -> tuple[Float64Array, Float64Array]:
    """Return standard errors of the signals [DN], and their common part from rounding of the dark frames.

    Few frames of a level show little of the drift of the light, so its relative size is averaged over the levels.
    """
    signal = measured.signal[used]
    noise = [measured.of_flats("mean_error")[used], measured.of_darks("mean_error")[used]]
    drift_dn2 = measured.of_flats("light_error")[used] ** 2 - noise[0] ** 2
    drift = math.sqrt(max(float((drift_dn2 / signal**2).mean()), 0.0))
    dark_shift = _shift_by_rounding(measured, measured.of_darks)[used]
    flat_shift = _shift_by_rounding(measured, measured.of_flats)[used]
    squares = [x**2 for x in (*noise, drift * signal, dark_shift, flat_shift)]
    return np.maximum(np.sqrt(sum(squares)), 1e-9 * signal), dark_shift


def _shift_by_rounding(measured: Series, of: Callable[[str], Float64Array]) -> Float64Array:
    """Return the standard deviation of the shifts that rounding gives to the means of levels [DN]."""
    total_dn2 = of("variance") + of("spread") ** 2
    return np.array([rounding_shift_dn(float(x)) if measured.whole else 0.0 for x in total_dn2])


def small_signals(measured: Series, curve: Curve) -> tuple[Series, PhotonTransfer]:
    """Return the levels of a linear response and photon transfer of small signals.

    If a line and a curve are possible, the interval of K includes both.
    """
    if curve:
        levels, transfer = _along(measured, curve)
    else:
        levels, transfer = measured, photon_transfer(measured)
    gain = transfer.gain.noted(curve.note)
    if curve.possible:
        gain = gain.extended(_along(measured, curve.possible)[1].gain)
    return levels, replace(transfer, gain=gain)


def _along(measured: Series, curve: Curve) -> tuple[Series, PhotonTransfer]:
    """Return photon transfer along a curve, with the best fraction of dark noise before the curve.

    The interval includes K for all fractions that noise does not distinguish from the best one.
    """
    levels = [curve.straighten(measured, early) for early in EARLY_NOISE]
    transfers = list(map(photon_transfer, levels))
    misfits = list(map(_misfit, transfers))
    best = int(np.argmin(misfits))
    gain = transfers[best].gain
    for transfer, misfit in zip(transfers, misfits, strict=True):
        if misfit < misfits[best] + TWO_SIDED**2:
            gain = gain.extended(transfer.gain)
    return levels[best], replace(transfers[best], gain=gain)


def _misfit(transfer: PhotonTransfer) -> float:
    """Return χ² of the fitted levels about the line."""
    used = transfer.fitted
    off = transfer.variance[used] - transfer.gain.value * transfer.signal[used]
    return float(np.square(off / np.maximum(transfer.errors[used], 1e-300)).sum())
