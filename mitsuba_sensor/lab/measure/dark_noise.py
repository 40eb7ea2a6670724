"""Temporal dark noise σ_y.dark [DN] and σ_d [e-] without rounding, or the bounds of EMVA 1288 R4 2.2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..frames.clipping import mark_clipped_sigma
from ..frames.series import Level, coarse_codes, measure_level
from ..frames.stack import ROUNDING_DN2, Stack, merged, rounding_error_dn2
from ..quantity import Figures, Quantity, no_value, normal_interval, quotient
from ..statistics.line_fits import straight_line

SECTION = "EMVA 1288 R4 6.6"
BOUND_DN, ANALOGUE_BOUND_DN = 0.49, 0.40
"""Upper bounds of σ_y.dark and of K·σ_d for a variance below 0.24 DN² (EMVA 1288 R4 2.2)."""


@dataclass(frozen=True, eq=False)
class DarkNoise(Figures):
    """total : σ_y.dark with rounding [DN].  analogue : K·σ_d without rounding [DN].  electrons : σ_d [e-]."""

    total: Quantity
    analogue: Quantity
    electrons: Quantity


def dark_noise(
    darks: Sequence[Stack],
    gain: Quantity | None = None,
    levels: Sequence[Level] | None = None,
) -> DarkNoise:
    """Measure temporal dark noise of dark frames.

    gain : K [DN/e-], or None.  levels : levels of the stacks, if already measured.

    With at least three exposure times, the variance is extrapolated to time 0; else it is the variance of the shortest.
    Below 0.24 DN² there are only bounds: σ_y.dark < 0.49 DN and σ_d < 0.40 DN/K.

    Clipped stacks are left out with a note. There is no value if the shortest stack is clipped and fewer than three
    exposure times remain.
    """
    if levels is None:
        levels = [measure_level(stack) for stack in darks]
    pairs, notes = _without_clipped(list(zip(darks, levels, strict=True)))
    darks, levels = [stack for stack, _ in pairs], [level for _, level in pairs]
    shortest = min(darks, key=lambda stack: stack.exposure_s)
    notes += [note for level in levels for note in level.notes]
    variance = _variance_at_zero(levels)
    whole = all(stack.whole_codes for stack in darks)
    coarse = shortest.coarse_at(variance[0]) if whole else ""

    def figure(symbol: str, rounding_dn2: float, bound: float) -> Quantity:
        noise = no_value(symbol, "temporal dark noise", "DN", SECTION)
        if shortest.clipping.clipped:
            noise = noise.without_value(shortest.clipping.note, clipped=True)
        elif coarse:
            noise = noise.with_interval((math.nan, 0.0, bound)).noted(coarse)
        else:
            noise = noise.with_interval(_root(variance, rounding_dn2, whole))
            noise = mark_clipped_sigma(noise, shortest) if shortest.clipping.share else noise
        return noise.noted("; ".join(merged([*notes, *coarse_codes(darks)])))

    analogue = figure("K·σ_d", ROUNDING_DN2 if whole else 0.0, ANALOGUE_BOUND_DN)
    total = figure("σ_y.dark", 0.0, BOUND_DN)
    return DarkNoise(total, analogue, _noise_in_electrons(analogue, gain))


def _without_clipped(
    darks: list[tuple[Stack, Level]],
) -> tuple[list[tuple[Stack, Level]], list[str]]:
    """Return the stacks that show the noise at time 0, with notes on the others; all stacks if none do."""
    inside = [pair for pair in darks if not pair[0].clipping.clipped]
    times = {stack.exposure_s for stack, _ in inside}
    if min(stack.exposure_s for stack, _ in darks) not in times and len(times) < 3:
        return darks, []
    clipped = [stack for stack, _ in darks if stack.clipping.clipped]
    return inside, [
        f"{dark.exposure_s:g} s left out ({dark.clipping.note})" for dark in clipped
    ]


def _variance_at_zero(levels: Sequence[Level]) -> tuple[float, float, float]:
    """Return (value, low, high) of σ_y.dark² at exposure time 0 from a weighted line, or of the shortest [DN²]."""
    times, variances, errors = np.array(
        [
            (level.exposure_s, level.variance, max(level.variance_error, 1e-12))
            for level in levels
        ]
    ).T
    if len(set(times.tolist())) > 2:
        return straight_line(times, variances, errors).offset_interval
    short = times == times.min()
    error = float(np.sqrt((errors[short] ** 2).sum()) / short.sum())
    return normal_interval(float(variances[short].mean()), error)


def _root(
    variances: tuple[float, float, float], rounding_dn2: float, whole: bool
) -> tuple[float, float, float]:
    """Return (value, low, high) of the noise without rounding_dn2; the rounding of whole codes is uncertain."""
    value, low, high = variances
    error = rounding_error_dn2(value) if whole else 0.0
    middle = value - rounding_dn2
    down, up = math.hypot(value - low, error), math.hypot(high - value, error)
    value, low, high = (math.sqrt(max(v, 0.0)) for v in (middle, middle - down, middle + up))
    return value, low, high


def _noise_in_electrons(analogue: Quantity, gain: Quantity | None) -> Quantity:
    """Return σ_d from K·σ_d and K."""
    like = replace(analogue, symbol="σ_d", unit="e-", note="")
    if gain is None:
        return like.without_value("K is unknown")
    if analogue.value == 0 and gain.low > 0:  # a quotient of 0 has no value
        return like.with_interval((0.0, 0.0, analogue.high / gain.low)).noted(analogue.note)
    return quotient(analogue, gain, like)
