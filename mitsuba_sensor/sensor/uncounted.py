"""Theory of a chain without its shot noise: every pixel has its mean number of electrons, whole or not."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from ..core import Exposure, Frame, SensorWindow
from ..core.types import Float64Array
from .electron_nodes import KINK
from .given_count import SHARP_DN, GivenCount
from .light_kind import PLAIN, Expected, LightKind
from .pixel_law import COARSE
from .stage import Chain, Stage, place_of
from .theory import Theory

CLOSER = 4
"""Nodes for each of the theory of counted electrons, whose curves are cubic."""

NO_LEVELS: Float64Array = np.zeros(0)


@dataclass(frozen=True, eq=False)
class GivenMean(GivenCount):
    """The stages behind the shot noise that is left out.  means_e : of the electrons that enter them."""

    means_e: Float64Array

    @cached_property
    def counts(self) -> Float64Array:
        """The means themselves, up to the full well."""
        largest = min((s.saturation_e for s in self.stages if s.saturation_e is not None), default=self.means_e[-1])
        return np.append(self.means_e[self.means_e < largest], largest)

    @property
    def dn_per_e(self) -> float:
        """No shot noise blurs the codes."""
        return 0.0


class TheoryOfMeans(Theory):
    """Theory of a physical chain that counts no electrons.

    Where neither noise nor offsets hide the steps of the converter there are straight lines between the nodes; where no
    pixel differs from another, there are nodes at ``levels_e`` [e-].
    """

    levels_e: Float64Array = NO_LEVELS

    @cached_property
    def nodes(self) -> Float64Array:
        """As if the electrons were counted, and about the ends closer, for no shot noise blurs them; where all pixels
        are alike, closer everywhere, and the levels."""
        given = self._like._given
        blur_e = given.spread_dn.max() / max(abs(given.dn_per_e), 1e-300)
        about = [end + KINK * blur_e - dark for end in given.ends_e for dark in (0.0, self._dark_e)]
        nodes: Float64Array = np.unique(np.concatenate([self._like.nodes, *about]))
        nodes = nodes[(nodes >= 0) & (nodes <= self._like.nodes[-1])]
        if self._like._given.spread_dn.any() or not all(map(self._is_certain, self.stages[1 : self._split])):
            return nodes
        closer = (nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(CLOSER) / CLOSER).ravel()
        levels = self.levels_e[np.isfinite(self.levels_e) & (self.levels_e < nodes[-1])]
        return np.unique(np.concatenate([closer, nodes[-1:], levels]))

    def behind(self, stage: Stage, light_e: Float64Array) -> Expected:
        """At these levels of mean photoelectrons."""
        if not self._in_steps:
            return super().behind(stage, light_e)
        levels = np.ravel(np.asarray(light_e, dtype=np.float64)) * self.electrons_per_light
        return Expected(*(np.interp(levels, self.nodes, x) for x in self.table(place_of(stage, self.stages)).T))

    @cached_property
    def _like(self) -> Theory:
        """Of the same chain, if it counted the electrons that enter the well."""
        like = Theory(self.stages, self.conditions, self.kind)
        vars(like).update(_count=self._split, _split=self._split)
        return like

    def _is_certain(self, stage: Stage) -> bool:
        """Whether a stage in front of the well does the same in all pixels."""
        law = stage.pixel_law(self.conditions, COARSE)
        return law is not None and not np.ptp(law.gains) and not np.ptp(law.offsets)

    @cached_property
    def _in_steps(self) -> bool:
        return bool(self._like._given.spread_dn.min() < SHARP_DN)

    @cached_property
    def _count(self) -> int:
        return self._split

    @cached_property
    def _split(self) -> int:
        behind = (s.saturation_e is not None or s.domain in ("volts", "DN") for s in self.stages)
        return list(behind).index(True)

    @cached_property
    def _given(self) -> GivenMean:
        return GivenMean(self.stages[self._split :], self.conditions, self.nodes)

    @cached_property
    def _law(self) -> scipy.sparse.csr_array:
        """Each mean is itself for certain."""
        counts, rows = self._given.counts, np.arange(self.nodes.size)
        column = np.searchsorted(counts, np.minimum(self.nodes, counts[-1]))
        return scipy.sparse.csr_array((np.ones(rows.size), (rows, column)), shape=(rows.size, counts.size))


class TheoryOfBursts(Theory):
    """Theory of a chain that counts the electrons which a photon frees, and not the photons: quantum yield alone."""

    @cached_property
    def _count(self) -> int | None:
        return _place_of_bursts(self.stages)

    @cached_property
    def _of_dark(self) -> Theory:
        """Dark electrons are as many as they are on average."""
        like = TheoryOfMeans(self.stages, self.conditions, PLAIN)
        vars(like).update(nodes=self.nodes, _laws=self._laws)
        return like


def _place_of_bursts(stages: Chain) -> int | None:
    return next((k for k, stage in enumerate(stages) if stage.frees_electrons), None)


def _kind_of_theory(stages: Chain, kind: LightKind) -> type[Theory]:
    """Of counted electrons, of mean electrons, or (chain konnik2014) of photons."""
    if stages[0].domain == "photons" or any(stage.counts_electrons for stage in stages):
        return Theory
    return TheoryOfBursts if kind.yield_mean > 1 and _place_of_bursts(stages) is not None else TheoryOfMeans


def theory_of(stages: Chain, frame: Frame, kind: LightKind = PLAIN, levels_e: Float64Array = NO_LEVELS) -> Theory:
    """For any chain.  levels_e : at which it is to be exact where the codes go up in steps [e-]."""
    theory = _kind_of_theory(stages, kind).of(stages, frame, kind)
    if isinstance(theory, TheoryOfMeans):
        vars(theory)["levels_e"] = levels_e
    return theory


def shared_theory_of(
    stages: Chain, frame: Frame, kind: LightKind = PLAIN, levels_e: Float64Array = NO_LEVELS
) -> Theory:
    """The same, computed once for all frames of a chain and an exposure; nobody may change it."""
    if frame.window.given or _kind_of_theory(stages, kind) is not Theory:
        return theory_of(stages, frame, kind, levels_e)
    return _theory_of_counts(_SameStages(stages), frame.exposure, kind)


class _SameStages:
    """Stages as a key: equal to the very same objects, for a theory finds its stages by identity."""

    def __init__(self, stages: Chain) -> None:
        self.stages, self.identities = stages, tuple(map(id, stages))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SameStages) and self.identities == other.identities

    def __hash__(self) -> int:
        return hash(self.identities)


@lru_cache(maxsize=4)  # a render asks for it, and every frame; the key holds the stages, whose identities stay theirs
def _theory_of_counts(key: _SameStages, exposure: Exposure, kind: LightKind) -> Theory:
    return Theory.of(key.stages, Frame(exposure, SensorWindow(0, (1, 1))), kind)


def theory_without(theory: Theory, out: Collection[Stage]) -> Theory:
    """The theory of the chain without some stages, of which the shot noise may be one."""
    rest = theory.without(out)
    like = _kind_of_theory(rest.stages, rest.kind)
    if like is Theory:
        return rest
    uncounted = like(rest.stages, rest.conditions, rest.kind)
    laws = [(k, law) for k, law in rest._laws if k < uncounted._count]  # type: ignore[operator]
    vars(uncounted).update(nodes=rest.nodes, _laws=laws)
    return uncounted
