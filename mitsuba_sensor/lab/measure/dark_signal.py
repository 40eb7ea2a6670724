"""Dark signal: histogram of the mean of dark frames, with four distributions fitted by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import Figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VALUES_MIN = 16
"""Smallest number of different values that show a distribution."""
FITTED_MAX = 2**16
"""Largest number of fitted values, at equal distances."""
CV_MIN = 1e-6
"""σ over mean below which all four distributions are equal."""
DISTRIBUTIONS = {
    "normal": "norm",
    "log-normal": "lognorm",
    "gamma": "gamma",
    "inverse Gaussian": "invgauss",
}
"""Names in scipy.stats; all but the normal distribution begin at 0."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted distribution.

    name : of the distribution.  parameters : as in scipy.stats.  bic : Bayesian information criterion, smaller is
    better.  ks : largest distance of the distribution functions.
    """

    name: str
    parameters: tuple[float, ...]
    bic: float
    ks: float

    @property
    def law(self) -> Any:
        """The distribution in scipy.stats."""
        return getattr(scipy.stats, DISTRIBUTIONS[self.name])(*self.parameters)


@dataclass(frozen=True, eq=False)
class DarkSignal(Figures):
    """Signal of the pixels above the offset, with fitted distributions.

    values : sorted, shape (n,) [DN].  offset_dn : known offset that is subtracted from the mean frame [DN].
    fits : by ascending BIC.  note : what restricts all of them.
    """

    values: Float64Array
    offset_dn: float
    fits: tuple[Fit, ...]
    note: str

    @property
    def best(self) -> Fit:
        """Fit with the smallest BIC."""
        return self.fits[0]

    @property
    def notes(self) -> tuple[str, ...]:
        """Best distribution, and what restricts it."""
        if not self.fits:
            return ()
        best = f"distribution of the dark signal over the pixels: {self.best.name} (lowest BIC)"
        return tuple(filter(None, (best, self.note)))

    @property
    def plots(self) -> dict[str, Callable[[Axes], object]]:
        """Plot functions by title, none if all values are equal."""
        if not self.fits:
            return {}
        logarithmic = partial(self.plot, log_counts=True)
        return {"Dark signal": self.plot, "Dark signal, logarithmic": logarithmic}

    def plot(self, ax: Axes, log_counts: bool = False) -> None:
        """Plot the normalised frequency of the values and the density of each fit.  log_counts : logarithmic axis."""
        edges, step = self._bins(whole_range=log_counts)
        counts, _ = np.histogram(self.values, edges)
        density, centres = counts / len(self.values) / step, 0.5 * (edges[1:] + edges[:-1])
        filled = density > 0
        ax.plot(centres[filled], density[filled], ".", ms=4, color="0.5", label="measured")
        x = np.linspace(edges[0], edges[-1], 2000)
        for fit in self.fits:
            ax.plot(x, fit.law.pdf(x), lw=1.2, label=fit.name)
        ax.set(xlabel="dark signal [DN]", ylabel="normalised frequency [1/DN]")
        if log_counts:
            ax.set(yscale="log", ylim=(0.3 * density[filled].min(), 3 * density.max()))

    def _bins(self, whole_range: bool) -> tuple[Float64Array, float]:
        """Return edges and width of histogram bins, for all values or for those about the median."""
        first, third = np.quantile(self.values, (0.25, 0.75))
        smallest, largest = self.values[[0, -1]]
        low, high = smallest, largest
        if not whole_range:
            reach = 4 * (third - first)
            low, high = np.clip((first - reach, third + reach), smallest, largest)
        step = max((third - first) / 12, (high - low) / 400) or 1.0
        # Means of N frames are multiples of 1/N; each bin gets the same number of them.
        distances = np.diff(self.values)
        grid = float(distances[distances > 1e-6 * step].min(initial=step))
        step = max(round(step / grid), 1) * grid
        low = smallest + (math.floor((low - smallest) / grid) - 0.5) * grid
        return np.arange(low, high + 2 * step, step), step


def dark_signal(dark: Stack, offset_dn: float = 0.0) -> DarkSignal:
    """Fit four distributions to the mean of N dark frames, which includes the remaining temporal noise σ²/N.

    offset_dn : black level, from frames without exposure time.
    Raises InputError for a mosaic, fewer than 16 pixels, and an offset that is not finite.
    """
    dark.require_one_filter()
    if not math.isfinite(offset_dn) or dark.mean.size < VALUES_MIN:
        raise InputError(
            f"offset_dn is {offset_dn!r} for {dark.mean.size} pixels; pass a finite offset and at least 16 pixels."
        )
    values = np.sort(dark.mean.ravel()) - offset_dn
    notes = [dark.clipping.note]
    if (distinct := len(np.unique(values))) < VALUES_MIN:
        notes.append(f"only {distinct} different values: rounding hides the distribution")
    if values[0] <= 0 and distinct > 1:
        below = int(np.count_nonzero(values <= 0))
        notes.append(
            f"only a normal distribution is fitted: {below} values are not above the offset"
        )
    fits = distributions_of(values) if distinct > 1 else ()
    return DarkSignal(values, offset_dn, fits, "; ".join(filter(None, notes)))


def distributions_of(values: Float64Array) -> tuple[Fit, ...]:
    """Fit distributions to sorted values, by ascending BIC; only a normal one if a value is not above 0."""
    sample = values[:: math.ceil(len(values) / FITTED_MAX)]
    skewed = values[0] > 0 and float(sample.std()) > CV_MIN * float(sample.mean())
    fits: list[Fit] = []
    for name, in_scipy in DISTRIBUTIONS.items():
        if name != "normal" and not skewed:
            continue
        begins_at_0 = {} if name == "normal" else {"floc": 0}
        distribution = getattr(scipy.stats, in_scipy)
        parameters = tuple(map(float, distribution.fit(sample, **begins_at_0)))
        law = distribution(*parameters)
        bic = 2 * math.log(len(sample)) - 2 * float(law.logpdf(sample).sum())
        ks = float(scipy.stats.ks_1samp(sample, law.cdf).statistic)
        fits.append(Fit(name, parameters, bic, ks))
    return tuple(sorted(fits, key=lambda fit: fit.bic))
