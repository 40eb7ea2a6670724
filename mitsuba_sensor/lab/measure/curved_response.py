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
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from ...core.types import Float64Array
from ..frames.series import Level, Series
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
NEWTON_STEPS = 12
SHARES = 0.0, 0.25, 0.5, 0.75, 1.0
"""Of the dark noise, that may arise before the response is curved."""
OF_SMALL_SIGNALS = (
    "of small signals: the response is curved, and variances are divided by the square of its slope; EMVA 1288 Linear "
    "takes the curve as a line"
)
TOO_FEW = (
    "levels of known light below 90 % of the largest mean: {}, which cannot tell whether the response is curved; "
    "take 3 or more"
)
UNDECIDED = "{} levels do not tell a curve of {:.2g} % from light that is not what is stated; the interval holds both"
HIDDEN = "{} levels do not tell a curve of up to {:.2g} % from a line"
"""In the notes of figures."""


def straight(signal: Float64Array, curvature: float) -> Float64Array:
    """s of y; signals beyond the vertex are taken to be at it.  signal, curvature : y [DN], κ [1/DN]."""
    if not curvature:
        return signal
    root = np.sqrt(np.maximum(1 + 4 * curvature * signal, 1e-9))
    return np.asarray((root - 1) / (2 * curvature))


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
            return TOO_FEW.format(self.levels)
        if self.possible:
            return UNDECIDED.format(self.levels, 100 * self.hidden)
        if self.hidden > MOST_HIDDEN:
            return HIDDEN.format(self.levels, 100 * self.hidden)
        return ""

    @property
    def possible_kappa(self) -> float:
        """κ of the possible curve, or 0 [1/DN]."""
        if self.possible is None:
            return 0.0
        return self.possible.kappa

    def __bool__(self) -> bool:
        return bool(self.kappa)

    def straight(self, signal: Float64Array) -> Float64Array:
        """s of y [DN], by Newton's method where it is no parabola."""
        linear = straight(signal, self.kappa)
        if len(self.terms) < 2:
            return linear
        for _ in range(NEWTON_STEPS):
            excess = linear * polyval(linear, (1.0, *self.terms)) - signal
            linear = linear - excess / np.maximum(self.slope(linear), 0.1)
        return linear

    def slope(self, linear: Float64Array) -> Float64Array:
        """dy/ds at s [DN]."""
        weighted = [(power + 2) * term for power, term in enumerate(self.terms)]
        return np.asarray(polyval(linear, (1.0, *weighted)))


def curvature(measured: Series, end: Peak) -> Curve:
    """The curve of the levels; a line where they show none, or where their light is not known."""
    used = _select_levels(measured, end)
    x, y = measured.light[used], measured.signal[used]
    levels = len(set(x.tolist()))
    if levels < FEWEST:
        return Curve(levels=levels)
    errors, dark_shift = _errors(measured, used)
    start, largest = float(y[0] / x[0]), float(y.max())

    def deviations(p: Float64Array) -> Float64Array:
        model = start * p[0] * x * (1 + p[1] * start * p[0] * x / largest)
        return np.asarray((model - y) / errors)

    fit = scipy.optimize.least_squares(deviations, (1.0, 0.0))
    bend, freedom = float(fit.x[1]), len(x) - 2
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    own = math.sqrt(float(covariance[1, 1]))
    of_dark = float((covariance @ fit.jac.T @ (dark_shift / errors))[1])
    by_noise, by_scatter = CURVED * math.hypot(own, of_dark), math.inf
    scatter = 1.0
    if freedom:
        scatter = 2 * float(fit.cost) / freedom
        quantile = float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2))
        by_scatter = quantile * math.hypot(own * math.sqrt(scatter), of_dark)
    if abs(bend) < by_noise:
        return Curve(levels=levels, hidden=by_noise)
    interval = normal_interval(bend / largest, math.hypot(own, of_dark) / largest)
    if scatter > 1:
        error = math.hypot(own * math.sqrt(scatter), of_dark) / largest
        interval = student_interval(bend / largest, error, freedom)
    terms = _higher_terms(x / x.max(), y, errors) or (bend / largest,)
    curve = Curve(*interval, terms, levels)
    if abs(bend) < by_scatter:
        return Curve(levels=levels, hidden=abs(bend), possible=curve)
    return curve


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
    for count in range(2, MOST_TERMS + 1):
        powers = x[:, None] ** np.arange(1, count + 2) / errors[:, None]
        freedom = len(x) - count - 1
        if freedom < 3:
            break
        inverse = np.linalg.pinv(powers.T @ powers)
        factors = inverse @ powers.T @ (y / errors)
        scatter = max(1.0, float(np.square(powers @ factors - y / errors).sum()) / freedom)
        limit = CURVED * float(scipy.special.stdtrit(freedom, 0.975)) / 1.96
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
    if not measured.whole:
        return np.zeros_like(total_dn2)
    return np.array([rounding_shift_dn(float(x)) for x in total_dn2])


def straighten(measured: Series, curve: Curve, scaled: float = 0.0) -> Series:
    """The levels that a linear response would have given: variances over the square of the slope.

    scaled : share of the dark noise's variance that arises before the response is curved, and is scaled by its slope.
    """
    flats: list[Level] = []
    for flat, dark_number in zip(measured.flats, measured.dark_of, strict=True):
        dark = measured.darks[dark_number]
        linear_dn = curve.straight(np.array(flat.mean - dark.mean))
        signal, slope = float(linear_dn), float(curve.slope(linear_dn))
        light_dn2 = (
            flat.variance - (1 - scaled + scaled * slope**2) * dark.variance
        ) / slope**2
        linear = replace(
            flat,
            mean=dark.mean + signal,
            variance=max(dark.variance + light_dn2, 0.0),
            variance_error=flat.variance_error / slope**2,
        )
        flats.append(linear)
    return replace(measured, flats=tuple(flats))


@dataclass(frozen=True, eq=False)
class SmallSignals:
    """levels : as a linear response would have given them.  transfer : photon transfer along them."""

    levels: Series
    transfer: PhotonTransfer


def small_signals(measured: Series, curve: Curve) -> SmallSignals:
    """Photon transfer of small signals along a response; K of a line and of a curve where both are possible."""
    if curve:
        found = _along(measured, curve)
    else:
        found = SmallSignals(measured, photon_transfer(measured))
    gain = found.transfer.gain.noted(curve.note)
    if curve.possible:
        gain = gain.extended(_along(measured, curve.possible).transfer.gain)
    return replace(found, transfer=replace(found.transfer, gain=gain))


def _along(measured: Series, curve: Curve) -> SmallSignals:
    """Photon transfer along a curve, with the share of the dark noise before it that fits the levels best.

    The interval holds K with the shares that noise does not tell from that.
    """
    found: list[SmallSignals] = []
    for scaled in SHARES:
        levels = straighten(measured, curve, scaled)
        found.append(SmallSignals(levels, photon_transfer(levels)))
    misfits = [_misfit(each.transfer) for each in found]
    best = int(np.argmin(misfits))
    gain = found[best].transfer.gain
    for each, misfit in zip(found, misfits, strict=True):
        if misfit < misfits[best] + TWO_SIDED**2:
            gain = gain.extended(each.transfer.gain)
    return replace(found[best], transfer=replace(found[best].transfer, gain=gain))


def _misfit(transfer: PhotonTransfer) -> float:
    """Sum of squares of what the fitted levels are off the line, over their standard errors."""
    used = transfer.fitted
    off = transfer.variance[used] - transfer.gain.value * transfer.signal[used]
    return float(np.square(off / np.maximum(transfer.errors[used], 1e-300)).sum())


def relative_slope(signal: float, kappa: float) -> float:
    """(dy/y)/(ds/s) at a signal y [DN]: by how much more than in proportion y grows with the light."""
    linear = float(straight(np.array(signal), kappa))
    return (1 + 2 * kappa * linear) / (1 + kappa * linear)
