"""Response to light: overall system gain K, curvature, and what ends the range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.series import Level, Series, series
from ..frames.stack import Stack
from ..measure.photon_transfer import PhotonTransfer, photon_transfer
from ..measure.radiometric import find_stray, radiometric
from ..measure.saturation import Peak, find_peak
from ..quantity import Quantity, no_value, normal_interval, student_interval
from .evidence import Fitted, frames_of
from .parabola import straight

USED = 0.02, 0.9
"""Part of the saturation signal from which the curvature is fitted."""
FEWEST = 5
"""Levels that it needs."""
CURVED = 3.3
"""Standard errors from which on a response is taken as curved: 0.1 % of the straight ones."""
PLATEAU = 0.2
"""Variance over the largest one, below which a level is full."""
MOST_PIXELS = 1024
"""Rows and columns about the centre of which K is measured: of 2 frames they give it within 0.2 %."""


@dataclass(frozen=True, eq=False)
class Response:
    """gain : K of small signals [DN/e-].  ratio : γ, gain at the end of the range over gain at zero.

    curvature : κ of y = s(1 + κs) [1/DN], 0 for a straight response.
    end : the largest signal [DN], linear.  limited_by : what ends it.  transfer : the curve.
    """

    gain: Fitted
    ratio: Fitted
    curvature: float
    end: Fitted
    limited_by: Literal["well", "ADC", "not reached"]
    transfer: PhotonTransfer
    efficiency: Quantity | None
    notes: tuple[str, ...]

    def straight(self, signal: Float64Array) -> Float64Array:
        """The linear signal s of a signal y = s(1 + κs) [DN]."""
        return straight(signal, self.curvature)


def response(darks: Sequence[Stack], flats: Sequence[Stack]) -> Response:
    """Response from flat fields of one filter and dark frames. Raises InputError as :func:`series` does."""
    measured = series(darks, flats, MOST_PIXELS)
    end = find_peak(measured)
    curvature, *ends_of_curvature = _curvature(measured, end)
    straightened = measured
    if curvature:
        straightened = _straighten(measured, curvature)
    transfer = photon_transfer(straightened)
    top = _largest_signal(measured, end, curvature)
    gain = transfer.gain
    if curvature:
        gain = gain.noted(
            "of small signals: the response is curved, and variances are divided by the square of its slope; "
            "EMVA 1288 Linear, as characterize has it, takes the curve as a line"
        )
    ratio = replace(_NO_RATIO, value=1.0, low=1.0, high=1.0)
    if curvature:
        low, high = sorted(1 + kappa * top.value for kappa in ends_of_curvature)
        ratio = replace(_NO_RATIO, value=1 + curvature * top.value, low=low, high=high)
    frames = frames_of(*flats)
    return Response(
        gain=Fitted(gain, frames),
        ratio=Fitted(ratio, frames),
        curvature=curvature,
        end=Fitted(top, frames),
        limited_by=end.limited_by,
        transfer=transfer,
        efficiency=radiometric(straightened).efficiency(transfer.gain),
        notes=measured.notes,
    )


_NO_RATIO = no_value("γ", "gain at full well over gain at zero", "", "fit")
_NO_END = no_value("µ_y.end", "largest linear signal", "DN", "fit")


def _curvature(measured: Series, end: Peak) -> tuple[float, float, float]:
    """(κ, low, high), or zeros where the response is straight or the light of the levels is not known."""
    nothing = 0.0, 0.0, 0.0
    x, y = measured.light, measured.signal
    used = measured.inside & (y > USED[0] * end.mean[0]) & (y < USED[1] * end.mean[0]) & (x > 0)
    stray, _ = find_stray(measured, end)
    used &= ~stray
    if used.sum() < FEWEST or len(set(x[used].tolist())) < FEWEST:
        return nothing
    x, y = x[used], y[used]
    errors = np.hypot(measured.of_flats("light_error"), measured.of_darks("light_error"))[used]
    start, largest = float(y[0] / x[0]), y.max()

    def deviations(p: Float64Array) -> Float64Array:
        model = start * p[0] * x * (1 + p[1] * start * p[0] * x / largest)
        return np.asarray((model - y) / np.maximum(errors, 1e-9 * y))

    fit = scipy.optimize.least_squares(deviations, (1.0, 0.0))
    freedom = len(x) - 2
    scatter = max(1.0, 2 * float(fit.cost) / freedom)
    error = math.sqrt(float(np.linalg.inv(fit.jac.T @ fit.jac)[1, 1]) * scatter)
    limit = CURVED * error * float(scipy.special.stdtrit(freedom, 0.975)) / 1.96
    if abs(fit.x[1]) < limit:
        return nothing
    kappa, error_of_kappa = float(fit.x[1]) / float(largest), error / float(largest)
    if scatter > 1:
        return student_interval(kappa, error_of_kappa, freedom)
    return normal_interval(kappa, error_of_kappa)


def _straighten(measured: Series, curvature: float) -> Series:
    """The levels that a linear response would have given: variances over the square of the slope."""
    flats: list[Level] = []
    for flat, dark_number in zip(measured.flats, measured.dark_of, strict=True):
        dark = measured.darks[dark_number]
        signal = float(straight(np.array(flat.mean - dark.mean), curvature))
        slope = 1 + 2 * curvature * signal
        variance = max(dark.variance + (flat.variance - dark.variance) / slope**2, 0.0)
        linear = replace(
            flat,
            mean=dark.mean + signal,
            variance=variance,
            variance_error=flat.variance_error / slope**2,
        )
        flats.append(linear)
    return replace(measured, flats=tuple(flats))


def _largest_signal(measured: Series, end: Peak, curvature: float) -> Quantity:
    """The linear mean of the brightest level where it is full; else a lower limit."""
    y, excess = measured.signal, measured.excess
    best = int(np.argmax(y))
    value = float(straight(y[best : best + 1], curvature)[0])
    full = excess[best] < PLATEAU * excess[end.index] and end.limited_by != "not reached"
    if not full:
        note = "the brightest flat field is not full: a lower limit"
        return replace(_NO_END, value=value, low=value, high=math.inf, note=note)
    flat_error = float(measured.of_flats("mean_error")[best])
    dark_error = float(measured.of_darks("mean_error")[best])
    _, low, high = normal_interval(value, math.hypot(flat_error, dark_error))
    return replace(_NO_END, value=value, low=low, high=high)
