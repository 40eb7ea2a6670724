"""Every fixed-pattern noise (FPN) map of one chip: to look at, to keep, or to replace by measured ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import refuse_readouts
from ..camera.sensor_size import check_on_sensor
from ..core import Exposure, InputError, SensorWindow, check_types, require_seed
from ..core.options import complete
from .checks import checked_origin
from .choices import precision_of
from .options import ExposeOptions, Precision
from .run import choose_backend


def fpn_maps(
    camera: AnyCamera,
    shape: tuple[int, int] | None = None,
    *,
    serial: int = 1,
    origin: tuple[int, int] = (0, 0),
    precision: Precision = "auto",
) -> dict[str, NDArray[np.float64]]:
    """Every FPN map of one chip, by name: gains (1 on average), dark current factors (1), offsets in electrons (0).

    ::

        maps = ms.fpn_maps("bayer_2mp", (48, 64), serial=7)
        frames = ms.expose(photons, "bayer_2mp", ms.Exposure(0.01), maps=maps)

    shape : (rows, columns) of the window; the whole sensor by default. The result fits ``expose(maps=…)``.
    precision : of :func:`expose`, so that these are the very maps that it uses.
    """
    camera = camera_of(camera)
    check_types(camera, Exposure(0.0))
    refuse_readouts(camera, "fixed-pattern noise maps are those of one read-out")
    size = shape
    if shape is None:
        size = (camera.sensor.rows, camera.sensor.columns)
    if not isinstance(size, tuple | list) or len(size) != 2 or 0 in size:
        raise InputError(
            f"shape is {size!r}; it must be (rows, columns) of the window, e.g. (480, 640)."
        )
    height, width = require_seed("shape", size[0]), require_seed("shape", size[1])
    first = checked_origin(origin)
    check_on_sensor("the window of the maps", (height, width), first, camera)
    asked = complete(ExposeOptions, {"precision": precision})["precision"]
    backend = choose_backend("numpy", precision_of(asked, camera, None), 0)
    window = SensorWindow(serial, (height, width), first, backend=backend, camera=camera.name)
    found = [stage.fpn_maps(window) for stage in camera.stages]
    return {name: np.asarray(x, dtype=np.float64) for maps in found for name, x in maps.items()}
