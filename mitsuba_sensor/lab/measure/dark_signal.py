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
        """The fit with the smallest BIC."""
        return self.fits[0]

    def plot(self, ax: Axes, log_counts: bool = False) -> None:
        """Normalised frequency of the values and the density of each fit; counts linear or logarithmic."""
        edges, step = self._bins(whole_range=log_counts)
        counts, _ = np.histogram(self.values, edges)
        density, centres = counts / len(self.values) / step, 0.5 * (edges[1:] + edges[:-1])
        filled = density > 0
        ax.plot(centres[filled], density[filled], ".", ms=4, color="0.5", label="measured")
        begin = edges[0]
        if self.values[0] > 0:
            begin = max(begin, 1e-6)
        x = np.linspace(begin, edges[-1], 2000)
        for fit in self.fits[:MOST_FITS]:
            ax.plot(x, fit.mixture.density(x), lw=1.2, label=fit.name)
        ax.set(xlabel="dark signal [DN]", ylabel="normalised frequency [1/DN]")
        if log_counts:
            ax.set(yscale="log", ylim=(0.3 * density[filled].min(), 3 * density.max()))

    def _bins(self, whole_range: bool) -> tuple[Float64Array, float]:
        """Edges and width of the bins of a histogram, of all values or of those about their middle."""
        first, third = np.quantile(self.values, (0.25, 0.75))
        smallest, largest = self.values[[0, -1]]
        low, high = smallest, largest
        if not whole_range:
            reach = 4 * (third - first)
            low, high = np.clip((first - reach, third + reach), smallest, largest)
        step = max((third - first) / 12, (high - low) / 400) or 1.0
        # Means of N frames are multiples of 1/N: a bin has as many of them as any other.
        distances = np.diff(self.values)
        grid = float(distances[distances > 1e-6 * step].min(initial=step))
        step = max(round(step / grid), 1) * grid
        low = smallest + (math.floor((low - smallest) / grid) - 0.5) * grid
        return np.arange(low, high + 2 * step, step), step


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
    asked = [*((name,) for name in families), *superimposed]
    _check_names(asked)
    if not math.isfinite(offset_dn) or dark.mean.size < FEWEST_VALUES:
        raise InputError(
            f"offset_dn is {offset_dn!r} for {dark.mean.size} pixels; it must be finite, of 16 or more."
        )
    values = np.sort(dark.mean.ravel()) - offset_dn
    x, w = _group_values(values)
    notes = [dark.clipping.note]
    if len(x) < FEWEST_VALUES:
        notes.append(f"only {len(x)} different values: rounding hides the distribution")
    fits: list[Fit] = []
    if values[0] == values[-1]:
        asked = []  # nothing is distributed
    for main, *parts in asked:
        if FAMILIES[main].positive and values[0] <= 0:
            below = int(np.count_nonzero(values <= 0))
            notes.append(
                f"{main} is not fitted: {below} values are not above the offset of {offset_dn:g} DN"
            )
        elif parts and len(x) < FEWEST_VALUES:
            notes.append(f"{' + '.join((main, *parts))} is not fitted")
        else:
            fit = _fit(main, tuple(parts), (x, w), values)
            parameters = tuple(mark_clipped(parameter, dark) for parameter in fit.parameters)
            fits.append(replace(fit, parameters=parameters))
    fits.sort(key=lambda fit: fit.bic)
    return DarkSignal(values, offset_dn, tuple(fits), "; ".join(filter(None, notes)))


def _check_names(asked: Sequence[tuple[str, ...]]) -> None:
    """Raises InputError where no distribution is asked for, or one that is none."""
    wrong: set[str] = set()
    for main, *parts in asked:
        wrong |= {main} - set(FAMILIES)
        wrong |= set(parts) - {"uniform", "normal"}
    if wrong or not asked:
        main_names = ", ".join(map(repr, FAMILIES))
        raise InputError(
            f"{sorted(wrong)} is no distribution; main ones are {main_names}, superimposed 'uniform', 'normal'."
        )


def _group_values(values: Float64Array) -> tuple[Float64Array, Float64Array]:
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
    """The most likely distribution of a family with these superimposed parts."""
    x, w = grouped
    family, count = FAMILIES[main], len(values)
    if parts:
        mixture = fitted_mixture(main, parts, x, w)
    else:
        mixture = Mixture(family, family.fit(values, np.ones(count)))
    likelihood = mixture.log_likelihood(x, w)
    below = mixture.below(values)
    rank = np.arange(count + 1) / count
    ks = float(max(np.abs(below - rank[1:]).max(), np.abs(below - rank[:-1]).max()))
    return Fit(
        name=" + ".join((main, *parts)),
        parameters=_parameters(mixture, x, w),
        mixture=mixture,
        log_likelihood=likelihood,
        bic=len(mixture.values) * math.log(count) - 2 * likelihood,
        ks=ks,
        ks_probability=float(scipy.special.kolmogorov(math.sqrt(count) * ks)),
    )


def _parameters(mixture: Mixture, x: Float64Array, w: Float64Array) -> tuple[Quantity, ...]:
    """Parameters of a fitted distribution, with symbols, units and intervals."""
    family = mixture.family
    if mixture.uniform or mixture.normal:
        errors: Sequence[float] = _observed_errors(mixture, x, w)
    else:
        errors = family.errors(mixture.main, float(w.sum()))
    intervals = [
        normal_interval(value, error)
        for value, error in zip(mixture.values, errors, strict=True)
    ]
    if mixture.uniform:
        _replace_uniform_intervals(intervals, mixture, x, w)
    quantities: list[Quantity] = []
    for (symbol, name, unit), interval in zip(_names(mixture), intervals, strict=True):
        quantities.append(Quantity(symbol, name, *interval, unit, SECTION))
    return tuple(quantities)


def _names(mixture: Mixture) -> list[tuple[str, str, str]]:
    """(symbol, name, unit) of each parameter, in the order of the mixture's values."""
    family, names = mixture.family, []
    for symbol, in_dn in zip(family.names, family.in_dn, strict=True):
        unit = ""
        if in_dn:
            unit = "DN"
        names.append((symbol, f"parameter of the {family.name} distribution", unit))
    if mixture.uniform:
        part = "superimposed uniform distribution"
        names.append(("w_uniform", f"share of the {part}", ""))
        names += [("from", part, "DN"), ("to", part, "DN")]
    if mixture.normal:
        part = "superimposed normal distribution"
        names.append(("w_normal", f"share of the {part}", ""))
        names += [("µ_normal", part, "DN"), ("σ_normal", part, "DN")]
    return names


def _replace_uniform_intervals(
    intervals: list[tuple[float, float, float]],
    mixture: Mixture,
    x: Float64Array,
    w: Float64Array,
) -> None:
    """Give share and edges of the uniform part intervals that hold for its edges, whose errors are not normal.

    The interval of the share is that of edges that are known, but what is measured is the density between them.
    """
    assert mixture.uniform
    _, low, high = mixture.uniform
    place = len(mixture.main)
    lowest, largest_low = edge_interval(mixture, 1, x, w)
    smallest_high, highest = edge_interval(mixture, 2, x, w)
    longest, shortest = highest - lowest, max(0.0, smallest_high - largest_low)
    share, least, most = intervals[place]
    intervals[place] = share, least * shortest / (high - low), most * longest / (high - low)
    intervals[place + 1] = low, lowest, largest_low
    intervals[place + 2] = high, smallest_high, highest


def _observed_errors(mixture: Mixture, x: Float64Array, w: Float64Array) -> list[float]:
    """Standard errors from the scatter of the derivatives of ln p by the parameters; 0 for the edges."""
    values = mixture.values
    steps = [1e-5 * (abs(value) or 1e-6) for value in values]
    if mixture.family.names[1] == "σ":
        steps[0] = 1e-4 * values[1]  # a mean far from 0 has no scale of its own
    if mixture.normal:
        steps[-2] = 1e-4 * values[-1]

    def log_density(place: int, step: float) -> Float64Array:
        moved = list(values)
        moved[place] += step
        density = mixture.with_values(moved).density(x)
        return np.asarray(np.log(np.maximum(density, 1e-300)))

    smooth = list(range(len(values)))
    if mixture.uniform:
        first_edge = len(mixture.main) + 1
        del smooth[first_edge : first_edge + 2]
    scores = np.array(
        [
            (log_density(i, steps[i]) - log_density(i, -steps[i])) / (2 * steps[i])
            for i in smooth
        ]
    )
    covariance = np.linalg.pinv(scores * w @ scores.T)
    errors = [0.0] * len(values)
    for place, i in enumerate(smooth):
        errors[i] = math.sqrt(max(covariance[place, place], 0.0))
    return errors
