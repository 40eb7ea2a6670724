"""Law of the read noise, normal or with other tails, from L-moments over the frames of each pixel.

L-moments (Hosking, J. R. Stat. Soc. B 52, 105, 1990) are linear in the noise's σ: their sums over pixels of different
σ have the ratios of one pixel, and exist for tails that have no fourth moment. τ₄ is 0.1226 for a normal law and
(λ − 1)(λ − 2)/((λ + 3)(λ + 4)) for Tukey's; τ₆ tells Tukey's and Student's apart where both have the same τ₄.

Of rounded values l_r = ∫ F(1 − F)·p_r(F) dx is a sum over the codes: over pixels that lie anywhere between two codes
its average is the integral again, and rounding has moved nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from ...core.noise_distributions import NoiseDistribution, StudentT, TukeyLambda
from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import TWO_SIDED, Quantity, no_value, student_interval

FEWEST_FRAMES = 6
"""An L-moment of order 6 needs as many values."""
MOST_VALUES = 2**22
"""Rows are left out, evenly, until there are no more: σ of τ₄ is 2e-4 by then."""
BLOCKS = 32
"""Groups of rows from whose differences the standard errors come."""
ALARM = 3.5
"""Standard errors of τ₄ from that of a normal law, below which the noise is taken for normal: 1 false alarm in 700."""
DRAWS = 2**22
"""Numbers that are drawn for the chance variance of l₂, which is then right to 0.5 %."""
EVEN, BLURRED = 0.4, 2.0
"""σ of the offsets from which on pixels lie anywhere between two codes, and σ of noise that hides where [DN]."""
ALIGNED, HIDDEN = 0.25, 0.5
"""σ of the offsets below which rounding may hide the noise of quiet pixels, and σ of the noise that it hides [DN]."""
STEP = 0.05
"""Relative step of a derivative."""
SPREAD = 9
"""Nodes of σ over the pixels."""
POLYNOMIALS = {
    2: (1.0,),
    4: (1.0, -5.0, 5.0),
    6: (1.0, -14.0, 56.0, -84.0, 42.0),
}
"""l_r = ∫ F(1 − F)·p_r(F) dx; coefficients of rising powers."""
WEIGHTS = {2: (-1, 2), 4: (-1, 12, -30, 20), 6: (-1, 30, -210, 560, -630, 252)}
"""l_r = Σ w_k·b_k of probability-weighted moments b_k."""


@dataclass(frozen=True)
class Family:
    """A distribution of camera files, and the range of its shape that is looked at, heavy tails first."""

    name: str
    symbol: str
    distribution: Callable[[float], NoiseDistribution]
    heaviest: float
    lightest: float


FAMILIES = (
    Family("tukey_lambda", "λ", TukeyLambda, -0.45, 0.2),
    Family("student", "ν", StudentT, 2.5, 200.0),
)


@dataclass(frozen=True)
class NoiseLaw:
    """name : as in a camera file.  shape : of the law, without a value for a normal one.  said : a sentence about τ₄.

    distribution : None for a normal law.  scales : l₂ of the pixels that were looked at [DN].
    unsure : half of the 95 % interval of τ₄; infinite where frames do not show it.
    """

    name: str
    shape: Quantity
    said: str
    distribution: NoiseDistribution | None
    scales: Float64Array
    unsure: float = math.inf

    def spread_over_pixels(self, frames: int, pixels: Pixels) -> tuple[float, float, float]:
        """(value, low, high) of cv of σ: l₂ varies by chance, as that of drawn numbers does, and by σ."""
        assert self.distribution is not None
        chance = np.random.default_rng(DRAWS)
        drawn = chance.normal(size=(frames, DRAWS // frames))
        magnitudes = self.distribution.quantile(scipy.special.ndtr(-np.abs(drawn)))
        noise = pixels.sigma * np.copysign(magnitudes, drawn)
        noise += math.sqrt(max(pixels.normal, 0.0)) * chance.normal(size=drawn.shape)
        if pixels.rounded:
            offsets = pixels.offsets * chance.normal(size=drawn.shape[1])
            noise = np.round(noise + pixels.mean + offsets)
        by_chance, unsure = _relative_variance(_sample_l_moments(noise)[0])
        measured, error = _relative_variance(self.scales)
        half = TWO_SIDED * math.hypot(error, unsure * (1 + measured))
        share = pixels.share(self.distribution)

        def cv(relative_variance: float) -> float:
            square = max(relative_variance - by_chance, 0.0) / (1 + by_chance)
            return math.sqrt(square) / share

        return cv(measured), cv(measured - half), cv(measured + half)


def _relative_variance(values: Float64Array) -> tuple[float, float]:
    """Variance over squared mean, with the standard error of it."""
    relative = values / values.mean() - 1
    square = relative**2
    # The mean that it is relative to is measured too.
    slope = square - 2 * square.mean() * relative
    return float(square.mean()), float(slope.std() / math.sqrt(values.size))


def of_one_family(laws: Sequence[NoiseLaw]) -> list[NoiseLaw]:
    """As a ladder of gain settings needs them: where they differ in kind, Tukey's of the same τ₄ in place of others."""
    if len({law.name for law in laws}) < 2:
        return list(laws)
    tukey = FAMILIES[0].name
    return [law if law.name == tukey else _tukey_like(law) for law in laws]


def _tukey_like(other: NoiseLaw) -> NoiseLaw:
    """Tukey's law of the same τ₄ as another one."""
    family, pixels = FAMILIES[0], Pixels(1.0)
    tau4, _ = pixels.ratios(other.distribution)
    shape = _shape(family, pixels, tau4)
    ends = [_shape(family, pixels, tau4 + step) for step in (-other.unsure, other.unsure)]
    figure = replace(NO_SHAPE, value=shape, low=min(ends), high=max(ends))
    return replace(
        other,
        name=family.name,
        shape=figure.noted(f"of the τ₄ of a {other.name} law"),
        distribution=family.distribution(shape),
    )


NO_SHAPE = no_value("λ", "shape of the read noise's law", "", "fit")


class Pixels(NamedTuple):
    """What the noise is mixed with.

    sigma, cv : of the read noise of a pixel, rms [DN], and of σ over the pixels.
    normal : variance of other noise, such as that of lines [DN²].
    rounded : whether the frames are whole numbers.  mean, offsets : of the pixels' means, and their σ [DN].
    """

    sigma: float
    cv: float = 0.0
    normal: float = 0.0
    rounded: bool = False
    mean: float = 0.0
    offsets: float = 0.0

    @property
    def hidden(self) -> bool:
        """Whether rounding hides what one pixel in six has, where rounding is not 1/12 and σ and cv are not so sure."""
        s = math.sqrt(math.log1p(self.cv**2))
        sigma_of_quiet_pixels = self.sigma * math.exp(-(s**2) - s)
        aligned = self.rounded and self.offsets < ALIGNED
        return aligned and self.cv > 0 and sigma_of_quiet_pixels < HIDDEN

    def ratios(self, law: NoiseDistribution | None) -> tuple[float, float]:
        """τ₄ and τ₆ that the frames should have."""
        s = math.sqrt(math.log1p(self.cv**2))
        nodes, shares = np.polynomial.hermite_e.hermegauss(SPREAD if s else 1)
        totals = np.zeros(3)
        for node, share in zip(nodes, shares / shares.sum(), strict=True):
            totals += share * self.l_moments(law, self.sigma * math.exp(s * node - s**2))
        return float(totals[1] / totals[0]), float(totals[2] / totals[0])

    def share(self, law: NoiseDistribution) -> float:
        """By how much l₂ of the frames follows σ, d ln l₂/d ln σ; other noise does not change with it."""
        up = self.l_moments(law, self.sigma * (1 + STEP))[0]
        down = self.l_moments(law, self.sigma * (1 - STEP))[0]
        return math.log(up / down) / math.log((1 + STEP) / (1 - STEP))

    def l_moments(self, law: NoiseDistribution | None, sigma: float) -> Float64Array:
        """l₂, l₄ and l₆ of σ·(noise of this law) and what is added to it."""
        z = np.linspace(0.0, 6.3, 631)[1:]
        if law is None:
            quantiles = z
        else:
            quantiles = law.quantile(scipy.special.ndtr(-z))
        far = sigma * quantiles
        table_x = np.concatenate([-far[::-1], [0.0], far])
        table_z = np.concatenate([-z[::-1], [0.0], z])
        other, units = math.sqrt(max(self.normal, 0.0)), np.zeros(1)
        if other:
            half = min(max(4, math.ceil(6 * other / sigma)), 200)
            units = np.linspace(-4.5, 4.5, 2 * half + 1)
        places, shares = other * units, np.exp(-0.5 * units**2)
        x, steps = self._grid(sigma, far[-1] + places[-1])
        below = np.zeros(x.size)
        for place, share in zip(places, shares / shares.sum(), strict=True):
            below += share * scipy.special.ndtr(np.interp(x - place, table_x, table_z))
        inner = below * (1 - below) * steps
        polyval = np.polynomial.polynomial.polyval
        return np.array([inner @ polyval(below, p) for p in POLYNOMIALS.values()])

    def _grid(self, sigma: float, end: float) -> tuple[Float64Array, Float64Array]:
        """Places and weights of the integral: the edges of the codes, where these show and pixels are not anywhere."""
        width = math.hypot(sigma, math.sqrt(max(self.normal, 0.0)))
        if not (self.rounded and self.offsets < EVEN and width < BLURRED):
            t = np.linspace(-1.0, 1.0, 801) * math.asinh(end / width)
            return width * np.sinh(t), width * np.cosh(t) * (t[1] - t[0])
        nodes, shares = np.polynomial.hermite_e.hermegauss(7 if self.offsets > 0 else 1)
        edges = np.arange(-math.ceil(end) - 1, math.ceil(end) + 2) + 0.5
        away = self.mean + self.offsets * nodes
        x = edges - (away - np.round(away))[:, None]
        return x.ravel(), np.repeat(shares / shares.sum(), edges.size)


@dataclass(frozen=True)
class Ratios:
    """τ₄ and τ₆ of frames, with standard errors from so many degrees of freedom; and l₂ of each pixel [DN]."""

    tau4: float
    tau6: float
    error4: float
    error6: float
    freedom: int
    scales: Float64Array


def ratios_of(stack: Stack) -> Ratios:
    """Ratios of each pixel's values over the frames as they are.

    What lines share is in them, for it is rounded with them.
    """
    height, width = stack.shape
    distance = max(1, math.ceil(len(stack) * height * width / MOST_VALUES))
    rows = np.arange(0, height, distance)
    by_row, by_column, scales = [], np.zeros((3, width)), []
    for block in np.array_split(rows, min(BLOCKS, rows.size)):
        moments = np.array(_sample_l_moments(stack.frames[:, block].astype(np.float64)))
        by_row.append(moments.sum(axis=(1, 2)))
        by_column += moments.sum(axis=1)
        scales.append(moments[0].ravel())
    edges = np.linspace(0, width, min(BLOCKS, width) + 1).astype(int)[:-1]
    row_groups = np.array(by_row).T
    column_groups = np.add.reduceat(by_column, edges, axis=1)
    l2, l4, l6 = (sums.sum() for sums in row_groups)
    return Ratios(
        tau4=float(l4 / l2),
        tau6=float(l6 / l2),
        error4=max(_error_of_ratio(row_groups, 1), _error_of_ratio(column_groups, 1)),
        error6=max(_error_of_ratio(row_groups, 2), _error_of_ratio(column_groups, 2)),
        freedom=min(row_groups.shape[1], column_groups.shape[1]) - 1,
        scales=np.concatenate(scales),
    )


def _error_of_ratio(sums: Float64Array, order: int) -> float:
    """Standard error of the ratio of two sums, from how it differs between groups of rows, or of columns."""
    second, more = sums[0], sums[order]
    rest = more - more.sum() / second.sum() * second
    return math.sqrt(rest @ rest * len(rest) / (len(rest) - 1)) / float(second.sum())


def _sample_l_moments(values: Float64Array) -> list[Float64Array]:
    """Unbiased l₂, l₄ and l₆ along the first axis."""
    ordered, n = np.sort(values, axis=0), len(values)
    rank, weight = np.arange(n, dtype=np.float64), np.ones(n)
    weighted_moments = []
    for k in range(6):
        weighted_moments.append(np.tensordot(weight, ordered, 1) / n)
        if n > k + 1:
            weight = weight * np.maximum(rank - k, 0.0) / (n - 1 - k)
        else:
            weight = weight * 0
    l_moments = []
    for factors in WEIGHTS.values():
        pairs = zip(factors, weighted_moments, strict=False)
        l_moments.append(np.asarray(sum(factor * b for factor, b in pairs)))
    return l_moments


def noise_law(stack: Stack, pixels: Pixels, note: str = "") -> NoiseLaw:
    """The law that the frames of darkness show: normal unless they tell otherwise.  note : why they cannot."""
    if len(stack) < FEWEST_FRAMES:
        note = note or f"{len(stack)} frames; the law of the noise needs {FEWEST_FRAMES}"
    if min(stack.shape) < 2:
        note = note or "a single line of pixels"
    if note:
        return NoiseLaw("normal", NO_SHAPE, f"assumed: {note}", None, np.zeros(0))
    ratios = ratios_of(stack)
    _, low, high = student_interval(ratios.tau4, ratios.error4, ratios.freedom)
    normal, _ = pixels.ratios(None)
    said = f"fit: τ₄ {ratios.tau4:.4f} ({low:.4f} to {high:.4f}) beside {normal:.4f} of a normal law"
    if not abs(ratios.tau4 - normal) > ALARM * ratios.error4:
        return NoiseLaw("normal", NO_SHAPE, said, None, ratios.scales, high - ratios.tau4)
    fits = [_fit_family(family, ratios, pixels, (low, high), said) for family in FAMILIES]
    _, law = min(fits, key=lambda fit: fit[0])
    return law


def _fit_family(
    family: Family, measured: Ratios, pixels: Pixels, ends: tuple[float, float], said: str
) -> tuple[float, NoiseLaw]:
    """The law of a family that has this τ₄, with the distance of its ratios in standard errors."""
    shapes = [_shape(family, pixels, tau4) for tau4 in (measured.tau4, *ends)]
    law = family.distribution(shapes[0])
    tau4, tau6 = pixels.ratios(law)
    distance = math.hypot(
        (tau6 - measured.tau6) / measured.error6, (tau4 - measured.tau4) / measured.error4
    )
    shape = Quantity(
        family.symbol, NO_SHAPE.name, shapes[0], min(shapes), max(shapes), "", "fit"
    )
    if abs(tau4 - measured.tau4) > measured.error4:
        shape = shape.noted("at the end of the range of a camera file")
    unsure = ends[1] - measured.tau4
    return distance, NoiseLaw(family.name, shape, said, law, measured.scales, unsure)


def _shape(family: Family, pixels: Pixels, tau4: float) -> float:
    """Where the family has this τ₄, or the end of its range that is nearer."""

    def off(shape: float) -> float:
        return pixels.ratios(family.distribution(shape))[0] - tau4

    if off(family.heaviest) <= 0:
        return family.heaviest
    if off(family.lightest) >= 0:
        return family.lightest
    return float(scipy.optimize.brentq(off, family.heaviest, family.lightest, xtol=1e-4))
