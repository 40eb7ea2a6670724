"""Checks of measured FPN maps that an exposure or a plan is given."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..core import InputError, SensorWindow, nearest, numbers
from ..stages.stage import Chain
from .map_units import maps_in_dn


def checked_maps(
    maps: Mapping[str, ArrayLike], stages: Chain, window: SensorWindow, camera: Camera
) -> dict[str, NDArray[np.float64]]:
    """Measured maps that fit the window, cut from the sensor's; a column's is (1, W), a row's (H, 1).

    Those in DN become electrons.
    """
    shape, sensor = window.shape, (camera.sensor.rows, camera.sensor.columns)
    if not isinstance(maps, Mapping):
        raise InputError(
            f"maps is a {type(maps).__name__}; pass a dict of name → array, as fpn_maps() returns."
        )
    if not maps:
        return {}
    known = {
        name: value.shape
        for stage in stages
        for name, value in stage.fpn_maps(SensorWindow(0, (2, 2))).items()
    }
    checked, in_dn = {}, maps_in_dn(stages)
    for name, values in maps.items():
        own, dn_per_unit = in_dn.get(name, (name, 1.0))
        if own not in known:
            names = (*known, *in_dn)
            raise InputError(
                f"maps names {name!r}; this camera's maps are {', '.join(names)}.{nearest(str(name), names)}"
            )
        if name != own and (own in maps or not dn_per_unit):
            why = "readout.dsnu_residual is 0: no offset is left"
            if own in maps:
                why = f"{own} too; give one of both"
            raise InputError(f"maps names {name!r}, and {why}.")
        array = numbers(f"maps[{name!r}]", values, "an array of numbers")
        for axis, places in enumerate((window.rows, window.columns)):
            if array.ndim == 2 and 1 < array.shape[axis] == sensor[axis] > places[-1]:
                array = array.take(places, axis)
        fits = tuple(
            n if pixels > 1 else 1 for n, pixels in zip(shape, known[own], strict=True)
        )
        if array.ndim != 2 or any(
            n not in (1, full) for n, full in zip(array.shape, fits, strict=True)
        ):
            raise InputError(
                f"maps[{name!r}] has shape {array.shape}; it must be {fits}, or 1 along an axis, or the sensor's."
            )
        if not np.isfinite(array).all() or (not own.endswith("_e") and (array < 0).any()):
            raise InputError(
                f"maps[{name!r}] holds NaN, infinite or negative values; correct the bad pixels first."
            )
        checked[own] = array / dn_per_unit if name != own else array
    return checked
