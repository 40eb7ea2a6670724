"""Dark current from mean and variance of dark frames over exposure time, and its change with temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import ClippedError
from ..frames.stack import Stack, rounding_shift_dn
from ..quantity import TWO_SIDED, Figures, Quantity, no_value
from ..statistics.line_fits import StraightLine, straight_line
from ..statistics.mean_squares import temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 7.1"
DRIFT_FALSE_ALARM = 0.01
"""Probability that drift is assumed for frames without drift."""
TEMPERATURE_SECTION = "EMVA 1288 R4 7.2"
NOT_RISING = "the dark current does not rise significantly with temperature"
BOLTZMANN_EV_PER_K = 8.617333262e-5
"""CODATA 2018."""


@dataclass(frozen=True, eq=False)
class DarkCurrentOverTime(Figures):
    """Dark signal versus exposure time.

    from_mean : slope of the mean [DN/s].  from_variance : slope of the temporal variance [DN²/s].
    line : line through the means [DN, s].  exposure_s, mean, mean_error : points with standard errors [s, DN].
    """

    from_mean: Quantity
    from_variance: Quantity
    line: StraightLine
    exposure_s: Float64Array
    mean: Float64Array
    mean_error: Float64Array

    def plot(self, ax: Axes) -> None:
        """Plot mean dark signal versus exposure time, with the straight line."""
        points = self.exposure_s, self.mean, self.mean_error
        ax.errorbar(*points, fmt="o", ms=4, capsize=2, label="measured")
        ends = np.array([0.0, self.exposure_s.max()])
        ax.plot(ends, self.line.offset + self.line.slope * ends, lw=1, label="straight line")
        ax.set(xlabel="exposure time [s]", ylabel="mean dark signal [DN]")


def dark_current(stacks: Sequence[Stack]) -> DarkCurrentOverTime:
    """Measure µ_I in dark stacks of at least 2 exposure times, at one temperature and gain.

    The errors come from temporal noise, because all stacks have the same fixed pattern. Stacks of one frame have no
    variance. Clipped stacks are left out with a note.

    Raises InputError for mosaics, stacks of different size, temperature or gain, and fewer than 2 exposure times.
    """
    used, note = _without_clipped(stacks)
    times_s = np.array([stack.exposure_s for stack in used])
    mean = np.array([stack.frame_means.mean() for stack in used])
    mean_error, freedom = errors_of_means(used)
    line = straight_line(times_s, mean, mean_error, freedom)
    from_mean = Quantity(
        "µ_I.mean", "dark current from the mean", *line.interval, "DN/s", SECTION, line.note
    )
    currents = [
        _note_no_current(current).noted(note)
        for current in (from_mean, _current_from_variance(used))
    ]
    return DarkCurrentOverTime(currents[0], currents[1], line, times_s, mean, mean_error)


def _note_no_current(current: Quantity) -> Quantity:
    """Return the dark current with a note if it is not above 0."""
    if current.high < 0:
        return current.noted(
            "negative: the black level falls with exposure time (drift, or masked reference pixels), "
            "which hides the dark current"
        )
    return current.noted("may be 0" if current.low <= 0 else "")


def _current_from_variance(stacks: Sequence[Stack]) -> Quantity:
    """Return the slope of the temporal variance over exposure time, from stacks of at least 2 frames [DN²/s]."""
    like = no_value("µ_I.var", "dark current from the variance", "DN²/s", SECTION)
    used = [stack for stack in stacks if len(stack) > 1 and not stack.coarse]
    if len({stack.exposure_s for stack in used}) < 2:
        coarse = next(filter(None, (stack.coarse for stack in stacks)), "")
        return like.noted(coarse or "fewer than 2 exposure times have 2 frames")
    points: list[tuple[float, float, float]] = []
    for stack in used:
        terms = temporal_mean_squares(stack).terms()
        error = math.sqrt(sum(2 * term.value**2 / term.freedom for term in terms))
        hidden = 2 * stack.clipping.share * stack.changes.variance
        value = sum(term.value for term in terms)
        points.append((stack.exposure_s, value, math.hypot(error, hidden)))
    line = straight_line(*np.array(points).T)
    return like.with_interval(line.interval).noted(line.note)


def _without_clipped(stacks: Sequence[Stack]) -> tuple[list[Stack], str]:
    """Return the unclipped stacks, and a note on the others.

    Raises InputError if the stacks differ, or if fewer than 2 exposure times remain.
    """
    for stack in stacks:
        stack.require_one_filter()
    settings = {(stack.shape, stack.temperature_k, stack.gain) for stack in stacks}
    if len(settings) > 1:
        differences = "; ".join(
            f"{h} × {w} pixels, {t} K, gain {g!r}" for (h, w), t, g in sorted(settings, key=str)
        )
        raise InputError(
            f"the dark stacks differ ({differences}); pass those of one size, temperature and gain."
        )
    used = [stack for stack in stacks if not stack.clipping.note]
    clipped = [stack for stack in stacks if stack.clipping.note]
    times = {stack.exposure_s for stack in used}
    if len(times) < 2:
        notes = [f" {stack.exposure_s:g} s: {stack.clipping.note}." for stack in clipped]
        any_clipped = any(stack.clipping.clipped for stack in stacks)
        raise (ClippedError if any_clipped else InputError)(
            f"dark current needs 2 unclipped exposure times; there are {len(times)}.{''.join(notes)}"
        )
    left_out = [f"{stack.exposure_s:g} s left out ({stack.clipping.note})" for stack in clipped]
    return used, "; ".join(left_out)


def errors_of_means(stacks: Sequence[Stack]) -> tuple[Float64Array, float]:
    """Return the standard error of each stack's mean and its degrees of freedom.

    The errors include pixel and line noise, rounding and, if frames scatter more than these explain, drift. They are
    NaN if a stack has one frame.
    """
    if min(map(len, stacks)) < 2:
        return np.full(len(stacks), np.nan), 1.0
    expected = np.array([temporal_mean_squares(stack).variance_of_mean() for stack in stacks])
    hidden = np.array([stack.clipping.share**2 * stack.changes.variance for stack in stacks])
    for number, stack in enumerate(stacks):
        if stack.whole_codes:
            total_dn2 = stack.changes.variance + stack.changes.of_means
            hidden[number] += rounding_shift_dn(total_dn2) ** 2
    scatter = np.array([stack.frame_means.var(ddof=1) for stack in stacks])
    frames = np.array([len(stack) for stack in stacks])
    freedom = float((frames - 1).sum())
    if (expected > 0).all():
        chi2 = float(((frames - 1) * scatter / expected).sum())
        if scipy.special.chdtrc(freedom, chi2) > DRIFT_FALSE_ALARM:
            return np.sqrt(expected / frames + hidden), math.inf
    drift = max(0.0, float((frames - 1) @ (scatter - expected)) / freedom)
    return np.sqrt((expected + drift) / frames + hidden), freedom


@dataclass(frozen=True, eq=False)
class DarkTemperature(Figures):
    """Dark current versus temperature, with models fitted to its logarithm.

    doubling : T_d of D ∝ 2^(T/T_d) [K].  activation : E_a of D ∝ exp(−E_a/kT) [eV]; half the band gap for generation by
    traps in the depletion region, the whole band gap for diffusion.
    temperature_k, current : points, in ``unit``.
    """

    doubling: Quantity
    activation: Quantity
    temperature_k: Float64Array
    current: Float64Array
    unit: str

    def plot(self, ax: Axes) -> None:
        """Plot the logarithm of dark current versus 1/kT (Arrhenius plot)."""
        x = 1 / (BOLTZMANN_EV_PER_K * self.temperature_k)
        ax.plot(x, self.current, "o", ms=4, label="measured")
        middle = float(np.log(self.current).mean() + self.activation.value * x.mean())
        ends = np.array([x.min(), x.max()])
        ax.plot(ends, np.exp(middle - self.activation.value * ends), lw=1, label="exp(−E_a/kT)")
        ax.set(xlabel="1/kT [1/eV]", ylabel=f"dark current [{self.unit}]", yscale="log")


def dark_temperature(currents: Mapping[float, Quantity]) -> DarkTemperature:
    """Fit doubling temperature and activation energy to at least 2 dark currents by temperature [K], in one unit.

    Currents whose interval includes 0 are left out with a note. Raises InputError if fewer than 2 remain, and for
    temperatures that are not positive or different units.
    """
    units = sorted({current.unit for current in currents.values()})
    if len(units) > 1 or not all(t > 0 for t in currents):
        raise InputError(
            f"currents has temperatures {sorted(currents)} K and units {units}; pass temperatures above 0 and one unit."
        )
    used = {t: current for t, current in sorted(currents.items()) if current.low > 0}
    left_out = [f"{t:g} K left out: may be 0" for t in sorted({*currents} - {*used})]
    if len(used) < 2:
        raise InputError(
            f"the dark current is above 0 at {len(used)} of {len(currents)} temperatures; take frames at 2 or more."
        )
    temperature_k = np.array(list(used))
    value, low, high = np.array([(x.value, x.low, x.high) for x in used.values()]).T
    error = np.log(high / low) / (2 * TWO_SIDED)
    note = "; ".join(left_out)
    doubling = no_value("T_d", "doubling temperature", "K", TEMPERATURE_SECTION)
    octaves = straight_line(temperature_k, np.log2(value), error / math.log(2))
    slope, least, most = octaves.interval
    doubling = doubling.noted(octaves.note)
    if least > 0:
        doubling = doubling.with_interval((1 / slope, 1 / most, 1 / least))
    else:
        doubling = doubling.noted(NOT_RISING)
    energy = straight_line(-1 / (BOLTZMANN_EV_PER_K * temperature_k), np.log(value), error)
    activation = Quantity(
        "E_a", "activation energy", *energy.interval, "eV", "Arrhenius law", energy.note
    )
    return DarkTemperature(
        doubling.noted(note), activation.noted(note), temperature_k, value, units[0]
    )
