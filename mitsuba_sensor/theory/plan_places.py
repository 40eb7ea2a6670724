"""Places of the sensor that a plan looks at: where the stages that depend on the place do most and least."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Frame, Moments
from ..core.types import Array
from ..stages.stage import Stage


class Places(NamedTuple):
    """Rows and columns of a window, counted from its first pixel; none where no stage depends on the place."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


def places_of_extremes(
    stages: Iterable[Stage], frame: Frame, light_e: Iterable[float]
) -> Places:
    """Pixels where a mean or a variance behind any stage is the largest or the smallest of the window.

    stages : between the light and the converter.  light_e : levels of light that are tried [e-].
    """
    rows: set[int] = set()
    columns: set[int] = set()
    inner = tuple(stages)
    for level_e in light_e:
        m = Moments(level_e, 0.0, 0.0, frame)
        for stage in inner:
            m = stage.moments(m)
            for values in (m.mean, m.temporal, m.spatial):
                for row, column in _extremes(values, frame.window.shape):
                    rows.add(row)
                    columns.add(column)
            m = _averaged(m)
    return Places(np.array(sorted(rows), np.int64), np.array(sorted(columns), np.int64))


def _extremes(values: Array, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Row and column of the smallest and the largest value, if these differ."""
    values = np.asarray(values, np.float64)
    if values.size == 1 or values.min() == values.max():
        return []
    everywhere = np.broadcast_to(values, shape)
    places = (everywhere.argmin(), everywhere.argmax())
    return [(int(place) // shape[1], int(place) % shape[1]) for place in places]


def _averaged(m: Moments) -> Moments:
    """One pixel like the average of the window."""
    return replace(
        m,
        mean=_average(m.mean),
        temporal=_average(m.temporal),
        spatial=_average(m.spatial),
        yield_mean=_average(m.yield_mean),
        yield_variance=_average(m.yield_variance),
        variance_e2=None if m.variance_e2 is None else _average(m.variance_e2),
        light=None if m.light is None else _averaged(m.light),
    )


def _average(values: Array) -> float:
    return float(np.mean(np.asarray(values)))
