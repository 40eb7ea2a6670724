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
from ..measure.curved_response import OF_SMALL_SIGNALS, curvature, straight, straighten
from ..measure.photon_transfer import PhotonTransfer, photon_transfer
from ..measure.radiometric import radiometric
from ..measure.saturation import Peak, find_peak
from ..quantity import Quantity, no_value, normal_interval
from .evidence import Fitted, frames_of

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
    kappa, *ends_of_curvature = curvature(measured, end)
    straightened = measured
    if kappa:
        straightened = straighten(measured, kappa)
    transfer = photon_transfer(straightened)
    top = _largest_signal(measured, end, kappa)
    gain = transfer.gain
    if kappa:
        gain = gain.noted(OF_SMALL_SIGNALS)
    ratio = replace(_NO_RATIO, value=1.0, low=1.0, high=1.0)
    if kappa:
        low, high = sorted(1 + limit * top.value for limit in ends_of_curvature)
        ratio = replace(_NO_RATIO, value=1 + kappa * top.value, low=low, high=high)
    frames = frames_of(*flats)
    return Response(
        gain=Fitted(gain, frames),
        ratio=Fitted(ratio, frames),
        curvature=kappa,
        end=Fitted(top, frames),
        limited_by=end.limited_by,
        transfer=transfer,
        efficiency=radiometric(straightened).efficiency(transfer.gain),
        notes=measured.notes,
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
