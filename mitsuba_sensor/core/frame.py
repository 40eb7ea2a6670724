"""Random numbers of one frame: temporal noise, keyed by seed, camera and exposure, frame number, source and pixel."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from . import distributions
from .backend import Backend
from .counter_rng import OF_CHARGE, key_of, random_bits_at, stream_of
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

    seed : of all temporal noise.
    """

    exposure: Exposure
    window: SensorWindow
    seed: int = 1
    index: int = 0
    gain: str = ""  # setting of the camera's gain ladder, where it has one
    _blocks: dict[tuple[int, int], Array] = field(default_factory=dict)
    charge: str = (
        ""  # of a frame with several exposures or photodiodes: another one than the first
    )

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "seed", require_seed("seed", self.seed)
        )  # a NumPy integer would overflow

    @cached_property
    def key(self) -> int:
        """Key of the temporal noise: two chips, cameras or exposures share none under one seed.

        Of the camera only its name counts: with another number in its datasheet the noise is the same, scaled.
        """
        window, exposure = self.window, self.exposure
        conditions = float(exposure.time_s), float(exposure.temperature_k)
        of_chip = "temporal", self.seed, window.camera, window.serial, self.gain
        if self.charge:
            return key_of(*of_chip, *conditions, self.charge)
        return key_of(*of_chip, *conditions)

    @cached_property
    def _readout_key(self) -> int:
        """Key of the noise behind the charge, which every read-out of it has of its own."""
        return key_of("readout", self.window.readout, self.key)

    def key_of_source(self, source: str) -> int:
        """Key of the temporal noise of a source: read-outs of the same charge have the same electrons."""
        if self.window.readout and source not in OF_CHARGE:
            return self._readout_key
        return self.key

    def on(self, backend: Backend) -> Self:
        """The same frame of the same camera, computed by ``backend``."""
        return replace(self, window=replace(self.window, backend=backend, _maps={}), _blocks={})

    def number(self, value: float) -> Array:
        """A parameter of the camera in the precision of the backend."""
        return self.window.number(value)

    def neighbour(self, signal: Array, rows: int, columns: int) -> Array:
        """What the pixels so many rows below and columns to the right have of this signal, (H, W).

        At the edge of the window it is what the last pixel there has. A stage that asks for it has a ``reach_px``.
        """
        return self.window.backend.neighbour(signal, self.window, rows, columns)

    def random_bits(self, source: str) -> Array:
        """The random bits of ``source`` in this frame, (H, W)."""
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
        """The random bits of ``source`` in frame ``frame_index`` at some pixels of the sensor, on NumPy.

        rows, columns : pixel coordinates on the sensor (not in the window); they broadcast with the frames.
        """
        block, slot = stream_of(source)
        key = self.key_of_source(source)
        return random_bits_at(
            block, np.asarray(rows), np.asarray(columns), np.asarray(frame_index), key
        )[slot]

    def row_normal(self, source: str, rows: ArrayLike | None = None) -> Array:
        """One standard normal per row of the window, new in every frame, (H, 1).

        rows : row numbers on the sensor, also negative ones; with them the result is a NumPy float64 array of their
            shape, which a filter can give a spectrum before ``window.backend.from_numpy(line[:, None], window)``.

        The value depends on the frame, the source and the row number, so a crop of the frame has the same rows. It is
        independent of the pixels and columns of a source of the same name.
        """
        window = self.window
        if rows is not None:
            return distributions.normal(
                self.random_bits_at(f"{source} (rows)", rows, [0], self.index)
            )
        return window.backend.from_numpy(self.row_normal(source, window.rows)[:, None], window)

    def column_normal(self, source: str, columns: ArrayLike | None = None) -> Array:
        """One standard normal per column of the window, new in every frame, (1, W).

        columns : column numbers on the sensor, as ``rows`` of :meth:`row_normal`.
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
        """One standard normal for all pixels, new in every frame and the same in a crop of it, (1, 1)."""
        window = self.window
        z = distributions.normal(self.random_bits_at(f"{source} (frame)", [0], [0], self.index))
        return window.backend.from_numpy(z.reshape(1, 1), window)

    def normal(self, source: str) -> Array:
        """Standard normal noise of ``source``, new in every frame, (H, W)."""
        return self.window.backend.normal(self.random_bits(source))

    def distributed(self, source: str, distribution: NoiseDistribution | None) -> Array:
        """Noise of ``source`` of mean 0, variance 1 and this distribution, or normal, new in every frame, (H, W)."""
        if distribution is None:
            return self.normal(source)
        return self.window.backend.distributed(self.random_bits(source), distribution)

    def poisson(self, source: str, mean: Array) -> Array:
        """Poisson counts of ``source`` with this ``mean`` (scalar or (H, W)), (H, W)."""
        return self.window.backend.poisson(self.random_bits(source), mean)

    def gamma_of_shape(self, source: str, shape: Array) -> Array:
        """Gamma numbers of ``source`` of this ``shape``, their mean and their variance, (H, W)."""
        return self.window.backend.gamma_of_shape(self.random_bits(source), shape)

    def split(
        self, source: str, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """A Poisson count of mean light + dark in two, of these means (scalars or (H, W)) and independent, (H, W)."""
        return self.window.backend.split(self.random_bits(source), count, light, dark)

    def bernoulli(self, source: str, probability: Array) -> Array:
        """1 with this ``probability`` (0 … 1, (H, W)), else 0, (H, W)."""
        return self.window.backend.bernoulli(self.random_bits(source), probability)
