"""Expectation of frames from four samples of each pixel: two frames of each of two sensor units in the same light.

x[s, f] is the signal of a pixel of sensor unit s in frame f. Averages over pixels, unbiased for any stage:

    mean      <x>
    temporal  <(x[s,0] − x[s,1])²>/2
    spatial   <(x[0,0] − x[1,0])·(x[0,1] − x[1,1])>/2       the image cancels, and temporal noise averages out
    frame     <(x − x[0,f])·(x − x[1,f])>                   variance of a frame x, not among the samples

The pixels are windows at their real places in the light, each with two separate serial numbers. The standard errors
are the spread of the windows. Averages and errors may miss an event in fewer than 3 of all sampled values.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, InputError
from ..core.counter_rng import key_of
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.threads import for_each
from ..stages.stage import Chain, Stage, converter_of, place_of, total

SIDE_PX, WINDOWS, WINDOWS_MAX = 64, 16, 24
"""Longest side of a window [px], and the number of windows; small windows are more."""

FIRST_SERIAL = 2**30
"""Serial number of the first sampled sensor unit."""

FIRST_SEED = 2**30
"""Seed of the first sampled frame; each frame has a separate seed, so frames of the same number have other noise."""

FRAME_NUMBERS_MAX = 64
"""Most frame numbers that are sampled."""

LARGEST = 1e30
"""Larger signals are treated as this, so that their fourth powers are finite."""


class Averages(NamedTuple):
    """Mean, temporal and spatial variance of a signal, averaged over the pixels, in the unit of its stage.

    errors : standard errors of these three.
    frame_mean, frame_variance : mean of the same pixels in the frames, and their variance about the expected pixels.
    """

    mean: float
    temporal: float
    spatial: float
    errors: tuple[float, float, float]
    frame_mean: float
    frame_variance: float

    @property
    def sigma(self) -> float:
        """Root of the sum of temporal and spatial variance."""
        return math.sqrt(self.temporal + self.spatial)


class Window(NamedTuple):
    """A sampled part of the frame: its rows and columns, and those of the pixels around it that affect it."""

    rows: slice
    columns: slice
    around: tuple[slice, ...]

    @property
    def inside(self) -> tuple[slice, ...]:
        """Rows and columns of the window, counted from the first pixel around it."""
        rows, columns = (
            slice(own.start - whole.start, own.stop - whole.start)
            for own, whole in zip(self[:2], self.around, strict=True)
        )
        return rows, columns


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expected signal after every stage of a chain, from samples of the chain.

    light, frame : light, exposure, place and measured maps of the whole window.
    count : number of frames, from ``frame`` on, that the averages cover; it matters to stages that use frame numbers.
    of_corners : True samples only the four corners of a large frame.
    """

    stages: Chain
    light: Detected
    frame: Frame
    count: int = 1
    of_corners: bool = False

    def __repr__(self) -> str:
        rows, columns = self.frame.window.shape
        return f"<Expectation: {len(self.stages)} stages, {rows} × {columns} pixels>"

    def averages(self, stage: Stage) -> Averages:
        """Return the averages over the pixels after a stage."""
        number = place_of(stage, self.stages)
        found, errors = self._averages
        mean, temporal, spatial, of_frame, variance = found[number].tolist()
        own = tuple(errors[number, :3].tolist())
        variances = max(temporal, 0.0), max(spatial, 0.0)
        return Averages(mean, *variances, own, of_frame, max(variance, 0.0))

    @property
    def pixels(self) -> int:
        """Number of sampled pixels."""
        return sum(self.pixels_of(number) for number in range(len(self.windows)))

    @cached_property
    def tiles(self) -> list[Window]:
        """The frame in windows of about equal size; windows are whole columns if stages reach far along columns."""
        shape = self.frame.window.shape
        reach_px = sum(stage.reach_px for stage in self.stages)
        rows, columns = SIDE_PX, SIDE_PX
        if reach_px > SIDE_PX:
            rows, columns = shape[0], max(SIDE_PX**2 // shape[0], 1)
        reach = reach_px, sum(stage.reach_along_rows_px for stage in self.stages)
        found = []
        for part in itertools.product(_parts(shape[0], rows), _parts(shape[1], columns)):
            around = tuple(
                slice(max(own.start - more, 0), min(own.stop + more, length))
                for own, more, length in zip(part, reach, shape, strict=True)
            )
            found.append(Window(*part, around))
        return found

    @cached_property
    def repeats(self) -> int:
        """Number of samples of each tile; 1 if there are so many tiles that some are omitted."""
        pixels = math.prod(self.frame.window.shape)
        windows = min(
            max(SIDE_PX**2 * WINDOWS * len(self.tiles) // pixels, WINDOWS), WINDOWS_MAX
        )
        return max(windows // len(self.tiles), 1)

    @cached_property
    def windows(self) -> list[Window]:
        """The sampled windows: all tiles equally often, or a selection evenly from the darkest to the brightest."""
        if self.of_corners:
            ends = [(0, side) for side in self.frame.window.shape]
            return [
                tile
                for tile in self.tiles
                if all(
                    own.start == first or own.stop == last
                    for own, (first, last) in zip(tile[:2], ends, strict=True)
                )
            ]
        if self.repeats > 1 or len(self.tiles) <= WINDOWS:
            return self.tiles * self.repeats
        order = np.argsort(
            [self._mean_e[tile[:2]].mean() for tile in self.tiles], kind="stable"
        )
        chosen = ((np.arange(WINDOWS) + 0.5) * len(order) / WINDOWS).astype(int)
        return [self.tiles[number] for number in sorted(order[chosen])]

    @cached_property
    def _mean_e(self) -> Float64Array:
        """Mean light of every pixel, shape (H, W) [e-], always finite."""
        return np.minimum(self.light.mean_e, LARGEST)

    @cached_property
    def _sensors(self) -> list[int]:
        """Number of the pair of sensor units of each window. Few pairs need few maps of whole columns.

        Two windows of one pair share neither rows nor columns, so no random number is in both.
        """
        used = list[
            set[int]
        ]()  # first rows of the windows of each pair, and −1 − first columns
        found = list[int]()
        for rows, columns, _ in self.windows:
            place = {rows.start, -1 - columns.start}
            pair = next((k for k, taken in enumerate(used) if not place & taken), len(used))
            used += [set()] * (pair == len(used))
            used[pair] = used[pair] | place
            found.append(pair)
        return found

    @cached_property
    def light_e(self) -> Float64Array:
        """Mean light of each window, shape (W,) [e-]."""
        return np.array([self._mean_e[window[:2]].mean() for window in self.windows])

    def pixels_of(self, number: int) -> int:
        """Return the number of pixels of a window."""
        return self._mean_e[self.windows[number][:2]].size

    def frames_of(self, number: int) -> list[list[Frame]]:
        """Return two frames of each of two sensor units, for a window with its surroundings."""
        pairs = self._frame_pairs
        indices = pairs[int(len(pairs) * (number + 0.5) / len(self.windows))]
        first = FIRST_SERIAL + 2 * self._sensors[number]
        return [
            [
                self._frame(number, first + sensor, FIRST_SEED + 2 * number + seed, index)
                for seed, index in enumerate(indices)
            ]
            for sensor in (0, 1)
        ]

    def light_of(self, number: int) -> Array:
        """Return the light of a window with its surroundings, after the first stage."""
        rows, columns = self.windows[number].around
        signal = self.light.signal
        return signal.mapped(lambda values: _part_of(values, rows, columns))

    def errors_of(
        self, values: Float64Array, weights: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Return the weighted average over the windows, and its standard error from their spread.

        values : shape (W, …).  weights : shape (W,). The spread is taken about the mean of the same tile, or about a
        straight line in the light of the windows.
        """
        shape = (-1, *(1,) * (values.ndim - 1))
        each, whole = weights.reshape(shape), max(float(weights.sum()), 1e-300)
        mean = (each * values).sum(axis=0) / whole
        if self.repeats > 1:
            tiles = values.reshape(self.repeats, -1, *values.shape[1:])
            weight = each.reshape(self.repeats, -1, *each.shape[1:])
            fitted = (weight * tiles).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
            off, used = (tiles - fitted).reshape(values.shape), len(self.tiles)
        else:
            slope, middle_e = self._slope(values, weights)
            off, used = values - mean - slope * (self.light_e - middle_e).reshape(shape), 2
        seen = max(int(np.count_nonzero(weights)), used + 1)
        spread = np.sqrt((each**2 * off**2).sum(axis=0) * seen / (seen - used))
        return mean, spread / whole

    def _slope(self, values: Float64Array, weights: Float64Array) -> tuple[Float64Array, float]:
        """Return the slope of values over the light of the windows [1/e-], and the mean light [e-]."""
        middle_e = float(np.average(self.light_e, weights=weights if weights.any() else None))
        off_e = weights * (self.light_e - middle_e)
        square = float(off_e @ (self.light_e - middle_e))
        if not square > 0:
            return np.zeros(values.shape[1:]), middle_e
        return np.tensordot(off_e, values, axes=1) / square, middle_e

    @cached_property
    def _averages(self) -> tuple[Float64Array, Float64Array]:
        """Mean, temporal, spatial variance, frame mean and variance after every stage, shape (S, 5), and their errors.

        If some tiles are omitted, a straight line through the windows carries the averages to the mean light of all
        pixels (the regression estimator of Cochran, Sampling Techniques, ch. 7).
        """
        found = np.empty((len(self.windows), len(self.stages), 5))

        def write(number: int) -> None:
            found[number] = self._statistics_of(number)

        for_each(write, range(len(self.windows)))
        broken = ~np.isfinite(found).all(axis=(0, 2))
        if broken.any():
            name = type(self.stages[int(np.argmax(broken))]).__name__
            raise InputError(
                f"{name} returns NaN in this light; let its sample return numbers."
            )
        weights = np.array([float(self.pixels_of(number)) for number in range(len(found))])
        mean, errors = self.errors_of(found, weights)
        if self.repeats == 1:
            slope, middle_e = self._slope(found, weights)
            mean = mean + slope * (float(self._mean_e.mean()) - middle_e)
        return mean, errors

    def _statistics_of(self, number: int) -> Float64Array:
        """Return the statistics of one window after every stage, shape (S, 5)."""
        light, inside = self.light_of(number), self.windows[number].inside
        frames = self.frames_of(number)
        index = frames[0][number % 2].index - self.frame.index
        own = self._frame(number, self.frame.window.serial, None, index)
        x00, x01, x10, x11, x = (
            self._after_all(light, frame, inside) for frame in (*frames[0], *frames[1], own)
        )
        parts = (
            (x00 + x01 + x10 + x11) / 4,
            ((x00 - x01) ** 2 + (x10 - x11) ** 2) / 4,
            (x00 - x10) * (x01 - x11) / 2,
            x,
            ((x - x00) * (x - x10) + (x - x01) * (x - x11)) / 2,
        )
        return np.stack([part.mean(axis=(1, 2)) for part in parts], axis=1)

    def _after_all(self, light: Array, frame: Frame, inside: tuple[slice, ...]) -> Float64Array:
        """Return the signals of one frame after every stage, shape (S, H, W)."""
        return np.stack(
            [as_values(x, frame)[inside] for x in signals(self.stages, light, frame)]
        )

    @cached_property
    def _frame_pairs(self) -> list[tuple[int, int]]:
        """Pairs of different frames by their number from the first frame, sorted by their distance."""
        apart = np.linspace(0, self.count - 1, min(self.count, FRAME_NUMBERS_MAX))
        numbers = np.unique(apart.astype(int))
        first, second = np.triu_indices(len(numbers), 1)
        if not first.size:
            return [(0, 0)]
        order = np.argsort(second - first, kind="stable")
        return list(
            zip(numbers[first[order]].tolist(), numbers[second[order]].tolist(), strict=True)
        )

    def _frame(self, number: int, serial: int, seed: int | None, index: int) -> Frame:
        """Return a frame of a window and its surroundings.

        serial : sensor unit.  seed : seed of the temporal noise; None for the frame itself.
        index : frame number from the first frame.
        On another sensor unit, measured maps are moved by random numbers of rows and columns, which makes them spatial
        noise like random maps.
        """
        whole, (rows, columns) = self.frame.window, self.windows[number].around
        shape = rows.stop - rows.start, columns.stop - columns.start
        down, along = (0, 0)
        if seed is not None:
            moved = np.random.default_rng(key_of("moved maps", serial)).integers(whole.shape)
            down, along = moved.tolist()
        places = (
            (np.arange(part.start, part.stop) + by) % length
            for part, by, length in zip(
                (rows, columns), (down, along), whole.shape, strict=True
            )
        )
        at = next(places), next(places)
        window = replace(
            whole,
            serial=serial,
            shape=shape,
            origin=(whole.origin[0] + rows.start, whole.origin[1] + columns.start),
            given={name: _part_of(x, *at) for name, x in whole.given.items()},
            _maps={},
            _tiles={},
        )
        return replace(
            self.frame,
            window=window,
            seed=self.frame.seed if seed is None else seed,
            index=self.frame.index + index,
            _blocks={},
        )


def signals(stages: Chain, light: Array, frame: Frame) -> Iterator[Array]:
    """Yield the signal of one frame after every stage.  light : the signal after the first stage."""
    signal = light
    for number, stage in enumerate(stages):
        if number:
            signal = stage.sample(signal, frame)
        yield signal


def passed_on(stage: Stage, signal: Array, frame: Frame) -> Array:
    """Return the signal after a stage that is left out: in the stage's unit, by its small-signal gain."""
    if stage.domain == "volts":
        signal = total(signal)
    if stage.nominal_gain == 1:
        return signal
    gain = frame.number(stage.nominal_gain)
    if isinstance(signal, Electrons):
        return signal.changed(
            lambda n: gain * n, lambda light, dark: (gain * light, gain * dark)
        )
    return gain * signal


def variances_of(x: Float64Array) -> tuple[float, float]:
    """Return temporal and spatial variance of samples of two sensor units in two frames, shape (2, 2, …)."""
    temporal = ((x[:, 0] - x[:, 1]) ** 2).mean() / 2
    spatial = ((x[0, 0] - x[1, 0]) * (x[0, 1] - x[1, 1])).mean() / 2
    return float(temporal), float(spatial)


def ideal_code(stages: Chain, swing: Array, frame: Frame) -> Float64Array:
    """Return the code of a swing before rounding and clipping, shape (H, W) [DN]."""
    return as_values(converter_of(stages).ideal(total(swing), frame), frame)


def is_clipped(stages: Chain, found: Sequence[Array], frame: Frame) -> NDArray[np.bool_]:
    """Return a mask of the pixels that the full well or the ADC clips.  found : the signals after every stage."""
    clipped = np.zeros(frame.window.shape, bool)
    for stage, signal in zip(stages, found, strict=True):
        for name, mask in stage.marked(total(signal), frame).items():
            if name.startswith("clipped"):
                clipped |= np.asarray(mask)
    return clipped


def as_values(signal: Array, frame: Frame) -> Float64Array:
    """Return a signal of any domain as finite float64 values, shape (H, W)."""
    values = np.broadcast_to(np.asarray(total(signal), np.float64), frame.window.shape)
    return np.clip(values, -LARGEST, LARGEST)


def _parts(length: int, longest: int) -> list[slice]:
    """Divide a side of a frame into parts of about equal length."""
    edges = np.linspace(0, length, -(-length // longest) + 1).astype(int).tolist()
    return [slice(*pair) for pair in zip(edges[:-1], edges[1:], strict=True)]


def _part_of(
    values: Array, rows: slice | NDArray[np.int64], columns: slice | NDArray[np.int64]
) -> Array:
    """Return rows and columns of values of shape (H, W), (H, 1), (1, W) or (); None stays None."""
    if values is None or np.ndim(values) == 0:
        return values
    values = np.asarray(values)
    everything = slice(None)
    found = values[rows if values.shape[0] > 1 else everything]
    return found[:, columns if values.shape[1] > 1 else everything]
