"""Slopes of errors against work, with their intervals, and which points nothing beats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError

CONFIDENCE = 0.95
"""Of every interval."""


@dataclass(frozen=True)
class Slope:
    """d log y / d log x with its interval.

    value : the mean of the runs' own slopes.  half_width : of the 95 % interval, Student's t over the runs.
    """

    value: float
    half_width: float
    runs: int

    def within(self, theory: float, distance: float) -> bool:
        """Whether the slope lies no farther than ``distance`` from theory."""
        return abs(self.value - theory) <= distance

    def covers(self, theory: float) -> bool:
        """Whether the interval holds this value."""
        return self.within(theory, self.half_width)

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.half_width:.3f}"


def log_slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of the straight line of least squares through (log x, log y)."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def mean_of_runs(values: Sequence[float]) -> tuple[float, float]:
    """Mean of a value that independent runs gave, and half the width of its 95 % interval (Student's t).

    Raises InputError for fewer than two runs: one has no spread.
    """
    from scipy.special import stdtrit

    count = len(values)
    if count < 2:
        raise InputError(f"there is {count} run; an interval needs at least 2.")
    spread = float(np.std(values, ddof=1)) / math.sqrt(count)
    return float(np.mean(values)), float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2)) * spread


def slope_of_runs(runs: Sequence[tuple[Sequence[float], Sequence[float]]]) -> Slope:
    """One slope per run of (x, y), and what they say together.

    The points of one run share their samples, so residuals about the line would promise too much; runs with seeds of
    their own do not.
    """
    value, half_width = mean_of_runs([log_slope(x, y) for x, y in runs])
    return Slope(value, half_width, len(runs))


def pareto(points: Sequence[tuple[float, float]]) -> tuple[int, ...]:
    """Indices of the points that no other beats: none is as small in both and smaller in one; the smallest x first.

    Equal points stay together; a point with NaN is never among them.
    """
    known = [i for i, point in enumerate(points) if not any(math.isnan(v) for v in point)]
    front: list[int] = []
    for i in sorted(known, key=lambda i: points[i]):
        if not front or points[i][1] < points[front[-1]][1] or points[i] == points[front[-1]]:
            front.append(i)
    return tuple(front)
