"""Response to light: overall system gain K, curvature, and what ends the range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.types import Float64Array
from ..frames.series import Series, series
from ..frames.stack import Stack
from ..measure.curved_response import curvature, small_signals, straight
from ..measure.photon_transfer import PhotonTransfer
from ..measure.radiometric import radiometric
from ..measure.saturation import Peak, find_peak
from ..quantity import Quantity, no_value, normal_interval
from .evidence import Fitted, frames_of
from .knee import Electrons, Knee, find_knee
from .noise_curve import NoiseCurve, noise_curve

PLATEAU = 0.2
"""Variance over the largest one, below which a level is full."""
MOST_CODES = 1023
"""Largest code up to which a response that is no parabola is written as widths of codes."""
BY_NOISE = (
    "of small signals: the response is that of the noise, whose variance is neither proportional to the signal nor "
    "that of a parabola; light as it is stated may give another"
)


@dataclass(frozen=True, eq=False)
class Response:
    """gain : K of small signals [DN/e-].  ratio : γ, gain at the end of the range over gain at zero.

    curvature : κ of y = s(1 + κs) [1/DN], 0 for a straight response.
    end : the largest signal [DN], linear.  limited_by : what ends it.  transfer : the curve.
    levels, peak : of the flat fields.  curve : the response by the noise, where it is no parabola.
    knee : of the full well, where it is no clip.
    """

    gain: Fitted
    ratio: Fitted
    curvature: float
    end: Fitted
    limited_by: Literal["well", "ADC", "not reached"]
    transfer: PhotonTransfer
    efficiency: Quantity | None
    notes: tuple[str, ...]
    levels: Series
    peak: Peak
    curve: NoiseCurve | None = None
    knee: Knee | None = None

    def straight(self, signal: Float64Array) -> Float64Array:
        """The linear signal s of a signal y, = s(1 + κs) or by the curve [DN]."""
        if self.curve is not None:
            return self.curve.gain * self.curve.electrons_of(signal)
        return straight(signal, self.curvature)

    def per_gain(self, signal: float) -> float:
        """(ds/s)/(dy/y) at a signal y [DN]: by how much less than in proportion y grows with the light."""
        linear = float(self.straight(np.array([signal]))[0])
        if self.curve is not None:
            slope = float(self.curve.slope_of(np.array([signal]))[0])
            return signal / (slope * linear)
        bend = self.curvature * linear
        return (1 + bend) / (1 + 2 * bend)

    def by_noise(self, noise_dn2: float) -> Response:
        """With what the variances of the flat fields say of the response, and of the way in which it saturates.

        noise_dn2 : temporal variance in the dark, without rounding [DN²].
        """
        changed = self
        measured, end = self.levels, self.peak
        gain = self.gain.quantity
        curve = None
        if measured.top_code is not None and measured.top_code <= MOST_CODES:
            curve = noise_curve(measured, end, gain.value, self.curvature, noise_dn2)
        if curve is not None:
            changed = self._along(curve)
        end_e = (
            float(changed.straight(np.array([end.mean[0]]))[0]) / changed.gain.quantity.value
        )
        knee = find_knee(measured, end, changed._of_electrons(), end_e, noise_dn2)
        return replace(changed, knee=knee)

    def _along(self, curve: NoiseCurve) -> Response:
        """This response with the curve in place of the line or parabola."""
        gain = replace(
            self.gain.quantity,
            value=curve.gain,
            low=curve.gain - curve.gain_error,
            high=curve.gain + curve.gain_error,
            note=BY_NOISE,
        )
        y = np.array([self.levels.signal.max()])
        along = replace(self, gain=self.gain.known_as(gain), curvature=0.0, curve=curve)
        end = self.end.quantity
        value = float(along.straight(y)[0])
        wider = value / end.value
        moved = replace(end, value=value, low=end.low * wider, high=end.high * wider)
        ratio = replace(_NO_RATIO, value=1.0, low=1.0, high=1.0)
        return replace(along, end=self.end.known_as(moved), ratio=self.ratio.known_as(ratio))

    def _of_electrons(self) -> Electrons:
        """Signal and slope for so many electrons."""
        gain, kappa, curve = self.gain.quantity.value, self.curvature, self.curve
        if curve is not None:
            return Electrons(
                curve.signal_of, lambda n: curve.gain * curve.slope_of(curve.signal_of(n))
            )
        return Electrons(
            lambda n: gain * n * (1 + kappa * gain * n),
            lambda n: gain * (1 + 2 * kappa * gain * n),
        )


def response(darks: Sequence[Stack], flats: Sequence[Stack]) -> Response:
    """Response from flat fields of one filter and dark frames. Raises InputError as :func:`series` does."""
    measured = series(darks, flats)
    end = find_peak(measured)
    curve = curvature(measured, end)
    kappa, small = curve.kappa, small_signals(measured, curve)
    straightened, transfer = small.levels, small.transfer
    top = _largest_signal(measured, end, kappa)
    ratio = replace(_NO_RATIO, value=1.0, low=1.0, high=1.0)
    if kappa:
        low, high = sorted(1 + limit * top.value for limit in (curve.low, curve.high))
        ratio = replace(_NO_RATIO, value=1 + kappa * top.value, low=low, high=high)
    frames = frames_of(*flats)
    return Response(
        gain=Fitted(transfer.gain, frames),
        ratio=Fitted(ratio, frames),
        curvature=kappa,
        end=Fitted(top, frames),
        limited_by=end.limited_by,
        transfer=transfer,
        efficiency=radiometric(straightened).efficiency(transfer.gain),
        notes=measured.notes,
        levels=measured,
        peak=end,
    )


_NO_RATIO = no_value("γ", "gain at full well over gain at zero", "", "fit")
_NO_END = no_value("µ_y.end", "largest linear signal", "DN", "fit")


def _largest_signal(measured: Series, end: Peak, kappa: float) -> Quantity:
    """The linear mean of the brightest level where it is full; else a lower limit."""
    y, excess = measured.signal, measured.excess
    best = int(np.argmax(y))
    value = float(straight(y[best : best + 1], kappa)[0])
    full = excess[best] < PLATEAU * excess[end.index] and end.limited_by != "not reached"
    if not full:
        note = "the brightest flat field is not full: a lower limit"
        return replace(_NO_END, value=value, low=value, high=math.inf, note=note)
    flat_error = float(measured.of_flats("mean_error")[best])
    dark_error = float(measured.of_darks("mean_error")[best])
    _, low, high = normal_interval(value, math.hypot(flat_error, dark_error))
    return replace(_NO_END, value=value, low=low, high=high)
