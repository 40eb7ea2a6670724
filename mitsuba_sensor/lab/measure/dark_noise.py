"""Temporal dark noise σ_y.dark [DN] and σ_d [e-], without rounding; by maximum likelihood where codes are coarse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma
from ..frames.notes import merged
from ..frames.rounding import ROUNDING_DN2, has_whole_codes
from ..frames.series import (
    COARSE_DN2,
    Level,
    coarse_codes,
    measure_level,
)
from ..frames.stack import Stack
from ..frames.temporal import temporal
from ..quantity import TWO_SIDED, Quantity, no_value, normal_interval, quotient, unknown
from ..statistics.rounded_normal import rounded_normal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 6.6"
FORBIDDEN_DN2 = 0.24
"""Variance [DN²] below which EMVA 1288 R4 2.2 gives an upper limit only: σ_y.dark 0.49 DN, K·σ_d 0.40 DN."""


@dataclass(frozen=True, eq=False)
class DarkNoise:
    """total : σ_y.dark [DN], rounding included.  analogue : the same without rounding [DN].  electrons : σ_d [e-].

    coarse : whether rounding is so coarse that the values are most likely ones, not differences of variances.
    points : exposure times [s] and variances [DN²] of the dark stacks.
    """

    total: Quantity
    analogue: Quantity
    electrons: Quantity
    coarse: bool
    points: tuple[Float64Array, Float64Array]

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Total and analogue noise [DN], and the noise in electrons."""
        return self.total, self.analogue, self.electrons

    def plot(self, axes: Axes) -> None:
        """Variance in the dark against exposure time, and the variance that is taken at time zero."""
        axes.plot(*self.points, "o", markersize=3, label="dark frames")
        axes.axhline(
            self.total.value**2,
            color="black",
            linewidth=1,
            label="temporal dark noise, squared",
        )
        axes.set(xlabel="exposure time [s]", ylabel="temporal variance in the dark [DN²]")


def dark_noise(
    darks: Sequence[Stack],
    gain: Quantity | None = None,
    levels: Sequence[Level] | None = None,
) -> DarkNoise:
    """Temporal dark noise from dark frames, and K [DN/e-] where it is known.

    levels : those of the stacks, where they were measured before.

    Of three exposure times or more the variance is extrapolated to zero, else it is that of the shortest. Where noise
    of the shortest is below 0.7 DN, rounding adds another variance than 1/12 DN² in pixels that are alike, and σ is
    the most likely one of the rounded codes; below 0.4 DN, where EMVA 1288 gives no value, a note says so.

    Stacks whose values are clipped are left out with a note; there is no value where the shortest is clipped and no
    three exposure times are left that say what it would be.
    """
    if levels is None:
        levels = [measure_level(stack) for stack in darks]
    used, notes = _without_clipped(darks)
    darks, levels = [darks[k] for k in used], [levels[k] for k in used]
    first = min(range(len(darks)), key=lambda k: darks[k].exposure_s)
    shortest, variance = darks[first], levels[first].variance
    whole = all(has_whole_codes(stack) for stack in darks)
    coarse = whole and variance < COARSE_DN2 + ROUNDING_DN2
    for level in levels:
        notes += level.notes
    notes = merged([*notes, *coarse_codes(darks)])
    if coarse:
        total, analogue = _most_likely_noise(shortest, variance)
    else:
        total, analogue = _noise_at_zero(levels, ROUNDING_DN2 if whole else 0.0)
    if shortest.clipping.share:
        total = mark_clipped_sigma(total, shortest)
        analogue = mark_clipped_sigma(analogue, shortest)
    total = replace(total, note="; ".join(filter(None, (total.note, *notes))))
    analogue = replace(analogue, note="; ".join(filter(None, (analogue.note, *notes))))
    times = np.array([level.exposure_s for level in levels])
    variances = np.array([level.variance for level in levels])
    electrons = _noise_in_electrons(analogue, gain)
    return DarkNoise(total, analogue, electrons, coarse, (times, variances))


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


def _empty(symbol: str, note: str = "") -> Quantity:
    return no_value(symbol, "temporal dark noise", "DN", SECTION, note)


def _noise_at_zero(levels: Sequence[Level], rounding: float) -> tuple[Quantity, Quantity]:
    """σ_y.dark and σ_d·K, from variances at exposure time 0 by a line with weights, or of the shortest."""
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
    interval = normal_interval(variance, error)
    total = _with_roots(_empty("σ_y.dark"), interval, 0.0)
    analogue = _with_roots(_empty("K·σ_d"), interval, rounding)
    return total, analogue


def _with_roots(
    like: Quantity, variances: tuple[float, float, float], removed: float
) -> Quantity:
    """The quantity with the roots of (value, low, high) of a variance, of which so much is removed, as values."""
    value, low, high = (math.sqrt(max(variance - removed, 0.0)) for variance in variances)
    return replace(like, value=value, low=low, high=high)


def _most_likely_noise(stack: Stack, variance: float) -> tuple[Quantity, Quantity]:
    """σ_y.dark, and the σ_d·K that is most likely to give the rounded codes of one stack."""
    if not np.ptp(stack.frames):
        return _hidden_noise(stack)
    if stack.bits is None:
        last_code = None
    else:
        last_code = 2**stack.bits - 1
    fit = rounded_normal(stack.frames, last_code)
    note = "most likely σ of rounded codes"
    if variance < FORBIDDEN_DN2:
        note = f"below 0.4 DN, where rounding forbids a difference of variances (EMVA 1288 R4 2.2): {note}"
    if not fit.identified:
        note += "; the codes change between two values only, which gives an upper limit"
    if fit.left_out > 0:
        note += f"; without {100 * fit.left_out:.2g} % of the pixels, which spread over 16 codes and more"
    statistics = temporal(stack)
    interval = normal_interval(variance, statistics.variance_error)
    total = _with_roots(_empty("σ_y.dark", note), interval, 0.0)
    # The likelihood takes all pixels as independent, but there are few rows and columns.
    by_lines_dn = TWO_SIDED * statistics.lines_error / (2 * fit.sigma_dn)
    low_dn = fit.sigma_dn - math.hypot(fit.sigma_dn - fit.low_dn, by_lines_dn)
    high_dn = fit.sigma_dn + math.hypot(fit.high_dn - fit.sigma_dn, by_lines_dn)
    analogue = replace(
        _empty("K·σ_d", note), value=fit.sigma_dn, low=max(0.0, low_dn), high=high_dn
    )
    return total, analogue


def _hidden_noise(stack: Stack) -> tuple[Quantity, Quantity]:
    """An upper limit of the noise where all codes are equal.

    Inside the range, σ of 0.4 DN changes at least one value in five: 32 values show it.
    """
    code = float(stack.frames.flat[0])
    if code <= 0 or (stack.bits is not None and code >= 2**stack.bits - 1):
        note = f"all dark values are {code:g}, an end of the range, which hides the noise"
        return _empty("σ_y.dark", note), _empty("K·σ_d", note)
    note = f"all dark values are {code:g}: an upper limit, 0.40 DN (EMVA 1288 R4 2.2)"
    zero = replace(_empty("σ_y.dark", note), value=0.0, low=0.0, high=0.49)
    return zero, replace(zero, symbol="K·σ_d", high=0.40)


def _noise_in_electrons(analogue: Quantity, gain: Quantity | None) -> Quantity:
    """σ_d from K·σ_d and K."""
    like = replace(analogue, symbol="σ_d", unit="e-", note="")
    if gain is None:
        return replace(unknown(like, "K is not known"), clipped=analogue.clipped)
    if analogue.low > 0 or not gain.low > 0 or math.isnan(analogue.value):
        return quotient(analogue, gain, like)
    return replace(
        like,
        value=analogue.value / gain.value,
        low=0.0,
        high=analogue.high / gain.low,
        note=analogue.note,
    )
