"""Response to light: overall system gain K, curvature, and what ends the range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.series import Series, series
from ..frames.stack import Stack
from ..measure.photon_transfer import PhotonTransfer, photon_transfer
from ..measure.radiometric import radiometric
from ..measure.saturation import Peak, find_peak
from ..quantity import Quantity, normal_interval, student_interval
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
    """From flat fields of one filter and dark frames. Raises InputError as :func:`series` does."""
    measured = series(darks, flats, MOST_PIXELS)
    end = find_peak(measured)
    curvature = _curvature(measured, end)
    used = _straightened(measured, curvature[0]) if curvature[0] else measured
    transfer = photon_transfer(used)
    frames = frames_of(*flats)
    made = Response(
        Fitted(transfer.gain, frames),
        Fitted(_NO_RATIO, frames),
        curvature[0],
        Fitted(_NO_END, frames),
        end.limited_by,
        transfer,
        radiometric(used).efficiency(transfer.gain),
        measured.notes,
    )
    top = _end(measured, end, made)
    ratio = replace(_NO_RATIO, value=1.0, low=1.0, high=1.0)
    if curvature[0]:
        value, low, high = (1 + one * top.value for one in curvature)
        ratio = replace(_NO_RATIO, value=value, low=min(low, high), high=max(low, high))
    return replace(made, end=Fitted(top, frames), ratio=Fitted(ratio, frames))


_NO_RATIO = Quantity(
    "γ", "gain at full well over gain at zero", math.nan, math.nan, math.nan, "", "fit"
)
_NO_END = Quantity(
    "µ_y.end", "largest linear signal", math.nan, math.nan, math.nan, "DN", "fit"
)


def _curvature(measured: Series, end: Peak) -> tuple[float, float, float]:
    """(κ, low, high), or zeros where the response is straight or the light of the levels is not known."""
    nothing = 0.0, 0.0, 0.0
    x, y = measured.light, measured.signal
    used = measured.inside & (y > USED[0] * end.mean[0]) & (y < USED[1] * end.mean[0]) & (x > 0)
    if used.sum() < FEWEST or len(set(x[used].tolist())) < FEWEST:
        return nothing
    x, y = x[used], y[used]
    error = np.hypot(
        measured.of_flats("light_error")[used], measured.of_darks("light_error")[used]
    )
    start = float(y[0] / x[0])
    found = scipy.optimize.least_squares(
        lambda p: (
            (start * p[0] * x * (1 + p[1] * start * p[0] * x / y.max()) - y)
            / np.maximum(error, 1e-9 * y)
        ),
        (1.0, 0.0),
    )
    freedom = len(x) - 2
    scatter = max(1.0, 2 * float(found.cost) / freedom)
    deviation = math.sqrt(float(np.linalg.inv(found.jac.T @ found.jac)[1, 1]) * scatter)
    kappa = float(found.x[1]) / float(y.max())
    if (
        abs(found.x[1])
        < CURVED * deviation * float(scipy.special.stdtrit(freedom, 0.975)) / 1.96
    ):
        return nothing
    error_of_kappa = deviation / float(y.max())
    one = (
        student_interval(kappa, error_of_kappa, freedom)
        if scatter > 1
        else normal_interval(kappa, error_of_kappa)
    )
    return one


def _straightened(measured: Series, curvature: float) -> Series:
    """The same levels as a linear response would have given: variances over the square of the slope."""
    flats = []
    for flat, dark in zip(
        measured.flats, (measured.darks[k] for k in measured.dark_of), strict=True
    ):
        s = float(straight(np.array(flat.mean - dark.mean), curvature))
        slope = 1 + 2 * curvature * s
        noise = max(dark.variance + (flat.variance - dark.variance) / slope**2, 0.0)
        flats.append(
            replace(
                flat,
                mean=dark.mean + s,
                variance=noise,
                variance_error=flat.variance_error / slope**2,
            )
        )
    return replace(measured, flats=tuple(flats))


def _end(measured: Series, end: Peak, found: Response) -> Quantity:
    """The mean of the brightest level where it is full; else a lower limit."""
    y, excess = measured.signal, measured.excess
    best = int(np.argmax(y))
    value = float(found.straight(y[best : best + 1])[0])
    full = excess[best] < PLATEAU * excess[end.index] and end.limited_by != "not reached"
    if not full:
        note = "the brightest flat field is not full: a lower limit"
        return replace(_NO_END, value=value, low=value, high=math.inf, note=note)
    noise = math.hypot(
        float(measured.of_flats("mean_error")[best]),
        float(measured.of_darks("mean_error")[best]),
    )
    _, low, high = normal_interval(value, noise)
    return replace(_NO_END, value=value, low=low, high=high)
