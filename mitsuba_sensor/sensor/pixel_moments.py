"""Clean frame: mean and variance of the code of every pixel of one camera, over temporal noise, with its own FPN maps.

Stages without temporal noise act on the pixels as they do in a frame, with the maps of this serial. The count has its
law about the mean that they leave, the noise behind it is normal, and so the law of the code is known (pixel_codes.py).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, Moments
from ..core.types import Float64Array
from .choices import check_clean
from .detection import Detected
from .pixel_codes import Part, PixelCodes
from .pixel_counts import CountLaws
from .recorder import has_temporal_noise
from .run import row_strips_of
from .stage import Chain, Line, PixelNoise, Stage, propagate
from .threads import for_each

STRIP = 2**15
"""Pixels that are looked at together."""

HIGHEST_E = 1e30
"""Mean electrons of a pixel in infinite light."""


class PixelMoments(NamedTuple):
    """Mean [DN] and temporal variance [DN²] of the code of every pixel, (H, W)."""

    mean: NDArray[np.float32]
    temporal: NDArray[np.float32]


class State(NamedTuple):
    """Of every pixel: chance of this state, its electrons, and variance that a stage of temporal noise has added."""

    chance: Array
    electrons: Electrons
    variance_e2: Array = 0.0


def pixel_moments(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Of the pixels of this window and serial, strip by strip.

    Raises InputError for chain konnik2014, which does not count the electrons that are detected.
    """
    if stages[0].domain == "photons":
        check_clean("konnik2014")
    shape = frame.window.shape
    found = PixelMoments(np.empty(shape, np.float32), np.empty(shape, np.float32))

    def write(rows: slice) -> None:
        part = replace(frame, window=frame.window.crop_rows(rows), _blocks={})
        mean, variance = _Strip(stages, light.crop_rows(rows).signal, part).moments()
        found.mean[rows], found.temporal[rows] = (x.reshape(part.window.shape) for x in (mean, variance))

    for_each(write, row_strips_of(shape, STRIP))
    return found


@dataclass(frozen=True, eq=False)
class _Strip:
    """Some rows of a window.  light : mean photoelectrons, (H, W)."""

    stages: Chain
    light: Electrons
    frame: Frame

    def moments(self) -> tuple[Float64Array, Float64Array]:
        """Over the states of the pixels, in front of the count and behind it."""
        size = self.frame.window.shape[0] * self.frame.window.shape[1]
        mean, square = np.zeros(size), np.zeros(size)
        for state, noise in itertools.product(self._states(), self._noise()):
            chance = self._flat(state.chance) * math.prod(one for one, _, _ in noise.values())
            pixels = np.flatnonzero(chance)
            if not pixels.size:
                continue
            moved = {number: (step, own) for number, (_, step, own) in noise.items()}
            law = self._law(state, pixels)
            code, variance = PixelCodes(
                self.stages, self.frame, self.parts, pixels, law, chance[pixels], moved
            ).moments()
            mean[pixels] += chance[pixels] * code
            square[pixels] += chance[pixels] * (variance + code**2)
        return mean, np.maximum(square - mean**2, 0.0)

    @cached_property
    def count(self) -> int:
        """The first stage that makes whole electrons; without one the first behind the mean electrons."""
        counted = (k for k, s in enumerate(self.stages) if s.counts_electrons or s.frees_electrons)
        return next(counted, self.split)

    @cached_property
    def split(self) -> int:
        """The first stage that works on single counts: a full well, or volts."""
        at = (k for k, s in enumerate(self.stages) if s.saturation_e is not None or s.domain in ("volts", "DN"))
        return next(k for k in at if k >= next((k for k, s in enumerate(self.stages) if s.counts_electrons), 0))

    @cached_property
    def parts(self) -> list[Part]:
        """What stands between the count and the converter, for these pixels."""
        found: list[Part] = []
        zero = np.zeros(self.frame.window.shape)
        for before, stage in itertools.pairwise(self.stages[self.split - 1 : -1]):
            if (noise := stage.pixel_noise(self.frame)) is not None:
                states = ((self._flat(chance), self._flat(x), self._flat(own)) for chance, x, own in noise.states)
                found.append(PixelNoise(tuple(states)))
            elif self._is_line(stage, before):
                offset = stage.sample(zero, self.frame)
                found.append(Line(self._flat(stage.sample(zero + 1.0, self.frame) - offset), self._flat(offset)))
            else:
                found.append(stage)
        return found

    def _is_line(self, stage: Stage, before: Stage) -> bool:
        """Whether a stage is a gain and an offset of every pixel, the same in all frames."""
        in_volts = before.domain == stage.domain == "volts"
        return in_volts and not stage.curved and not has_temporal_noise(stage, before, self.frame)

    def _states(self) -> list[State]:
        """In front of the count."""
        light = {k: np.asarray(x, np.float64) for k, x in vars(self.light).items() if x is not None}
        states = [State(1.0, Electrons(**{**light, "light": np.minimum(light["light"], HIGHEST_E)}))]
        for before, stage in itertools.pairwise(self.stages[: self.count]):
            states = [after for state in states for after in self._behind(stage, before, state)]
        return states

    def _behind(self, stage: Stage, before: Stage, state: State) -> Iterator[State]:
        """In front of the count: as in a frame where there is no temporal noise, else in each of its states."""
        if outcomes := stage.outcomes(state.electrons, self.frame):
            yield from (state._replace(chance=state.chance * chance, electrons=e) for chance, e in outcomes)
        elif has_temporal_noise(stage, before, self.frame):
            was = state.electrons
            m = stage.moments(Moments(was.total, 0.0, 0.0, self.frame))
            electrons = replace(was, light=was.light + (m.mean - was.total))
            yield State(state.chance, electrons, state.variance_e2 + m.temporal)
        else:
            yield state._replace(electrons=stage.sample(state.electrons, self.frame))

    def _law(self, state: State, pixels: NDArray[np.intp]) -> CountLaws:
        """Mean and variance of the count, and of what multiplies electrons."""
        e = state.electrons
        m = propagate(
            self.stages[self.count : self.split],
            Moments(
                e.total,
                0.0,
                0.0,
                self.frame,
                light=Moments(e.light, 0.0, 0.0, self.frame),
                yield_mean=e.yield_mean,
                yield_variance=e.yield_variance,
                variance_e2=e.variance_e2,
            ),
        )
        return CountLaws(*(self._flat(x)[pixels] for x in (m.mean, m.temporal + state.variance_e2)))

    def _noise(self) -> Iterator[dict[int, tuple[Array, Array, Array]]]:
        """Every combination of the normals of noise behind the count: chance, mean and variance, by number of part."""
        mixed = {k: part.states for k, part in enumerate(self.parts) if isinstance(part, PixelNoise)}
        for some in itertools.product(*mixed.values()):
            yield dict(zip(mixed, some, strict=True))

    def _flat(self, x: Array) -> Float64Array:
        return np.broadcast_to(np.asarray(x, np.float64), self.frame.window.shape).reshape(-1)
