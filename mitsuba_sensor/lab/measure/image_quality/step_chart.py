"""A step chart: response (OECF, ISO 14524), ISO speed (ISO 12232), noise, SNR and dynamic range (ISO 15739)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers, require
from ....core.plots import name_level, set_log_axes
from ....core.types import Float64Array
from ...frames.stack import Stack, coarse_note
from ...quantity import LEVEL, Figures, Quantity, no_value, normal_interval
from .patches import Patches, Region, measure_patches, require_regions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SATURATION_CONSTANT, NOISE_CONSTANT = 78.0, 10.0
"""ISO 12232: the speed is 78/H for the exposure H that saturates, and 10/H for a signal-to-noise ratio of 40 or 10."""
SPEED_RATIOS = (40, 10)
"""Signal-to-noise ratios of the two noise-based speeds."""
SATURATION, NOISE = "ISO 12232 saturation", "ISO 12232 noise"
SATURATION_MAX_DN = 1e12
"""Largest saturation signal, far above any code."""
NOISY_PATCHES_MIN = 3
"""Smallest number of patches with measurable noise that show noise versus signal."""
NO_RANGE = no_value("DR", "dynamic range", "dB", "ISO 15739")


@dataclass(frozen=True, eq=False)
class StepChart(Figures):
    """Results of a step chart.

    exposure_lxs : exposure of the patches at the focal plane [lx s].  patches : their statistics.
    slope : response [DN/(lx s)].  linearity_error : largest deviation from a line through the black level [%].
    saturation_speed, noise_speed_40, noise_speed_10 : ISO speeds.  dynamic_range : [dB].
    """

    exposure_lxs: Float64Array
    patches: Patches
    slope: Quantity
    linearity_error: Quantity
    saturation_speed: Quantity
    noise_speed_40: Quantity
    noise_speed_10: Quantity
    dynamic_range: Quantity

    @property
    def snr(self) -> Float64Array:
        """Signal over total noise of each patch, shape (P,)."""
        return np.asarray(self.patches.mean / np.sqrt(self.patches.total))

    def plot(self, ax: Axes) -> None:
        """Plot the response (OECF) versus exposure."""
        error = 1.96 * self.patches.mean_error
        ax.errorbar(self.exposure_lxs, self.patches.mean, yerr=error, fmt="o", label="patches")
        line = self.slope.value * self.exposure_lxs
        ax.plot(self.exposure_lxs, line, label="line through the black level")
        ax.set(xlabel="exposure at the focal plane [lx s]", ylabel="signal above black [DN]")

    def plot_snr(self, ax: Axes) -> None:
        """Plot the signal-to-noise ratio versus exposure."""
        lit = (self.exposure_lxs > 0) & (self.patches.mean > 0)
        exposures = self.exposure_lxs[lit]
        temporal = self.patches.mean[lit] / np.sqrt(self.patches.temporal[lit])
        ax.plot(exposures, self.snr[lit], "o", label="total noise")
        ax.plot(exposures, temporal, "s", label="temporal noise")
        set_log_axes(ax)
        for ratio in SPEED_RATIOS:
            name_level(ax, f"SNR {ratio:g}", y=ratio)
        ax.set(xlabel="exposure at the focal plane [lx s]", ylabel="signal-to-noise ratio")


class _Variance(NamedTuple):
    """A variance as a polynomial of the signal, lowest power first [DN²], with the covariance of its coefficients."""

    coefficients: Float64Array
    covariance: Float64Array

    @classmethod
    def fit(
        cls, signal: Float64Array, variance: Float64Array, error: Float64Array, order: int
    ) -> _Variance:
        """Fit by weighted least squares, with weights from the fitted instead of the measured variances."""
        relative = error / variance
        powers = signal[:, None] ** np.arange(order + 1)
        expected = variance
        for _ in range(4):
            weight = 1 / (relative * expected)
            design = powers * weight[:, None]
            covariance = np.linalg.pinv(design.T @ design)
            coefficients = covariance @ design.T @ (variance * weight)
            expected = np.maximum(powers @ coefficients, 0.1 * variance)
        return cls(coefficients, np.asarray(covariance, np.float64))

    def signal_at(self, ratio: float) -> tuple[float, float]:
        """Return the signal y with y = ratio·√(a + b·y + c·y²), and its standard error [DN]; NaN if there is none."""
        constant, linear, square = np.append(self.coefficients, 0.0)[:3] * ratio**2
        rest = linear**2 + 4 * (1 - square) * constant
        if square >= 1 or rest <= 0:
            return math.nan, math.nan
        value = float((linear + math.sqrt(rest)) / (2 * (1 - square)))
        slopes = ratio**2 * value ** np.arange(len(self.coefficients)) / math.sqrt(rest)
        return value, math.sqrt(max(float(slopes @ self.covariance @ slopes), 0.0))


def step_chart(
    stack: Stack,
    regions: Sequence[Region],
    exposure_lxs: ArrayLike,
    *,
    black_dn: ArrayLike,
    saturation_dn: float | None = None,
) -> StepChart:
    """Measure response, ISO speeds, noise and dynamic range in at least two frames of a chart of grey patches.

    ::

        steps_e = np.array([0.0, 500.0, 2000.0, 8000.0, 16000.0])
        light = ms.Photons(np.repeat(steps_e, 16)[None] * np.ones((16, 1)), detected=True)
        frames = ms.expose(light, camera, exposure, frames=4).digital
        patches = [(0, 16 * number, 16, 16) for number in range(5)]
        chart = ms.lab.step_chart(ms.lab.Stack(frames, 0.1), patches, steps_e / 1000, black_dn=64.0)
        print(chart.dynamic_range)

    regions : (first row, first column, rows, columns) of each patch.
    exposure_lxs : illuminance at the focal plane times exposure time of each patch [lx s], 0 for a dark patch.
    black_dn : mean of dark frames, a number or a map (H, W), which includes column offsets.
    saturation_dn : saturation signal above black. Default: signal of the full-scale code.
    Noise below 0.24 DN² is not measurable, so figures that need it have no value.
    Raises InputError for one frame, a mosaic, fewer than 4 unclipped patches, and patches outside of the frames.
    """
    regions = require_regions(regions)
    wanted = "exposures in lx s of 0 or more, one for each patch"
    exposures = finite_numbers("exposure_lxs", exposure_lxs, wanted)
    if exposures.shape != (len(regions),) or exposures.min(initial=0.0) < 0:
        raise InputError(
            f"exposure_lxs has shape {exposures.shape} for {len(regions)} patches and values from "
            f"{exposures.min(initial=0.0):g}; pass {wanted}."
        )
    black = finite_numbers("black_dn", black_dn, "DN, the mean of dark frames")
    if saturation_dn is not None:
        saturation_dn = require(
            "saturation_dn", saturation_dn, 0.0, SATURATION_MAX_DN, "DN above black, e.g. 4000"
        )
    if black.shape not in ((), stack.shape):
        raise InputError(
            f"black_dn has shape {black.shape}; pass a number, or a map of the frames' shape {stack.shape}."
        )
    black = np.broadcast_to(black, stack.shape)
    patches = measure_patches(stack, regions, black)
    largest = saturation_dn
    if largest is None and stack.bits is not None:
        largest = 2**stack.bits - 1 - float(black.mean())
    usable = patches.clipped == 0
    if largest is not None:
        usable &= patches.mean < 0.97 * largest
    if usable.sum() < 4 or not (exposures[usable] > 0).any():
        raise InputError(
            f"{int(usable.sum())} of {len(regions)} patches are unclipped; pass at least 4, the darkest above code 0."
        )
    error = np.maximum(patches.mean_error, 1e-9 * np.abs(patches.mean).max())
    patches = patches._replace(mean_error=error)
    part, light = patches.select(usable), exposures[usable]
    response = _response(light, part)
    noisy = part.select(part.coarse == 0)
    hidden = coarse_note(float(part.temporal.min()), 0.0) if part.coarse.any() else ""
    saturation = no_value("S_sat", "saturation-based ISO speed", "", SATURATION)
    if largest is None:
        saturation = saturation.noted("pass bits of the stack, or saturation_dn")
    else:
        saturation = _speed(saturation, response, (largest, 0.0), SATURATION_CONSTANT)
    speed_40, speed_10 = (
        _noise_speed(ratio, response, noisy, largest, hidden) for ratio in SPEED_RATIOS
    )
    return StepChart(
        exposures,
        patches,
        response,
        _linearity(light, part, response),
        saturation,
        speed_40,
        speed_10,
        NO_RANGE.noted(hidden) if hidden else _dynamic_range(noisy, largest),
    )


def _response(exposures: Float64Array, part: Patches) -> Quantity:
    """Return the slope of signal versus exposure through the black level. Raises InputError if it is not positive."""
    weight = 1 / np.square(part.mean_error)
    information = float((weight * exposures**2).sum())
    slope = float((weight * exposures * part.mean).sum()) / information
    if not slope > 0:
        raise InputError(
            f"the signal above black changes by {slope:.3g} DN per lx s; pass patches that become brighter with their "
            "exposure, and the black level of the same frames."
        )
    interval = normal_interval(slope, 1 / math.sqrt(information))
    return Quantity("s", "response", *interval, "DN/(lx s)", "ISO 14524")


def _noise_speed(
    ratio: int, response: Quantity, noisy: Patches, largest: float | None, hidden: str
) -> Quantity:
    """Return a noise-based speed.

    noisy : patches with measurable noise.  hidden : reason why others have none, or an empty text.
    """
    like = no_value(f"S_noise{ratio}", f"noise-based ISO speed, SNR {ratio}", "", NOISE)
    if len(noisy.mean) < NOISY_PATCHES_MIN:
        return like.noted(hidden)
    signal = _Variance.fit(noisy.mean, noisy.total, noisy.total_error, 2).signal_at(ratio)
    if signal[0] < noisy.mean.min() and hidden:
        return like.noted(hidden)
    if largest is not None and signal[0] > largest:
        return like.noted(f"saturates before a signal-to-noise ratio of {ratio}")
    return _speed(like, response, signal, NOISE_CONSTANT)


def _speed(
    like: Quantity, response: Quantity, signal: tuple[float, float], constant: float
) -> Quantity:
    """Return constant/H for the exposure H of a signal.  signal : with its standard error [DN]."""
    value, error = signal
    if not (value > 0 and math.isfinite(error) and response.value > 0):
        return like.noted("no exposure has this signal-to-noise ratio")
    speed = constant * response.value / value
    relative = math.hypot(error / value, response.standard_error / response.value)
    return like.with_interval(normal_interval(speed, speed * relative))


def _linearity(exposures: Float64Array, part: Patches, response: Quantity) -> Quantity:
    """Return the largest deviation from the line, of patches above 5 % of the brightest [% of the patch].

    Noise enlarges the largest of several deviations, so the interval combines intervals of all patches that hold
    together in 95 of 100 charts (Šidák 1967).
    """
    line = response.value * exposures
    bright = line > 0.05 * line.max()
    deviation = 100 * np.abs((part.mean - line)[bright] / line[bright])
    error = 100 * part.mean_error[bright] / line[bright]
    half = error * NormalDist().inv_cdf((1 + LEVEL ** (1 / error.size)) / 2)
    low, high = max(float((deviation - half).max()), 0.0), float((deviation + half).max())
    value = float(deviation.max())
    name = "largest deviation from a line"
    return Quantity("LE_max", name, value, low, high, "%", "ISO 14524")


def _dynamic_range(noisy: Patches, largest: float | None) -> Quantity:
    """Return saturation over the signal with a temporal signal-to-noise ratio of 1 [dB]."""
    signal, error = math.nan, math.nan
    if len(noisy.mean) >= NOISY_PATCHES_MIN:
        noise = _Variance.fit(noisy.mean, noisy.temporal, noisy.temporal_error, 1)
        signal, error = noise.signal_at(1.0)
    if largest is None or not (signal > 0 and math.isfinite(error)):
        return NO_RANGE.noted("needs the saturation, and a dark patch whose noise is above 0")
    decibel = 20 * math.log10(largest / signal)
    return NO_RANGE.with_interval(normal_interval(decibel, 20 / math.log(10) * error / signal))
