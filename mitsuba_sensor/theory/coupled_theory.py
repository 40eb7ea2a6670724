"""Theory of chains that couple neighbouring pixels, which make a picture of their own of the light of a scene.

Pixels in the same light then have different expected signals: one beside a bright edge, or in the streak of a full
column, is brighter. So the expected signal is that of each pixel by itself. Every tile is sampled with several serial
numbers: what differs between these in one pixel is spatial noise, and their average is what is expected there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ..core.counter_rng import key_of
from ..core.types import Float64Array
from ..sensor.choices import check_law
from ..stages.propagate import FRAMES
from .frame_theory import LightGroups
from .measured_theory import MOST_WINDOWS, SAMPLES, MeasuredTheory
from .sampled_pixels import values_at
from .tiles import Tile, tiles_of

SIDE_PX, FEWEST_REPEATS = 32, 4
"""Side of a tile at most, and serial numbers of each of them at least."""


class CoupledTheory(MeasuredTheory):
    """Theory of one light on a chain that couples neighbours, by samples of each tile with several serial numbers.

    Measured maps, of which there is one set, lie elsewhere on the sensor for each of these: they are moved around it by
    random numbers of rows and columns. Effects that depend on the place of a pixel belong to the picture.
    """

    @cached_property
    def _places(self) -> list[Tile]:
        """Different tiles: all of the window, or some at random where there are too many."""
        shape = self.frame.window.shape
        rows, columns = SIDE_PX, SIDE_PX
        if sum(stage.reach_px for stage in self.stages) > SIDE_PX:
            rows, columns = shape[0], max(SIDE_PX**2 // shape[0], 1)
        tiles = tiles_of(shape, (rows, columns))
        fewest_samples = FEWEST_REPEATS * math.prod(shape) / len(tiles)
        count = min(max(int(SAMPLES / fewest_samples), 2), MOST_WINDOWS // FEWEST_REPEATS)
        if count >= len(tiles):
            return tiles
        random = np.random.default_rng(key_of("measured windows"))
        chosen = random.choice(len(tiles), count, replace=False)
        return [tiles[number] for number in sorted(chosen)]

    @property
    def _repeats(self) -> int:
        """Serial numbers of each tile."""
        places = self._places
        samples = SAMPLES // sum(tile.pixels for tile in places)
        return max(min(samples, MOST_WINDOWS // len(places)), FEWEST_REPEATS)

    @cached_property
    def _tiles(self) -> list[Tile]:
        return self._places * self._repeats

    @cached_property
    def _light_groups(self) -> LightGroups:
        """All pixels in one: what coupling adds to a pixel does not follow from its light."""
        light_e = self._sampled_light
        whole = np.array([float(light_e.size)]), np.array([light_e.mean()])
        return LightGroups(np.zeros(light_e.size, np.intp), *whole)

    def _given(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], serial: int
    ) -> dict[str, Float64Array]:
        """Measured maps, moved around the window by random numbers of rows and columns of this serial number."""
        window = self.frame.window
        down, right = np.random.default_rng(key_of("moved maps", serial)).integers(window.shape)
        height, width = window.shape
        return {
            name: values_at(x, (rows + down) % height, (columns + right) % width)
            for name, x in window.given.items()
        }

    def _squares(
        self, residual: Float64Array, temporal: Float64Array, unbiased: float
    ) -> Float64Array:
        """Squares of the distances from the mean of the same pixel over all its serial numbers."""
        of_pixel = residual.reshape(self._repeats, -1)
        distance = (of_pixel - of_pixel.mean(axis=0)).ravel()
        share = self._repeats / (self._repeats - 1)
        return np.asarray(share * distance**2 - temporal / len(FRAMES))

    def _standard_error(self, values: Float64Array) -> float:
        """By the spread of the averages of the serial numbers of each tile, or of tiles where there are others, too."""
        pixels = [tile.pixels for tile in self._tiles]
        means = np.add.reduceat(values, np.cumsum([0, *pixels[:-1]])) / pixels
        means = means.reshape(self._repeats, -1)
        if sum(tile.pixels for tile in self._places) < math.prod(self.frame.window.shape):
            of_tiles = means.mean(axis=0)
            return float(of_tiles.std(ddof=1) / math.sqrt(of_tiles.size))
        # squares about a mean of so few depend on each other: their spread is smaller by this share if they are normal
        share = (self._repeats - 1) / (self._repeats - 2)
        return float(np.sqrt(share * means.var(axis=0, ddof=1).mean() / means.size))

    def expected_in(self, rows: slice) -> Iterator[tuple[Tile, dict[int, Float64Array]]]:
        """The tiles in these rows, and the average of all samples of each of their pixels behind every stage."""
        ends = np.cumsum([0, *(tile.pixels for tile in self._places)])
        for number, whole in enumerate(self._places):
            tile = whole.of_rows(rows)
            if not tile.pixels:
                continue
            means = self._means_of_pixels[:, ends[number] : ends[number + 1]]
            inside = tile.within(whole)
            of_rows = means.reshape(-1, *whole.shape)[:, inside.rows]
            yield tile, dict(enumerate(of_rows))

    @cached_property
    def _means_of_pixels(self) -> Float64Array:
        """Mean over all samples of every pixel of the tiles behind every stage, (S, P)."""
        frames = self._frames
        by_serial = frames.reshape(*frames.shape[:2], self._repeats, -1)
        return np.asarray(by_serial.mean(axis=(0, 2)))

    def variance_of_expected(self, number: int) -> float:
        """Variance of the average of the samples of a pixel behind a stage, averaged over the pixels."""
        mean, _ = self._sampled(number)
        of_serials = mean.reshape(self._repeats, -1).var(axis=0, ddof=1)
        return float(of_serials.mean()) / self._repeats

    def digital_mean(self) -> NoReturn:
        """Not known for every pixel. Raises InputError."""
        self._refuse("the picture that is expected of all cameras is")

    def digital_variance(self) -> NoReturn:
        """Not known for every pixel. Raises InputError."""
        self._refuse("the variance of each pixel is")

    def _refuse(self, what: str) -> NoReturn:
        check_law(self.stages, what, "average frames of several serial numbers")
        raise AssertionError("a chain that couples neighbours has a stage without law")
