"""Where a real lens puts its picture: the ray through the middle of the stop, against the ideal image height."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .paraxial import cardinal, opened
from .pupil import ray_to
from .ray_trace import to_stop, trace

if TYPE_CHECKING:
    from ..sensor.lens_datasheet import LensSection

POINTS = 17  # of the table, the axis left out
SECANTS = 12  # steps to the middle of the stop; superlinear, six do
Array = NDArray[np.float64]


def chief_heights(lens: LensSection, focus_m: float, highest_mm: float) -> tuple[Array, Array]:
    """(ideal, real) image heights of points in the plane that is in focus, up to ``highest_mm`` [mm].

    Ideal is the principal distance times the tangent of the field angle at the middle of the paraxial entrance pupil.
    Heights whose chief ray is stopped or misses a surface are left out.
    """
    points = cardinal(lens)
    surfaces, distance = opened(lens), points.image_distance(focus_m)
    half = to_stop(surfaces)
    heights = highest_mm * np.arange(1, POINTS + 1) / POINTS
    with np.errstate(all="ignore"):  # of rays that miss
        before = heights * points.exit_pupil / (points.exit_pupil - distance)  # through the paraxial exit pupil
        at, miss_before = before + 1e-3, trace(half, ray_to(distance, heights, before, 0 * heights)).x
        for _ in range(SECANTS):
            miss = trace(half, ray_to(distance, heights, at, 0 * heights)).x
            step = np.where(miss == miss_before, 0.0, miss * (at - before) / (miss - miss_before))
            before, miss_before, at = at, miss, at - step
        end = trace(surfaces, ray_to(distance, heights, at, 0 * heights))
        slope, depth = end.dx / end.dz, end.z - (points.length - points.entrance_pupil)
        tangent = slope if math.isinf(focus_m) else (end.x + (focus_m * 1e3 - depth) * slope) / (focus_m * 1e3)
    unvignetted = np.asarray(end.unvignetted)
    return -points.principal_distance(focus_m) * tangent[unvignetted], heights[unvignetted]
