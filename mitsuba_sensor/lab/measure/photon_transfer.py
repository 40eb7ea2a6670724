"""Photon transfer: temporal variance versus mean, whose slope is the overall system gain K.

The points are flat fields (EMVA 1288 R4 6.6), or bins of pixels in one scene from dark to saturated (Konnik and Welsh
2014, section 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.plots import set_log_axes
from ...core.types import Float64Array
from ..frames.clipping import CLIPPED_MAX, note_left_out
from ..frames.series import Series
from ..frames.stack import Stack
from ..frames.temporal import Maps, temporal
from ..quantity import Figures, Quantity, no_value
from ..statistics.line_fits import line_through_origin
from .saturation import Peak, find_peak, peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FITTED = 0.7
"""Fraction of the saturation signal up to which K is fitted (EMVA 1288 R4 6.6)."""
BINS = 100
BIN_PIXELS_MIN = 30
"""Smallest number of pixels in a bin; the variance of fewer has no normal error."""
GAIN = no_value("K", "overall system gain", "DN/e-", "EMVA 1288 R4 6.6")
INITIAL_GAIN = replace(GAIN, symbol="K_0", name="gain at zero of a parabola")


@dataclass(frozen=True, eq=False)
class PhotonTransfer(Figures):
    """Photon transfer curve, and K as the slope of its lower part.

    gain : K [DN/e-].  initial_gain : slope at zero of a parabola, K of the linear part of a curved response.
    signal : mean minus dark mean [DN].  variance, errors : temporal variance minus dark variance, with standard errors
    [DN²].  fitted : mask of the points that K is fitted to.  peak : largest variance and limit of the range.
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
        """K alone."""
        return (self.gain,)

    def plot(self, axes: Axes, log: bool = False) -> None:
        """Plot variance versus signal with the fitted line.  log : True for logarithmic axes."""
        shown, begin = np.ones(len(self.signal), bool), 0.0
        if log:
            shown = (self.signal > 0) & (self.variance > 0)
            begin = self.signal[shown].min()
        x, y, error = self.signal, self.variance, 1.96 * self.errors
        fitted, others = shown & self.fitted, shown & ~self.fitted
        axes.errorbar(x[fitted], y[fitted], error[fitted], fmt="o", ms=3, label="fitted")
        axes.plot(x[others], y[others], "s", ms=3, label="not fitted")
        ends = np.array([begin, self.peak.mean[0]])
        if math.isfinite(self.gain.value):
            axes.plot(ends, self.gain.value * ends, color="black", lw=1, label="slope K")
        axes.set(xlabel="mean − dark mean [DN]", ylabel="variance − dark variance [DN²]")
        if log:
            set_log_axes(axes)


class _Points(NamedTuple):
    """Points of a curve, shape (n,) each, whose errors depend on K.

    signal, variance, errors, fitted, peak : as in :class:`PhotonTransfer`.
    dark : dark variance [DN²].  freedom : degrees of freedom of the variances.
    mean_error : standard errors of the means for a variance of 1 DN².
    shared : covariances (n, n) of the variances and of the means that share dark frames.
    """

    signal: Float64Array
    variance: Float64Array
    errors: Float64Array
    fitted: NDArray[np.bool_]
    peak: Peak
    dark: Float64Array
    freedom: Float64Array
    mean_error: Float64Array
    shared: tuple[Float64Array, Float64Array]

    def covariance(self, gain: float) -> Float64Array:
        """Return the covariance of the fitted variances for this K.

        Errors come from the line instead of each level, because a level that is low at random would get more weight.
        They are scaled to the average error of the fitted levels relative to normal noise.
        """
        used = self.fitted
        measured = (self.variance + self.dark)[used]
        square = (self.errors[used] / measured) ** 2 * self.freedom[used] / 2
        model = self.dark + gain * np.maximum(self.signal, 0)
        single = model * np.sqrt(2 * max(float(np.mean(square)), 0.5) / self.freedom)
        by_mean = gain * self.mean_error * np.sqrt(model)
        whole = np.diag(single**2 + by_mean**2) + self.shared[0] + gain**2 * self.shared[1]
        return np.asarray(whole[np.ix_(used, used)])

    def without_gain(self, why: str, clipped: bool = False) -> PhotonTransfer:
        """Return the curve without K.  clipped : True if clipping is the reason."""
        gain, initial_gain = (gain.without_value(why, clipped) for gain in (GAIN, INITIAL_GAIN))
        return PhotonTransfer(gain, initial_gain, *self[:5])

    def fit(self, clipped: str, notes: Sequence[str] = ()) -> PhotonTransfer:
        """Fit K.  clipped : reason why points are left out, or empty."""
        x, y = self.signal[self.fitted], self.variance[self.fitted]
        if not len(x) or self.peak.mean[0] <= 0 or not (y > 0).any():
            why = clipped or "no level lies between dark and 70 % of saturation"
            return self.without_gain(why, bool(clipped))
        slope = float(np.median((y / np.maximum(x, 1e-300))[x > 0])) if (x > 0).any() else 0.0
        for _ in range(4):
            line = line_through_origin(x, y, self.covariance(max(slope, 1e-12)))
            slope = line.slope
        note = "; ".join(filter(None, (line.note, note_left_out(clipped), *notes)))
        gain = GAIN.with_interval((line.slope, line.low, line.high)).noted(note)
        if len(x) < 3:
            note = (
                f"a parabola needs 3 levels between dark and 70 % of saturation, not {len(x)}"
            )
        initial = INITIAL_GAIN.with_interval(line.initial).noted(note)
        return PhotonTransfer(gain, initial, *self[:5])


def photon_transfer(measured: Series) -> PhotonTransfer:
    """Measure curve and K in flat fields and dark frames between 0 and 70 % of saturation.

    The weights are the errors of the variances, including rounding and the error shared through the dark frames.
    """
    ends, variance = find_peak(measured), measured.of_flats("variance")
    within = (measured.signal <= FITTED * ends.mean[0]) & (variance > 0)
    points = _Points(
        measured.signal,
        measured.excess,
        measured.of_flats("variance_error"),
        within & measured.inside & ~measured.coarse,
        ends,
        measured.of_darks("variance"),
        measured.of_flats("freedom"),
        measured.of_flats("mean_error") / np.sqrt(np.maximum(variance, 1e-300)),
        (
            measured.shared(measured.dark_variance_error)
            + np.diag(measured.flat_rounding_error**2),
            measured.shared(measured.of_darks("mean_error")),
        ),
    )
    if within.any() and measured.coarse[within].all():
        return points.without_gain(measured.flats[int(np.argmax(within))].coarse)
    return points.fit(measured.why_clipped(within))


def photon_transfer_of_scene(scene: Stack, dark: Stack | None = None) -> PhotonTransfer:
    """Measure K in one scene from dark to saturated: mean of the variances in bins of the pixels' means.

    Without dark frames, signal and variance are relative to the darkest bin, and a note reports it.
    Raises InputError for a scene with fewer than 5 levels of 30 pixels.
    """
    maps = Maps.empty(scene)
    statistics = temporal(scene, maps)
    notes, clipping = [statistics.drift_note], scene.clipping
    clipped_scene = (
        f"{100 * clipping.black:.2f} % of the values of the scene are 0 and "
        f"{100 * clipping.saturated:.2f} % are at the largest code"
    )
    if dark is None:
        bins = _bin_pixels(scene, maps.mean, maps.variance)
        black, dark_variance, dark_error = (float(column[0]) for column in bins[:3])
        clipped = clipped_scene if bins.clipped[0] > CLIPPED_MAX else ""
        bins = _Bins(*(column[1:] for column in bins))
        bins = bins._replace(mean=bins.mean - black)
        notes.insert(0, "signal is relative to the darkest pixels: no dark frames")
    else:
        if dark.shape != scene.shape:
            raise InputError(
                f"{scene.source}: shape {scene.shape}, dark {dark.shape}; pass frames of equal size."
            )
        below = temporal(dark)
        bins = _bin_pixels(scene, maps.mean - dark.mean, maps.variance)
        black, dark_variance, dark_error = below.mean, below.variance, below.variance_error
        clipped = dark.clipping.note if dark.clipping.clipped else ""
    top = None if scene.bits is None else 2**scene.bits - 1 - black
    excess = bins.variance - dark_variance
    ends = peak(bins.mean, excess, bins.error, top)
    if ends.limited_by == "not reached":
        notes.append("the scene does not reach saturation")
    within = (bins.mean <= FITTED * ends.mean[0]) & (bins.variance > 0)
    fitted = within & (bins.clipped <= CLIPPED_MAX) & (not clipped)
    count, freedom = len(excess), bins.pixels * (statistics.frames - 1)
    shared = np.full((count, count), dark_error**2), np.zeros((count, count))
    dark_dn2 = np.full(count, dark_variance)
    points = _Points(
        bins.mean, excess, bins.error, fitted, ends, dark_dn2, freedom, freedom**-0.5, shared
    )
    left_out = bool((within & ~fitted).any())
    return points.fit((clipped or clipped_scene) if left_out else "", [x for x in notes if x])


class _Bins(NamedTuple):
    """Bins of pixels with about equal means, shape (bins,) each.

    mean, variance : averages of the pixels [DN, DN²].  error : standard error of the variance.
    pixels : their number.  clipped : fraction of the frames in which they are clipped.
    """

    mean: Float64Array
    variance: Float64Array
    error: Float64Array
    pixels: Float64Array
    clipped: Float64Array


def _bin_pixels(scene: Stack, means: Float64Array, variances: Float64Array) -> _Bins:
    """Return bins of equal width of the pixels' means (H, W), without bins of few pixels.

    Raises InputError if fewer than 5 bins remain.
    """
    x, variance = means.ravel(), variances.ravel()
    clipped = scene.clipping.shares_of_pixels(scene.frames).ravel()
    width = max(float(np.ptp(x)), 1e-9) / BINS
    index = np.minimum(((x - x.min()) / width).astype(np.intp), BINS - 1)
    counts = np.bincount(index, minlength=BINS).astype(np.float64)
    kept = counts >= BIN_PIXELS_MIN
    if kept.sum() < 5:
        raise InputError(
            f"{scene.source}: {kept.sum()} levels of {BIN_PIXELS_MIN} pixels or more between {x.min():.4g} and "
            f"{x.max():.4g} DN; pass a scene from dark to saturated."
        )

    def average(values: Float64Array) -> Float64Array:
        return np.bincount(index, values, BINS)[kept] / counts[kept]

    mean_variance = average(variance)
    scatter = np.maximum(average(variance**2) - mean_variance**2, 0)
    error = np.sqrt(scatter / counts[kept])
    return _Bins(average(x), mean_variance, error, counts[kept], average(clipped))
