"""Signal and code of a pixel given its electron count: a normal law, by the moments of the stages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core import Frame, Moments
from ..core.types import Float64Array
from .count_law import STEPS, count_nodes
from .curve import behind
from .curved_noise import Swing
from .interpolation import interpolation
from .measured_maps import is_measured
from .pixel_law import RARE
from .stage import Chain, Converter, converter_of
from .threads import for_each

OFFSET_STEPS, FARTHEST, BLUR = (0.75, 0.2, 0.06, 0.019, 0.006, 0.0019), 5.25, 0.7
"""Quantiles of the fixed offsets lie one of these steps apart, up to the farthest [σ]; at most BLUR of the noise."""

SHARP_DN = 0.5
"""Noise behind the count [DN] below which single electrons and steps of the converter show in the codes: at this one
they move a mean by 0.002 DN."""

BLURRING = 1 / 16
"""Up to this gain [DN/e-] shot noise blurs the steps of the converter; of a larger one electrons can keep to the same
place between the steps, at 1 or ½ DN/e- all of them."""

AT_ONCE, MOST, GROUPS, LEAST = 2**18, 1e6, 6, 6
"""Codes that are looked at together, at most for one group of means, how many groups there are, and the least number
of distances between the quantiles of the offsets."""

MODES: Float64Array = np.linspace(-4.5, 4.5, 37)
"""Offsets [σ] at which the codes of the states of a pixel are compared."""

MOST_ENDS = 8
"""Times that a curve comes to the end of the converter, or leaves it, at most."""

SURE = 9.0
"""A signal so many σ beyond the last step of the converter has the largest code."""

LARGEST_E = 1e12
"""Without a full well counts are looked at up to where the converter is full, and no further than this."""


@dataclass(frozen=True, eq=False)
class GivenCount:
    """The stages from the first one on that works on whole counts, a full well or volts, to the converter.

    conditions : exposure and measured maps.
    """

    stages: Chain
    conditions: Frame

    @property
    def converter(self) -> Converter:
        """The last stage."""
        return converter_of(self.stages)

    @cached_property
    def counts(self) -> Float64Array:
        """Nodes of the count, up to the one that fills well or converter."""
        largest = min((s.saturation_e for s in self.stages if s.saturation_e is not None), default=np.inf)
        if not np.isfinite(largest):
            largest = 64.0
            while largest < LARGEST_E and self._line(np.array([largest]))[0][0] < self.converter.highest * 1.5:
                largest *= 2
        some = np.linspace(0.0, largest, 65)
        codes, sigma, spread = self._line(some)
        dn_per_e = max(np.abs(np.diff(codes)).max() / max(some[1], 1e-300), 1e-300)
        hidden = sigma.min() >= SHARP_DN or (dn_per_e < BLURRING and spread.min() >= SHARP_DN)  # by noise, or offsets
        full = some[codes >= self.converter.highest * 1.5]
        widest = np.inf if hidden else np.floor(max(sigma.min() / dn_per_e, 1.0))  # noise fills the gaps
        return count_nodes(float(largest), float(widest), full[0] if full.size else np.inf)

    @property
    def codes_before_rounding(self) -> tuple[Float64Array, Float64Array]:
        """Mean and temporal σ at the nodes of the count [DN]."""
        return self._lines[:2]

    @property
    def spread_dn(self) -> Float64Array:
        """σ of noise and fixed offsets together."""
        return self._lines[2]

    @cached_property
    def _lines(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        return self._line(self.counts)

    @property
    def is_sharp(self) -> bool:
        """Whether single electrons may show in the codes."""
        return bool(self.codes_before_rounding[1].min() < SHARP_DN)

    @property
    def dn_per_e(self) -> float:
        """Code of the first electrons [DN/e-]."""
        codes, counts = self.codes_before_rounding[0], self.counts
        return float((codes[1] - codes[0]) / (counts[1] - counts[0])) if counts.size > 1 else 0.0

    @cached_property
    def ends_e(self) -> list[float]:
        """Counts at which well or converter are full, and at which a curve that falls again leaves the end."""
        beyond = self.codes_before_rounding[0] - (self.converter.highest - 0.5)
        after = np.flatnonzero(np.diff(beyond >= 0, prepend=False))[:MOST_ENDS]
        before = np.maximum(after - 1, 0)
        share = np.divide(beyond[after], beyond[after] - beyond[before], out=np.zeros(after.size), where=after > before)
        changes = self.counts[after] - share * (self.counts[after] - self.counts[before])
        return [float(self.counts[-1]), *map(float, changes)]

    @cached_property
    def read_noise_e(self) -> float:
        """Noise behind the count, as electrons."""
        codes, sigma = self.codes_before_rounding
        ends = self.counts[[codes.argmin(), codes.argmax()]]
        slope = max(np.ptp(codes) / max(np.ptp(ends), 1.0), 1e-300)
        return float(min(sigma.max() / slope, self.counts[-1]))

    def analogue_tables(self, law: scipy.sparse.csr_array) -> dict[int, Float64Array]:
        """Mean and variances behind every stage before the converter, by its id, (rows of the law, 3)."""
        found, m = {}, self._entering(self.counts)
        for stage in self.stages[:-1]:
            m = behind(stage, m)
            found[id(stage)] = _mixed(law, *parts_of(m, self.counts.shape))
        return found

    def code_table(self, law: scipy.sparse.csr_array) -> Float64Array:
        """The same of the codes."""
        swing = Swing.behind(self.stages[:-1], self.converter, self.counts, self.conditions)
        found, of_step = np.empty((law.shape[0], 3)), self._offset_steps(law, swing)

        def average(some: NDArray[np.intp]) -> None:
            part = law[some]
            used = slice(int(part.indices.min()), int(part.indices.max()) + 1)
            found[some] = _over_offsets(
                self.converter, part[:, used], swing.of_counts(used), self.counts[used], of_step[some[0]]
            )

        each = (np.flatnonzero(of_step == step) for step in np.unique(of_step))
        for_each(average, (some for rows in each for some in _neighbours(rows)))
        return found

    def modes(self, law: scipy.sparse.csr_array) -> Float64Array | None:
        """(rows of the law, J): how the mean code follows the fixed offsets, at some of them, times √ of their weights.

        None without offsets.
        """
        swing = Swing.behind(self.stages[:-1], self.converter, self.counts, self.conditions)
        moving = swing.parts[2].any()
        if not moving and swing.fixed.size == 1:
            return None
        z = MODES if moving else np.zeros(1)
        weights = np.outer(swing.fixed, np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()).ravel()
        code, _ = _codes(self.converter, swing, self.counts, z)
        found = law @ code
        return np.asarray((found - (found @ weights)[:, None]) * np.sqrt(weights))

    def _entering(self, counts: Float64Array) -> Moments:
        return Moments(counts, 0.0, 0.0, self.conditions)

    def _line(self, counts: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Mean, temporal σ, and σ of temporal and fixed parts together, of some counts in the quietest pixels [DN]."""
        m, gain = (
            reduce(lambda m, stage: behind(stage, m), self.stages[:-1], self._entering(counts)),
            self.converter.gain_dn_per_v,
        )
        mean, temporal, spatial = parts_of(m, counts.shape)
        for number, stage in enumerate(self.stages):
            later = math.prod(one.nominal_gain for one in self.stages[number + 1 : -1])
            if (law := stage.noise_law(self.conditions)) is not None:
                temporal = np.maximum(temporal - later**2 * law.quieter, 0.0)
            if is_measured(stage, self.conditions.window):  # a map may be of few values
                of_map = stage.moments(Moments(0.0, 0.0, 0.0, self.conditions)).spatial
                spatial = np.maximum(spatial - later**2 * of_map, 0.0)
        return self.converter.black_level_dn + gain * mean, gain * np.sqrt(temporal), gain * np.sqrt(temporal + spatial)

    def _offset_steps(self, law: scipy.sparse.csr_array, swing: Swing) -> Float64Array:
        """Distance of the quantiles of the offsets [σ] for every row: less than the noise that blurs the codes."""
        mean, temporal, spatial = (x.reshape(x.shape[0], -1) for x in swing.parts)
        centre = mean[:, mean.shape[1] // 2]
        off = centre - centre[0]
        shares = np.outer(swing.temporal, swing.fixed).ravel()
        temporal, spatial = (x[:, shares > min(RARE, 0.5 * shares.max())] for x in (temporal, spatial))
        largest = spatial.max(1)
        with np.errstate(divide="ignore", invalid="ignore"):  # where a curve is flat there is little of both
            noise = np.where(spatial > 0, temporal / spatial, np.inf).min(1)
        blurring = np.where(largest > 0, np.minimum(noise, 1e12) * largest, 0.0)
        first, second, own, offset = (law @ np.stack([off, off**2, blurring, largest], axis=1)).T
        shot = np.maximum(second - first**2, 0.0) if self.dn_per_e < BLURRING or not self.is_sharp else 0.0
        blur = BLUR * np.sqrt(own + shot)
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = np.where(offset > 0, blur / np.sqrt(offset), np.inf)
        steps = np.array(OFFSET_STEPS)
        return np.asarray(steps[np.searchsorted(-steps, -wanted).clip(0, steps.size - 1)])


def _neighbours(rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Rows of means that lie side by side, in groups: where these have few counts, fine steps are cheap."""
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        yield from np.array_split(run, min(GROUPS, run.size))


def parts_of(m: Moments, shape: tuple[int, ...]) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Mean and variances as arrays."""
    return np.broadcast_to(m.mean, shape), np.broadcast_to(m.temporal, shape), np.broadcast_to(m.spatial, shape)


def _mixed(
    law: scipy.sparse.csr_array, mean: Float64Array, temporal: Float64Array, spatial: Float64Array
) -> Float64Array:
    """Over the counts: what is fixed is shared by all of them."""
    reference = float(mean[mean.size // 2])
    off = mean - reference
    columns = np.stack([off, temporal + spatial + off**2, np.sqrt(spatial)], axis=1)
    first, second, shared = (law @ columns).T
    return np.stack([reference + first, np.maximum(second - first**2 - shared**2, 0.0), shared**2], axis=1)


def _over_offsets(
    converter: Converter, law: scipy.sparse.csr_array, swing: Swing, counts: Float64Array, step: float
) -> Float64Array:
    """Codes of these counts, for quantiles of the offsets so many σ apart."""
    mean, _, spatial = swing.parts
    number = max(2 * FARTHEST / max(step, 2 * FARTHEST * mean.size / MOST), LEAST)
    z = np.linspace(-FARTHEST, FARTHEST, int(np.ceil(number)) + 1) if spatial.any() else np.zeros(1)
    chance = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    if z.size > 1:
        z = z / np.sqrt(chance @ z**2)  # of variance 1, wherever it is cut
    weights = np.outer(swing.fixed, chance).ravel()
    code, square = _codes(converter, swing, counts, z)
    first = law @ code
    own = np.maximum(law @ square - first**2, 0.0)
    average = first @ weights
    return np.stack([average, own @ weights, (first - average[:, None]) ** 2 @ weights], axis=1)


def _codes(
    converter: Converter, swing: Swing, counts: Float64Array, z: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Mean code and mean square of the code of every count, for each kind of pixels at each offset [σ].

    Kinds of pixels whose noise hides single electrons are looked at where the counts are √N/STEPS apart, and kinds that
    are the same in all states in one of them.
    """
    few = np.unique(np.floor(2 * STEPS * np.sqrt(counts)), return_index=True)[1]
    few = np.append(few, counts.size - 1) if few[-1] < counts.size - 1 else few
    loud = _loud(converter, swing) & (few.size >= LEAST) & (2 * few.size < counts.size)
    still = np.all([np.all(x == x[:, :1], axis=(0, 1)) for x in swing.parts[:2]], axis=0) & (swing.temporal.size > 1)
    code, square = np.empty((2, counts.size, loud.size, z.size))
    for kinds, thin, one in ((a & b, a is loud, b is still) for a in (loud, ~loud) for b in (still, ~still)):
        if not kinds.any():
            continue
        part = swing.of_kinds(kinds, slice(1) if one else slice(None))
        mean, squared = _codes_of_all(converter, part.of_counts(few) if thin else part, z)
        if thin:
            between = interpolation(counts[few], counts)
            mean, variance = between @ mean, between @ (squared - mean**2)
            squared = variance + mean**2
        code[:, kinds], square[:, kinds] = (x.reshape(counts.size, -1, z.size) for x in (mean, squared))
    return code.reshape(counts.size, -1), square.reshape(counts.size, -1)


def _loud(converter: Converter, swing: Swing) -> NDArray[np.bool_]:
    """Kinds of pixels in whose codes no steps show: together these move the mean by less than at SHARP_DN."""
    sigma = converter.gain_dn_per_v * np.sqrt(swing.parts[1].min(axis=0))  # (T, S)
    moves = swing.fixed * (swing.temporal @ np.exp(-2 * (np.pi * sigma) ** 2))
    order = np.argsort(moves)
    loud = np.empty(moves.size, bool)
    loud[order] = np.cumsum(moves[order]) <= np.exp(-2 * (np.pi * SHARP_DN) ** 2)
    return loud


def _codes_of_all(converter: Converter, swing: Swing, z: Float64Array) -> tuple[Float64Array, Float64Array]:
    """The same at every count."""
    mean, temporal, spatial = swing.parts
    farthest = mean - SURE * (np.sqrt(temporal) + np.sqrt(spatial))
    full = converter.black_level_dn + converter.gain_dn_per_v * farthest.min(axis=(1, 2)) > converter.last_step_dn
    kinds = swing.fixed.size * z.size
    code, square = np.full((2, mean.shape[0], kinds), [[[converter.highest]], [[converter.highest**2]]], float)
    rows = np.flatnonzero(~full)
    for some in np.array_split(rows, min(rows.size * mean[0].size * z.size // AT_ONCE + 1, rows.size) or 1):
        if not some.size:
            continue
        x = mean[some, ..., None] + np.sqrt(spatial[some])[..., None] * z
        sigma = np.broadcast_to(np.sqrt(temporal[some])[..., None], x.shape)
        first, variance = converter.code_moments(x, sigma)
        for found, values in ((code, first), (square, variance + first**2)):
            over_time = values[:, 0] if swing.temporal.size == 1 else np.einsum("ct...,t->c...", values, swing.temporal)
            found[some] = over_time.reshape(some.size, -1)
    return code, square
