"""Theory of a frame: mean, temporal and spatial variance behind every stage, from the conditional law of the code.

Chained means and variances hold for normal signals only. Here the electrons are counted: given the count N and the
fixed offsets, the signal is normal about a known mean, so that the law of the code follows from Φ at the transition
levels of the converter. That is averaged over

1. the offsets (DSNU) and column gains, by quantiles,
2. the count, by the law of its mean λ and variance (count_law.py): E[code | λ] and Var[code | λ] at about 1000 λ,
3. what fixes λ before the count (PRNU, dark current and its mixtures, RTS states), by quantiles (pixel_law.py).

What is left is a function of the mean photoelectrons of a pixel. A frame is a look-up; its averages are a look-up at
the occupied levels of light (light_levels.py).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from ..core import Frame, Moments, Photons, SensorWindow
from ..core.types import Float64Array
from .averages import Average, average_over
from .count_law import count_law, count_nodes
from .interpolation import interpolation
from .pixel_law import COARSE, PixelLaw, Quantiles, normal_law
from .stage import Chain, Converter, Stage, converter_of, propagate

OFFSET_STEPS, FARTHEST, BLUR = (0.75, 0.2, 0.06), 5.25, 0.7
"""Quantiles of the fixed offsets lie one of these steps apart, up to the farthest [σ]; at most BLUR of the noise."""

SHARP_DN = 0.5
"""Noise behind the count [DN] below which single electrons and steps of the converter show in the codes: at this one
they move a mean by 0.002 DN."""

PER_DECADE = 48
KINK = np.arange(-10.0, 10.001, 0.25)
"""Nodes about the levels where well or converter are full, in σ of the count."""

NARROW = 0.4
"""Quantiles of a law lie close together where their distance is below so many σ of the count at saturation."""

BEATS = 8
"""Harmonics of the steps of the converter whose beat with the electrons is resolved."""


class Expected(NamedTuple):
    """Mean, temporal and spatial variance of a signal at some levels of light, in the unit of its stage."""

    mean: Float64Array
    temporal: Float64Array
    spatial: Float64Array


class LightKind(NamedTuple):
    """What else the counts of a pixel depend on: electrons per interaction, its variance, and which share of the mean
    photoelectrons is the variance of a render that the shot noise compensates."""

    yield_mean: float = 1.0
    yield_variance: float = 0.0
    compensated: float = 0.0


PLAIN = LightKind()


@dataclass(frozen=True, eq=False)
class Theory:
    """Theory of one chain in one exposure.

    stages : the whole chain, or what a plan left of it.
    conditions : exposure and window (serial 0, one pixel), with measured FPN maps where they are given.
    kind : of the light.
    """

    stages: Chain
    conditions: Frame
    kind: LightKind
    _found: dict[int, Float64Array] = field(default_factory=dict)

    @classmethod
    def of(cls, stages: Chain, frame: Frame, kind: LightKind = PLAIN) -> Theory:
        """For the exposure and the measured maps of this frame."""
        window = SensorWindow(0, (1, 1), given=frame.window.given)
        return cls(tuple(stages), Frame(frame.exposure, window), kind)

    def behind(self, stage: Stage, light_e: Float64Array) -> Expected:
        """At these levels of mean photoelectrons; of chain konnik2014, of photons."""
        number = next(k for k, one in enumerate(self.stages) if one is stage)
        levels = np.atleast_1d(np.asarray(light_e, dtype=np.float64))
        if self._count is None:
            return self._normal(number, levels)
        table = self.table(number)
        found = interpolation(self.nodes, levels) @ table
        found[levels == 0] = table[0]
        return Expected(found[:, 0], np.maximum(found[:, 1], 0.0), np.maximum(found[:, 2], 0.0))

    def digital(self, light_e: Float64Array) -> Expected:
        """Of the digital numbers [DN, DN², DN²]."""
        return self.behind(self.stages[-1], light_e)

    def means(self, light_e: Float64Array) -> dict[int, Float64Array]:
        """Means behind every stage, by its number; straight lines between the nodes."""
        if self._count is None:
            levels, place = np.unique(light_e, return_inverse=True)
            return {k: self._normal(k, levels).mean[place].reshape(light_e.shape) for k in range(len(self.stages))}
        left = np.clip(np.searchsorted(self.nodes, light_e, side="right") - 1, 0, self.nodes.size - 2)
        share = np.minimum((light_e - self.nodes[left]) / (self.nodes[left + 1] - self.nodes[left]), 1.0)
        columns = {k: self.table(k)[:, 0] for k in range(len(self.stages))}
        return {k: mean[left] + share * (mean[left + 1] - mean[left]) for k, mean in columns.items()}

    def without(self, out: Collection[Stage]) -> Theory:
        """The same without some stages; what does not depend on them is not computed again."""
        kept = [stage for stage in self.stages if not any(stage is other for other in out)]
        rest, count = replace(self, stages=tuple(kept), _found={}), self._count
        assert count is not None
        place = {id(stage): k for k, stage in enumerate(kept)}
        shared: dict[str, Any] = {"nodes": self.nodes}
        averages = [(place.get(id(self.stages[k])), average) for k, average in self._laws]
        shared["_laws"] = [(k, average) for k, average in averages if k is not None]
        if all(id(stage) in place for stage in self.stages[count:]):
            names: tuple[str, ...] = ("_counts", "_law", "_codes", "_analogue_tables")
        elif np.array_equal(rest._counts, self._counts) and place.keys() >= {id(s) for s in self._counting}:
            names = ("_law",)
        else:
            names = ()
        vars(rest).update(shared, **{name: getattr(self, name) for name in names})
        return rest

    def is_neutral(self, stage: Stage) -> bool:
        """Whether the stage changes neither its signal nor any moment of it."""
        number = next(k for k, one in enumerate(self.stages) if one is stage)
        count = self._count
        assert count is not None
        if number < count and (law := stage.pixel_law(self.conditions, COARSE)) is not None:
            return bool(np.all(law.gains == 1) and np.all(law.offsets == 0))
        at = self._counts if number >= self._split else self.nodes
        m = stage.moments(replace(self._entering, mean=at))
        same = np.array_equal(np.broadcast_to(m.mean, at.shape), at)
        return same and not np.any(m.temporal) and not np.any(m.spatial)

    def chance_to_fill(self, light_e: Float64Array) -> float:
        """The largest chance that the well is full at these levels."""
        values = np.zeros((self.nodes.size, 1, 3))
        values[:, 0, 0] = self._law[:, [-1]].toarray()[:, 0]
        for _, average in reversed(self._laws):
            values = average.averaged(values)
        return float(np.interp(light_e, self.nodes, values[:, 0, 0]).max())

    def to_dn(self, stage: Stage) -> float:
        """Digital numbers of one unit of the signal behind a stage, by the nominal gains of the stages behind it."""
        number = next(k for k, one in enumerate(self.stages) if one is stage)
        return float(np.prod([one.nominal_gain for one in self.stages[number + 1 :]]))

    def table(self, number: int) -> Float64Array:
        """Mean and variances behind stage ``number`` at the nodes of mean photoelectrons, (nodes, 3)."""
        if number not in self._found:
            last = len(self.stages) - 1
            numbers = [last] if number == last else [k for k in range(last) if k not in self._found]
            self._found.update(self._averaged(numbers))
        return self._found[number]

    def _averaged(self, numbers: Sequence[int]) -> dict[int, Float64Array]:
        """Average over the laws of the stages between the light and the count."""
        found = {number: self._given_electrons(number) for number in numbers}
        for stage, average in reversed(self._laws):
            behind = [number for number in numbers if number >= stage]
            if behind:
                values = average.averaged(np.stack([found[number] for number in behind], axis=1))
                found.update((number, values[:, k]) for k, number in enumerate(behind))
        return found

    def _given_electrons(self, number: int) -> Float64Array:
        """Behind a stage, at the nodes of the mean electrons that enter the count; in front of it the mean itself."""
        count, zero = self._count, np.zeros(self.nodes.size)
        assert count is not None
        if number < count:
            return np.stack([self.nodes, zero, zero], axis=1)
        if number < self._split:
            m = self._counted(self.stages[count : number + 1])
            return np.stack([m.mean, m.temporal, zero], axis=1)
        last = number == len(self.stages) - 1
        return self._codes if last else self._analogue_tables[id(self.stages[number])]

    # -- levels ------------------------------------------------------------------------------------------------------

    @cached_property
    def nodes(self) -> Float64Array:
        """Nodes of mean electrons, of light and dark alike: evenly in their logarithm, and close where the ends are."""
        top = 1e4 * max(self._counts[-1], 1.0)
        parts = [np.array([0.0]), np.geomspace(1e-4, top, int(PER_DECADE * np.log10(top * 1e4)))]
        dark = self._dark_e
        for end in self._ends:
            around = end + KINK * np.sqrt(end + self._read_e**2 + 1)
            parts += [around, around - dark]
        parts.append(self._beats())
        if converter_of(self.stages).inl_lsb is not None:
            parts.append(self._evenly(top))
        found = np.unique(np.concatenate(parts))
        found = found[(found >= 0) & np.isfinite(found)]
        return found[np.diff(found, prepend=-1.0) > 1e-5 * found + 1e-6]

    @cached_property
    def _ends(self) -> list[float]:
        """Counts at which well or converter are full."""
        codes = self._line[0]
        inside = np.flatnonzero(codes >= converter_of(self.stages).highest - 0.5)
        return [self._counts[-1], *([float(self._counts[inside[0]])] if inside.size else [])]

    def _beats(self) -> Float64Array:
        """Nodes that resolve slow beats between electrons and steps of the converter where little noise hides them."""
        codes, sigma = self._line
        if sigma.min() > SHARP_DN or codes.size < 3:
            return np.zeros(0)
        pitch, found = float(codes[1] - codes[0]), []
        for k in range(1, BEATS + 1):
            slow = abs(k * pitch - round(k * pitch))
            if slow > 1e-5 and np.exp(-2 * (np.pi * k * sigma.min()) ** 2) > 1e-3:
                period = 1 / slow
                found.append(np.arange(0, min((period / 4) ** 2, self._counts[-1] * 1.2, 250 * period), period / 8))
        return np.concatenate(found) if found else np.zeros(0)

    def _evenly(self, top: float) -> Float64Array:
        """Nodes a third of the noise apart, for steps of unequal width."""
        read = self._read_e
        steps = np.arange(0, 6 * (np.sqrt(1.2 * self._counts[-1] + read**2) - read))
        return np.minimum((read + steps / 6) ** 2 - read**2, top)

    @cached_property
    def _dark_e(self) -> float:
        """Mean electrons that are there without light."""
        m = Moments(0.0, 0.0, 0.0, self.conditions)
        return float(np.mean(propagate(self.stages[1 : self._count], m).mean))

    # -- given the count ---------------------------------------------------------------------------------------------

    @cached_property
    def _count(self) -> int | None:
        return next((k for k, stage in enumerate(self.stages) if stage.counts_electrons), None)

    @cached_property
    def _split(self) -> int:
        """The first stage behind the count that works on single counts: a full well, or volts."""
        after = enumerate(self.stages)
        count = -1 if self._count is None else self._count
        return next(k for k, s in after if k > count and (s.saturation_e is not None or s.domain in ("volts", "DN")))

    @cached_property
    def _saturation_e(self) -> float:
        return min((s.saturation_e for s in self.stages if s.saturation_e is not None), default=np.inf)

    @cached_property
    def _counts(self) -> Float64Array:
        """Nodes of the count, up to the one that fills well or converter."""
        largest = self._saturation_e
        if not np.isfinite(largest):
            largest, highest = 64.0, converter_of(self.stages).highest
            while largest < 1e12 and self._analogue(np.array([largest]))[0].mean() < highest * 1.5:
                largest *= 2
        coarse = np.linspace(0.0, largest, 65)
        return count_nodes(float(largest), bool(self._analogue(coarse)[1].min() < SHARP_DN))

    def _analogue(self, counts: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Code before rounding, and temporal σ, given the count [DN]."""
        converter, m = converter_of(self.stages), Moments(counts, 0.0, 0.0, self.conditions)
        m = propagate(self.stages[self._split : -1], m)
        sigma = np.sqrt(np.broadcast_to(m.temporal, counts.shape)) * converter.gain_dn_per_v
        return converter.black_level_dn + converter.gain_dn_per_v * m.mean, sigma

    @cached_property
    def _line(self) -> tuple[Float64Array, Float64Array]:
        return self._analogue(self._counts)

    @cached_property
    def _read_e(self) -> float:
        """Noise behind the count, as electrons."""
        codes, sigma = self._line
        slope = max((codes[-1] - codes[0]) / max(self._counts[-1], 1.0), 1e-300)
        return float(min(sigma.max() / slope, self._counts[-1]))

    @property
    def _counting(self) -> Chain:
        """The count and what multiplies electrons."""
        return self.stages[self._count : self._split]

    @property
    def _entering(self) -> Moments:
        """What enters the count, at the nodes."""
        light = np.maximum(self.nodes - self._dark_e, 0.0)
        return Moments(
            self.nodes,
            0.0,
            0.0,
            self.conditions,
            light=Moments(light, 0.0, 0.0, self.conditions),
            yield_mean=self.kind.yield_mean,
            yield_variance=self.kind.yield_variance,
            variance_e2=self.kind.compensated * light if self.kind.compensated else None,
        )

    def _counted(self, stages: Sequence[Stage]) -> Moments:
        """Moments behind the count and what multiplies electrons, at the nodes."""
        m = propagate(stages, self._entering)
        shape = self.nodes.shape
        return replace(m, mean=np.broadcast_to(m.mean, shape), temporal=np.broadcast_to(m.temporal, shape))

    @cached_property
    def _law(self) -> sparse.csr_array:
        """Chance of every count at the nodes of mean electrons."""
        counted = self._counted(self._counting)
        return count_law(counted.mean, counted.temporal, self._counts)

    @cached_property
    def _analogue_tables(self) -> dict[int, Float64Array]:
        """Mean and variances at the nodes of mean electrons behind the stages from the well to the converter."""
        found, m = {}, Moments(self._counts, 0.0, 0.0, self.conditions)
        for number in range(self._split, len(self.stages) - 1):
            m = self.stages[number].moments(m)
            found[id(self.stages[number])] = _mixed(self._law, *_parts(m, self._counts.shape))
        return found

    @cached_property
    def _codes(self) -> Float64Array:
        """The law of the code, given the count and the fixed offset, averaged over both; as the tables above."""
        m = propagate(self.stages[self._split : -1], Moments(self._counts, 0.0, 0.0, self.conditions))
        mean, temporal, spatial = _parts(m, self._counts.shape)
        found, of_step = np.empty((self.nodes.size, 3)), self._offset_steps(temporal, spatial)
        for step in np.unique(of_step):
            rows = np.flatnonzero(of_step == step)
            part = self._law[rows]
            used = slice(int(part.indices.min()), int(part.indices.max()) + 1)
            given = mean[used], np.sqrt(temporal[used]), np.sqrt(spatial[used])
            found[rows] = _over_offsets(converter_of(self.stages), part[:, used], *given, step)
        return found

    def _offset_steps(self, temporal: Float64Array, spatial: Float64Array) -> Float64Array:
        """Distance of the quantiles of the offsets [σ] at every node: less than the noise that blurs the codes."""
        at = np.minimum(np.searchsorted(self._counts, self.nodes), self._counts.size - 1)
        codes, counts = self._line[0][:2], self._counts[:2]
        gain = (counts[-1] - counts[0]) * converter_of(self.stages).gain_dn_per_v
        pitch = (codes[-1] - codes[0]) / gain if gain else 0.0
        blur = np.sqrt(temporal[at] + pitch**2 * np.minimum(self.nodes, self._counts[-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = np.where(spatial[at] > 0, BLUR * blur / np.sqrt(spatial[at]), np.inf)
        return np.array(OFFSET_STEPS)[np.searchsorted(-np.array(OFFSET_STEPS), -wanted).clip(0, len(OFFSET_STEPS) - 1)]

    # -- before the count --------------------------------------------------------------------------------------------

    @cached_property
    def _laws(self) -> list[tuple[int, Average]]:
        """The laws of the stages between the light and the count, with their numbers."""
        assert self._count is not None
        end = min(self._ends)
        gap = NARROW * np.sqrt(end + self._read_e**2 + 1)
        return [(k, average_over(partial(self._pixel_law, k), self.nodes, end, gap)) for k in range(1, self._count)]

    def _pixel_law(self, number: int, quantiles: Quantiles) -> PixelLaw:
        """The law of a stage; of one that has none a normal law with the moments that it states."""
        stage = self.stages[number]
        if (law := stage.pixel_law(self.conditions, quantiles)) is not None:
            return law
        m = stage.moments(Moments(self.nodes, 0.0, 0.0, self.conditions))
        return normal_law(*_parts(m, self.nodes.shape))

    # -- a chain that does not count electrons ------------------------------------------------------------------------

    def _normal(self, number: int, levels: Float64Array) -> Expected:
        """By the moments of the stages alone (chain konnik2014, which is there for comparison)."""
        window = SensorWindow(0, (1, levels.size), given=self.conditions.window.given)
        light = Photons(levels[None, :])
        m = propagate(self.stages[: number + 1], Moments(light, 0.0, 0.0, replace(self.conditions, window=window)))
        return Expected(*(np.asarray(x[0], dtype=np.float64) for x in _parts(m, (1, levels.size))))


def _parts(m: Moments, shape: tuple[int, ...]) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Mean and variances as arrays."""
    return np.broadcast_to(m.mean, shape), np.broadcast_to(m.temporal, shape), np.broadcast_to(m.spatial, shape)


def _mixed(law: sparse.csr_array, mean: Float64Array, temporal: Float64Array, spatial: Float64Array) -> Float64Array:
    """Over the counts: what is fixed is shared by all of them."""
    reference = float(mean[mean.size // 2])
    off = mean - reference
    first, second, shared = (law @ np.stack([off, temporal + off**2, np.sqrt(spatial)], axis=1)).T
    return np.stack([reference + first, np.maximum(second - first**2, 0.0), shared**2], axis=1)


def _over_offsets(
    converter: Converter,
    law: sparse.csr_array,
    mean: Float64Array,
    sigma: Float64Array,
    offset: Float64Array,
    step: float,
) -> Float64Array:
    """Codes of a normal signal, for quantiles of the offsets so many σ apart."""
    z = np.arange(-FARTHEST, FARTHEST + step / 2, step) if offset.any() else np.zeros(1)
    weights = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    swing = mean[:, None] + offset[:, None] * z
    code, variance = converter.code_moments(swing, np.broadcast_to(sigma[:, None], swing.shape))
    first = law @ code
    own = np.maximum(law @ (variance + code**2) - first**2, 0.0)
    average = first @ weights
    return np.stack([average, own @ weights, (first - average[:, None]) ** 2 @ weights], axis=1)
