"""Theory of a chain without its shot noise: every pixel has its mean number of electrons, whole or not."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ..core.types import Float64Array
from .given_count import GivenCount
from .stage import Stage
from .theory import Theory


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


def theory_without(theory: Theory, out: Collection[Stage]) -> Theory:
    """The theory of the chain without some stages, of which the shot noise may be one."""
    rest = theory.without(out)
    if any(stage.counts_electrons for stage in rest.stages):
        return rest
    ahead = theory.stages[: next(k for k, stage in enumerate(theory.stages) if stage.counts_electrons)]
    place = sum(1 for stage in ahead if not any(stage is other for other in out))
    split = next(k for k, s in enumerate(rest.stages) if s.saturation_e is not None or s.domain in ("volts", "DN"))
    given = GivenMean(rest.stages[split:], rest.conditions, rest.nodes)
    column = np.searchsorted(given.counts, np.minimum(rest.nodes, given.counts[-1]))
    shape = rest.nodes.size, given.counts.size
    law = sparse.csr_array((np.ones(shape[0]), (np.arange(shape[0]), column)), shape=shape)
    vars(rest).update(_count=place, _split=split, _given=given, _law=law)
    return rest
