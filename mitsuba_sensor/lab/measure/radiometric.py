"""Radiometric function: mean and noise versus light, responsivity R, quantum efficiency η, linearity error LE."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.plots import set_log_axes
from ...core.types import Float64Array
from ..frames.clipping import note_left_out
from ..frames.series import Series
from ..quantity import Figures, Quantity, no_value, quotient
from ..statistics.line_fits import line_through_origin
from .saturation import Peak, find_peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FITTED = 0.05, 0.7
"""Fractions of the saturation signal between which R is fitted: EMVA 1288 R4 6.6 ends at 70 %; below 5 % the dark level
matters."""
LINEAR = 0.05, 0.95
"""Fractions of the saturation signal between which the linearity error is averaged (EMVA 1288 R4 6.7)."""
EFFICIENCY_USUAL_MAX = 0.9
"""Quantum efficiency that few sensors exceed."""
TOO_EFFICIENT = "more electrons than photons"
"""Part of the note of a quantum efficiency above 1, which has no value."""
EFFICIENCY = no_value("η", "quantum efficiency", "", "EMVA 1288 R4 2.1")
STRAY_LEVELS_MIN = 6
"""Smallest number of levels among which a stray level can be found."""
STRAY_FRACTION_MAX = 0.2
"""Largest fraction of stray levels; if more levels are off, the light scatters."""
STRAY_SIGMAS = 8.0
"""Distance of a stray level from the curve, in its standard errors and in the robust σ of all distances; light that
scatters has no such level, whatever its distribution."""
STRAY_MIN = 0.002
"""Smallest relative distance of a stray level: more than a smooth curve has between neighbouring levels."""
STRAY_CANDIDATES = 4


@dataclass(frozen=True, eq=False)
class Radiometric(Figures):
    """Response to light.

    responsivity : R [DN/p] or, if photons are unknown, [DN/s].  linearity_error : LE [%].
    light : photons per pixel or exposure times [s].  signal, noise : mean minus dark mean, and standard deviation [DN].
    deviation : of the signal from the line between 5 and 95 % of saturation [%], NaN outside.
    """

    responsivity: Quantity
    linearity_error: Quantity
    light: Float64Array
    signal: Float64Array
    noise: Float64Array
    deviation: Float64Array
    photons_known: bool

    def efficiency(self, gain: Quantity) -> Quantity | None:
        """Return η = R / K (EMVA 1288 R4 2.1), or None if photons are unknown.

        Above 1 it has no value, and the note suggests the unit of the photons.
        """
        if not self.photons_known:
            return None
        efficiency = quotient(self.responsivity, gain, EFFICIENCY)
        if efficiency.low > 1:
            return EFFICIENCY.noted(_note_other_unit(efficiency.value))
        return efficiency

    @property
    def light_label(self) -> str:
        """Axis label of the light."""
        return "photons per pixel" if self.photons_known else "exposure time [s]"

    def plot(self, axes: Axes, log: bool = False) -> None:
        """Plot signal and noise versus light, with the line of R.  log : True for logarithmic axes."""
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
        """Plot the relative deviation from the line of the linearity error."""
        axes.plot(self.light, self.deviation, "o-", ms=3, lw=1, label="deviation")
        axes.axhline(0, color="black", lw=1, label="line")
        axes.set(xlabel=self.light_label, ylabel="deviation from the line [%]")


def radiometric(measured: Series) -> Radiometric:
    """Measure the response of flat fields to photons or, if unknown, to the exposure time."""
    unit = "DN/p" if measured.photons_known else "DN/s"
    responsivity = no_value("R", "responsivity", unit, "EMVA 1288 R4 6.6")
    error = no_value("LE", "linearity error", "%", "EMVA 1288 R4 6.7")
    light, deviation = measured.light, np.full(len(measured.flats), math.nan)
    if len(set(light.tolist())) < 2 and len(light) > 1:
        nothing = "neither photons nor exposure times distinguish the levels"
        responsivity, error = responsivity.noted(nothing), error.noted(nothing)
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
    """Return a guess of the unit of the photons if there are more electrons than photons."""
    smallest_um, largest_um = (
        math.sqrt(efficiency / least) for least in (EFFICIENCY_USUAL_MAX, 0.2)
    )
    guess = "is the photodiode calibrated for this wavelength?"
    if efficiency > 100:
        guess = f"are they thousands of photons, or per µm² of a pixel of {smallest_um:.2g} µm?"
    elif efficiency > 1.5:
        guess = f"are they per µm², of a pixel of {smallest_um:.2g} to {largest_um:.2g} µm?"
    return (
        f"it would be {efficiency:.3g}, {TOO_EFFICIENT}: photons must be per pixel and exposure, and are "
        f"at least {efficiency:.3g} times as many; {guess}"
    )


def stray_levels(
    light: Float64Array, signal: Float64Array, errors: Float64Array
) -> dict[int, float]:
    """Return the numbers of levels that are off the curve of the other levels, with their relative distances.

    light, signal, errors : of levels in ascending order, shape (n,); standard errors of the signals [DN].

    Each level is compared with the line through its two neighbours, so a smooth curve has no stray levels. Among the
    most distant levels, the one whose removal leaves the smallest distances is removed first.
    """
    kept, stray = np.arange(len(light)), list[int]()
    while len(kept) >= STRAY_LEVELS_MIN and len(stray) <= STRAY_FRACTION_MAX * len(light):
        score = _stray_scores(light[kept], signal[kept], errors[kept])
        if score.max() < 1:
            break
        candidates = np.argsort(score)[-STRAY_CANDIDATES:]
        rest = [np.delete(kept, place) for place in candidates]
        worst = [_stray_scores(light[k], signal[k], errors[k]).max() for k in rest]
        best = int(np.argmin(worst))
        stray.append(int(kept[candidates[best]]))
        kept = rest[best]
    if not stray or len(stray) > max(1.0, STRAY_FRACTION_MAX * len(light)):
        return {}
    _, first = np.unique(light[kept], return_index=True)
    line = scipy.interpolate.make_interp_spline(light[kept][first], signal[kept][first], k=1)
    return {number: float(signal[number] / line(light[number]) - 1) for number in sorted(stray)}


def _stray_scores(
    light: Float64Array, signal: Float64Array, errors: Float64Array
) -> Float64Array:
    """Return distances of at least 3 levels from the line through their neighbours, over the limit, shape (n,).

    An end is compared with the next two levels. A score of 1 or more means a stray level.
    """
    number = np.arange(len(light))
    first = np.clip(number - 1, 0, None)
    second = np.clip(number + 1, None, len(light) - 1)
    first[0], second[0], first[-1], second[-1] = 1, 2, len(light) - 3, len(light) - 2
    step = np.maximum(light[second] - light[first], 1e-300)
    weight = (light - light[first]) / step
    share = (signal - (1 - weight) * signal[first] - weight * signal[second]) / signal
    error = np.sqrt(
        errors**2 + ((1 - weight) * errors[first]) ** 2 + (weight * errors[second]) ** 2
    )
    grown = np.sqrt(1 + (1 - weight) ** 2 + weight**2)
    scatter = 1.4826 * float(np.median(np.abs(share / grown)))
    limit = STRAY_SIGMAS * np.maximum(scatter * grown, error / signal)
    return np.asarray(np.abs(share) / np.maximum(limit, STRAY_MIN))


def find_stray(measured: Series, ends: Peak) -> tuple[NDArray[np.bool_], str]:
    """Return a mask of levels between 5 and 70 % of saturation whose light is not as stated, and a note on them."""
    moving = measured.of_flats("variance") > 0  # a stuck code does not show the light
    used = np.flatnonzero(_select_levels(measured, ends, FITTED) & measured.inside & moving)
    errors = np.hypot(measured.of_flats("light_error"), measured.of_darks("light_error"))
    stray = stray_levels(measured.light[used], measured.signal[used], errors[used])
    off = np.zeros(len(measured.flats), bool)
    texts: list[str] = []
    for number, share in stray.items():
        level = measured.flats[used[number]]
        light = (
            f"{level.photons:.4g} photons"
            if level.photons is not None
            else f"{level.exposure_s:.4g} s"
        )
        texts.append(f"{level.source} is {100 * share:+.3g} % off the others at {light}")
        off[used[number]] = True
    return (
        off,
        f"left out, because the light is not as stated: {'; '.join(texts)}" if texts else "",
    )


def _select_levels(
    measured: Series, ends: Peak, part: tuple[float, float]
) -> NDArray[np.bool_]:
    """Return a mask of the levels that are lit and within this part of the saturation signal."""
    share = measured.signal / max(ends.mean[0], 1e-300)
    within = (share >= part[0]) & (share <= part[1])
    return np.asarray(within & (measured.light > 0) & (measured.signal > 0))


def _responsivity(
    measured: Series, ends: Peak, stray: NDArray[np.bool_], like: Quantity
) -> Quantity:
    """Return R, the slope of the line through the origin without stray levels."""
    used = _select_levels(measured, ends, FITTED) & ~stray
    clipped = measured.why_clipped(used)
    used &= measured.inside
    if not used.any():
        few = clipped or "no level lies between 5 and 70 % of saturation"
        return like.without_value(few, bool(clipped))
    errors = np.maximum(measured.of_flats("light_error"), 1e-9 * np.abs(measured.signal))
    shared = measured.shared(measured.of_darks("light_error"))  # by the same dark frames
    covariance = (np.diag(np.maximum(errors, 1e-12) ** 2) + shared)[np.ix_(used, used)]
    line = line_through_origin(measured.light[used], measured.signal[used], covariance)
    responsivity = like.with_interval((line.slope, line.low, line.high))
    return responsivity.noted(line.note).noted(note_left_out(clipped))


def _linearity(
    measured: Series, ends: Peak, stray: NDArray[np.bool_], like: Quantity
) -> tuple[Quantity, Float64Array]:
    """Return LE, the mean of |y − ŷ|/ŷ over 5 to 95 % of saturation, for a line with the least relative deviations.

    Noise e of the means changes LE by at most the mean of |e|/ŷ, which is half the width of the interval.
    """
    deviation = np.full(len(measured.light), math.nan)
    used = _select_levels(measured, ends, LINEAR) & ~stray
    clipped = measured.why_clipped(used)
    used &= measured.inside
    if used.sum() < 3:
        few = f"{used.sum()} levels lie between 5 and 95 % of saturation; 3 are needed"
        return like.without_value(clipped or few, bool(clipped)), deviation
    x, y = measured.light[used], measured.signal[used]
    coefficients = np.polynomial.polynomial.polyfit(x, y, 1, w=1 / y)
    line = np.polynomial.polynomial.polyval(x, coefficients)
    deviation[used] = 100 * (y - line) / line
    value = float(np.abs(deviation[used]).mean())
    errors = np.hypot(measured.of_flats("light_error"), measured.of_darks("light_error"))
    noise = 100 * errors[used] / line
    # Mean and standard deviation of |e| of normal e: √(2/π) and √(1 − 2/π) times σ.
    half = math.sqrt(2 / math.pi) * float(noise.mean())
    half += 1.645 * math.sqrt(1 - 2 / math.pi) * float(np.sqrt((noise**2).sum())) / len(noise)
    error = like.with_interval((value, max(0.0, value - half), value + half))
    return error.noted(note_left_out(clipped)), deviation
