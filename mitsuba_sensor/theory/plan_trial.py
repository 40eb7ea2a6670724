"""Effect of omitting stages of a chain on samples of its frames, with the same random numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core import Array, Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.threads import for_each
from ..stages.stage import Chain, Stage, converter_of, place_of, sample, total, without
from .expected import (
    LARGEST,
    SIDE_PX,
    Expectation,
    ideal_code,
    is_clipped,
    signals,
    variances_of,
)

CLEAR_SIGMAS = 7.0
"""A full well can be omitted if the fullest sampled pixel is this many σ of shot noise below it."""

NEEDED = "changes the unit; always needed"
IDLE = "has no effect here"
BELOW = "below the tolerance"


@dataclass(frozen=True)
class Effect:
    """Effect of omitting one stage [DN].

    stage : label of the stage, after its readout's label if there are several.
    mean_dn, temporal_dn, spatial_dn : mean of the change of unclipped pixels, and its σ from frame to frame and from
        sensor unit to sensor unit; the larger of the frame's light and all its levels.
    structure_dn : σ of the change that all pixels of a row or column share, times the root of the line's length, for
        comparison with the noise of a pixel.
    pixels_beyond : expected number of pixels of a frame, clipped or not, that change by more than the tolerance.
    """

    stage: str
    kept: bool
    mean_dn: float
    temporal_dn: float
    spatial_dn: float
    structure_dn: float
    pixels_beyond: float
    reason: str = ""

    @property
    def columns(self) -> tuple[float, ...]:
        """The numbers of a table row."""
        changes = self.mean_dn, self.temporal_dn, self.spatial_dn, self.structure_dn
        return (*changes, self.pixels_beyond)

    @property
    def largest_dn(self) -> float:
        """The largest change [DN]."""
        return max(self.columns[:-1])


@dataclass(frozen=True, eq=False)
class Trial:
    """A chain with and without stages, in the light of a frame and at all levels between its pixels."""

    stages: Chain
    light: Detected
    frame: Frame
    tolerance_dn: float

    def chosen(self) -> tuple[list[Effect], Chain]:
        """Return the effects of all stages, and the stages that remain."""
        whole = self.stages
        units = [stage.domain for stage in whole]
        needed = [True, *(one != before for before, one in itertools.pairwise(units))]
        alone = self.moved(
            [() if no else (one,) for one, no in zip(whole, needed, strict=True)]
        )
        small = [
            (one.largest_dn, number)
            for number, one in enumerate(alone)
            if not needed[number] and self.is_within(one) and self.is_clear_of(whole[number])
        ]
        out = [whole[number] for _, number in sorted(small)]
        while out and not self.is_within(self.moved([out])[0]):
            out.pop()
        effects = []
        for stage, one, unit in zip(whole, alone, needed, strict=True):
            is_out = any(stage is other for other in out)
            reason = NEEDED if unit else ""
            if is_out:
                reason = BELOW if one.largest_dn or one.pixels_beyond else IDLE
            effects.append(replace(one, stage=stage.label, kept=not is_out, reason=reason))
        return effects, without(whole, out)

    def is_within(self, effect: Effect) -> bool:
        """Return True if no sampled pixel, and no line mean times √length, changes by more than the tolerance."""
        return effect.pixels_beyond == 0 and effect.largest_dn <= self.tolerance_dn

    def is_clear_of(self, stage: Stage) -> bool:
        """Return True if the fullest sampled pixel is far below the clipping level of the stage."""
        if stage.saturation_e is None:
            return True
        fullest_e = float(self.fullest[place_of(stage, self.stages) - 1])
        return fullest_e + CLEAR_SIGMAS * math.sqrt(max(fullest_e, 0.0)) < stage.saturation_e

    @cached_property
    def of_frame(self) -> Expectation:
        """Expectation in windows of the frame."""
        return Expectation(self.stages, self.light, self.frame)

    @cached_property
    def levels(self) -> Expectation:
        """Expectation in a window with all levels of the light, and all values of measured maps at each level."""
        rows, columns = (min(SIDE_PX, side) for side in self.frame.window.shape)
        shape = rows, columns
        part, light_e = self.light.crop_rows(slice(0, rows)), self.light.mean_e
        low, high = (math.log1p(min(float(x), LARGEST)) for x in (light_e.min(), light_e.max()))
        levels_e = np.expm1(np.linspace(low, high, rows * columns)).reshape(shape)
        signal = part.signal.mapped(lambda values: values[..., :columns])
        ramp = np.sort(levels_e, axis=1).astype(signal.light.dtype)
        order = np.random.default_rng(1).permutation(rows * columns)
        given = {
            name: np.quantile(x, order / max(order.size - 1, 1)).reshape(shape)
            for name, x in self.frame.window.given.items()
        }
        window = replace(self.frame.window, shape=shape, given=given, _maps={}, _tiles={})
        light = Detected(part.photons, replace(signal, light=ramp))
        return Expectation(self.stages, light, replace(self.frame, window=window, _blocks={}))

    @cached_property
    def windows(self) -> list[tuple[Expectation, int]]:
        """Windows of the frame, its corners, and two windows with all levels of light."""
        frame = self.of_frame
        parts = [frame] if frame.repeats > 1 else [frame, replace(frame, of_corners=True)]
        found = [(part, k) for part in parts for k in range(len(part.windows))]
        return [*found, (self.levels, 0), (self.levels, 1)]

    @cached_property
    def fullest(self) -> Float64Array:
        """Largest sampled signal after each stage."""
        return np.full(len(self.stages), -np.inf)

    @cached_property
    def clipped(self) -> Float64Array:
        """Fraction of clipped pixels in each window of the frame."""
        return np.zeros(len(self.of_frame.windows))

    def moved(self, outs: Sequence[Collection[Stage]]) -> list[Effect]:
        """Return the effect of omitting each of these sets of stages."""
        found = np.zeros((len(self.windows), len(outs), 5))

        def write(number: int) -> None:
            found[number] = self._window(number, outs)

        for_each(write, range(len(found)))
        count = len(self.of_frame.windows)
        both = np.stack([found[:count].mean(axis=0), found[-2:].mean(axis=0)])
        changes = np.sqrt(np.maximum(both[..., :4], 0)).max(axis=0)
        beyond = both[0, :, 4] * math.prod(self.frame.window.shape)
        beyond = np.maximum(beyond, found[:, :, 4].any(axis=0))
        numbers = np.concatenate([changes, beyond[:, None]], axis=1).tolist()
        return [Effect("", True, *row) for row in numbers]

    def _window(self, number: int, outs: Sequence[Collection[Stage]]) -> Float64Array:
        """Return the statistics of one window for each set of stages, shape (sets, 5).

        They are squared mean, temporal and spatial variance of the change, variance that lines share times their
        length, and the fraction of pixels beyond the tolerance.
        """
        expectation, place = self.windows[number]
        inside, light = expectation.windows[place].inside, expectation.light_of(place)
        top, keep, moved = converter_of(self.stages).highest + 0.5, np.ones((1, 1), bool), []
        for frame in (one for sensor in expectation.frames_of(place) for one in sensor):
            outputs = list(signals(self.stages, light, frame))
            keep = keep & ~is_clipped(self.stages, outputs, frame)[inside]
            for k, signal in enumerate(outputs):
                self.fullest[k] = max(self.fullest[k], float(np.max(total(signal))))
            code = np.clip(ideal_code(self.stages, outputs[-2], frame), -0.5, top)[inside]
            moved.append([
                np.clip(self._without(out, outputs, frame), -0.5, top)[inside] - code if out else 0 * code
                for out in outs
            ])  # fmt: skip
        if expectation is self.of_frame:
            self.clipped[place] = 1 - keep.mean()
        rows = []
        for one in np.moveaxis(np.array(moved), 1, 0):
            d = one.reshape(2, 2, *one.shape[1:])
            some = d[..., keep] if keep.any() else np.zeros((2, 2, 1))
            beyond = (np.abs(d) > self.tolerance_dn).mean()
            rows.append(
                [some.mean() ** 2, *variances_of(some), self._of_lines(d * keep), beyond]
            )
        return np.array(rows)

    def _without(
        self, out: Collection[Stage], outputs: list[Array], frame: Frame
    ) -> Float64Array:
        """Return the codes without some stages, before rounding and clipping.  outputs : signals after every stage."""
        first = min(place_of(stage, self.stages) for stage in out)
        rest = without(self.stages[first:-1], out)
        return ideal_code(self.stages, sample(rest, outputs[first - 1], frame), frame)

    def _of_lines(self, d: Float64Array) -> float:
        """Return the variance that the pixels of a line share, times the length of the line.

        It is the largest of rows and columns, from frame to frame or from sensor unit to sensor unit. d : changes,
        shape (2, 2, H, W).
        """
        height, width = self.frame.window.shape
        temporal = (d[:, 0] - d[:, 1]) / math.sqrt(2)
        spatial = (d[:1].mean(axis=1) - d[1:].mean(axis=1)) / math.sqrt(2)
        return max(
            max(width * _shared(x), height * _shared(np.swapaxes(x, 1, 2)))
            for x in (temporal, spatial)
        )


def _shared(x: Float64Array) -> float:
    """Return the variance that the pixels of a row share, from its even and odd pixels.  x : shape (N, H, W)."""
    if x.shape[2] < 2:
        return 0.0
    return float((x[..., ::2].mean(axis=2) * x[..., 1::2].mean(axis=2)).mean())
