"""Dark current from mean and variance of dark frames over the exposure time; what doubles it with the temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import ClippedError, temporal_note
from ..frames.stack import Stack
from ..quantity import LEVEL, Quantity
from ..statistics.line_fits import StraightLine, straight_line
from ..statistics.mean_squares import MeanSquares, temporal_mean_squares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 7.1"
DRIFT = 0.01
"""Probability that frames without drift are taken to have one."""
TEMPERATURE_SECTION = "EMVA 1288 R4 7.2"
BOLTZMANN_EV_PER_K = 8.617333262e-5
"""CODATA 2018."""


@dataclass(frozen=True, eq=False)
class DarkCurrentOverTime:
    """Dark signal against exposure time.

    from_mean : slope of the mean [DN/s]; [e-/s] by :meth:`per_gain`.
    from_variance : slope of the temporal variance [DN²/s]; [e-/s] by :meth:`per_gain`.
    line : through the means [DN, s].
    exposure_s, mean, mean_error : the points, with standard errors [s, DN].
    """

    from_mean: Quantity
    from_variance: Quantity
    line: StraightLine
    exposure_s: Float64Array
    mean: Float64Array
    mean_error: Float64Array

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both."""
        return self.from_mean, self.from_variance

    def per_gain(self, gain: Quantity | float) -> DarkCurrentOverTime:
        """In electrons.  gain : K [DN/e-]; the interval of a measured one widens these."""
        variance = self.from_variance.divided(gain, "DN/s").divided(gain, "e-/s")
        return replace(
            self, from_mean=self.from_mean.divided(gain, "e-/s"), from_variance=variance
        )

    def plot(self, ax: Axes) -> None:
        """Mean dark signal against exposure time, with the straight line."""
        ax.errorbar(
            self.exposure_s,
            self.mean,
            yerr=self.mean_error,
            fmt="o",
            ms=4,
            capsize=2,
            label="measured",
        )
        ends = np.array([0.0, self.exposure_s.max()])
        ax.plot(ends, self.line.offset + self.line.slope * ends, lw=1, label="straight line")
        ax.set(xlabel="exposure time [s]", ylabel="mean dark signal [DN]")


def dark_current(stacks: Sequence[Stack]) -> DarkCurrentOverTime:
    """µ_I of dark stacks of 2 exposure times or more, at one temperature and gain.

    The errors are those of temporal noise; the fixed pattern is the same in all stacks and widens no interval. Stacks
    of one frame have a mean and no variance. Stacks with clipped values are left out, with a note.

    Raises InputError for mosaics, stacks of different sizes, temperatures or gains, and fewer than 2 exposure times.
    """
    used, note = _checked(stacks)
    noise = [temporal_mean_squares(stack) if len(stack) > 1 else None for stack in used]
    x = np.array([stack.exposure_s for stack in used])
    mean = np.array([stack.frame_means.mean() for stack in used])
    mean_error, freedom = errors_of_means(used, noise)
    line = straight_line(x, mean, mean_error, freedom)
    from_mean = Quantity(
        "µ_I.mean", "dark current from the mean", *line.interval, "DN/s", SECTION, line.note
    )
    some = [i for i, one in enumerate(noise) if one]
    terms = [one.variance() for one in noise if one]
    variance = np.array([sum(part.value for part in one) for one in terms])
    error = np.array(
        [math.sqrt(sum(2 * part.value**2 / part.freedom for part in one)) for one in terms]
    )
    error = np.hypot(
        error, [2 * used[i].clipping.share * float(used[i].variance.mean()) for i in some]
    )
    name = "dark current from the variance"
    if len(set(x[some])) < 2:
        few = "fewer than 2 exposure times have 2 frames"
        from_variance = Quantity(
            "µ_I.var", name, math.nan, math.nan, math.nan, "DN²/s", SECTION, few
        )
    else:
        fit = straight_line(x[some], variance, error)
        from_variance = Quantity("µ_I.var", name, *fit.interval, "DN²/s", SECTION, fit.note)
        for stack in used:
            from_variance = from_variance.noted(temporal_note(stack) if len(stack) > 1 else "")
    return DarkCurrentOverTime(
        from_mean.noted(note), from_variance.noted(note), line, x, mean, mean_error
    )


def _checked(stacks: Sequence[Stack]) -> tuple[list[Stack], str]:
    """Those without clipped values, and what to say of the others."""
    for stack in stacks:
        stack.require_one_filter()
    settings = {(stack.shape, stack.temperature_k, stack.gain) for stack in stacks}
    if len(settings) > 1:
        found = "; ".join(
            f"{h} × {w} pixels, {t} K, gain {g!r}" for (h, w), t, g in sorted(settings, key=str)
        )
        raise InputError(
            f"the dark stacks differ: {found}. Pass those of one temperature and gain."
        )
    used = [stack for stack in stacks if not stack.clipping.note]
    times = sorted({stack.exposure_s for stack in used})
    if len(times) < 2:
        left = "".join(
            f" {stack.exposure_s:g} s: {stack.clipping.note}."
            for stack in stacks
            if stack not in used
        )
        kind = ClippedError if any(stack.clipping.clipped for stack in stacks) else InputError
        raise kind(
            f"dark current needs 2 exposure times without clipped values; there are {len(times)}.{left}"
        )
    left_out = [
        f"{stack.exposure_s:g} s left out ({stack.clipping.note})"
        for stack in stacks
        if stack not in used
    ]
    return used, "; ".join(left_out)


def errors_of_means(
    stacks: Sequence[Stack], noise: Sequence[MeanSquares | None]
) -> tuple[Float64Array, float]:
    """Standard error of every stack's mean, and its degrees of freedom: of pixels and lines, and of drift if there is
    more scatter between frames than these give."""
    if any(one is None for one in noise):
        return np.full(len(stacks), np.nan), 1.0
    expected = np.array([one.variance_of_mean() for one in noise if one])
    hidden = np.array([one.clipping.share**2 * float(one.variance.mean()) for one in stacks])
    found = np.array([stack.frame_means.var(ddof=1) for stack in stacks])
    frames = np.array([len(stack) for stack in stacks])
    free = float((frames - 1).sum())
    if (expected > 0).all() and scipy.special.chdtrc(
        free, float(((frames - 1) * found / expected).sum())
    ) > DRIFT:
        return np.sqrt(expected / frames + hidden), math.inf
    drift = max(0.0, float((frames - 1) @ (found - expected)) / free)
    return np.sqrt((expected + drift) / frames + hidden), free


@dataclass(frozen=True, eq=False)
class DarkTemperature:
    """Laws of dark current over temperature, each fitted to its logarithm.

    doubling : T_d of D ∝ 2^(T/T_d) [K].  activation : E_a of D ∝ exp(−E_a/kT) [eV]; half the band gap where traps in
        the depletion region generate it, the whole band gap where it diffuses.
    temperature_k, current : the points, in the unit of the currents.
    """

    doubling: Quantity
    activation: Quantity
    temperature_k: Float64Array
    current: Float64Array
    unit: str

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both."""
        return self.doubling, self.activation

    def plot(self, ax: Axes) -> None:
        """Arrhenius plot: logarithm of dark current against 1/kT."""
        x = 1 / (BOLTZMANN_EV_PER_K * self.temperature_k)
        ax.plot(x, self.current, "o", ms=4, label="measured")
        middle = float(np.log(self.current).mean() + self.activation.value * x.mean())
        ends = np.array([x.min(), x.max()])
        ax.plot(ends, np.exp(middle - self.activation.value * ends), lw=1, label="exp(−E_a/kT)")
        ax.set(xlabel="1/kT [1/eV]", ylabel=f"dark current [{self.unit}]", yscale="log")


def dark_temperature(currents: Mapping[float, Quantity]) -> DarkTemperature:
    """Of dark currents by their temperature [K], 2 or more, all in the same unit.

    Currents whose interval contains 0 are left out, with a note. Raises InputError for fewer than 2 others, for
    temperatures that are not positive, and for different units.
    """
    if any(not t > 0 for t in currents) or len({one.unit for one in currents.values()}) > 1:
        units = sorted({one.unit for one in currents.values()})
        raise InputError(
            f"temperatures {sorted(currents)} K, units {units}; temperatures are above 0, all units equal."
        )
    used = {t: one for t, one in sorted(currents.items()) if one.low > 0}
    if len(used) < 2:
        raise InputError(
            f"dark current is above 0 at {len(used)} temperatures of {len(currents)}; at least 2 are needed."
        )
    t = np.array(list(used))
    current = np.array([one.value for one in used.values()])
    z = float(scipy.special.ndtri((1 + LEVEL) / 2))
    error = np.array([math.log(one.high / one.low) / (2 * z) for one in used.values()])
    octaves = straight_line(t, np.log2(current), error / math.log(2))
    slope, low, high = octaves.interval
    ends = (1 / slope, 1 / high, 1 / low) if low > 0 else (math.nan, 0.0, math.inf)
    left = [f"{t:g} K left out: not told from 0" for t in sorted(currents) if t not in used]
    note = "; ".join(left)
    doubling = Quantity(
        "T_d", "doubling temperature", *ends, "K", TEMPERATURE_SECTION, octaves.note
    ).noted(note)
    energy = straight_line(-1 / (BOLTZMANN_EV_PER_K * t), np.log(current), error)
    arrhenius = Quantity(
        "E_a", "activation energy", *energy.interval, "eV", "Arrhenius law", energy.note
    ).noted(note)
    return DarkTemperature(doubling, arrhenius, t, current, next(iter(used.values())).unit)
