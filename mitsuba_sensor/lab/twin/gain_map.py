"""Photo response non-uniformity: the gains of pixels, rows and columns, from a flat field less its dark frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
    """PRNU of a flat field of one filter, about half saturated."""
    y = flat.mean - dark.expected_frame(flat.exposure_s)
    level = float(y.mean())
    per_gain = response.per_gain(level)
    noises = [Noise(temporal_mean_squares(flat), 1 / len(flat)), *dark.offsets.noises]
    if dark.rates is not None:
        for noise in dark.rates.noises:
            noises.append(Noise(noise.squares, noise.factor * flat.exposure_s**2))
    signal = CombinedMap(y, tuple(noises))
    spreads, frames = signal.spread(per_gain / level), frames_of(flat)

    def figure(part: str, name: str, symbol: str) -> Fitted:
        prnu = Quantity(
            symbol, f"photo response non-uniformity of {name}", *spreads[part], "", "fit"
        )
        if math.isfinite(prnu.low) and prnu.low == 0:
            prnu = prnu.noted("not told from 0")
        return Fitted(prnu, frames)

    return GainMap(
        pixel=figure("pixel", "pixels", "PRNU_pixel"),
        row=figure("row", "rows", "PRNU_row"),
        column=figure("col", "columns", "PRNU_col"),
        parts={name: part * per_gain / level for name, part in signal.parts().items()},
    )
