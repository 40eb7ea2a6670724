"""Temporal dark noise σ_y.dark [DN] and σ_d [e-] without rounding; bounds where EMVA 1288 R4 2.2 has no figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma
from ..frames.notes import merged
from ..frames.series import Level, coarse_codes, measure_level
from ..frames.stack import ROUNDING_DN2, Stack, coarse_note, rounding_error_dn2
from ..quantity import (
    Quantity,
    hidden_by_clipping,
    no_value,
    normal_interval,
    quotient,
    unknown,
    upper_bound,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 6.6"
BOUND_DN, ANALOGUE_BOUND_DN = 0.49, 0.40
"""Upper bounds of σ_y.dark and of K·σ_d where the variance is below 0.24 DN², EMVA 1288 R4 2.2."""
NO_NOISE = no_value("σ_y.dark", "temporal dark noise", "DN", SECTION)


@dataclass(frozen=True, eq=False)
class DarkNoise:
    """total : σ_y.dark [DN], rounding included.  analogue : the same without rounding [DN].  electrons : σ_d [e-].

    points : exposure times [s] and variances [DN²] of the dark stacks.
    """

    total: Quantity
    analogue: Quantity
    electrons: Quantity
    points: tuple[Float64Array, Float64Array]

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Total and analogue noise [DN], and the noise in electrons."""
        return self.total, self.analogue, self.electrons

    def plot(self, axes: Axes) -> None:
        """Variance in the dark against exposure time, and the variance that is taken at time zero."""
        axes.plot(*self.points, "o", markersize=3, label="dark frames")
        label = "temporal dark noise, squared"
        axes.axhline(self.total.value**2, color="black", linewidth=1, label=label)
        axes.set(xlabel="exposure time [s]", ylabel="temporal variance in the dark [DN²]")


def dark_noise(
    darks: Sequence[Stack],
    gain: Quantity | None = None,
    levels: Sequence[Level] | None = None,
) -> DarkNoise:
    """Temporal dark noise from dark frames, and K [DN/e-] where it is known.

    levels : those of the stacks, where they were measured before.

    Of three exposure times or more the variance is extrapolated to zero, else it is that of the shortest. Below
    0.24 DN² there are only the bounds of EMVA 1288: σ_y.dark < 0.49 DN and σ_d < 0.40 DN/K.

    Stacks whose values are clipped are left out with a note; there is no value where the shortest is clipped and no
    three exposure times are left that say what it would be.
    """
    if levels is None:
        levels = [measure_level(stack) for stack in darks]
    used, notes = _without_clipped(darks)
    darks, levels = [darks[k] for k in used], [levels[k] for k in used]
    shortest = min(darks, key=lambda stack: stack.exposure_s)
    for level in levels:
        notes += level.notes
    note = "; ".join(merged([*notes, *coarse_codes(darks)]))
    variance = _variance_at_zero(levels)
    total = _root(variance, 0.0)
    analogue = replace(total, symbol="K·σ_d")
    if all(stack.whole_codes for stack in darks):
        coarse = coarse_note(variance[0])
        analogue = replace(_root(variance, ROUNDING_DN2), symbol="K·σ_d")
        if coarse:
            total = upper_bound(total, BOUND_DN, coarse)
            analogue = upper_bound(analogue, ANALOGUE_BOUND_DN, coarse)
    if shortest.clipping.clipped:
        total = hidden_by_clipping(total, shortest.clipping.note)
        analogue = hidden_by_clipping(analogue, shortest.clipping.note)
    elif shortest.clipping.share:
        total = mark_clipped_sigma(total, shortest)
        analogue = mark_clipped_sigma(analogue, shortest)
    total, analogue = total.noted(note), analogue.noted(note)
    times = np.array([level.exposure_s for level in levels])
    variances = np.array([level.variance for level in levels])
    electrons = _noise_in_electrons(analogue, gain)
    return DarkNoise(total, analogue, electrons, (times, variances))


def _without_clipped(darks: Sequence[Stack]) -> tuple[list[int], list[str]]:
    """Numbers of the stacks that show the noise at exposure time 0, and notes about the others; all where none do."""
    inside = [k for k, stack in enumerate(darks) if not stack.clipping.clipped]
    times = {darks[k].exposure_s for k in inside}
    shortest_s = min(stack.exposure_s for stack in darks)
    if shortest_s not in times and len(times) < 3:
        return list(range(len(darks))), []
    notes: list[str] = []
    for stack in darks:
        if stack.clipping.clipped:
            notes.append(f"{stack.exposure_s:g} s left out ({stack.clipping.note})")
    return inside, notes


def _variance_at_zero(levels: Sequence[Level]) -> tuple[float, float, float]:
    """(value, low, high) of σ_y.dark² at exposure time 0 by a line with weights, or of the shortest [DN²]."""
    times = np.array([level.exposure_s for level in levels])
    variances = np.array([level.variance for level in levels])
    errors = np.maximum([level.variance_error for level in levels], 1e-12)
    if len(set(times.tolist())) > 2:
        variance = float(np.polynomial.polynomial.polyfit(times, variances, 1, w=1 / errors)[0])
        basis = np.stack([np.ones_like(times), times], axis=1) / errors[:, None]
        error = math.sqrt(float(np.linalg.inv(basis.T @ basis)[0, 0]))
    else:
        short = times == times.min()
        variance = float(variances[short].mean())
        error = float(np.sqrt((errors[short] ** 2).sum()) / short.sum())
    return normal_interval(variance, error)


def _root(variances: tuple[float, float, float], rounding_dn2: float) -> Quantity:
    """Noise from (value, low, high) of its variance, of which rounding is subtracted with what it may differ by."""
    value, low, high = variances
    error = rounding_error_dn2(value) if rounding_dn2 else 0.0
    middle = value - rounding_dn2
    down, up = math.hypot(value - low, error), math.hypot(high - value, error)
    value, low, high = (math.sqrt(max(v, 0.0)) for v in (middle, middle - down, middle + up))
    return replace(NO_NOISE, value=value, low=low, high=high)


def _noise_in_electrons(analogue: Quantity, gain: Quantity | None) -> Quantity:
    """σ_d from K·σ_d and K."""
    like = replace(analogue, symbol="σ_d", unit="e-", note="")
    if gain is None:
        return replace(unknown(like, "K is not known"), clipped=analogue.clipped)
    if analogue.low > 0 or not gain.low > 0 or math.isnan(analogue.value):
        return quotient(analogue, gain, like)
    value, high = analogue.value / gain.value, analogue.high / gain.low
    return replace(like, value=value, low=0.0, high=high, note=analogue.note)
