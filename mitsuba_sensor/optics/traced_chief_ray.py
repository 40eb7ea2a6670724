"""Chief rays of a traced lens: from image points through the middle of its stop into the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core import Float64Array
from .exit_pupil import ray_to
from .paraxial import cardinal_points
from .ray_trace import Ray, unobscured
from .traced_lens import SequentialSurfaces, traced_lens

if TYPE_CHECKING:
    from ..camera.lens_datasheet import LensSection

SECANTS = 12  # steps to the middle of the stop; superlinear, six are enough


class ChiefRays(NamedTuple):
    """Rays from the film, and what becomes of them on the side of the scene; NaN where there is none."""

    start: Ray
    end: Ray


def trace_chief_rays(lens: LensSection, focus_m: float, heights_mm: Float64Array) -> ChiefRays:
    """Chief rays of image heights, for a sensor that is in focus at a distance."""
    points, traced = cardinal_points(lens), traced_lens(lens)
    if isinstance(traced, SequentialSurfaces):
        traced = SequentialSurfaces(unobscured(traced.surfaces))
    distance = points.image_distance(focus_m)

    def ray_through(radial: Float64Array) -> Ray:
        return ray_to(distance, heights_mm, radial, 0 * heights_mm)

    with np.errstate(all="ignore"):  # rays that miss a surface give NaN
        # Start at the paraxial exit pupil.
        before = heights_mm * points.exit_pupil / (points.exit_pupil - distance)
        radial, miss_before = before + 1e-3, np.asarray(traced.miss_stop(ray_through(before)))
        for _ in range(SECANTS):
            miss = np.asarray(traced.miss_stop(ray_through(radial)))
            secant = miss * (radial - before) / (miss - miss_before)
            step = np.where(miss == miss_before, 0.0, secant)
            before, miss_before, radial = radial, miss, radial - step
        start = ray_through(radial)
        return ChiefRays(start, traced.trace(start))
