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
from ..frames.clipping import LARGEST_SHARE, note_left_out
from ..frames.series import Series
from ..frames.stack import Stack
from ..frames.temporal import Maps, temporal
from ..quantity import Quantity, hidden_by_clipping, no_value, unknown
from ..statistics.line_fits import line_through_origin
from .log_axes import set_log_axes
from .saturation import Peak, find_peak, peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FITTED = 0.7
"""Share of the saturation signal up to which K is fitted, EMVA 1288 R4 6.6."""
BINS = 100
FEWEST_OF_A_BIN = 30
"""Pixels of a bin, below which its variance has no normal error."""
GAIN = no_value("K", "overall system gain", "DN/e-", "EMVA 1288 R4 6.6")


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

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """K."""
        return (self.gain,)

    def plot(self, axes: Axes, log: bool = False) -> None:
        """Variance against signal with the fitted line; log for both axes logarithmic."""
        shown, begin = np.ones(len(self.signal), bool), 0.0
        if log:
            shown = (self.signal > 0) & (self.variance > 0)
            begin = self.signal[shown].min()
        fitted, others = shown & self.fitted, shown & ~self.fitted
        axes.errorbar(
            self.signal[fitted],
            self.variance[fitted],
            1.96 * self.errors[fitted],
            fmt="o",
            markersize=3,
            label="fitted",
        )
        axes.plot(
            self.signal[others], self.variance[others], "s", markersize=3, label="not fitted"
        )
        ends = np.array([begin, self.peak.mean[0]])
        if math.isfinite(self.gain.value):
            axes.plot(ends, self.gain.value * ends, color="black", linewidth=1, label="slope K")
        axes.set(xlabel="mean − dark mean [DN]", ylabel="variance − dark variance [DN²]")
        if log:
            set_log_axes(axes)


def photon_transfer(measured: Series) -> PhotonTransfer:
    """Curve and K from flat fields and dark frames, between 0 and 70 % of saturation.

    Weights are the errors of the variances, with what all levels share by their dark frames.
    """
    ends = find_peak(measured)
    variance, errors = measured.of_flats("variance"), measured.of_flats("variance_error")
    freedom, dark_variance = measured.of_flats("freedom"), measured.of_darks("variance")
    within = (measured.signal <= FITTED * ends.mean[0]) & (variance > 0)
    fitted = within & measured.inside & ~measured.coarse
    curve = _Curve(measured.signal, measured.excess, errors, fitted, ends)
    if within.any() and measured.coarse[within].all():
        nothing = unknown(GAIN, measured.flats[int(np.argmax(within))].coarse)
        return PhotonTransfer(nothing, replace(nothing, symbol="K_0"), *curve)

    def covariance(gain: float) -> Float64Array:
        model = dark_variance + gain * np.maximum(measured.signal, 0)
        own = np.hypot(
            _errors_by_model(model, fitted, (variance, errors, freedom)),
            gain * measured.of_flats("mean_error"),
        )
        shared = measured.shared(measured.dark_variance_error)
        shared = shared + measured.shared(gain * measured.of_darks("mean_error"))
        return np.asarray(np.diag(own**2) + shared)

    return _fit(curve, covariance, measured.why_clipped(within))


class _Darkness(NamedTuple):
    """Mean [DN], variance and its standard error [DN²] without light, and why they are clipped, or nothing."""

    mean: float
    variance: float
    error: float
    clipped: str


def photon_transfer_of_scene(scene: Stack, dark: Stack | None = None) -> PhotonTransfer:
    """From one scene that runs from darkness to saturation: mean of the variances in bins of the pixels' means.

    Without dark frames, signal and variance are counted from those of the darkest bin, and the note says so.
    Raises InputError for a scene with less than 5 levels of 30 pixels.
    """
    maps = Maps.empty(scene)
    statistics = temporal(scene, maps)
    notes = [statistics.drift_note]
    if dark is None:
        bins = _bin_pixels(scene, maps.mean, maps.variance)
        clipped = ""
        if bins.clipped[0] > LARGEST_SHARE:
            clipped = _note_clipped_scene(scene)
        darkness = _Darkness(
            float(bins.mean[0]), float(bins.variance[0]), float(bins.error[0]), clipped
        )
        bins = bins.without_darkest()
        notes.insert(0, "signal is counted from the darkest pixels: no dark frames")
    else:
        if dark.shape != scene.shape:
            sizes = f"{scene.shape} pixels, the dark frames {dark.shape}"
            raise InputError(
                f"{scene.source}: the scene has {sizes}; pass frames of equal size."
            )
        below = temporal(dark)
        bins = _bin_pixels(scene, maps.mean - dark.mean, maps.variance)
        clipped = ""
        if dark.clipping.clipped:
            clipped = dark.clipping.note
        darkness = _Darkness(
            below.mean,
            below.variance,
            below.variance_error,
            clipped,
        )
    if scene.bits is None:
        top = None
    else:
        top = 2**scene.bits - 1 - darkness.mean
    excess = bins.variance - darkness.variance
    ends = peak(bins.mean, excess, bins.error, top)
    if ends.limited_by == "not reached":
        notes.append("the scene does not reach saturation")
    variance = excess + darkness.variance
    within = (bins.mean <= FITTED * ends.mean[0]) & (variance > 0)
    fitted = within & (bins.clipped <= LARGEST_SHARE) & (not darkness.clipped)
    freedom = bins.pixels * (statistics.frames - 1)

    def covariance(gain: float) -> Float64Array:
        model = darkness.variance + gain * np.maximum(bins.mean, 0)
        own = np.hypot(
            _errors_by_model(model, fitted, (variance, bins.error, freedom)),
            gain * np.sqrt(model / freedom),
        )
        return np.asarray(np.diag(own**2) + darkness.error**2)

    why_left_out = ""
    if (within & ~fitted).any():
        why_left_out = darkness.clipped or _note_clipped_scene(scene)
    curve = _Curve(bins.mean, excess, bins.error, fitted, ends)
    return _fit(curve, covariance, why_left_out, [note for note in notes if note])


def _note_clipped_scene(scene: Stack) -> str:
    black, top = scene.clipping.black, scene.clipping.saturated
    return f"{black:.2%} of the values of the scene are 0 and {top:.2%} are at the largest code"


class _Bins(NamedTuple):
    """Bins of pixels whose means are about equal, (bins,) each.

    mean, variance : of the pixels' means [DN] and variances [DN²].  error : standard error of that variance.
    pixels : in each bin.  clipped : share of the frames in which they are clipped.
    """

    mean: Float64Array
    variance: Float64Array
    error: Float64Array
    pixels: Float64Array
    clipped: Float64Array

    def without_darkest(self) -> _Bins:
        """All bins but the first, whose mean is subtracted from theirs."""
        mean, variance, error, pixels, clipped = (values[1:] for values in self)
        return _Bins(mean - float(self.mean[0]), variance, error, pixels, clipped)


def _bin_pixels(scene: Stack, means: Float64Array, variances: Float64Array) -> _Bins:
    """Bins of equal width of the pixels' means, without bins of few pixels, (H, W) each.

    Raises InputError where fewer than 5 bins are left.
    """
    x, variance = means.ravel(), variances.ravel()
    clipped = scene.clipping.shares_of_pixels(scene.frames).ravel()
    width = max(float(np.ptp(x)), 1e-9) / BINS
    index = np.minimum(((x - x.min()) / width).astype(np.intp), BINS - 1)
    kept = np.bincount(index, minlength=BINS) >= FEWEST_OF_A_BIN
    count = np.bincount(index, minlength=BINS)[kept].astype(np.float64)
    if len(count) < 5:
        raise InputError(
            f"{scene.source}: {len(count)} levels of {FEWEST_OF_A_BIN} pixels or more between {x.min():.4g} and "
            f"{x.max():.4g} DN; pass a scene that runs from darkness to saturation."
        )

    def average(values: Float64Array) -> Float64Array:
        return np.bincount(index, values, BINS)[kept] / count

    mean_variance = average(variance)
    scatter = np.maximum(average(variance**2) - mean_variance**2, 0)
    error = np.sqrt(scatter / count)
    return _Bins(average(x), mean_variance, error, count, average(clipped))


def _errors_by_model(
    model: Float64Array, fitted: NDArray[np.bool_], measured: tuple[Float64Array, ...]
) -> Float64Array:
    """Standard errors of variances that a line gives; measured are variances, their errors and degrees of freedom.

    Taken from the line, not from each level, since a level that comes out low by chance would weigh more. They are as
    much larger than those of normal noise as the fitted levels' are on average.
    """
    variance, error, freedom = measured
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
    positive = x > 0
    slope = 0.0
    if positive.any():
        slope = float(np.median(y[positive] / x[positive]))
    for _ in range(4):
        line = line_through_origin(x, y, covariance(max(slope, 1e-12))[np.ix_(used, used)])
        slope = line.slope
    note = "; ".join(filter(None, (line.note, note_left_out(clipped), *notes)))
    gain = replace(GAIN, value=line.slope, low=line.low, high=line.high, note=note)
    if used.sum() < 3:
        note = f"a parabola needs 3 levels between darkness and 70 % of saturation, not {used.sum()}"
    name = "gain at zero of a parabola"
    value, low, high = line.initial
    initial = replace(GAIN, symbol="K_0", name=name, value=value, low=low, high=high, note=note)
    return PhotonTransfer(gain, initial, *curve)
