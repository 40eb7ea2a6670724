"""Temporal dark noise σ_y.dark [DN] and σ_d [e-] without rounding; bounds where EMVA 1288 R4 2.2 has no figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..frames.clipping import mark_clipped_sigma
from ..frames.series import Level, coarse_codes, measure_level
from ..frames.stack import ROUNDING_DN2, Stack, coarse_note, merged, rounding_error_dn2
from ..quantity import (
    Figures,
    Quantity,
    no_value,
    normal_interval,
    quotient,
    unknown,
    upper_bound,
)
from ..statistics.line_fits import straight_line

SECTION = "EMVA 1288 R4 6.6"
BOUND_DN, ANALOGUE_BOUND_DN = 0.49, 0.40
"""Upper bounds of σ_y.dark and of K·σ_d where the variance is below 0.24 DN², EMVA 1288 R4 2.2."""


@dataclass(frozen=True, eq=False)
class DarkNoise(Figures):
    """total : σ_y.dark [DN], rounding included.  analogue : the same without rounding [DN].  electrons : σ_d [e-]."""

    total: Quantity
    analogue: Quantity
    electrons: Quantity


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
    pairs, notes = _without_clipped(list(zip(darks, levels, strict=True)))
    darks, levels = [stack for stack, _ in pairs], [level for _, level in pairs]
    shortest = min(darks, key=lambda stack: stack.exposure_s)
    notes += [note for level in levels for note in level.notes]
    variance = _variance_at_zero(levels)
    whole = all(stack.whole_codes for stack in darks)
    coarse = coarse_note(variance[0]) if whole else ""

    def figure(symbol: str, rounding_dn2: float, bound: float) -> Quantity:
        like = no_value(symbol, "temporal dark noise", "DN", SECTION)
        if shortest.clipping.clipped:
            noise = unknown(like, shortest.clipping.note, clipped=True)
        elif coarse:
            noise = upper_bound(like, bound, coarse)
        else:
            noise = like.with_interval(_root(variance, rounding_dn2))
            noise = mark_clipped_sigma(noise, shortest) if shortest.clipping.share else noise
        return noise.noted("; ".join(merged([*notes, *coarse_codes(darks)])))

    analogue = figure("K·σ_d", ROUNDING_DN2 if whole else 0.0, ANALOGUE_BOUND_DN)
    total = figure("σ_y.dark", 0.0, BOUND_DN)
    return DarkNoise(total, analogue, _noise_in_electrons(analogue, gain))


def _without_clipped(
    darks: list[tuple[Stack, Level]],
) -> tuple[list[tuple[Stack, Level]], list[str]]:
    """The stacks that show the noise at exposure time 0, and notes about the others; all where none do."""
    inside = [pair for pair in darks if not pair[0].clipping.clipped]
    times = {stack.exposure_s for stack, _ in inside}
    if min(stack.exposure_s for stack, _ in darks) not in times and len(times) < 3:
        return darks, []
    clipped = [stack for stack, _ in darks if stack.clipping.clipped]
    return inside, [
        f"{stack.exposure_s:g} s left out ({stack.clipping.note})" for stack in clipped
    ]


def _variance_at_zero(levels: Sequence[Level]) -> tuple[float, float, float]:
    """(value, low, high) of σ_y.dark² at exposure time 0 by a line with weights, or of the shortest [DN²]."""
    times = np.array([level.exposure_s for level in levels])
    variances = np.array([level.variance for level in levels])
    errors = np.maximum([level.variance_error for level in levels], 1e-12)
    if len(set(times.tolist())) > 2:
        return straight_line(times, variances, errors).offset_interval
    short = times == times.min()
    error = float(np.sqrt((errors[short] ** 2).sum()) / short.sum())
    return normal_interval(float(variances[short].mean()), error)


def _root(
    variances: tuple[float, float, float], rounding_dn2: float
) -> tuple[float, float, float]:
    """(value, low, high) of the noise, of whose variance rounding is subtracted with what it may differ by."""
    value, low, high = variances
    error = rounding_error_dn2(value) if rounding_dn2 else 0.0
    middle = value - rounding_dn2
    down, up = math.hypot(value - low, error), math.hypot(high - value, error)
    value, low, high = (math.sqrt(max(v, 0.0)) for v in (middle, middle - down, middle + up))
    return value, low, high


def _noise_in_electrons(analogue: Quantity, gain: Quantity | None) -> Quantity:
    """σ_d from K·σ_d and K."""
    like = replace(analogue, symbol="σ_d", unit="e-", note="")
    if gain is None:
        return unknown(like, "K is not known")
    if analogue.value == 0 and gain.low > 0:  # of which a quotient has no value
        return like.with_interval((0.0, 0.0, analogue.high / gain.low)).noted(analogue.note)
    return quotient(analogue, gain, like)
