"""Radiometric function: mean and noise against light, responsivity R, quantum efficiency, linearity error LE."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.types import Float64Array
from ..frames.clipping import note_left_out
from ..frames.series import Series
from ..quantity import Figures, Quantity, no_value, quotient, unknown
from ..statistics.line_fits import line_through_origin
from .photon_transfer import set_log_axes
from .saturation import Peak, find_peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FITTED = 0.05, 0.7
"""Part of the saturation signal over which R is fitted: EMVA 1288 R4 6.6 ends at 70 %; below 5 % the dark level counts.
"""
LINEAR = 0.05, 0.95
"""Part of the saturation signal over which the linearity error is averaged, EMVA 1288 R4 6.7."""
MOST_EFFICIENT = 0.9
"""Quantum efficiency that few sensors exceed."""
TOO_EFFICIENT = "more electrons than photons"
"""In the note of a quantum efficiency above 1, which has no value."""
EFFICIENCY = no_value("η", "quantum efficiency", "", "EMVA 1288 R4 2.1")
FEWEST_FOR_STRAY = 6
"""Levels of which one can be said to be off the curve of the others."""
MOST_STRAY = 0.2
"""Share of the levels up to which those that are off are named; of more, the light is what scatters."""
STRAY_LIMIT = 8.0
"""Distance from the curve, over its own standard error and over the robust σ of all distances, from which on a level is
off: light that scatters, of whatever distribution, has no such level."""
LEAST_STRAY = 0.002
"""Smallest distance from the curve that is named: more than a smooth curve has between neighbouring levels."""
STRAY_CANDIDATES = 4


@dataclass(frozen=True, eq=False)
class Radiometric(Figures):
    """responsivity : R [DN/p], or [DN/s] where photons are not known.  linearity_error : LE [%].

    light : photons per pixel or exposure times [s].  signal, noise : mean minus dark mean, and standard deviation [DN].
    deviation : of the signal from the line through 5 to 95 % of saturation [%], NaN outside.
    """

    responsivity: Quantity
    linearity_error: Quantity
    light: Float64Array
    signal: Float64Array
    noise: Float64Array
    deviation: Float64Array
    photons_known: bool

    def efficiency(self, gain: Quantity) -> Quantity | None:
        """η = R / K (EMVA 1288 R4 2.1), None where photons are not known.

        It has no value where it is above 1, and the note says what unit the photons may have.
        """
        if not self.photons_known:
            return None
        efficiency = quotient(self.responsivity, gain, EFFICIENCY)
        if efficiency.low > 1:
            return unknown(efficiency, _note_other_unit(efficiency.value))
        return efficiency

    @property
    def light_label(self) -> str:
        """Label of the axis on which the light is drawn."""
        return "photons per pixel" if self.photons_known else "exposure time [s]"

    def plot(self, axes: Axes, log: bool = False) -> None:
        """Signal and noise against light, with the line of R; log for both axes logarithmic."""
        axes.plot(self.light, self.signal, "o", markersize=3, label="mean − dark mean")
        axes.plot(self.light, self.noise, "s", markersize=3, label="standard deviation")
        slope = self.responsivity.value
        if math.isfinite(slope):
            shown = self.light[slope * self.light <= 1.05 * self.signal.max()]
            axes.plot(shown, slope * shown, color="black", linewidth=1, label="slope R")
        axes.set(xlabel=self.light_label, ylabel="signal, noise [DN]")
        if log:
            set_log_axes(axes)

    def plot_deviation(self, axes: Axes) -> None:
        """Relative deviation from the line of the linearity error."""
        axes.plot(self.light, self.deviation, "o-", ms=3, lw=1, label="deviation")
        axes.axhline(0, color="black", lw=1, label="line")
        axes.set(xlabel=self.light_label, ylabel="deviation from the line [%]")


def radiometric(measured: Series) -> Radiometric:
    """Response of flat fields and dark frames to photons, or to the exposure time where photons are not known."""
    unit = "DN/p" if measured.photons_known else "DN/s"
    responsivity = no_value("R", "responsivity", unit, "EMVA 1288 R4 6.6")
    error = no_value("LE", "linearity error", "%", "EMVA 1288 R4 6.7")
    light, deviation = measured.light, np.full(len(measured.flats), math.nan)
    if len(set(light.tolist())) < 2 and len(light) > 1:
        nothing = "neither photons nor exposure times tell the levels apart"
        responsivity, error = unknown(responsivity, nothing), unknown(error, nothing)
    else:
        ends = find_peak(measured)
        stray, note = find_stray(measured, ends)
        error, deviation = _linearity(measured, ends, stray, error.noted(note))
        responsivity = _responsivity(measured, ends, stray, responsivity.noted(note))
    return Radiometric(
        responsivity=responsivity,
        linearity_error=error,
        light=light,
        signal=measured.signal,
        noise=np.sqrt(measured.of_flats("variance")),
        deviation=deviation,
        photons_known=measured.photons_known,
    )


def _note_other_unit(efficiency: float) -> str:
    """What unit the photons may have where more electrons than photons are measured."""
    smallest_um, largest_um = (math.sqrt(efficiency / least) for least in (MOST_EFFICIENT, 0.2))
    guess = "is the photodiode calibrated for this wavelength?"
    if efficiency > 100:
        guess = (
            f"these may be thousands of photons, or per µm² of a pixel of {smallest_um:.2g} µm"
        )
    elif efficiency > 1.5:
        guess = f"these may be per µm², of a pixel of {smallest_um:.2g} to {largest_um:.2g} µm"
    return (
        f"it would be {efficiency:.3g}, {TOO_EFFICIENT}: photons must be per pixel and exposure, and are "
        f"at least {efficiency:.3g} times as many; {guess}"
    )


def stray_levels(
    light: Float64Array, signal: Float64Array, errors: Float64Array
) -> dict[int, float]:
    """Numbers of the levels that are off the curve of the others, and the share of the signal by which they are.

    light, signal, errors : of levels in ascending order, (n,).  errors : standard errors of the signals [DN].

    Every level is compared with the straight line through its two neighbours, so that a smooth curve is no reason. Of
    the levels that are most off, that is taken out without which the others are least off, and so on.
    """
    if len(light) < FEWEST_FOR_STRAY:
        return {}
    kept = np.arange(len(light))
    found: list[int] = []
    while len(kept) >= FEWEST_FOR_STRAY and len(found) <= MOST_STRAY * len(light):
        score = _stray_scores(light[kept], signal[kept], errors[kept])
        if score.max() < 1:
            break
        candidates = np.argsort(score)[-STRAY_CANDIDATES:]
        rest = [np.delete(kept, place) for place in candidates]
        worst = [_stray_scores(light[k], signal[k], errors[k]).max() for k in rest]
        best = int(np.argmin(worst))
        found.append(int(kept[candidates[best]]))
        kept = rest[best]
    if not found or len(found) > max(1.0, MOST_STRAY * len(light)):
        return {}
    _, first = np.unique(light[kept], return_index=True)
    line = scipy.interpolate.make_interp_spline(light[kept][first], signal[kept][first], k=1)
    curve = line(light)
    return {number: float(signal[number] / curve[number] - 1) for number in sorted(found)}


def _stray_scores(
    light: Float64Array, signal: Float64Array, errors: Float64Array
) -> Float64Array:
    """Distances of levels, at least 3, from the line through their neighbours, or the next two at an end, over σ and
    over the limit: a level with 1 or more is off, (n,)."""
    number = np.arange(len(light))
    first = np.clip(number - 1, 0, None)
    second = np.clip(number + 1, None, len(light) - 1)
    first[0], second[0], first[-1], second[-1] = 1, 2, len(light) - 3, len(light) - 2
    step = np.maximum(light[second] - light[first], 1e-300)
    weight = (light - light[first]) / step
    share = (signal - (1 - weight) * signal[first] - weight * signal[second]) / signal
    own = np.sqrt(
        errors**2 + ((1 - weight) * errors[first]) ** 2 + (weight * errors[second]) ** 2
    )
    grown = np.sqrt(1 + (1 - weight) ** 2 + weight**2)
    scatter = 1.4826 * float(np.median(np.abs(share / grown)))
    limit = STRAY_LIMIT * np.maximum(scatter * grown, own / signal)
    return np.asarray(np.abs(share) / np.maximum(limit, LEAST_STRAY))


def find_stray(measured: Series, ends: Peak) -> tuple[NDArray[np.bool_], str]:
    """Which levels between 5 and 70 % of saturation have another light than is stated, and a note about them."""
    moving = measured.of_flats("variance") > 0  # a stuck code does not tell the light
    within = _select_levels(measured, ends, FITTED)
    used = np.flatnonzero(within & measured.inside & moving)
    errors = np.hypot(measured.of_flats("light_error"), measured.of_darks("light_error"))
    found = stray_levels(measured.light[used], measured.signal[used], errors[used])
    off = np.zeros(len(measured.flats), bool)
    texts: list[str] = []
    for number, share in found.items():
        level = measured.flats[used[number]]
        light = (
            f"{level.exposure_s:.4g} s"
            if level.photons is None
            else f"{level.photons:.4g} photons"
        )
        texts.append(f"{level.source} is {100 * share:+.3g} % off the others at {light}")
        off[used[number]] = True
    if not texts:
        return off, ""
    return off, f"left out, because their light is not what is stated: {'; '.join(texts)}"


def _select_levels(
    measured: Series, ends: Peak, part: tuple[float, float]
) -> NDArray[np.bool_]:
    """Which levels are lit and within this part of the saturation signal."""
    share = measured.signal / max(ends.mean[0], 1e-300)
    within = (share >= part[0]) & (share <= part[1])
    return np.asarray(within & (measured.light > 0) & (measured.signal > 0))


def _covariance(measured: Series) -> Float64Array:
    """Covariance of the signals of all flat fields [DN²]: flats of one exposure time share their dark frames."""
    own = np.maximum(measured.of_flats("light_error"), 1e-9 * np.abs(measured.signal))
    shared = measured.shared(measured.of_darks("light_error"))
    return np.asarray(np.diag(np.maximum(own, 1e-12) ** 2) + shared)


def _responsivity(
    measured: Series, ends: Peak, stray: NDArray[np.bool_], like: Quantity
) -> Quantity:
    """R: slope of the line through the origin, without stray levels."""
    used = _select_levels(measured, ends, FITTED) & ~stray
    clipped = measured.why_clipped(used)
    used &= measured.inside
    if not used.any():
        few = clipped or "no level lies between 5 and 70 % of saturation"
        return unknown(like, few, bool(clipped))
    covariance = _covariance(measured)[np.ix_(used, used)]
    line = line_through_origin(measured.light[used], measured.signal[used], covariance)
    responsivity = like.with_interval((line.slope, line.low, line.high))
    return responsivity.noted(line.note).noted(note_left_out(clipped))


def _linearity(
    measured: Series, ends: Peak, stray: NDArray[np.bool_], like: Quantity
) -> tuple[Quantity, Float64Array]:
    """LE: mean |y - ŷ|/ŷ over 5 to 95 % of saturation, about a line a + bH whose relative deviations are least.

    Noise of the means e moves it by at most the mean of |e|/ŷ, which is the half width of the interval.
    """
    deviation = np.full(len(measured.light), math.nan)
    used = _select_levels(measured, ends, LINEAR) & ~stray
    clipped = measured.why_clipped(used)
    used &= measured.inside
    if used.sum() < 3:
        few = f"{used.sum()} levels lie between 5 and 95 % of saturation; 3 are needed"
        return unknown(like, clipped or few, bool(clipped)), deviation
    x, y = measured.light[used], measured.signal[used]
    coefficients = np.polynomial.polynomial.polyfit(x, y, 1, w=1 / y)
    line = np.polynomial.polynomial.polyval(x, coefficients)
    deviation[used] = 100 * (y - line) / line
    value = float(np.abs(deviation[used]).mean())
    errors = np.hypot(measured.of_flats("light_error"), measured.of_darks("light_error"))
    noise = 100 * errors[used] / line
    # mean and standard deviation of |e| of normal e: sqrt(2/π) and sqrt(1 - 2/π) times σ
    half = math.sqrt(2 / math.pi) * float(noise.mean())
    half += 1.645 * math.sqrt(1 - 2 / math.pi) * float(np.sqrt((noise**2).sum())) / len(noise)
    error = like.with_interval((value, max(0.0, value - half), value + half))
    return error.noted(note_left_out(clipped)), deviation
