"""Pixels over which a plan compares a chain with and without stages: the middle of every law, and its far ends."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame, SensorWindow
from ..core.counter_rng import key_of
from ..core.types import Array, Float64Array, RandomBits
from ..stages.stage import Chain, Stage
from .plan_places import Places
from .sampled_pixels import SampledWindow, sampled_window

MIDDLE = 512
"""Pixels whose random numbers are spread evenly over every law."""

TAIL: Float64Array = 2.0 ** -np.arange(1.0, 32.25, 0.5)
"""Chances of the far ends of a law: up to the last random number that is drawn."""

SHARE: Float64Array = TAIL * (1 - 0.5**0.5) * 2**0.5
"""Share of the pixels from each of these to the one before it: what lies between counts as the farther one."""


ONE_SIGMA = (0.841, 0.159)
"""Quantiles of a normal law, 1σ from its middle."""


class PlanWindow(SampledWindow):
    """Pixels of a plan, one for each row; columns are levels of light, in which a pixel has the same maps."""

    def _random_bits(self, source: str) -> RandomBits:
        """Random bits of these pixels, (H, 1)."""
        if source not in self._bits:
            self._bits[source] = _even_bits(source, self.sample_rows)[:, None]
        return self._bits[source][self.first_row : self.first_row + self.shape[0]]


class PlanSample(NamedTuple):
    """Pixels of a plan at some levels of light.

    frame : exposure, and their window, (P, L).
    light : mean photoelectrons, (P, L); a level comes once for each column of the sensor that is looked at.
    middle : number of pixels whose average is that of the frame; each of those behind is at a far end of one law.
    shares : (P,) share of the frame's pixels that each of them stands for.
    """

    frame: Frame
    light: Electrons
    middle: int
    shares: Float64Array

    @classmethod
    def of(
        cls,
        stages: Chain,
        frame: Frame,
        light_e: Float64Array,
        yields: tuple[float, float],
        extremes: Places,
    ) -> Self:
        """For these levels of light.

        frame : exposure, and the window whose places and measured maps count.
        yields : mean and variance of the electrons that a photon frees.
        extremes : rows and columns that must be among the pixels.
        """
        height, width = frame.window.shape
        sources = _sources(stages, frame)
        given = {name: np.sort(np.ravel(values)) for name, values in frame.window.given.items()}
        ends = 2 * TAIL.size
        count = MIDDLE + ends * (len(sources) + len(given))
        bits = {source: _even_bits(source, count)[:, None] for source in sources}
        shares = np.full(count, 1 / MIDDLE)
        for place, source in enumerate(sources):
            block = slice(MIDDLE + place * ends, MIDDLE + (place + 1) * ends)
            bits[source][block, 0] = _bits_of(np.concatenate([TAIL, 1 - TAIL]))
            shares[block] = np.tile(SHARE, 2)
        maps = {}
        for place, (name, values) in enumerate(given.items(), start=len(sources)):
            block = slice(MIDDLE + place * ends, MIDDLE + (place + 1) * ends)
            quantiles = _even_bits(name, count) / 2.0**32
            quantiles[block] = np.concatenate([TAIL, 1 - TAIL])
            shares[block] = np.tile(SHARE, 2)
            maps[name] = values[
                np.minimum((quantiles * values.size).astype(int), values.size - 1)
            ][:, None]
        rows = _places(height, MIDDLE)
        rows[_places(MIDDLE, extremes.rows.size)] = extremes.rows
        rows = np.concatenate([rows, np.full(count - MIDDLE, height // 2)])
        columns = _places(width, light_e.size)
        if extremes.columns.size:
            columns = np.tile(extremes.columns, light_e.size)
            light_e = np.repeat(light_e, extremes.columns.size)
        places = sampled_window(replace(frame.window, given={}), rows, columns, "sampled")
        window = PlanWindow(
            **{name: getattr(places, name) for name in _FIELDS}, given=maps, _bits=bits
        )
        light: Array = np.broadcast_to(light_e, (count, light_e.size))
        return cls(
            replace(frame, window=window, _blocks={}),
            Electrons(light, yield_mean=yields[0], yield_variance=yields[1]),
            MIDDLE,
            shares,
        )


_FIELDS = (
    "serial",
    "shape",
    "origin",
    "backend",
    "camera",
    "row_numbers",
    "column_numbers",
    "maps",
    "sample_rows",
)


class _Recorder(SampledWindow):
    """A pixel that notes which fixed-pattern noise maps are drawn."""

    def _random_bits(self, source: str) -> RandomBits:
        self._bits[source] = np.zeros((1, 1), np.uint32)
        return np.full(self.shape, 2**31, np.uint32)


def _sources(stages: Iterable[Stage], frame: Frame) -> list[str]:
    """Names of the random fixed-pattern noise maps that a chain draws."""
    given = {
        name: np.full((1, 1), np.median(values)) for name, values in frame.window.given.items()
    }
    window: SensorWindow = _Recorder(
        0,
        (1, 1),
        given=given,
        row_numbers=np.zeros(1, np.int64),
        column_numbers=np.zeros(1, np.int64),
    )
    one_pixel = replace(frame, window=window, _blocks={})
    signal: Array = Electrons(np.ones((1, 1)), 1.0)
    for stage in tuple(stages)[1:]:
        stage.fpn_maps(window)
        signal = stage.sample(signal, one_pixel)
    assert isinstance(window, _Recorder)
    return sorted(window._bits)


def _even_bits(source: str, count: int) -> RandomBits:
    """Random bits: the first MIDDLE evenly spread, in random order, and the rest 1σ from the middle in turns: a pixel
    at the far end of one law is a usual one by all others."""
    random = np.random.default_rng(key_of("plan", source))
    even = (random.permutation(MIDDLE) + 0.5) / MIDDLE
    return _bits_of(np.concatenate([even, np.resize(ONE_SIGMA, count - MIDDLE)]))


def _bits_of(chances: Float64Array) -> RandomBits:
    return np.clip(np.floor(chances * 2.0**32), 0, 2**32 - 1).astype(np.uint32)


def _places(length: int, count: int) -> NDArray[np.int64]:
    """Places along a side of the window, both ends among them."""
    return np.rint(np.linspace(0, length - 1, count)).astype(np.int64)
