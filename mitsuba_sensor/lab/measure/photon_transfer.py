"""Photon transfer: temporal variance against the mean, whose slope is the overall system gain K.

From flat fields (EMVA 1288 R4 6.6), or from one scene that runs from darkness to saturation, in bins of the pixels'
means (Konnik and Welsh 2014, section 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import LARGEST_SHARE
from ..frames.series import Series
from ..frames.stack import Stack
from ..frames.temporal import temporal
from ..quantity import Quantity, hidden_by_clipping, unknown
from ..statistics.line_fits import line_through_origin
from .saturation import Peak, find_peak, peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FITTED = 0.7
"""Share of the saturation signal up to which K is fitted, EMVA 1288 R4 6.6."""
BINS = 100
FEWEST_OF_A_BIN = 30
"""Pixels of a bin, below which its variance has no normal error."""
GAIN = Quantity(
    "K", "overall system gain", math.nan, math.nan, math.nan, "DN/e-", "EMVA 1288 R4 6.6"
)


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """The curve, and K as the slope of its lower part.

    gain : K [DN/e-].  initial_gain : slope at zero of a parabola, which is K of the linear part of a curved response.
    signal : mean minus dark mean [DN].  variance : temporal variance minus that in the dark [DN²], and its standard
    errors.  fitted : which points K is from.  peak : the largest variance, and whether the well or the ADC ends there.
    """

    gain: Quantity
    initial_gain: Quantity
    signal: Float64Array
    variance: Float64Array
    errors: Float64Array
    fitted: NDArray[np.bool_]
    peak: Peak

    def plot(self, axes: Axes, log: bool = False) -> None:
        """Variance against signal with the fitted line; log for both axes logarithmic."""
        shown = (
            (self.signal > 0) & (self.variance > 0) if log else np.ones(len(self.signal), bool)
        )
        fitted = shown & self.fitted
        bars = 1.96 * self.errors[fitted]
        axes.errorbar(
            self.signal[fitted],
            self.variance[fitted],
            bars,
            fmt="o",
            markersize=3,
            label="fitted",
        )
        axes.plot(
            self.signal[shown & ~fitted],
            self.variance[shown & ~fitted],
            "s",
            markersize=3,
            label="not fitted",
        )
        ends = np.array([self.signal[shown].min() if log else 0.0, self.peak.mean[0]])
        if math.isfinite(self.gain.value):
            axes.plot(ends, self.gain.value * ends, color="black", linewidth=1, label="slope K")
        axes.set(xlabel="mean − dark mean [DN]", ylabel="variance − dark variance [DN²]")
        if log:
            axes.set(xscale="log", yscale="log")


def photon_transfer(measured: Series) -> PhotonTransfer:
    """From flat fields and dark frames, between 0 and 70 % of saturation.

    Weights are the errors of the variances, with what all levels share by their dark frames.
    """
    found = find_peak(measured)
    within = (measured.signal <= FITTED * found.mean[0]) & (measured.of_flats("variance") > 0)
    fitted, clipped = within & measured.inside, measured.why_clipped(within)
    errors, freedom = measured.of_flats("variance_error"), measured.of_flats("freedom")
    curve = _Curve(measured.signal, measured.excess, errors, fitted, found)
    dark, variance = measured.of_darks("variance"), measured.of_flats("variance")

    def covariance(gain: float) -> Float64Array:
        own = _errors(
            dark + gain * np.maximum(measured.signal, 0), fitted, (variance, errors, freedom)
        )
        own = np.hypot(own, gain * measured.of_flats("mean_error"))
        shared = measured.shared(measured.dark_variance_error) + measured.shared(
            gain * measured.of_darks("mean_error")
        )
        return np.asarray(np.diag(own**2) + shared)

    return _fit(curve, covariance, clipped)


def photon_transfer_of_scene(scene: Stack, dark: Stack | None = None) -> PhotonTransfer:
    """From one scene that runs from darkness to saturation: mean of the variances in bins of the pixels' means.

    Without dark frames, signal and variance are counted from those of the darkest bin, and the note says so.
    Raises InputError for a scene with less than 5 levels of 30 pixels.
    """
    found = temporal(scene)
    below = None if dark is None else temporal(dark)
    if below is not None and below.mean.shape != found.mean.shape:
        sizes = f"{found.mean.shape} pixels, the dark frames {below.mean.shape}"
        raise InputError(f"{scene.source}: the scene has {sizes}; pass frames of equal size.")
    x = (found.mean if below is None else found.mean - below.mean).ravel()
    mean, variance, error, count, clipped = _bins(
        x, found.variance.ravel(), scene.clipping.shares_of_pixels(scene.frames).ravel()
    )
    if len(mean) < 5:
        raise InputError(
            f"{scene.source}: {len(mean)} levels of {FEWEST_OF_A_BIN} pixels or more between {x.min():.4g} and "
            f"{x.max():.4g} DN; pass a scene that runs from darkness to saturation."
        )
    base = float(mean[0]) if below is None else 0.0
    floor, floor_error = (
        (variance[0], error[0])
        if below is None
        else (below.variance.mean(), below.variance_error)
    )
    top = None
    if scene.bits is not None:
        top = 2**scene.bits - 1 - base - (0.0 if below is None else float(below.mean.mean()))
    first = 1 if below is None else 0
    signal, excess, error, count = (
        mean[first:] - base,
        variance[first:] - floor,
        error[first:],
        count[first:],
    )
    ends = peak(signal, excess, error, top)
    within = (signal <= FITTED * ends.mean[0]) & (excess + floor > 0)
    inside = clipped <= LARGEST_SHARE
    darkness_is_clipped = not inside[0] if dark is None else dark.clipping.clipped
    fitted = within & inside[first:] & (not darkness_is_clipped)
    freedom = count * (found.frames - 1)

    def covariance(gain: float) -> Float64Array:
        model = floor + gain * np.maximum(signal, 0)
        own = np.hypot(
            _errors(model, fitted, (excess + floor, error, freedom)),
            gain * np.sqrt(model / freedom),
        )
        return np.asarray(np.diag(own**2) + floor_error**2)

    notes = [
        "signal is counted from the darkest pixels: no dark frames" if below is None else "",
        found.drift_note,
    ]
    notes += _open_end(ends)
    why = ""
    if (within & ~fitted).any():
        why = (
            dark.clipping.note
            if dark is not None and dark.clipping.clipped
            else _why_of_scene(scene)
        )
    return _fit(
        _Curve(signal, excess, error, fitted, ends),
        covariance,
        why,
        [one for one in notes if one],
    )


def _why_of_scene(scene: Stack) -> str:
    black, top = scene.clipping.black, scene.clipping.saturated
    return f"{black:.2%} of the values of the scene are 0 and {top:.2%} are at the largest code"


def _open_end(ends: Peak) -> list[str]:
    return ["the scene does not reach saturation"] if ends.limited_by == "not reached" else []


def _bins(
    x: Float64Array, variance: Float64Array, clipped: Float64Array
) -> tuple[Float64Array, ...]:
    """Means, mean variances, their standard errors, pixels, and clipped shares of bins of equal width, without bins of
    few pixels."""
    width = max(float(np.ptp(x)), 1e-9) / BINS
    index = np.minimum(((x - x.min()) / width).astype(np.intp), BINS - 1)
    kept = np.bincount(index, minlength=BINS) >= FEWEST_OF_A_BIN
    count = np.bincount(index, minlength=BINS)[kept].astype(np.float64)
    mean, average, square, share = (
        np.bincount(index, one, BINS)[kept] / count
        for one in (x, variance, variance**2, clipped)
    )
    return mean, average, np.sqrt(np.maximum(square - average**2, 0) / count), count, share


def _errors(
    model: Float64Array, fitted: NDArray[np.bool_], found: tuple[Float64Array, ...]
) -> Float64Array:
    """Standard errors of variances that a line gives; found are variances, their errors and degrees of freedom.

    Taken from the line, not from each level, since a level that comes out low by chance would weigh more. They are as
    much larger than those of normal noise as the fitted levels' are on average.
    """
    variance, error, freedom = found
    excess = float(np.mean((error[fitted] / variance[fitted]) ** 2 * freedom[fitted] / 2))
    return np.asarray(model * np.sqrt(2 * max(excess, 0.5) / freedom))


class _Curve(NamedTuple):
    """The points of a curve, before K is known."""

    signal: Float64Array
    variance: Float64Array
    errors: Float64Array
    fitted: NDArray[np.bool_]
    peak: Peak


def _fit(
    curve: _Curve,
    covariance: Callable[[float], Float64Array],
    clipped: str,
    notes: Sequence[str] = (),
) -> PhotonTransfer:
    """K of the points that are fitted, whose errors depend on K.  clipped : why points are left out, or nothing."""
    used = curve.fitted
    if not used.any() or curve.peak.mean[0] <= 0 or not (curve.variance[used] > 0).any():
        nothing = unknown(GAIN, "no level lies between darkness and 70 % of saturation")
        if clipped:
            nothing = hidden_by_clipping(GAIN, clipped)
        return PhotonTransfer(nothing, replace(nothing, symbol="K_0"), *curve)
    x, y = curve.signal[used], curve.variance[used]
    gain = float(np.median(y[x > 0] / x[x > 0])) if (x > 0).any() else 0.0
    for _ in range(4):
        line = line_through_origin(x, y, covariance(max(gain, 1e-12))[np.ix_(used, used)])
        gain = line.slope
    left_out = f"levels with clipped values are left out ({clipped})" if clipped else ""
    note = "; ".join(filter(None, (line.note, left_out, *notes)))
    known = replace(GAIN, value=line.slope, low=line.low, high=line.high, note=note)
    value, low, high = line.initial
    few = (
        ""
        if used.sum() > 2
        else f"a parabola needs 3 levels between darkness and 70 % of saturation, not {used.sum()}"
    )
    initial = replace(
        GAIN, symbol="K_0", name="gain at zero of a parabola", value=value, low=low, high=high
    )
    return PhotonTransfer(known, replace(initial, note=few or note), *curve)
