"""One frame: random numbers of every temporal noise source, keyed by seed, frame number, source and pixel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import distributions
from .backend import Backend
from .counter_rng import STREAMS, random_bits_at
from .errors import require_seed
from .exposure import Exposure
from .sensor_window import SensorWindow


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame ``index`` of ``window`` under ``exposure``; ``seed`` is the seed of all temporal noise."""

    exposure: Exposure
    window: SensorWindow
    seed: int = 1
    index: int = 0
    _blocks: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_seed("seed", self.seed)

    def on(self, backend: Backend) -> Frame:
        """The same frame of the same camera, computed by ``backend``."""
        window = self.window
        other = SensorWindow(window.serial, window.shape, window.origin, window.given, backend)
        return Frame(self.exposure, other, self.seed, self.index)

    def number(self, value: float) -> Any:
        """A parameter of the camera in the precision of the backend."""
        return self.window.number(value)

    def random_bits(self, source: str) -> Any:
        """The random bits of ``source`` in this frame, (H, W)."""
        number, slot = STREAMS[source]
        if number not in self._blocks:
            self._blocks[number] = self.window.backend.random_bits(number, self.window, self.index, self.seed)
        return self._blocks[number][slot]

    def telegraph(self, site: Any, switching: float, duty: float) -> Any:
        """Whether the trap of each ``site`` (above 0) is on in this frame, 1 or 0, (H, W).

        A trap is drawn anew with chance ``switching`` per frame and is then on with chance ``duty``; its state is that
        of the latest such frame, which is looked for backwards, so any frame can be made alone. Traps are few: they are
        followed on the host.
        """
        window = self.window
        state = np.zeros(window.shape)
        rows, columns = window.once("sites", lambda: np.nonzero(window.backend.to_numpy(site, window)))
        index = self.index
        while rows.size:
            switch, on = (
                self._at("rts_switch", rows, columns, index),
                self._at("rts_state", rows, columns, index),
            )
            drawn = (distributions.survival(switch) < switching) | (index == 0)
            state[rows[drawn], columns[drawn]] = distributions.survival(on[drawn]) < duty
            rows, columns, index = rows[~drawn], columns[~drawn], index - 1
        return window.backend.from_numpy(state, window)

    def _at(self, source: str, rows: NDArray[np.intp], columns: NDArray[np.intp], frame: int) -> Any:
        number, slot = STREAMS[source]
        return random_bits_at(number, self.window.rows[rows], self.window.columns[columns], frame, self.seed)[slot]

    def normal(self, source: str) -> Any:
        """Standard normal noise of ``source``, new in every frame, (H, W)."""
        return self.window.backend.normal(self.random_bits(source))

    def poisson(self, source: str, mean: Any) -> Any:
        """Poisson counts of ``source`` about ``mean`` (scalar or (H, W)), (H, W)."""
        return self.window.backend.poisson(self.random_bits(source), mean)

    def bernoulli(self, source: str, chance: Any) -> Any:
        """1 with this ``chance`` (0 … 1, (H, W)), else 0, (H, W)."""
        return self.window.backend.bernoulli(self.random_bits(source), chance)
