"""Ways to make a frame: engine, precision, plan, and how counts are drawn, also as other simulators do it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import arrays
from ...core.backend import Backend
from ...sensor.run import choose_backend
from ..frames import BACKENDS
from ..statistics import Array
from .poisson_law import law_of, law_of_counts

EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR = "exact", "quantile", "Gaussian", "mean only", "NumPy Generator"
SAMPLERS = (EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)
OWN = SAMPLERS[:2]  # what the package offers: in float64 SciPy's exact quantile, in float32 its own quantile function
LARGEST_MEAN = 9.2e18  # ``Generator.poisson`` refuses means that int64 cannot count: those above 9.22e18
DRAWS = 2**21  # draws of a third party's generator for each mean


@dataclass(frozen=True)
class Setting:
    """One way to make frames. tolerance_dn : of the plan [DN], or None for the whole chain."""

    engine: str
    precision: str
    sampler: str
    tolerance_dn: float | None = None

    @property
    def name(self) -> str:
        """For measurements, tables and people."""
        plan = "" if self.tolerance_dn is None else f", plan {self.tolerance_dn:g} DN"
        return f"{self.engine} {self.precision}, {self.sampler}{plan}"

    @property
    def offered(self) -> bool:
        """Whether the package makes frames in this way; the others stand beside it for comparison."""
        return self.sampler in OWN

    @property
    def compiled(self) -> bool:
        """Whether a kernel makes the frames."""
        return self.engine in BACKENDS

    def backend(self) -> Backend:
        """Who does the arithmetic, with the sampler's law in the place of the engine's own."""
        own = choose_backend(self.engine, self.precision, 0)
        if self.offered:
            return own
        other = copy.copy(own)  # all that is not counted keeps its bits
        other.poisson = partial(LAWS[self.sampler], own)  # type: ignore[method-assign]
        return other


REFERENCE = Setting("numpy", "float64", EXACT)  # what all others are compared with: the whole chain, every law exact


def gaussian(backend: Backend, bits: Any, mean: Any) -> Any:
    """round(λ + √λ·z), not below 0: what many simulators do."""
    return arrays.maximum(arrays.floor(mean + arrays.sqrt(mean) * backend.normal(bits) + 0.5), 0.0)


def mean_only(backend: Backend, bits: Any, mean: Any) -> Any:
    """λ itself: no draw."""
    return mean


def generator(backend: Backend, bits: Any, mean: Any) -> Any:
    """NumPy's ``Generator.poisson``, a third party: exact by rejection, and with a state.

    The first bits of a strip are its seed, so a frame can be made again, but a crop is no longer the frame's crop.
    """
    random = np.random.default_rng(bits.ravel()[:4])
    return random.poisson(np.minimum(mean, LARGEST_MEAN), bits.shape).astype(np.float32)


LAWS: dict[str, Callable[[Backend, Any, Any], Any]] = {
    GAUSSIAN: gaussian,
    MEAN_ONLY: mean_only,
    GENERATOR: generator,
}


def counts_of(backend: Backend, bits: NDArray[np.uint32], mean: float) -> Array:
    """What a line of random bits (N,) draws from one mean, as float64 on the host, on whichever engine."""
    if backend.compiled:
        compiled: Any = backend
        counts = backend.poisson(compiled.uint(bits), backend.number(mean)).numpy()
    else:
        counts = backend.poisson(bits, np.float32(mean) if backend.precision == "float32" else mean)
    return np.broadcast_to(np.asarray(counts, dtype=np.float64), bits.shape)


def drawn_law(setting: Setting, mean: float) -> dict[str, Any]:
    """The law that a sampler draws at a mean [events], rounded to float32: every engine is given the same."""
    held, backend = float(np.float32(mean)), setting.backend()
    if setting.sampler == GENERATOR:
        bits = np.random.default_rng(1).integers(0, 2**32, DRAWS, dtype=np.uint32)
        return asdict(law_of_counts(counts_of(backend, bits, held), held))
    return asdict(law_of(lambda bits: counts_of(backend, bits, held), held))
