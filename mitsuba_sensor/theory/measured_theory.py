"""Theory of chains with a stage whose law nobody has written: averages over samples of the chain itself.

Windows of neighbouring pixels at their real places are sampled, each with a serial number of its own, by two frames.
The two differ by temporal noise alone; the product of their distances from the mean has that of spatial noise.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import SensorWindow
from ..core.counter_rng import key_of
from ..core.types import Array, Float64Array
from ..sensor.threads import for_each
from ..stages.propagate import FIRST_SERIAL, FRAMES
from ..stages.stage import total, without, without_law
from .frame_theory import FrameTheory
from .pixel_moments import HIGHEST_E
from .pixel_swing import Codes
from .sampled_pixels import values_at
from .tiles import Tile, tiles_of

SIDE_PX, SAMPLES, MOST_WINDOWS = 64, 2**18, 256
"""Side of a window at most, pixels of all windows together, and how many windows there are at most."""


class MeasuredTheory(FrameTheory):
    """Theory of one light on one chain, by samples; what a pixel in so much light is without the stages that have no
    law is known, and only what they and the fixed patterns change is averaged."""

    @property
    def origin(self) -> dict[str, Any]:
        """How the averages were found, ready for JSON."""
        return {
            "measured": True,
            "stages_without_law": [stage.label for stage in without_law(self.stages)],
            "samples": self._sampled_light.size,
            "serial_numbers": len(self._tiles),
            "frames_of_each": len(FRAMES),
        }

    @property
    def note(self) -> str:
        """How the averages were found, for people; empty where they follow from the law of a pixel."""
        measured = self.origin
        named = ", ".join(measured["stages_without_law"])
        return (
            f"temporal and spatial are measured by {measured['samples']} pixels of {measured['serial_numbers']} serial "
            f"numbers in {measured['frames_of_each']} frames each, not derived: no law of a single pixel is "
            f"known behind {named}"
        )

    @cached_property
    def _tiles(self) -> list[Tile]:
        """Parts of the window: all of them equally often, or some at random where there are too many."""
        tiles = tiles_of(self.frame.window.shape, (SIDE_PX, SIDE_PX))
        pixels = math.prod(self.frame.window.shape) / len(tiles)
        count = min(max(int(SAMPLES / pixels), 2), MOST_WINDOWS)
        if count < len(tiles):
            random = np.random.default_rng(key_of("measured windows"))
            chosen = random.choice(len(tiles), count, replace=False)
            return [tiles[number] for number in sorted(chosen)]
        return tiles * max(count // len(tiles), 2)

    @cached_property
    def _lawful(self) -> FrameTheory:
        """Theory of the chain without the stages that have no law."""
        stages = without(self.stages, without_law(self.stages))
        return FrameTheory(stages, self.light, self.frame)

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        before = sum(stage.has_law for stage in self.stages[: number + 1])
        return self._lawful._plain(before - 1, light_e)

    def _squares(
        self, residual: Float64Array, temporal: Float64Array, unbiased: float
    ) -> Float64Array:
        return (residual**2 - temporal / len(FRAMES)) * unbiased

    def _standard_error(self, values: Float64Array) -> float:
        """By the spread of the averages of windows, whose pixels may depend on each other."""
        pixels = [tile.pixels for tile in self._tiles]
        sums = np.add.reduceat(values, np.cumsum([0, *pixels[:-1]]))
        means = sums / pixels
        repeats = self._tiles.count(self._tiles[0])
        if repeats == 1:
            return float(means.std(ddof=1) / math.sqrt(means.size))
        variance = means.reshape(repeats, -1).var(axis=0, ddof=1).mean()
        return float(np.sqrt(variance / means.size))

    @cached_property
    def _sampled_light(self) -> Float64Array:
        light_e = self.light.mean_e
        parts = [light_e[tile.rows, tile.columns].ravel() for tile in self._tiles]
        return np.minimum(np.concatenate(parts), HIGHEST_E)

    def _sampled(self, number: int) -> Codes:
        """Mean and variance of the two frames of every sampled pixel behind a stage."""
        first, second = self._frames[:, number]
        return (first + second) / 2, (first - second) ** 2 / 2

    @cached_property
    def _frames(self) -> Float64Array:
        """Two frames of every sampled pixel behind every stage, (2, S, P), in the unit of the stage."""
        found = np.empty((len(FRAMES), len(self.stages), self._sampled_light.size))
        ends = np.cumsum([0, *(tile.pixels for tile in self._tiles)])

        def write(number: int) -> None:
            found[:, :, ends[number] : ends[number + 1]] = self._frames_of_tile(number)

        for_each(write, range(len(self._tiles)))
        return found

    def _frames_of_tile(self, number: int) -> Float64Array:
        """Two frames of one window behind every stage, (2, S, P); the neighbours about it are computed too."""
        tile, shape = self._tiles[number], self.frame.window.shape
        reach_px = (
            sum(stage.reach_px for stage in self.stages),
            sum(stage.reach_along_rows_px for stage in self.stages),
        )
        around = tile.wider(reach_px, shape)
        inside = tile.within(around)
        rows, columns = (np.arange(part.start, part.stop) for part in around)
        window = self._chip(rows, columns, FIRST_SERIAL + number)
        light = self.light.signal.mapped(lambda values: values_at(values, rows, columns))
        found = []
        for index in FRAMES:
            frame = replace(self.frame, window=window, index=index, _blocks={})
            signal: Array = light
            for place, stage in enumerate(self.stages):
                if place:
                    signal = stage.sample(signal, frame)
                values = np.broadcast_to(np.asarray(total(signal), np.float64), window.shape)
                found.append(np.clip(values[inside], -HIGHEST_E, HIGHEST_E).ravel())
        return np.reshape(found, (len(FRAMES), len(self.stages), tile.pixels))

    def _chip(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], serial: int
    ) -> SensorWindow:
        """Neighbouring rows and columns of the window, with the maps of a serial number, and the measured ones."""
        window = self.frame.window
        return SensorWindow(
            serial,
            (rows.size, columns.size),
            (window.origin[0] + int(rows[0]), window.origin[1] + int(columns[0])),
            given=self._given(rows, columns, serial),
            camera=window.camera,
        )

    def _given(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], serial: int
    ) -> dict[str, Float64Array]:
        """Measured maps of these rows and columns: of every serial number the same."""
        given = self.frame.window.given
        return {name: values_at(x, rows, columns) for name, x in given.items()}

    @cached_property
    def _digital(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance of every pixel at its level of light."""
        return self._by_light()
