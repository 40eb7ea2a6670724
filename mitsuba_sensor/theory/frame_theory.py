"""What the frames of a camera are expected to be: averages of the law of a pixel (pixel_moments.py) over pixels.

The pixels are sampled at their real places, each with the fixed-pattern noise of a serial number of its own
(sampled_pixels.py). What differs from level to level of light is the scene; what differs among pixels in the same light
is spatial noise. The response of a pixel with no fixed-pattern noise is known at every level of light (response.py), so
that only what the fixed patterns add to it is averaged, and a large frame needs no more pixels than a small one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame, Moments, Photons, SensorWindow
from ..core.backend import NUMPY_FLOAT64
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.run import row_strips_of
from ..sensor.threads import for_each
from ..stages.propagate import propagate
from ..stages.stage import Chain, Stage, place_of
from .light_levels import WIDTH, LightLevels, light_levels
from .pixel_moments import HIGHEST_E, STRIP, PixelStrip
from .pixel_swing import Codes
from .response import Response, median_frame
from .sampled_pixels import PIXELS, SampledPixels, sample_pixels
from .tiles import Tile

FOLLOWED = 2**18
"""Pixels of a frame whose signals are followed behind every stage: σ is then known to 0.14 %. Of larger frames these
are strips of rows, evenly spread."""

GROUP, GROUPS = 1024, 64
"""Pixels of about the same light that are averaged together, at least, and how many such groups there are at most."""


PILOT, FEWEST, WORK = 1024, 4096, 2**22
"""Pixels that tell how much work a pixel is, and so many are looked at at least; normals that are added up at most."""

DARK_E = 1e-150
"""Mean photoelectrons below which pixels are of the same light: slopes between them would leave all numbers."""

LARGEST = 1e70
"""Numbers beyond this one are as good as infinite, and their fourth powers are not."""


class Averages(NamedTuple):
    """Mean, temporal and spatial variance of a signal, averaged over the pixels, in the unit of its stage.

    errors : standard errors of the three, by the spread of the sampled pixels.
    """

    mean: float
    temporal: float
    spatial: float
    errors: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def sigma(self) -> float:
        """Root of both variances together."""
        return math.sqrt(self.temporal + self.spatial)


@dataclass(frozen=True, eq=False)
class FrameTheory:
    """Theory of one light on one chain.

    light, frame : of the window, and its exposure, place and measured maps.
    """

    stages: Chain
    light: Detected
    frame: Frame
    _behind: dict[int, Codes] = field(default_factory=dict)

    def __repr__(self) -> str:
        rows, columns = self.frame.window.shape
        return f"<FrameTheory: {len(self.stages)} stages, {rows} × {columns} pixels>"

    def averages(self, stage: Stage) -> Averages:
        """Averages over the pixels behind a stage."""
        number = place_of(stage, self.stages)
        if not self._counts_electrons:
            return self._propagated(number)
        mean, temporal = self._sampled(number)
        levels, plain = self._sampled_light, self._plain_of_sample(number)
        off = np.clip(mean - plain[0], -LARGEST, LARGEST)
        shift = self._light_groups.smooth(off)
        residual = off - shift.at(levels)
        noise = np.clip(temporal - plain[1], -LARGEST, LARGEST)
        noise_shift = self._light_groups.smooth(noise)
        square = self._squares(residual, temporal, shift.unbiased)
        plain_mean, plain_temporal = self._plain_of_levels(number)
        moved = plain_temporal + noise_shift.at(self.levels.light_e)
        spatial = max(float(square.mean()), 0.0)
        missed = spatial * self._missed_share(plain_mean, plain[0])
        mean_error, temporal_error, spatial_error = map(
            self._standard_error,
            (residual, noise - noise_shift.at(levels), square - square.mean()),
        )
        return Averages(
            self._over_light(plain_mean + shift.at(self.levels.light_e)),
            max(self._over_light(moved), 0.0),
            spatial,
            (mean_error, temporal_error, math.hypot(spatial_error, missed)),
        )

    def _missed_share(self, at_levels: Float64Array, sampled: Float64Array) -> float:
        """By which share the mean square of a signal over all pixels differs from that over the sampled ones.

        Where few very bright pixels make most of it, the sample may have none of them; spatial variance, which is
        about proportional to the square, is then wrong by as much, and its spread does not show it.
        """
        over_all = self._over_light(np.clip(at_levels, -LARGEST, LARGEST) ** 2)
        over_sample = float(np.mean(np.clip(sampled, -LARGEST, LARGEST) ** 2))
        if not over_sample > 0:
            return 0.0
        return abs(over_all / over_sample - 1)

    def expected_in(self, rows: slice) -> Iterator[tuple[Tile, dict[int, Float64Array]]]:
        """The pixels in these rows whose signals are followed, and what is expected of them behind every stage."""
        columns = slice(0, self.frame.window.shape[1])
        for strip in self._followed_rows:
            tile = Tile(strip, columns).of_rows(rows)
            if tile.pixels:
                yield tile, self.means(tile.rows)

    def variance_of_expected(self, number: int) -> float:
        """Variance of what is expected of a pixel behind a stage, where it was measured."""
        return 0.0

    @cached_property
    def _followed_rows(self) -> list[slice]:
        shape = self.frame.window.shape
        strips = list(row_strips_of(shape, NUMPY_FLOAT64.strip_pixels))
        number = min(len(strips), max(FOLLOWED * len(strips) // math.prod(shape), 1))
        return [strips[k * len(strips) // number] for k in range(number)]

    def means(self, rows: slice) -> dict[int, Float64Array]:
        """Expected signal behind every stage, by its number, in the pixels of some rows."""
        light_e = self.light.crop_rows(rows).mean_e
        if not self._counts_electrons:
            return {k: self._propagated_to(k, light_e)[0] for k in range(len(self.stages))}
        found = dict[int, Float64Array]()
        self._prepare(range(len(self.stages)))
        for number in range(len(self.stages)):
            off = self._sampled(number)[0] - self._plain_of_sample(number)[0]
            shift = self._light_groups.smooth(off)
            found[number] = self._plain_of_rows(number, rows)[0] + shift.at(light_e)
        return found

    @property
    def origin(self) -> dict[str, Any]:
        """How the averages were found, ready for JSON."""
        return {"measured": False}

    @property
    def note(self) -> str:
        """How the averages were found, for people; empty where they follow from the law of a pixel."""
        return ""

    def digital_mean(self) -> NDArray[np.float32]:
        """Expected digital number of every pixel over frames and serial numbers, (H, W) [DN]."""
        return self._digital[0]

    def digital_variance(self) -> NDArray[np.float32]:
        """Temporal variance of every pixel, averaged over serial numbers, (H, W) [DN²]."""
        return self._digital[1]

    @cached_property
    def sample(self) -> SampledPixels:
        """The pixels that are averaged over."""
        pilot = sample_pixels(self.light.signal, self.frame, PILOT)
        work = PixelStrip(self.stages, pilot.light, pilot.frame).work()
        return sample_pixels(
            self.light.signal, self.frame, int(np.clip(WORK / work, FEWEST, PIXELS))
        )

    @cached_property
    def levels(self) -> LightLevels:
        """Levels of light of all pixels."""
        return light_levels(self.light)

    @cached_property
    def response(self) -> Response:
        """Of a pixel in the middle of the window that has no fixed-pattern noise."""
        darkest, brightest = self.levels.light_e[[0, -1]]
        ends = float(darkest * (1 - WIDTH)), float(brightest * (1 + WIDTH))
        return Response.of(
            self.stages, self.frame, *(ends if brightest > darkest else (darkest, darkest))
        )

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        """Mean and temporal variance behind a stage, of pixels without fixed-pattern noise in so much light."""
        return self.response.mean(number, light_e), self.response.temporal(number, light_e)

    def _plain_of_sample(self, number: int) -> Codes:
        """The same in the light of the sampled pixels, (P,) each."""
        return self._plain(number, self._sampled_light)

    def _plain_of_levels(self, number: int) -> Codes:
        """The same at every level of light."""
        return self._plain(number, self.levels.light_e)

    def _plain_of_rows(self, number: int, rows: slice) -> Codes:
        """The same in the light of some rows, (rows, W) each."""
        return self._plain(number, np.minimum(self.light.crop_rows(rows).mean_e, HIGHEST_E))

    def _by_light(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance of every code in its light, with what fixed-pattern noise adds at about that light."""
        last, found = len(self.stages) - 1, list[NDArray[np.float32]]()
        everywhere = slice(0, self.frame.window.shape[0])
        light_e = np.minimum(self.light.mean_e, HIGHEST_E)
        for sampled, plain, at_light in zip(
            self._sampled(last),
            self._plain_of_sample(last),
            self._plain_of_rows(last, everywhere),
            strict=True,
        ):
            shift = self._light_groups.smooth(sampled - plain)
            found.append(np.maximum(at_light + shift.at(light_e), 0.0).astype(np.float32))
        return found[0], found[1]

    def _squares(
        self, residual: Float64Array, temporal: Float64Array, unbiased: float
    ) -> Float64Array:
        """Squares of these residuals without what temporal noise adds: their average is the spatial variance.

        residual : of the mean of every sampled pixel from that of pixels in the same light.
        unbiased : factor by which the squares are too small.
        """
        return residual**2 * unbiased

    def _standard_error(self, values: Float64Array) -> float:
        """Standard error of the average of values of the sampled pixels, whose mean is 0."""
        return float(values.std() / math.sqrt(values.size))

    @property
    def _counts_electrons(self) -> bool:
        """Whether the pixels have a law: all chains but konnik2014, which is there for comparison."""
        return self.stages[0].domain != "photons"

    @cached_property
    def _sampled_light(self) -> Float64Array:
        light = np.broadcast_to(
            np.asarray(self.sample.light.light, np.float64), self.sample.frame.window.shape
        )
        return np.minimum(light.ravel(), HIGHEST_E)

    @cached_property
    def _light_groups(self) -> LightGroups:
        return LightGroups.of(self._sampled_light)

    def _sampled(self, number: int) -> Codes:
        """Mean and variance of the sampled pixels behind a stage."""
        last = len(self.stages) - 1
        if number not in self._behind:
            self._prepare([last] if number == last else range(len(self.stages)))
        return self._behind[number]

    def _prepare(self, numbers: Collection[int]) -> None:
        """Compute the sampled pixels behind these stages, those that are missing."""
        if missing := [number for number in numbers if number not in self._behind]:
            self._behind.update(
                behind_stages(self.stages, self.sample.light, self.sample.frame, missing)
            )

    def _over_light(self, values: Float64Array) -> float:
        return float(np.average(values, weights=self.levels.pixels))

    @cached_property
    def _digital(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance of every pixel without fixed-pattern noise, and what that adds at its level of light."""
        shape, last = self.frame.window.shape, len(self.stages) - 1
        found = np.empty(shape, np.float32), np.empty(shape, np.float32)
        if not self._counts_electrons:
            light_e = self.light.mean_e
            mean, temporal, _ = (x.reshape(shape) for x in self._propagated_to(last, light_e))
            return mean.astype(np.float32), temporal.astype(np.float32)
        plain_window = replace(self.sample.window, maps="median", given={}, _maps={})
        plain_frame = replace(self.sample.frame, window=plain_window)
        plain = behind_stages(self.stages, self.sample.light, plain_frame, [last])[last]
        shifts = [
            self._light_groups.smooth(with_maps - without_maps)
            for with_maps, without_maps in zip(self._sampled(last), plain, strict=True)
        ]
        whole = median_frame(self.frame, np.arange(shape[0]), np.arange(shape[1]))

        def write(rows: slice) -> None:
            part = replace(whole, window=whole.window.crop_rows(rows), _blocks={})
            light = self.light.crop_rows(rows)
            law = PixelStrip(self.stages, light.signal, part).codes()
            for values, moments, shift in zip(found, law, shifts, strict=True):
                pixels = moments.reshape(part.window.shape) + shift.at(light.mean_e)
                values[rows] = np.maximum(pixels, 0.0)

        for_each(write, row_strips_of(shape, STRIP))
        return found

    # -- chain konnik2014 --------------------------------------------------------------------------------------------

    def _propagated(self, number: int) -> Averages:
        """By the moments of the stages alone."""
        levels = self.levels
        mean, temporal, spatial = map(
            self._over_light, self._propagated_to(number, levels.light_e)
        )
        return Averages(mean, temporal, spatial)

    def _propagated_to(self, number: int, photons: Float64Array) -> tuple[Float64Array, ...]:
        levels, place = np.unique(photons, return_inverse=True)
        window = SensorWindow(0, (1, levels.size), given=self.frame.window.given)
        start = Moments(Photons(levels[None, :]), 0.0, 0.0, replace(self.frame, window=window))
        m = propagate(self.stages[: number + 1], start)
        parts = (
            np.broadcast_to(np.asarray(x, np.float64), (1, levels.size))[0]
            for x in (m.mean, m.temporal, m.spatial)
        )
        return tuple(part[place].reshape(photons.shape) for part in parts)


def behind_stages(
    stages: Chain, light: Electrons, frame: Frame, numbers: Collection[int]
) -> dict[int, Codes]:
    """Mean and variance of the signal of every pixel behind these stages, (P,) each, on all processors.

    light, frame : of a window, (H, W).
    """
    shape = frame.window.shape
    found = {number: (np.empty(shape), np.empty(shape)) for number in numbers}

    def write(rows: slice) -> None:
        part = replace(frame, window=frame.window.crop_rows(rows), _blocks={})
        for number, moments in (
            PixelStrip(stages, _rows_of(light, rows), part).behind(numbers).items()
        ):
            for values, computed in zip(found[number], moments, strict=True):
                values[rows] = computed.reshape(part.window.shape)

    for_each(write, row_strips_of(shape, STRIP))
    return {
        number: (mean.ravel(), variance.ravel()) for number, (mean, variance) in found.items()
    }


def _rows_of(light: Electrons, rows: slice) -> Electrons:
    """Some rows of photoelectrons."""
    return light.mapped(lambda values: values[rows] if len(values) > 1 else values)


class Smoothed(NamedTuple):
    """A straight line between means of groups of pixels of about the same light.

    light_e, values : (G,) means of the groups.  unbiased : factor by which squares about the line are too small.
    """

    light_e: Float64Array
    values: Float64Array
    unbiased: float

    def at(self, light_e: Float64Array) -> Float64Array:
        """At these levels of light."""
        return np.asarray(np.interp(light_e, self.light_e, self.values))


class LightGroups(NamedTuple):
    """Groups of pixels of about the same light.

    number : (P,) of the group of each pixel.  pixels : (G,) in each group.  light_e : (G,) mean light of each group.
    """

    number: NDArray[np.intp]
    pixels: Float64Array
    light_e: Float64Array

    @classmethod
    def of(cls, light_e: Float64Array) -> LightGroups:
        """Of pixels in so much light, (P,): groups of about as many pixels each, none of them empty."""
        light_e = np.where(light_e < DARK_E, 0.0, light_e)
        groups = min(max(light_e.size // GROUP, 1), GROUPS)
        edges = np.unique(np.quantile(light_e, np.linspace(0, 1, groups + 1)[1:-1]))
        interval = np.searchsorted(edges, light_e, side="right")
        _, number = np.unique(interval, return_inverse=True)
        pixels = np.bincount(number).astype(np.float64)
        return cls(number, pixels, np.bincount(number, light_e) / pixels)

    def smooth(self, values: Float64Array) -> Smoothed:
        """The line of values of these pixels, (P,)."""
        mean_value = np.bincount(self.number, values) / self.pixels
        used = max(float(values.size - self.pixels.size), 1.0)
        return Smoothed(self.light_e, mean_value, values.size / used)
