"""Response of a pixel without fixed-pattern noise: mean and temporal variance behind every stage, by its light."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame
from ..core.types import Float64Array
from ..stages.stage import Chain, converter_of
from .pixel_moments import HIGHEST_E, PixelStrip
from .pixel_swing import Codes
from .sampled_pixels import sampled_window

FIRST_NODES, MOST_NODES, ROUNDS = 65, 4096, 6
"""Levels of light that are looked at first, at most, and how often some are put between them."""

CURVED_DN = 0.002
"""A level is put between two where it may lie further than this from their straight line, in means and in σ."""


QUIET_PIXELS, QUIET_COUNTS, RARE = 256, 65, 0.02
"""Pixels and counts that are searched for the least noise, and the share of the pixels that is left out of it."""


@dataclass(frozen=True, eq=False)
class Response:
    """Straight lines between levels of light.

    light_e : (L,) rising mean photoelectrons.
    """

    stages: Chain
    frame: Frame
    light_e: Float64Array
    _behind: dict[int, Codes] = field(default_factory=dict)

    @classmethod
    def of(cls, stages: Chain, frame: Frame, darkest_e: float, brightest_e: float) -> Response:
        """Between these levels [e-], with more of them where the response is curved.

        frame : exposure, and the window in whose middle the pixel is.
        """
        low, high = (min(light_e, HIGHEST_E) for light_e in (darkest_e, brightest_e))
        levels = np.unique(
            np.expm1(
                np.linspace(np.log1p(low), np.log1p(high), FIRST_NODES if high > low else 1)
            )
        )
        levels[0], levels[-1] = low, high
        mean, variance = behind_stages_at(stages, frame, levels, [len(stages) - 1])[
            len(stages) - 1
        ]
        for _ in range(ROUNDS):
            between = _curved(levels, mean, variance)
            if not between.size or levels.size + between.size > MOST_NODES:
                break
            order = np.argsort(np.concatenate([levels, between]), kind="stable")
            more = behind_stages_at(stages, frame, between, [len(stages) - 1])[len(stages) - 1]
            levels = np.concatenate([levels, between])[order]
            mean, variance = (
                np.concatenate(x)[order] for x in zip((mean, variance), more, strict=True)
            )
        return cls(stages, frame, levels, {len(stages) - 1: (mean, variance)})

    def mean(self, number: int, light_e: Float64Array) -> Float64Array:
        """Mean behind stage ``number``, in its unit."""
        return np.asarray(np.interp(light_e, self.light_e, self._moments(number)[0]))

    def temporal(self, number: int, light_e: Float64Array) -> Float64Array:
        """Temporal variance behind stage ``number``."""
        return np.asarray(np.interp(light_e, self.light_e, self._moments(number)[1]))

    def _moments(self, number: int) -> Codes:
        if number not in self._behind:
            self._behind.update(
                behind_stages_at(
                    self.stages, self.frame, self.light_e, range(len(self.stages) - 1)
                )
            )
        return self._behind[number]


def median_frame(frame: Frame, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Frame:
    """Pixels of a frame by their places in its window; every fixed-pattern noise map has the middle of its law."""
    return replace(
        frame, window=sampled_window(frame.window, rows, columns, "median"), _blocks={}
    )


def behind_stages_at(
    stages: Chain, frame: Frame, light_e: Float64Array, numbers: Collection[int]
) -> dict[int, Codes]:
    """Mean and variance behind some stages, of a pixel in the middle of the window in so much light, (L,) each."""
    height, width = frame.window.shape
    middle = np.full(light_e.size, width // 2)
    pixels = median_frame(frame, np.array([height // 2]), middle)
    return PixelStrip(stages, Electrons(light_e[None, :]), pixels).behind(numbers)


def least_noise_dn(stages: Chain, frame: Frame) -> float:
    """Smallest σ of the noise behind the count at any count up to the full well or the end of the converter [DN].

    Of pixels, and of states of a pixel, the quietest ones count that are not RARE.
    """
    converter = converter_of(stages)
    places = np.zeros(1, np.int64), np.zeros(QUIET_PIXELS, np.int64)
    window = sampled_window(frame.window, *places, "sampled")
    strip = PixelStrip(
        stages, Electrons(np.zeros(window.shape)), replace(frame, window=window, _blocks={})
    )
    dn_per_e = converter.gain_dn_per_v * math.prod(stage.nominal_gain for stage in stages[1:-1])
    wells = [stage.saturation_e for stage in stages if stage.saturation_e is not None]
    full_e = min([*wells, converter.highest / dn_per_e])
    sigma_dn = strip.noise_behind_count_dn(np.linspace(0.0, full_e, QUIET_COUNTS), RARE)
    return float(np.quantile(sigma_dn.min(axis=0), RARE))


def _curved(levels: Float64Array, mean: Float64Array, variance: Float64Array) -> Float64Array:
    """Levels between those about which the response is not straight."""
    if levels.size < 3:
        return np.zeros(0)
    sigma = np.sqrt(variance)
    curved = np.zeros(levels.size, bool)
    for values in (mean, sigma):
        share = (levels[1:-1] - levels[:-2]) / (levels[2:] - levels[:-2])
        straight = values[:-2] + share * (values[2:] - values[:-2])
        curved[1:-1] |= np.abs(values[1:-1] - straight) > CURVED_DN * np.maximum(
            1.0, sigma[1:-1]
        )
    here = curved[:-1] | curved[1:]
    middle = 0.5 * (levels[:-1] + levels[1:])
    apart = np.diff(levels) > 1e-9 * np.maximum(levels[1:], 1.0)
    return middle[here & apart]
