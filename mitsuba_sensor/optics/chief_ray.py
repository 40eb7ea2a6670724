"""Chief rays of a sequential lens: real image height, through the middle of the stop, against the ideal one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..core.types import Float64Array
from .exit_pupil import ray_to
from .paraxial import cardinal_points, surfaces_at_f_number
from .ray_trace import surfaces_to_stop, trace

if TYPE_CHECKING:
    from ..sensor.lens_datasheet import LensSection

POINTS = 17  # of the table, without the axis
SECANTS = 12  # steps to the middle of the stop; superlinear, six are enough


def chief_ray_heights(lens: LensSection, focus_m: float, highest_mm: float) -> tuple[Float64Array, Float64Array]:
    """(ideal, real) image heights of points in the plane that is in focus, up to ``highest_mm`` [mm].

    Ideal is the principal distance times the tangent of the field angle at the middle of the paraxial entrance pupil.
    Heights whose chief ray is vignetted or misses a surface are left out.
    """
    points = cardinal_points(lens)
    surfaces, distance = surfaces_at_f_number(lens), points.image_distance(focus_m)
    rear_group = surfaces_to_stop(surfaces)
    heights = highest_mm * np.arange(1, POINTS + 1) / POINTS
    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        before = heights * points.exit_pupil / (points.exit_pupil - distance)  # through the paraxial exit pupil
        at, miss_before = before + 1e-3, trace(rear_group, ray_to(distance, heights, before, 0 * heights)).x
        for _ in range(SECANTS):
            miss = trace(rear_group, ray_to(distance, heights, at, 0 * heights)).x
            step = np.where(miss == miss_before, 0.0, miss * (at - before) / (miss - miss_before))
            before, miss_before, at = at, miss, at - step
        end = trace(surfaces, ray_to(distance, heights, at, 0 * heights))
        slope, depth = end.dx / end.dz, end.z - (points.length - points.entrance_pupil)
        tangent = slope if math.isinf(focus_m) else (end.x + (focus_m * 1e3 - depth) * slope) / (focus_m * 1e3)
    unvignetted = np.asarray(end.unvignetted)
    return -points.principal_distance(focus_m) * tangent[unvignetted], heights[unvignetted]
