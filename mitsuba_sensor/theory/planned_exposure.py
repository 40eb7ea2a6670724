"""Exposures with a plan that is made for their light, where ``tolerance_dn`` asks for one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from ..camera.camera import Camera
from ..core import Exposure
from ..core.options import complete
from ..sensor.choices import tolerance_of
from ..sensor.expose import PreparedExposure, prepare_exposure
from ..sensor.options import ExposeOptions
from .combined_plan import plan_of


def prepare_planned_exposure(
    camera: Camera,
    exposure: Exposure,
    shape: tuple[int, ...],
    origin: tuple[int, int],
    options: ExposeOptions,
) -> PreparedExposure:
    """What :func:`sensor.expose.prepare_exposure` returns; its light gets a plan within ``tolerance_dn``.

    shape, origin : (rows, columns) of the window and its first pixel.  Raises InputError.
    """
    sensor = prepare_exposure(camera, exposure, shape, origin, options)
    tolerance_dn = tolerance_of(complete(ExposeOptions, options))
    if tolerance_dn is None:
        return sensor
    return replace(sensor, planner=partial(plan_of, tolerance_dn=tolerance_dn))
