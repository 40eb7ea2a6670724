"""Fixed-pattern noise (FPN) maps of one sensor unit, and checks of measured maps that replace them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import refuse_readouts
from ..camera.sensor_size import check_on_sensor
from ..core import (
    Exposure,
    InputError,
    SensorWindow,
    check_types,
    nearest,
    numbers,
)
from ..core.checks import require_pair
from ..core.options import complete
from ..stages.chain import whole_chain
from ..stages.stage import Chain, ElectronMaps
from .checks import ORIGIN
from .options import ExposeOptions, Precision
from .precision import precision_of
from .run import choose_backend


def fpn_maps(
    camera: AnyCamera,
    shape: tuple[int, int] | None = None,
    *,
    serial: int = 1,
    origin: tuple[int, int] = (0, 0),
    precision: Precision = "auto",
) -> dict[str, NDArray[np.float64]]:
    """Return every FPN map of one sensor unit by name: gains (mean 1), dark current factors (1), offsets [e-] (0).

    ::

        maps = ms.fpn_maps("bayer_2mp", (48, 64), serial=7)
        frames = ms.expose(photons, "bayer_2mp", ms.Exposure(0.01), maps=maps)

    shape : (rows, columns) of the window. Default: the whole sensor. The result fits ``expose(maps=…)``.
    precision : as for :func:`expose`, which then uses exactly these maps.
    """
    camera = camera_of(camera)
    check_types(camera, Exposure(0.0))
    refuse_readouts(camera, "fixed-pattern noise maps belong to one readout")
    if shape is None:
        shape = (camera.sensor.rows, camera.sensor.columns)
    size = require_pair("shape", shape, "(rows, columns) of the window, e.g. (480, 640)")
    if 0 in size:
        raise InputError(
            f"shape is {size}; it must be (rows, columns) of the window, each at least 1."
        )
    first = require_pair("origin", origin, ORIGIN)
    check_on_sensor("the window of the maps", size, first, camera)
    asked = complete(ExposeOptions, {"precision": precision})["precision"]
    backend = choose_backend("numpy", precision_of(asked, camera), 0)
    window = SensorWindow(serial, size, first, backend=backend, camera=camera.name)
    found = [stage.fpn_maps(window) for stage in camera.stages]
    return {name: np.asarray(x, dtype=np.float64) for maps in found for name, x in maps.items()}


def checked_maps(
    maps: Mapping[str, ArrayLike] | None, window: SensorWindow, camera: Camera
) -> dict[str, NDArray[np.float64]]:
    """Return measured maps that fit the window: (H, W), (1, W) of columns or (H, 1) of rows. Raises InputError.

    Maps of the whole sensor are cropped, and maps in DN become electrons. Maps of switched-off stages are accepted.
    """
    if maps is not None and not isinstance(maps, Mapping):
        raise InputError(
            f"maps is a {type(maps).__name__}; pass a dict of name → array, as fpn_maps() returns."
        )
    if not maps:
        return {}
    stages, sensor = whole_chain(camera), (camera.sensor.rows, camera.sensor.columns)
    known = {
        name: value.shape
        for stage in stages
        for name, value in stage.fpn_maps(SensorWindow(0, (2, 2))).items()
    }
    checked, in_dn = {}, _maps_in_dn(stages)
    for name, values in maps.items():
        own, dn_per_unit = in_dn.get(name, (name, 1.0))
        if own not in known:
            names = (*known, *in_dn)
            raise InputError(
                f"maps names {name!r}; this camera's maps are {', '.join(names)}.{nearest(str(name), names)}"
            )
        if name != own and own in maps:
            raise InputError(f"maps names both {name!r} and {own!r}; give only one.")
        if not dn_per_unit:
            raise InputError(
                f"maps names {name!r}, but readout.dsnu_residual is 0, so no offset is left; omit the map."
            )
        array = numbers(f"maps[{name!r}]", values, "an array of numbers")
        for axis, places in enumerate((window.rows, window.columns)):
            if array.ndim == 2 and 1 < array.shape[axis] == sensor[axis] > places[-1]:
                array = array.take(places, axis)
        fits = tuple(
            n if pixels > 1 else 1 for n, pixels in zip(window.shape, known[own], strict=True)
        )
        if array.ndim != 2 or any(
            n not in (1, full) for n, full in zip(array.shape, fits, strict=True)
        ):
            raise InputError(
                f"maps[{name!r}] has shape {array.shape}; it must be {fits}, 1 along an axis, or the whole sensor."
            )
        if not np.isfinite(array).all() or (not own.endswith("_e") and (array < 0).any()):
            raise InputError(
                f"maps[{name!r}] contains NaN, infinite or negative values; correct the bad pixels first."
            )
        checked[own] = array / dn_per_unit if name != own else array
    return checked


def _maps_in_dn(stages: Chain) -> dict[str, tuple[str, float]]:
    """Return, for a map in DN, the map in electrons and their ratio, the small-signal gain K: ``dsnu_pixel_dn`` → …

    If the CDS leaves a fraction of the offsets, the ratio is that fraction of K: a map in DN is measured after the CDS.
    """
    found = {}
    for number, stage in enumerate(stages):
        rest = math.prod(one.nominal_gain for one in stages[number + 1 :])
        if not isinstance(stage, ElectronMaps):
            continue
        for name, gain in stage.gains_of_maps().items():
            found[f"{name.removesuffix('_e')}_dn"] = (name, gain * rest)
    return found
