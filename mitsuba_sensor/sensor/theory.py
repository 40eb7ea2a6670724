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
from typing import Any

import numpy as np
import scipy

from ..core import Frame, Moments, Photons, SensorWindow
from ..core.types import Float64Array
from .averages import Average, average_over
from .count_law import count_law
from .electron_nodes import electron_nodes
from .given_count import GivenCount, parts_of
from .interpolation import interpolation
from .light_kind import PLAIN, Expected, LightKind, possible
from .pixel_law import COARSE, PixelLaw, Quantiles, normal_law
from .stage import Chain, Stage, place_of, propagate, without

NARROW = 0.4
"""Quantiles of a law lie close together where their distance is below so many σ of the count at saturation."""

CHUNK = 2**16  # levels that are looked up at a time


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
        given = frame.window.given
        window = frame.window.cached("conditions", lambda: SensorWindow(0, (1, 1), given=given))
        return cls(tuple(stages), Frame(frame.exposure, window), kind)

    def behind(self, stage: Stage, light_e: Float64Array) -> Expected:
        """At these levels of mean photoelectrons; of chain konnik2014, of photons."""
        number = place_of(stage, self.stages)
        levels = np.atleast_1d(np.asarray(light_e, dtype=np.float64))
        if self._count is None:
            return self._normal(number, levels)
        table = self.table(number)
        parts = np.array_split(levels.ravel() * self.electrons_per_light, max(levels.size // CHUNK, 1))
        found = np.concatenate([interpolation(self.nodes, part) @ table for part in parts])
        return Expected(*possible(found, stage.limits).T)

    def digital(self, light_e: Float64Array) -> Expected:
        """Of the digital numbers [DN, DN², DN²]."""
        return self.behind(self.stages[-1], light_e)

    def means(self, light_e: Float64Array) -> dict[int, Float64Array]:
        """Means behind every stage, by its number; straight lines between the nodes."""
        if self._count is None:
            levels, place = np.unique(light_e, return_inverse=True)
            return {k: self._normal(k, levels).mean[place].reshape(light_e.shape) for k in range(len(self.stages))}
        electrons = light_e * self.electrons_per_light
        left = np.clip(np.searchsorted(self.nodes, electrons, side="right") - 1, 0, self.nodes.size - 2)
        share = np.minimum((electrons - self.nodes[left]) / (self.nodes[left + 1] - self.nodes[left]), 1.0)
        columns = {k: self.table(k)[:, 0] for k in range(len(self.stages))}
        return {k: mean[left] + share * (mean[left + 1] - mean[left]) for k, mean in columns.items()}

    def without(self, out: Collection[Stage]) -> Theory:
        """The same without some stages; what does not depend on them is not computed again."""
        kept = without(self.stages, out)
        rest, count = replace(self, stages=kept, _found={}), self._count
        assert count is not None
        place = {id(stage): k for k, stage in enumerate(kept)}
        shared: dict[str, Any] = {"nodes": self.nodes}
        averages = [(place.get(id(self.stages[k])), average) for k, average in self._laws]
        shared["_laws"] = [(k, average) for k, average in averages if k is not None]
        if all(id(stage) in place for stage in self.stages[count:]):
            names: tuple[str, ...] = ("_given", "_law", "_codes", "_analogue_tables")
        elif np.array_equal(rest._given.counts, self._given.counts) and place.keys() >= {id(s) for s in self._counting}:
            names = ("_law",)
        else:
            names = ()
        vars(rest).update(shared, **{name: getattr(self, name) for name in names})
        if self._of_dark is not None:
            vars(rest)["_of_dark"] = self._of_dark.without(out)
        return rest

    def is_neutral(self, stage: Stage) -> bool:
        """Whether the stage changes neither its signal nor any moment of it."""
        number = place_of(stage, self.stages)
        count = self._count
        assert count is not None
        if number < count and (law := stage.pixel_law(self.conditions, COARSE)) is not None:
            return bool(np.all(law.gains == 1) and np.all(law.offsets == 0))
        at = self._given.counts if number >= self._split else self.nodes
        m = stage.moments(replace(self._entering, mean=at))
        same = np.array_equal(np.broadcast_to(m.mean, at.shape), at)
        return same and not np.any(m.temporal) and not np.any(m.spatial)

    def chance_to_fill(self, light_e: Float64Array) -> float:
        """The largest chance that the well is full at these levels."""
        of_dark = None if self._of_dark is None else self._of_dark._chances_of_the_last
        values = self._chances_of_the_last
        for _, average in reversed(self._laws):
            values = average.averaged(values, None, of_dark)
            of_dark = None if of_dark is None else average.averaged(of_dark)
        return float(np.interp(light_e * self.electrons_per_light, self.nodes, values[:, 0, 0]).max())

    @property
    def _chances_of_the_last(self) -> Float64Array:
        values = np.zeros((self.nodes.size, 1, 3))
        values[:, 0, 0] = self._law[:, [-1]].toarray()[:, 0]
        return values

    def to_dn(self, stage: Stage) -> float:
        """Digital numbers of one unit of the signal behind a stage, by the nominal gains of the stages behind it."""
        number = place_of(stage, self.stages)
        return float(np.prod([one.nominal_gain for one in self.stages[number + 1 :]]))

    def table(self, number: int) -> Float64Array:
        """Mean and variances behind stage ``number`` at the nodes of mean photoelectrons, (nodes, 3)."""
        if number not in self._found:
            last = len(self.stages) - 1
            self.prepare([last] if number == last else range(last))
        return self._found[number]

    def prepare(self, numbers: Sequence[int]) -> None:
        """Make the tables behind several stages at once."""
        missing = [number for number in numbers if number not in self._found]
        found = self._averaged(missing) if missing else {}
        self._found.update((number, possible(table, self.stages[number].limits)) for number, table in found.items())

    def _averaged(self, numbers: Sequence[int]) -> dict[int, Float64Array]:
        """Average over the laws of the stages between the light and the count."""
        found = {number: self._given_electrons(number) for number in numbers}
        of_dark = (
            {} if self._of_dark is None else {number: self._of_dark._given_electrons(number) for number in numbers}
        )
        for stage, average in reversed(self._laws):
            behind = [number for number in numbers if number >= stage]
            if behind:
                of_codes = stage == self._laws[-1][0] and behind[-1] == len(self.stages) - 1
                modes = self._given.modes(self._law) if of_codes and average.has_states else None
                dark = np.stack([of_dark[number] for number in behind], axis=1) if of_dark else None
                values = average.averaged(np.stack([found[number] for number in behind], axis=1), modes, dark)
                found.update((number, values[:, k]) for k, number in enumerate(behind))
                if dark is not None:
                    values = average.averaged(dark, modes)
                    of_dark.update((number, values[:, k]) for k, number in enumerate(behind))
        return found

    def _given_electrons(self, number: int) -> Float64Array:
        """Behind a stage, at the nodes of the mean electrons that enter the count; in front of it the mean itself."""
        count, zero = self._count, np.zeros(self.nodes.size)
        assert count is not None
        if number < count:
            return np.stack([self._entering.mean, zero, zero], axis=1)
        if number < self._split:
            m = self._counted(self.stages[count : number + 1])
            return np.stack([m.mean, m.temporal, zero], axis=1)
        last = number == len(self.stages) - 1
        return self._codes if last else self._analogue_tables[id(self.stages[number])]

    # -- levels ------------------------------------------------------------------------------------------------------

    @cached_property
    def nodes(self) -> Float64Array:
        """Nodes of mean electrons after the quantum yield, of light and dark alike."""
        return electron_nodes(self._given, self._dark_e)

    @cached_property
    def electrons_per_light(self) -> float:
        """The quantum yield, where a stage of the chain multiplies by it, else 1."""
        one = Moments(1.0, 0.0, 0.0, self.conditions)
        plain, more = (propagate(self.stages[1 : self._split], replace(one, yield_mean=y)) for y in (1.0, 2.0))
        return self.kind.yield_mean if np.any(plain.mean != more.mean) else 1.0

    @cached_property
    def _of_dark(self) -> Theory | None:
        """The same for dark electrons, whose counts vary otherwise: with a quantum yield, or compensated light.

        What light and dark give together lies between the two tables, by their shares of the mean electrons.
        """
        if self.kind == PLAIN or self._count is None:
            return None
        like = replace(self, kind=PLAIN, _found={})
        vars(like).update(nodes=self.nodes, _given=self._given, _laws=self._laws)
        return like

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
    def _given(self) -> GivenCount:
        """What stands behind the count."""
        return GivenCount(self.stages[self._split :], self.conditions)

    @property
    def _counting(self) -> Chain:
        """The count and what multiplies electrons."""
        return self.stages[self._count : self._split]

    @property
    def _entering(self) -> Moments:
        """What enters the count, at the nodes: light alone, and after its yield so many electrons as they say."""
        light = self.nodes / self.electrons_per_light
        return Moments(
            light,
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
    def _law(self) -> scipy.sparse.csr_array:
        """Chance of every count at the nodes of mean electrons."""
        m = self._counted(self._counting)
        return count_law(m.mean, m.temporal, self._given.counts)

    @cached_property
    def _analogue_tables(self) -> dict[int, Float64Array]:
        return self._given.analogue_tables(self._law)

    @cached_property
    def _codes(self) -> Float64Array:
        return self._given.code_table(self._law)

    # -- before the count --------------------------------------------------------------------------------------------

    @cached_property
    def _laws(self) -> list[tuple[int, Average]]:
        """The laws of the stages between the light and the count, with their numbers."""
        assert self._count is not None
        end = min(self._given.ends_e)
        gap = NARROW * np.sqrt(end + self._given.read_noise_e**2 + 1)
        return [(k, average_over(partial(self._pixel_law, k), self.nodes, end, gap)) for k in range(1, self._count)]

    def _pixel_law(self, number: int, quantiles: Quantiles) -> PixelLaw:
        """The law of a stage; of one that has none a normal law with the moments that it states."""
        stage = self.stages[number]
        if (law := stage.pixel_law(self.conditions, quantiles)) is not None:
            return law
        m = stage.moments(Moments(self.nodes, 0.0, 0.0, self.conditions))
        return normal_law(*parts_of(m, self.nodes.shape))

    # -- a chain that does not count electrons ------------------------------------------------------------------------

    def _normal(self, number: int, levels: Float64Array) -> Expected:
        """By the moments of the stages alone (chain konnik2014, which is there for comparison)."""
        window = SensorWindow(0, (1, levels.size), given=self.conditions.window.given)
        light = Photons(levels[None, :])
        m = propagate(self.stages[: number + 1], Moments(light, 0.0, 0.0, replace(self.conditions, window=window)))
        return Expected(*(np.asarray(x[0], dtype=np.float64) for x in parts_of(m, (1, levels.size))))
