"""Ways to draw the counts of a frame: the product's own, and those of other simulators, which only the studies know."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...core import arrays
from ...core.backend import Backend
from ...core.llvm import backend_problem
from ...sensor.run import choose_backend

EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR = "exact", "quantile", "Gaussian", "mean only", "NumPy Generator"
SAMPLERS = (EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)
OWN = SAMPLERS[:2]
"""What the product offers: in float64 SciPy's exact quantile, in float32 its own quantile function."""

COMPILERS = {"drjit": "llvm", "cuda": "cuda"}
"""Engine → back end of Dr.Jit."""

LARGEST_MEAN = 9.2e18
"""``Generator.poisson`` refuses means that int64 cannot count: those above 9.22e18."""


@dataclass(frozen=True)
class Setting:
    """One way to make frames. tolerance_dn : of the plan [DN], or None for the whole chain."""

    engine: str
    precision: str
    sampler: str
    tolerance_dn: float | None = None

    @property
    def name(self) -> str:
        """For keys, tables and people."""
        plan = "" if self.tolerance_dn is None else f", plan {self.tolerance_dn:g} DN"
        return f"{self.engine} {self.precision}, {self.sampler}{plan}"

    @property
    def offered(self) -> bool:
        """Whether the product makes frames in this way; the others stand beside it for comparison."""
        return self.sampler in OWN

    @property
    def compiled(self) -> bool:
        """Whether a kernel makes the frames."""
        return self.engine in COMPILERS

    def backend(self) -> Backend:
        """Who does the arithmetic, with the sampler's law in the place of the engine's own."""
        backend = choose_backend(self.engine, self.precision, 0)
        return backend if self.offered else drawing(backend, LAWS[self.sampler])


def problem_of(engine: str) -> str | None:
    """Why this engine is not on this machine, or None where it is."""
    return backend_problem(COMPILERS[engine]) if engine in COMPILERS else None


def drawing(backend: Backend, law: Callable[[Backend, Any, Any], Any]) -> Backend:
    """These lanes with another law of the counts, law(lanes, words, mean): all that is not counted keeps its bits."""
    other = copy.copy(backend)
    other.poisson = partial(law, backend)  # type: ignore[method-assign]
    return other


def gaussian(backend: Backend, words: Any, mean: Any) -> Any:
    """round(λ + √λ·z), not below 0: what many simulators do."""
    return arrays.maximum(arrays.floor(mean + arrays.sqrt(mean) * backend.normal(words) + 0.5), 0.0)


def mean_only(backend: Backend, words: Any, mean: Any) -> Any:
    """λ itself: no draw."""
    return mean


def generator(backend: Backend, words: Any, mean: Any) -> Any:
    """NumPy's ``Generator.poisson``, a third party: exact by rejection, and with a state.

    The first words of a strip are its seed, so a frame can be made again, but a crop is no longer the frame's crop.
    """
    random = np.random.default_rng(words.ravel()[:4])
    return random.poisson(np.minimum(mean, LARGEST_MEAN), words.shape).astype(np.float32)


LAWS: dict[str, Callable[[Backend, Any, Any], Any]] = {
    GAUSSIAN: gaussian,
    MEAN_ONLY: mean_only,
    GENERATOR: generator,
}


def draws_of(backend: Backend, words: Any, mean: float) -> Any:
    """What a line of words (N,) draws from one mean, as float64 on the host, on whichever engine."""
    if backend.on_host:
        counts = backend.poisson(words, np.float32(mean) if backend.precision == "float32" else mean)
    else:
        compiled: Any = backend
        counts = backend.poisson(compiled.uint(words), backend.number(mean)).numpy()
    return np.broadcast_to(np.asarray(counts, dtype=np.float64), words.shape)
