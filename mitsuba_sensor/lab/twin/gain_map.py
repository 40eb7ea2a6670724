"""Photo response non-uniformity: the gains of pixels, rows and columns, from a flat field less its dark frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import Quantity
from ..statistics.mean_squares import temporal_mean_squares
from .combined_map import CombinedMap, Noise
from .dark import Dark
from .evidence import Fitted, frames_of
from .response import Response


@dataclass(frozen=True, eq=False)
class GainMap:
    """pixel, row, column : σ over the mean of the gains.  parts : of the map, each of mean 0, rows, columns, pixels."""

    pixel: Fitted
    row: Fitted
    column: Fitted
    parts: dict[str, Float64Array]


def gain_map(flat: Stack, dark: Dark, response: Response) -> GainMap:
    """Of a flat field of one filter, about half saturated."""
    y = flat.mean - dark.at(flat.exposure_s)
    level = float(y.mean())
    linear = float(response.straight(np.array([level]))[0])
    per_gain = (1 + response.curvature * linear) / (
        1 + 2 * response.curvature * linear
    )  # d ln s / d ln y
    noises = [Noise(temporal_mean_squares(flat), 1 / len(flat)), *dark.offsets.noises]
    if dark.rates is not None:
        noises += [
            Noise(one.squares, one.factor * flat.exposure_s**2) for one in dark.rates.noises
        ]
    found = CombinedMap(y, tuple(noises))
    spread, parts = found.spread(per_gain / level), found.parts()
    frames = frames_of(flat)

    def figure(part: str, name: str) -> Fitted:
        one = Quantity(
            f"PRNU_{part}", f"photo response non-uniformity of {name}", *spread[part], "", "fit"
        )
        if math.isfinite(one.low) and one.low == 0:
            one = one.noted("not told from 0")
        return Fitted(one, frames)

    scaled = {name: part * per_gain / level for name, part in parts.items()}
    return GainMap(
        figure("pixel", "pixels"), figure("row", "rows"), figure("col", "columns"), scaled
    )
