"""A curved response y = s(1 + κs + …), the linear signal s that it came from, and the levels that it would have given.

EMVA 1288 R4 Linear takes every response for a line; where the levels show that it is none, photon transfer is that of
the linear signal, whose variance is the measured one over the square of the slope dy/ds, as noise is referred to the
input of a camera.
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

USED = 0.02, 0.9
"""Part of the saturation signal from which the curvature is fitted."""
ENOUGH = 5
"""Levels from which on those below the largest variance are taken; of fewer, those below the largest mean: a response
that falls off has its largest variance far below saturation."""
FEWEST = 2
"""Levels that tell a curve from a line, where noise is all that they are off by; of three the scatter is known too."""
MOST_TERMS = 3
"""Of κs + κ₂s² + κ₃s³: more than the first where the levels are not on a parabola."""
CURVED = 3.3
"""Standard errors from which on a response is taken as curved: 0.1 % of the straight ones."""
FALSE_ALARM = 1e-3
"""The same by the scatter of the levels, which light that is not what is stated makes larger."""
MOST_HIDDEN = 0.02
"""Part of the largest signal by which a response may be curved without a note that the levels do not show it."""
SHARES = 0.0, 0.25, 0.5, 0.75, 1.0
"""Of the dark noise, that may arise before the response is curved."""
GRID, LEAST_SLOPE = 4097, 0.1
"""Points of a response that is inverted, and the slope at which it ends."""
OF_SMALL_SIGNALS = (
    "of small signals: the response is curved, and variances are divided by the square of its slope; EMVA 1288 Linear "
    "takes the curve as a line"
)


@dataclass(frozen=True)
class Curve:
    """A response y = s(1 + κs + κ₂s² + …).

    kappa, low, high : of the parabola y = s(1 + κs) that is nearest, with its interval [1/DN]; 0 where the response is
    a line, or the light of the levels is not known.  terms : κ, κ₂, … [1/DN, 1/DN², …], of that parabola or of what
    is nearer.  levels : how many distinct ones it is from.  hidden : part of the largest signal by which it may be
    curved without being taken so.  possible : a curve that noise does not explain, but light that scatters may.
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
        """Of a figure that takes this response as a line, or as a curve."""
        if self.kappa:
            return OF_SMALL_SIGNALS
        if self.levels < FEWEST:
            return (
                f"levels of known light below 90 % of the largest mean: {self.levels}, which cannot tell whether the "
                "response is curved; take 3 or more"
            )
        percent = 100 * min(self.hidden, 1e6)
        if self.possible:
            return (
                f"{self.levels} levels do not tell a curve of {percent:.2g} % from light that is not what is stated; "
                "the interval holds both"
            )
        if self.hidden > MOST_HIDDEN:
            return (
                f"{self.levels} levels do not tell a curve of up to {percent:.2g} % from a line"
            )
        return ""

    def __bool__(self) -> bool:
        return bool(self.kappa)

    def straight(self, signal: Float64Array) -> Float64Array:
        """s of y [DN]; signals beyond the end of the curve are taken to be at it."""
        grid = np.linspace(0.0, 2 * float(np.abs(signal).max()), GRID)
        grid = grid[: np.argmax(np.append(self.slope(grid), 0.0) < LEAST_SLOPE)]
        curved = np.interp(signal, grid * polyval(grid, (1.0, *self.terms)), grid)
        return np.where(signal > 0, curved, signal)

    def slope(self, linear: Float64Array) -> Float64Array:
        """dy/ds at s [DN]."""
        return np.asarray(polyval(linear, polyder((0.0, 1.0, *self.terms))))

    def relative_slope(self, signal: float) -> float:
        """(dy/y)/(ds/s) at a signal y [DN]: by how much more than in proportion y grows with the light."""
        linear = self.straight(np.array(signal))
        return float(self.slope(linear) * linear) / signal

    def straighten(self, measured: Series, scaled: float = 0.0) -> Series:
        """The levels that a linear response would have given: variances over the square of the slope.

        scaled : share of the dark noise's variance that arises before the response is curved, and is scaled by its
        slope.
        """
        signal = self.straight(measured.signal)
        squares = self.slope(signal) ** 2
        dark_mean, dark_dn2 = measured.of_darks("mean"), measured.of_darks("variance")
        light_dn2 = measured.of_flats("variance") - (1 - scaled + scaled * squares) * dark_dn2
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
    """The curve of the levels; a line where they show none, or where their light is not known."""
    used = _select_levels(measured, end)
    x, y = measured.light[used], measured.signal[used]
    levels = len(set(x.tolist()))
    if levels < FEWEST:
        return Curve(levels=levels)
    errors, dark_shift = _errors(measured, used)
    x, largest = x / x.max(), float(y.max())
    (a, b), inverse, chi2, influence = _polynomial(x, y, errors, 2)
    bend, freedom = float(b / a**2), len(x) - 2
    slopes = np.array([-2 * bend / a, 1 / a**2])
    own = math.sqrt(float(slopes @ inverse @ slopes))
    of_dark = float(slopes @ influence @ dark_shift)
    scatter = chi2 / freedom if freedom else 1.0
    by_noise, wider = math.hypot(own, of_dark), math.hypot(own * math.sqrt(scatter), of_dark)
    hidden = CURVED * by_noise * largest
    if abs(bend) * largest < hidden:
        return Curve(levels=levels, hidden=hidden)
    interval = normal_interval(bend, by_noise)
    if scatter > 1:
        interval = student_interval(bend, wider, freedom)
    curve = Curve(*interval, _higher_terms(x, y, errors) or (bend,), levels)
    limit = float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2)) if freedom else math.inf
    if abs(bend) < limit * wider:
        return Curve(levels=levels, hidden=abs(bend) * largest, possible=curve)
    return curve


def _polynomial(
    x: Float64Array, y: Float64Array, errors: Float64Array, terms: int
) -> tuple[Float64Array, Float64Array, float, Float64Array]:
    """Factors of x, x², … by weighted least squares, their covariance, χ², and what each y changes in the factors."""
    powers = x[:, None] ** np.arange(1, terms + 1) / errors[:, None]
    inverse = np.linalg.pinv(powers.T @ powers)
    influence = inverse @ powers.T / errors
    factors = influence @ y
    chi2 = float(np.square(powers @ factors - y / errors).sum())
    return factors, np.asarray(inverse), chi2, influence


def _select_levels(measured: Series, end: Peak) -> NDArray[np.bool_]:
    """The levels that the curvature is from."""
    x, y = measured.light, measured.signal
    stray, _ = find_stray(measured, end)
    lit = measured.inside & (x > 0) & ~stray
    used = lit & (y > USED[0] * end.mean[0]) & (y < USED[1] * end.mean[0])
    largest = float(np.max(y, where=lit, initial=0.0))
    if len(set(x[used].tolist())) < ENOUGH and largest > end.mean[0]:
        used = lit & (y > USED[0] * largest) & (y < USED[1] * largest)
    return np.asarray(used)


def _higher_terms(x: Float64Array, y: Float64Array, errors: Float64Array) -> tuple[float, ...]:
    """κ, κ₂, … of as many terms as the levels show, nothing where the first is enough.

    A term is taken where it is 3.3 of its standard errors, with the scatter about the curve that has it.
    """
    found: tuple[float, ...] = ()
    for count in range(3, MOST_TERMS + 2):
        freedom = len(x) - count
        if freedom < 3:
            break
        factors, inverse, chi2, _ = _polynomial(x, y, errors, count)
        scatter = max(1.0, chi2 / freedom)
        limit = CURVED * float(scipy.special.stdtrit(freedom, 0.975)) / TWO_SIDED
        if abs(factors[-1]) > limit * math.sqrt(float(inverse[-1, -1]) * scatter):
            found = tuple(float(a / factors[0] ** (k + 2)) for k, a in enumerate(factors[1:]))
    return found


def _errors(measured: Series, used: NDArray[np.bool_]) -> tuple[Float64Array, Float64Array]:
    """Standard errors of the signals [DN], and the part of them that rounding of the dark frames gives to all alike.

    Few frames of a level tell little of how the light drifts: it does by one share of the signal at all levels.
    """
    signal = measured.signal[used]
    own = [measured.of_flats("mean_error")[used], measured.of_darks("mean_error")[used]]
    drift_dn2 = measured.of_flats("light_error")[used] ** 2 - own[0] ** 2
    drift = math.sqrt(max(float((drift_dn2 / signal**2).mean()), 0.0))
    dark_shift = _shift_by_rounding(measured, measured.of_darks)[used]
    flat_shift = _shift_by_rounding(measured, measured.of_flats)[used]
    squares = [x**2 for x in (*own, drift * signal, dark_shift, flat_shift)]
    return np.maximum(np.sqrt(sum(squares)), 1e-9 * signal), dark_shift


def _shift_by_rounding(measured: Series, of: Callable[[str], Float64Array]) -> Float64Array:
    """Standard deviation of what rounding to whole codes may add to means of levels [DN]."""
    total_dn2 = of("variance") + of("spread") ** 2
    return np.array([rounding_shift_dn(float(x)) if measured.whole else 0.0 for x in total_dn2])


def small_signals(measured: Series, curve: Curve) -> tuple[Series, PhotonTransfer]:
    """Levels as a linear response would have given them, and photon transfer of small signals along them.

    K is that of a line and of a curve where both are possible.
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
    """Photon transfer along a curve, with the share of the dark noise before it that fits the levels best.

    The interval holds K with the shares that noise does not tell from that.
    """
    levels = [curve.straighten(measured, scaled) for scaled in SHARES]
    transfers = list(map(photon_transfer, levels))
    misfits = list(map(_misfit, transfers))
    best = int(np.argmin(misfits))
    gain = transfers[best].gain
    for transfer, misfit in zip(transfers, misfits, strict=True):
        if misfit < misfits[best] + TWO_SIDED**2:
            gain = gain.extended(transfer.gain)
    return levels[best], replace(transfers[best], gain=gain)


def _misfit(transfer: PhotonTransfer) -> float:
    """Sum of squares of what the fitted levels are off the line, over their standard errors."""
    used = transfer.fitted
    off = transfer.variance[used] - transfer.gain.value * transfer.signal[used]
    return float(np.square(off / np.maximum(transfer.errors[used], 1e-300)).sum())
