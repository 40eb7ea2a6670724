"""Random numbers of a frame: temporal noise keyed by seed, camera, exposure, frame number, source and pixel."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from . import distributions
from .backend import Backend
from .counter_rng import CHARGE_SOURCES, key_of, random_bits_at, stream_of
from .errors import require_seed
from .exposure import Exposure
from .noise_distributions import NoiseDistribution
from .sensor_window import SensorWindow
from .types import Array, RandomBits


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame ``index`` of ``window`` under ``exposure``.

    ::

        def sample(self, swing, frame):  # a method of a Stage
            return swing + frame.number(self.sigma_v) * frame.row_normal("hum")

    seed : of all temporal noise.  gain : gain setting of the camera, if any.  charge : name of a later exposure or
        another photodiode; empty for the first.
    """

    exposure: Exposure
    window: SensorWindow
    seed: int = 1
    index: int = 0
    gain: str = ""
    _blocks: dict[tuple[int, int], Array] = field(default_factory=dict)
    charge: str = ""

    def __post_init__(self) -> None:
        seed = require_seed("seed", self.seed)  # a NumPy integer would overflow
        object.__setattr__(self, "seed", seed)

    @cached_property
    def key(self) -> int:
        """Key of the temporal noise; it differs between sensor units, cameras and exposures.

        Only the name of the camera enters, so another number in its datasheet only scales the noise.
        """
        window, exposure = self.window, self.exposure
        conditions = float(exposure.time_s), float(exposure.temperature_k)
        charge = (self.charge,) if self.charge else ()
        sensor = "temporal", self.seed, window.camera, window.serial, self.gain
        return key_of(*sensor, *conditions, *charge)

    @cached_property
    def _readout_key(self) -> int:
        """Key of the noise after the charge, separate for every readout."""
        return key_of("readout", self.window.readout, self.key)

    def key_of_source(self, source: str) -> int:
        """Return the key of the temporal noise of a source; readouts of the same charge share their electrons."""
        if self.window.readout and source not in CHARGE_SOURCES:
            return self._readout_key
        return self.key

    def on(self, backend: Backend) -> Self:
        """Return the same frame computed by ``backend``."""
        return replace(self, window=replace(self.window, backend=backend, _maps={}), _blocks={})

    def number(self, value: float) -> Array:
        """Return a camera parameter in the precision of the backend."""
        return self.window.number(value)

    def neighbour(self, signal: Array, rows: int, columns: int) -> Array:
        """Return the signal of the pixels this many rows below and columns to the right, shape (H, W).

        The edge pixels of the window are repeated. A stage that calls this declares its ``reach_px``.
        """
        return self.window.backend.neighbour(signal, self.window, rows, columns)

    def random_bits(self, source: str) -> Array:
        """Return the random bits of ``source`` in this frame, shape (H, W)."""
        block, slot = stream_of(source)
        key = self.key_of_source(source)
        if (block, key) not in self._blocks:
            self._blocks[block, key] = self.window.backend.random_bits(
                block, self.window, self.index, key
            )
        return self._blocks[block, key][slot]

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: Array
    ) -> RandomBits:
        """Return the random bits of ``source`` in frame ``frame_index`` at some pixels, on NumPy.

        rows, columns : coordinates on the sensor (not in the window); they broadcast with the frames.
        """
        (block, slot), key = stream_of(source), self.key_of_source(source)
        y, x, index = map(np.asarray, (rows, columns, frame_index))
        return random_bits_at(block, y, x, index, key)[slot]

    def row_normal(self, source: str, rows: ArrayLike | None = None) -> Array:
        """Return one standard normal per row of the window, new in every frame, shape (H, 1).

        rows : row numbers on the sensor, which may be negative. The result then is a NumPy float64 array of their
            shape; filter it to give it a spectrum, then call ``window.backend.from_numpy(line[:, None], window)``.

        The value depends on frame, source and row number, so a crop of the frame has the same rows. It is independent
        of pixels and columns of a source with the same name.
        """
        window = self.window
        if rows is not None:
            return distributions.normal(
                self.random_bits_at(f"{source} (rows)", rows, [0], self.index)
            )
        return window.backend.from_numpy(self.row_normal(source, window.rows)[:, None], window)

    def column_normal(self, source: str, columns: ArrayLike | None = None) -> Array:
        """Return one standard normal per column of the window, new in every frame, shape (1, W).

        columns : column numbers on the sensor, like ``rows`` of :meth:`row_normal`.
        """
        window = self.window
        if columns is not None:
            return distributions.normal(
                self.random_bits_at(f"{source} (columns)", [0], columns, self.index)
            )
        return window.backend.from_numpy(
            self.column_normal(source, window.columns)[None, :], window
        )

    def frame_normal(self, source: str) -> Array:
        """Return one standard normal for all pixels, new in every frame and equal in a crop, shape (1, 1)."""
        window = self.window
        z = distributions.normal(self.random_bits_at(f"{source} (frame)", [0], [0], self.index))
        return window.backend.from_numpy(z.reshape(1, 1), window)

    def normal(self, source: str) -> Array:
        """Return standard normal noise of ``source``, new in every frame, shape (H, W)."""
        return self.window.backend.normal(self.random_bits(source))

    def distributed(self, source: str, distribution: NoiseDistribution | None) -> Array:
        """Return noise of ``source`` with mean 0, variance 1 and this distribution (None: normal), shape (H, W)."""
        if distribution is None:
            return self.normal(source)
        return self.window.backend.distributed(self.random_bits(source), distribution)

    def poisson(self, source: str, mean: Array) -> Array:
        """Return Poisson counts of ``source`` with this ``mean`` (scalar or (H, W)), shape (H, W)."""
        return self.window.backend.poisson(self.random_bits(source), mean)

    def gamma_of_shape(self, source: str, shape: Array) -> Array:
        """Return gamma numbers of ``source`` with mean and variance ``shape``, shape (H, W)."""
        return self.window.backend.gamma_of_shape(self.random_bits(source), shape)

    def split(
        self, source: str, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """Split Poisson counts of mean light + dark into two independent counts of these means, shape (H, W)."""
        return self.window.backend.split(self.random_bits(source), count, light, dark)

    def bernoulli(self, source: str, probability: Array) -> Array:
        """Return 1 with this ``probability`` (0 to 1, shape (H, W)), else 0; shape (H, W)."""
        return self.window.backend.bernoulli(self.random_bits(source), probability)
