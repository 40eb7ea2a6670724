"""Temporal dark noise σ_y.dark [DN] and σ_d [e-], without rounding; by maximum likelihood where codes are coarse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma
from ..frames.series import COARSE_DN2, ROUNDING_DN2, Level, coarse_codes, level
from ..frames.stack import Stack
from ..frames.temporal import temporal
from ..quantity import Quantity, normal_interval, quotient, unknown
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
        """All of them."""
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


def dark_noise(darks: Sequence[Stack], gain: Quantity | None = None) -> DarkNoise:
    """From dark frames, and K [DN/e-] where it is known.

    Of three exposure times or more the variance is extrapolated to zero, else it is that of the shortest. Where noise
    of the shortest is below 0.7 DN, rounding adds another variance than 1/12 DN² in pixels that are alike, and σ is
    the most likely one of the rounded codes; below 0.4 DN, where EMVA 1288 gives no value, a note says so.

    Stacks whose values are clipped are left out with a note; there is no value where the shortest is clipped and no
    three exposure times are left that say what it would be.
    """
    darks, left_out = _inside(darks)
    levels = [level(one) for one in darks]
    shortest = min(darks, key=lambda one: one.exposure_s)
    whole = all(bool((one.frames == np.round(one.frames)).all()) for one in darks)
    variance = float(temporal(shortest).variance.mean())
    coarse = whole and variance < COARSE_DN2 + ROUNDING_DN2
    notes = [*left_out, *(note for one in levels for note in one.notes), *coarse_codes(darks)]
    found = (
        _rounded(shortest, variance)
        if coarse
        else _at_zero(levels, ROUNDING_DN2 if whole else 0.0)
    )
    marked = (
        mark_clipped_sigma(one, shortest) if shortest.clipping.share else one for one in found
    )
    total, analogue = (
        replace(one, note="; ".join(filter(None, (one.note, *notes)))) for one in marked
    )
    electrons = replace(analogue, symbol="σ_d", unit="e-", note="")
    if gain is None:
        electrons = replace(unknown(electrons, "K is not known"), clipped=analogue.clipped)
    elif analogue.low > 0:
        electrons = quotient(analogue, gain, electrons)
    else:
        electrons = _upper(analogue, gain, electrons)
    points = (
        np.array([one.exposure_s for one in levels]),
        np.array([one.variance for one in levels]),
    )
    return DarkNoise(total, analogue, electrons, coarse, points)


def _inside(darks: Sequence[Stack]) -> tuple[Sequence[Stack], list[str]]:
    """The stacks that show the noise at exposure time 0, and what to say of the others; all where none do."""
    inside = [one for one in darks if not one.clipping.clipped]
    times = {one.exposure_s for one in inside}
    if min(one.exposure_s for one in darks) not in times and len(times) < 3:
        return darks, []
    clipped = [one for one in darks if one.clipping.clipped]
    return inside, [f"{one.exposure_s:g} s left out ({one.clipping.note})" for one in clipped]


def _named(symbol: str, note: str = "") -> Quantity:
    return Quantity(
        symbol, "temporal dark noise", math.nan, math.nan, math.nan, "DN", SECTION, note
    )


def _at_zero(levels: Sequence[Level], rounding: float) -> tuple[Quantity, Quantity]:
    """σ_y.dark and σ_d·K, from variances at exposure time 0 by a line with weights, or of the shortest."""
    times = np.array([one.exposure_s for one in levels])
    variances = np.array([one.variance for one in levels])
    errors = np.maximum([one.variance_error for one in levels], 1e-12)
    if len(set(times.tolist())) > 2:
        variance = float(np.polynomial.polynomial.polyfit(times, variances, 1, w=1 / errors)[0])
        basis = np.stack([np.ones_like(times), times], axis=1) / errors[:, None]
        error = math.sqrt(float(np.linalg.inv(basis.T @ basis)[0, 0]))
    else:
        short = times == times.min()
        variance, error = (
            float(variances[short].mean()),
            float(np.sqrt((errors[short] ** 2).sum()) / short.sum()),
        )
    value, low, high = normal_interval(variance, error)
    roots = (
        [math.sqrt(max(one - less, 0.0)) for one in (value, low, high)]
        for less in (0.0, rounding)
    )
    total, analogue = (
        replace(_named(symbol), value=found[0], low=found[1], high=found[2])
        for symbol, found in zip(("σ_y.dark", "K·σ_d"), roots, strict=True)
    )
    return total, analogue


def _rounded(stack: Stack, variance: float) -> tuple[Quantity, Quantity]:
    """The same of the codes of one stack."""
    if not np.ptp(stack.frames):
        return _no_noise(stack)
    last = None if stack.bits is None else 2**stack.bits - 1
    found = rounded_normal(stack.frames, last)
    note = "most likely σ of rounded codes"
    if variance < FORBIDDEN_DN2:
        note = f"below 0.4 DN, where rounding forbids a difference of variances (EMVA 1288 R4 2.2): {note}"
    if not found.identified:
        note += "; the codes change between two values only, which gives an upper limit"
    if found.left_out > 0:
        note += f"; without {100 * found.left_out:.2g} % of the pixels, which spread over 16 codes and more"
    error = temporal(stack).variance_error
    total = [math.sqrt(max(one, 0.0)) for one in normal_interval(variance, error)]
    return (
        replace(_named("σ_y.dark", note), value=total[0], low=total[1], high=total[2]),
        replace(
            _named("K·σ_d", note), value=found.sigma_dn, low=found.low_dn, high=found.high_dn
        ),
    )


def _no_noise(stack: Stack) -> tuple[Quantity, Quantity]:
    """All codes are one. Inside the range, σ of 0.4 DN changes at least one value in five: 32 values show it."""
    code = float(stack.frames.flat[0])
    if code <= 0 or (stack.bits is not None and code >= 2**stack.bits - 1):
        note = f"all dark values are {code:g}, an end of the range, which hides the noise"
        return _named("σ_y.dark", note), _named("K·σ_d", note)
    note = f"all dark values are {code:g}: an upper limit, 0.40 DN (EMVA 1288 R4 2.2)"
    zero = replace(_named("σ_y.dark", note), value=0.0, low=0.0, high=0.49)
    return zero, replace(zero, symbol="K·σ_d", high=0.40)


def _upper(analogue: Quantity, gain: Quantity, like: Quantity) -> Quantity:
    """An interval that begins at zero, in electrons."""
    if not gain.low > 0 or math.isnan(analogue.value):
        nothing = unknown(like, "; ".join(filter(None, (analogue.note, gain.note))))
        return replace(nothing, clipped=analogue.clipped or gain.clipped)
    return replace(
        like,
        value=analogue.value / gain.value,
        low=0.0,
        high=analogue.high / gain.low,
        note=analogue.note,
    )
