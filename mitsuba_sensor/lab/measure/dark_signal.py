"""Dark signal: histogram of the mean of dark frames, and distributions fitted to it by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Quantity, normal_interval
from ..statistics.families import FAMILIES
from ..statistics.mixture import Mixture, edge_interval, fitted_mixture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "Konnik & Welsh 2014, dark signal"
FEWEST_VALUES = 16
"""Different values of a distribution that rounding does not hide."""
MOST_FITS = 6
"""Curves in a plot beside the histogram."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A distribution and how well it describes the values.

    name : of the family, with superimposed parts "gamma + uniform + normal".  parameters : with 95 % intervals.
    log_likelihood, bic : larger and smaller is better.  ks : largest distance of the distribution functions.
    ks_probability : of a larger one by chance, were the parameters not fitted; too large by that.
    """

    name: str
    parameters: tuple[Quantity, ...]
    mixture: Mixture
    log_likelihood: float
    bic: float
    ks: float
    ks_probability: float


@dataclass(frozen=True, eq=False)
class DarkSignal:
    """Signal of the pixels above the offset and what was fitted to it.

    values : sorted, (n,) [DN].  offset_dn : subtracted from the frames' mean [DN]; it is known, not fitted.
    fits : by BIC, the best first.  note : what restricts all of them.
    """

    values: Float64Array
    offset_dn: float
    fits: tuple[Fit, ...]
    note: str

    @property
    def best(self) -> Fit:
        """With the smallest BIC."""
        return self.fits[0]

    def plot(self, ax: Axes, log_counts: bool = False) -> None:
        """Normalised frequency of the values and the density of each fit; counts linear or logarithmic."""
        first, third = np.quantile(self.values, (0.25, 0.75))
        ends = self.values[[0, -1]]
        low, high = (
            ends
            if log_counts
            else np.clip((first - 4 * (third - first), third + 4 * (third - first)), *ends)
        )
        step = max((third - first) / 12, (high - low) / 400) or 1.0
        apart = np.diff(self.values)
        grid = float(
            apart[apart > 1e-6 * step].min(initial=step)
        )  # means of N frames are multiples of 1/N: whole ones
        step = max(round(step / grid), 1) * grid
        low = ends[0] + (math.floor((low - ends[0]) / grid) - 0.5) * grid
        counts, edges = np.histogram(self.values, np.arange(low, high + 2 * step, step))
        density, centres = counts / len(self.values) / step, 0.5 * (edges[1:] + edges[:-1])
        some = density > 0
        ax.plot(centres[some], density[some], ".", ms=4, color="0.5", label="measured")
        x = np.linspace(
            max(edges[0], 1e-6) if self.values[0] > 0 else edges[0], edges[-1], 2000
        )
        for one in self.fits[:MOST_FITS]:
            ax.plot(x, one.mixture.density(x), lw=1.2, label=one.name)
        ax.set(xlabel="dark signal [DN]", ylabel="normalised frequency [1/DN]")
        if log_counts:
            ax.set(yscale="log", ylim=(0.3 * density[some].min(), 3 * density.max()))


def dark_signal(
    dark: Stack,
    offset_dn: float = 0.0,
    families: Sequence[str] = tuple(FAMILIES),
    superimposed: Sequence[tuple[str, ...]] = (),
) -> DarkSignal:
    """Distributions of the mean of N dark frames.  What is left of temporal noise, σ²/N, is part of them.

    offset_dn : the black level, known from frames of no exposure time; 0 describes the frames as they are.
    families : of "normal", "log-normal", "gamma" and "inverse Gaussian".
    superimposed : each a main family and parts with weights of their own, ("gamma", "uniform", "normal") for example.

    The intervals are those of independent pixels: column offsets make them too narrow.
    Raises InputError for a mosaic, unknown names, fewer than 16 values, and offsets that are not finite.
    """
    dark.require_one_filter()
    wrong = {*families, *(one[0] for one in superimposed)} - set(FAMILIES)
    wrong |= {part for one in superimposed for part in one[1:]} - {"uniform", "normal"}
    if wrong or not (families or superimposed):
        known = ", ".join(map(repr, FAMILIES))
        raise InputError(
            f"{sorted(wrong)} is no distribution; main ones are {known}, superimposed 'uniform', 'normal'."
        )
    if not math.isfinite(offset_dn) or dark.mean.size < FEWEST_VALUES:
        raise InputError(
            f"offset_dn is {offset_dn!r} for {dark.mean.size} pixels; it must be finite, of 16 or more."
        )
    values = np.sort(dark.mean.ravel()) - offset_dn
    x, w = _condensed(values)
    notes = [dark.clipping.note]
    if len(x) < FEWEST_VALUES:
        notes.append(f"only {len(x)} different values: rounding hides the distribution")
    if values[0] == values[-1]:
        return DarkSignal(values, offset_dn, (), "; ".join(filter(None, notes)))
    fits = []
    for main, *parts in [*((name,) for name in families), *superimposed]:
        if FAMILIES[main].positive and values[0] <= 0:
            below = int(np.count_nonzero(values <= 0))
            notes.append(
                f"{main} is not fitted: {below} values are not above the offset of {offset_dn:g} DN"
            )
            continue
        if parts and len(x) < FEWEST_VALUES:
            notes.append(f"{' + '.join((main, *parts))} is not fitted")
            continue
        fit = _fit(main, tuple(parts), (x, w), values)
        fits.append(
            replace(fit, parameters=tuple(mark_clipped(one, dark) for one in fit.parameters))
        )
    return DarkSignal(
        values,
        offset_dn,
        tuple(sorted(fits, key=lambda one: one.bic)),
        "; ".join(filter(None, notes)),
    )


def _condensed(values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Sorted values as (values, how many), those within σ/100 of each other together, as their mean."""
    sigma = float(np.subtract(*np.quantile(values, (0.75, 0.25)))) / 1.349
    width = max(sigma / 100, 1e-12 * float(np.ptp(values)), 1e-300)
    group = np.floor((values - values[0]) / width)
    starts = np.concatenate(([0], np.nonzero(np.diff(group))[0] + 1))
    w = np.diff(np.append(starts, len(values))).astype(np.float64)
    return np.add.reduceat(values, starts) / w, w


def _fit(
    main: str,
    parts: tuple[str, ...],
    grouped: tuple[Float64Array, Float64Array],
    values: Float64Array,
) -> Fit:
    x, w = grouped
    family, count = FAMILIES[main], len(values)
    single = Mixture(family, family.fit(values, np.ones(count)))
    mixture = fitted_mixture(main, parts, x, w) if parts else single
    likelihood = mixture.log_likelihood(x, w)
    below = mixture.below(values)
    rank = np.arange(count + 1) / count
    ks = float(max(np.abs(below - rank[1:]).max(), np.abs(below - rank[:-1]).max()))
    bic = len(mixture.values) * math.log(count) - 2 * likelihood
    probability = float(scipy.special.kolmogorov(math.sqrt(count) * ks))
    return Fit(
        " + ".join((main, *parts)),
        _parameters(mixture, x, w),
        mixture,
        likelihood,
        bic,
        ks,
        probability,
    )


def _parameters(mixture: Mixture, x: Float64Array, w: Float64Array) -> tuple[Quantity, ...]:
    """With symbols, units and intervals."""
    family, name = mixture.family, f"parameter of the {mixture.family.name} distribution"
    single = not (mixture.uniform or mixture.normal)
    errors = (
        family.errors(mixture.main, float(w.sum()))
        if single
        else _observed_errors(mixture, x, w)
    )
    values = zip(mixture.values, errors, strict=True)
    intervals = [normal_interval(value, error) for value, error in values]
    named = [
        (symbol, name, "DN" if in_dn else "")
        for symbol, in_dn in zip(family.names, family.in_dn, strict=True)
    ]
    if mixture.uniform:
        part, at = "superimposed uniform distribution", len(named)
        named += [
            ("w_uniform", f"share of the {part}", ""),
            *((symbol, part, "DN") for symbol in ("from", "to")),
        ]
        for edge in (1, 2):
            intervals[at + edge] = (mixture.uniform[edge], *edge_interval(mixture, edge, x, w))
        (low, lowest, _), (high, _, highest) = intervals[at + 1 : at + 3]
        longest, shortest = (
            highest - lowest,
            max(0.0, intervals[at + 2][1] - intervals[at + 1][2]),
        )
        share, least, most = intervals[
            at
        ]  # of edges that are known; the density between them is what is measured
        intervals[at] = share, least * shortest / (high - low), most * longest / (high - low)
    if mixture.normal:
        part = "superimposed normal distribution"
        named += [
            ("w_normal", f"share of the {part}", ""),
            ("µ_normal", part, "DN"),
            ("σ_normal", part, "DN"),
        ]
    both = zip(named, intervals, strict=True)
    return tuple(
        Quantity(symbol, what, *interval, unit, SECTION)
        for (symbol, what, unit), interval in both
    )


def _observed_errors(mixture: Mixture, x: Float64Array, w: Float64Array) -> list[float]:
    """Standard errors from the scatter of the derivatives of ln p by the parameters; those of the edges apart."""
    values = mixture.values
    edges = [len(mixture.main) + 1, len(mixture.main) + 2] if mixture.uniform else []
    smooth = [i for i in range(len(values)) if i not in edges]
    steps = [1e-5 * (abs(value) or 1e-6) for value in values]
    if mixture.family.names[1] == "σ":
        steps[0] = 1e-4 * values[1]  # a mean far from 0 has no scale of its own
    if mixture.normal:
        steps[-2] = 1e-4 * values[-1]
    rows = []
    for i in smooth:
        step = steps[i]
        both = [
            mixture.with_values([v + sign * step * (i == j) for j, v in enumerate(values)])
            for sign in (1, -1)
        ]
        up, down = (np.log(np.maximum(one.density(x), 1e-300)) for one in both)
        rows.append((up - down) / (2 * step))
    scores = np.array(rows)
    covariance = np.linalg.pinv(scores * w @ scores.T)
    errors = [0.0] * len(values)
    for place, i in enumerate(smooth):
        errors[i] = math.sqrt(max(covariance[place, place], 0.0))
    return errors
