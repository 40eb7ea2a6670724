"""The probability distribution of the code of each pixel of a straight chain, in closed form.

A straight chain is a Poisson count, gain and offset of each pixel, normal noise, the rounding of the ADC and both
clips. Sampling the stages without temporal noise, and with 1σ of each source alone, gives gain, offset and noise of
every pixel. A smooth response curve enters by its slope and curvature at the mean. Other chains raise NotStraight.

If the full well lies between two codes and noise is below about 0.5 DN, derivatives of the mean near the full well err
by up to 1.2 % of the code of the full well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, NoReturn

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core import Array, Electrons, Frame
from ..core.code_law import code_moments, log_chance_of_code, rounded_poisson
from ..core.noise_distributions import NoiseDistribution
from ..core.types import Float64Array
from .stage import Chain, ElectronCounter, converter_of, sample

HIGHEST_E = 1e30
"""Limit of the mean electrons of a pixel."""

FEW_E = 64.0
"""Below this mean, counts are summed one by one [e-]."""

CLIP_SIGMAS = 3.5
"""A clip further away changes the mean by less than 1e-4 of the noise."""

REACH_SIGMAS = 6.5
"""Sums omit counts further away."""

FEW_REACH_E = 8.0
"""Sums of few electrons reach this much further [e-]."""

LOUD_DN = 0.6
"""From this normal noise, rounding adds 1/12 DN² wherever the mean is, within 3e-4 DN."""

ELECTRON_SHOWS = 0.1
"""A smaller step per electron, relative to the noise after the count, does not show at a clip."""

NODES: Float64Array = np.linspace(-REACH_SIGMAS, REACH_SIGMAS, 53)
"""Nodes of a normal count of many electrons [σ]."""

NODE_WEIGHTS: Float64Array = np.exp(-0.5 * NODES**2) / np.exp(-0.5 * NODES**2).sum()
NODE_SIGMA = 0.15
"""Width of a node [σ], so that nodes of a quiet pixel do not fall on single codes."""

CURVE_STEP, CURVE_CHECK = 2.0, 3.5
"""Distances from the mean at which a curve is sampled, and at which it must still be a parabola [σ]."""

CURVED = 0.05
"""Largest distance of a curve from that parabola, relative to the noise; the variance then errs by 2 % at most."""

TAIL, TAIL_RANGE = 1e-4, 1 / 16
"""Probability that a code is an outlier, and the mean distance of outliers relative to the code range: a wrong pixel
cannot outweigh all others, but still has a gradient."""


class NotStraight(Exception):
    """Why a chain has no closed form."""


@dataclass(frozen=True, eq=False)
class QuietFrame(Frame):
    """A frame without temporal noise, except for ``level`` σ of the source ``only``.

    sources : collects the sources that stages draw from.
    """

    only: str = ""
    level: float = 0.0
    sources: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, frame: Frame, only: str = "", level: float = 0.0) -> QuietFrame:
        """Return such a frame of the same window."""
        return cls(
            frame.exposure, frame.window, frame.seed, frame.index, frame.gain, {}, frame.charge, only, level
        )  # fmt: skip

    def _constant(self, source: str) -> Array:
        self.sources.add(source)
        return np.full((1, 1), self.level if source == self.only else 0.0)

    def normal(self, source: str) -> Array:
        return self._constant(source)

    def distributed(self, source: str, distribution: NoiseDistribution | None) -> Array:
        return self._constant(source)

    def frame_normal(self, source: str) -> Array:
        return self._constant(source)

    def row_normal(self, source: str, rows: ArrayLike | None = None) -> Array:
        return self._constant(source) if rows is None else super().row_normal(source, rows)

    def column_normal(self, source: str, columns: ArrayLike | None = None) -> Array:
        if columns is None:
            return self._constant(source)
        return super().column_normal(source, columns)

    def random_bits(self, source: str) -> NoReturn:
        raise NotStraight(f"the noise {source!r} is not normal")

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: Array
    ) -> NoReturn:
        raise NotStraight(f"the noise {source!r} is not normal")


class MuteFrame(QuietFrame):
    """A frame for the stages around the count, which must not draw."""

    def _constant(self, source: str) -> NoReturn:
        raise NotStraight(f"the noise {source!r} acts on electrons")


class StraightChain(NamedTuple):
    """The parts of a straight chain.

    before : from the mean photoelectrons to the mean count.  counted : whether there is shot noise.
    well, well_e : the full well, infinite without one.  after : from the count to the converter.
    """

    before: Chain
    counted: bool
    well: Chain
    well_e: float
    after: Chain

    @classmethod
    def of(cls, stages: Chain) -> StraightChain:
        """Divide a chain. Raises NotStraight."""
        for stage in stages:
            if stage.reach_px:
                raise NotStraight(f"{stage.label} couples neighbouring pixels")
        if stages[0].domain == "photons" or converter_of(stages).inl_lsb is not None:
            raise NotStraight("the steps of its converter are unequal")
        volts = next((k for k, stage in enumerate(stages) if stage.domain == "volts"), None)
        if volts is None:
            raise NotStraight("several readouts are combined")
        electrons, well_e = list(stages[1:volts]), np.inf
        well: Chain = ()
        if electrons and (saturation_e := electrons[-1].saturation_e) is not None:
            well, well_e = (electrons.pop(),), saturation_e
        counted = any(isinstance(stage, ElectronCounter) for stage in electrons)
        last = electrons[-1] if electrons else stages[0]
        is_poisson = isinstance(last, ElectronCounter) and last.is_poisson
        if counted and not is_poisson:
            raise NotStraight(f"{last.label} changes the count of electrons")
        before = tuple(electrons[:-1]) if counted else tuple(electrons)
        return cls(before, counted, well, well_e, stages[volts:])


class PixelLine(NamedTuple):
    """The distribution of some pixels, (P,) each.

    rate_e : mean count.  variance_e2 : of the count, 0 without shot noise.  well_e : full well.
    signal_dn, slope, bend : x(n) = signal + slope·(n − centre) + bend·(n − centre)², before rounding, about centre_e.
    sigma_dn : of the normal noise after the count.  highest : the largest code.
    """

    rate_e: Float64Array
    variance_e2: Float64Array
    counted: bool
    well_e: float
    centre_e: Float64Array
    signal_dn: Float64Array
    slope: Float64Array
    bend: Float64Array
    sigma_dn: Float64Array
    highest: int

    def pixels(self, chosen: Array) -> PixelLine:
        """Return some of the pixels."""
        fields: dict[str, Any] = self._asdict()
        for name, values in fields.items():
            if isinstance(values, np.ndarray):
                fields[name] = values[chosen]
        return self._replace(**fields)

    def ideal_dn(self, count_e: Float64Array) -> Float64Array:
        """x(n)."""
        off = np.minimum(count_e, self.well_e) - self.centre_e
        return self.signal_dn + off * (self.slope + off * self.bend)

    @property
    def normal(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Mean and σ of x with its shot noise, and its gain at the mean: far below the well, or above it."""
        held = self.rate_e < self.well_e
        variance_e2 = np.where(held, self.variance_e2, 0.0)
        gain = self.slope + 2 * self.bend * (
            np.minimum(self.rate_e, self.well_e) - self.centre_e
        )
        mean = self.ideal_dn(self.rate_e) + self.bend * variance_e2
        variance = self.sigma_dn**2 + variance_e2 * (
            gain**2 + 2 * self.bend * (gain + self.bend * variance_e2)
        )
        return mean, np.sqrt(np.maximum(variance, 0.0)), gain

    @property
    def is_few(self) -> Array:
        """Mask of pixels whose counts are summed one by one."""
        return (self.rate_e < FEW_E) & (self.variance_e2 <= 2 * self.rate_e)

    @property
    def is_near_well(self) -> Array:
        """Mask of pixels in which some counts fill the well and others do not."""
        if not self.counted or np.isinf(self.well_e):
            return np.zeros(self.rate_e.shape, bool)
        return (
            np.abs(self.rate_e - self.well_e)
            < CLIP_SIGMAS * np.sqrt(self.variance_e2) + FEW_REACH_E
        )

    def nodes(self) -> Iterator[tuple[Float64Array, Float64Array, Float64Array]]:
        """Yield probability, x and σ of normals that add up to the distribution, one for each count or node."""
        few = self.is_few
        logarithm, root = np.log(np.maximum(self.rate_e, 1e-300)), np.sqrt(self.variance_e2)
        wider = self.slope * np.sqrt(np.maximum(self.variance_e2 - self.rate_e, 0.0))
        own_sigma = np.hypot(self.sigma_dn, np.where(few, wider, 0.0))
        most = float(np.max(self.rate_e[few], initial=-1.0))
        last = (
            int(most + REACH_SIGMAS * np.sqrt(max(most, 0.0)) + FEW_REACH_E)
            if few.any()
            else -1
        )
        kept = np.sqrt(1 - NODE_SIGMA**2)
        many_nodes = NODES.size if not few.all() else 0
        full = np.zeros(self.rate_e.shape)
        for k in range(max(last + 1, many_nodes)):
            chance = np.exp(k * logarithm - self.rate_e - scipy.special.gammaln(k + 1.0))
            count, sigma = np.full(self.rate_e.shape, float(k)), own_sigma
            if not few.all():
                z, weight = (NODES[k], NODE_WEIGHTS[k]) if k < NODES.size else (0.0, 0.0)
                around = self.rate_e + kept * z * root + (z * z - 1) / 6
                below, held, spread = self._held(around, NODE_SIGMA * root)
                full += np.where(few, 0.0, weight * (1 - below))
                chance, count = (
                    np.where(few, chance, weight * below),
                    np.where(few, count, held),
                )
                sigma = np.hypot(sigma, np.where(few, 0.0, spread * self.slope))
            yield chance, self.ideal_dn(count), sigma
        if np.isfinite(self.well_e):
            yield full, self.ideal_dn(self.rate_e + self.well_e), self.sigma_dn

    def _held(
        self, count_e: Float64Array, sigma_e: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the probability that a normal count does not fill the well, and its mean and σ then."""
        u = np.clip((self.well_e - count_e) / np.maximum(sigma_e, 1e-9), -8.0, 8.0)
        below = scipy.special.ndtr(u)
        hazard = np.exp(-0.5 * u * u) / np.sqrt(2 * np.pi) / below
        spread = sigma_e * np.sqrt(np.maximum(1 - hazard * (u + hazard), 0.0))
        return (
            below,
            np.minimum(count_e, self.well_e + 8.0 * sigma_e) - sigma_e * hazard,
            spread,
        )


def line_of(stages: Chain, light: Electrons, frame: Frame) -> PixelLine:
    """Return the distribution of the pixels of a window.  light : mean photoelectrons, (H, W). Raises NotStraight."""
    parts = StraightChain.of(stages)
    if not isinstance(light.yield_mean, float):
        raise NotStraight("a photon frees several electrons")
    shape, converter = frame.window.shape, converter_of(stages)
    wide = light.mapped(lambda values: np.minimum(np.asarray(values, np.float64), HIGHEST_E))
    mean = sample(parts.before, replace(wide, by_readout=None), MuteFrame.of(frame))
    rate_e = np.maximum(np.broadcast_to(np.asarray(mean.total, np.float64), shape), 0.0)
    sample(parts.well, Electrons(rate_e[:1, :1]), MuteFrame.of(frame))  # a clip alone

    def ideal(count_e: Array, quiet: QuietFrame) -> Float64Array:
        swing = sample(parts.after[:-1], Electrons(count_e), quiet)
        return np.asarray(converter.ideal(swing, quiet), np.float64)

    quiet = QuietFrame.of(frame)
    centre = np.minimum(rate_e, parts.well_e)
    root = np.sqrt(np.maximum(centre, 1.0))
    step = CURVE_STEP * root
    here, above, below = (ideal(centre + k * step, quiet) for k in (0.0, 1.0, -1.0))
    slope, bend = (above - below) / (2 * step), (above - 2 * here + below) / (2 * step**2)
    variance, moved = np.zeros(shape), np.zeros(shape)
    for source in sorted(quiet.sources):
        up, down = (ideal(centre, QuietFrame.of(frame, source, level)) for level in (1.0, -1.0))
        variance, moved = variance + (0.5 * (up - down)) ** 2, moved + 0.5 * (up + down) - here
    sigma = np.sqrt(variance)
    noise = np.hypot(slope * root, sigma)
    far = CURVE_CHECK * root
    missed = ideal(centre + far, quiet) - (here + far * (slope + far * bend))
    if max(np.max(np.abs(x) / np.maximum(noise, 0.01)) for x in (missed, moved)) > CURVED:
        raise NotStraight("its response is curved within the noise of a pixel")
    flat = (
        np.ravel(np.broadcast_to(x, shape)) for x in (centre, here + moved, slope, bend, sigma)
    )
    variance_e2 = rate_e if parts.counted else np.zeros(shape)
    known = rate_e.ravel(), variance_e2.ravel(), parts.counted, parts.well_e
    return PixelLine._make((*known, *flat, converter.highest))


def moments(line: PixelLine) -> tuple[Float64Array, Float64Array]:
    """Return mean and variance of the code of every pixel, (P,) each [DN, DN²]."""
    mean, sigma, gain = line.normal
    reach = CLIP_SIGMAS * sigma
    below, above = mean - reach, mean + reach
    inside = (below > -0.5) & (above < line.highest + 0.5)
    at_clip = ~inside & (above > -0.5) & (below < line.highest + 0.5)
    shows = line.counted & (gain > ELECTRON_SHOWS * line.sigma_dn)
    summed = line.is_near_well | (at_clip & shows)
    phased = inside & ~summed & (line.sigma_dn < LOUD_DN) & line.counted
    normal = ~summed & ~phased
    found = np.empty((2, mean.size))
    found[:, normal] = code_moments(mean[normal], sigma[normal], line.highest)
    if phased.any():
        some = np.flatnonzero(phased)
        count_e = np.where(line.rate_e < line.well_e, line.rate_e, 0.0)[some]
        found[:, some] = rounded_poisson(mean[some], line.sigma_dn[some], gain[some], count_e)
    if summed.any():
        found[:, summed] = _summed(line.pixels(summed), mean[summed])
    return found[0], found[1]


def _summed(line: PixelLine, about_dn: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Sum over the nodes of the count.  about_dn : near the mean."""
    about = np.clip(about_dn, 0, line.highest)
    total, first, second = np.zeros((3, about.size))
    for chance, ideal, sigma in line.nodes():
        code, variance = code_moments(ideal, sigma, line.highest)
        off = code - about
        total += chance
        first += chance * off
        second += chance * (off**2 + variance)
    off = first / total
    return about + off, np.maximum(second / total - off**2, 0.0)


def log_chance(
    line: PixelLine, codes: Float64Array, render_e2: Float64Array | float = 0.0
) -> Float64Array:
    """Return the log-probability of a code in every pixel, (P,); finite for every code.

    render_e2 : variance of the mean count, if a render estimated it.
    A fraction TAIL of the codes are outliers, with a Laplace distribution around the expected code.
    """
    line = line._replace(variance_e2=line.variance_e2 + render_e2)
    mean, sigma, gain = line.normal
    found = log_chance_of_code(codes, mean, sigma, line.highest)
    few = line.counted & line.is_few & (gain > ELECTRON_SHOWS * line.sigma_dn)
    some = np.flatnonzero(few | line.is_near_well)
    if some.size:
        total = np.full(some.size, -np.inf)
        for chance, ideal, own in line.pixels(some).nodes():
            term = log_chance_of_code(codes[some], ideal, own, line.highest)
            with np.errstate(divide="ignore"):
                total = np.logaddexp(total, np.log(chance) + term)
        found[some] = total
    range_dn = TAIL_RANGE * (line.highest + 1)
    outlier = np.log(TAIL / (2 * range_dn)) - np.abs(codes - mean) / range_dn
    return np.asarray(np.logaddexp(np.log1p(-TAIL) + found, outlier))
