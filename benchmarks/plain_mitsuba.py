"""A camera with a film of plain Mitsuba, for references and timing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def sensor_like(
    mi: Any, old: Any, size: int, edges_nm: Sequence[float], sampler: str = "independent"
) -> Any:
    """Return the pinhole of ``old`` with size × size pixels and equal responses between the edges."""
    ends = zip(edges_nm[:-1], edges_nm[1:], strict=True)
    bands = {
        f"band{k:02}": {
            "type": "regular",
            "wavelength_min": low,
            "wavelength_max": high,
            "values": "1, 1",
        }
        for k, (low, high) in enumerate(ends)
    }
    film = {
        "type": "specfilm",
        "width": size,
        "height": size,
        "component_format": "float32",
        **bands,
    }
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.ravel(mi.traverse(old)["x_fov"])[0]),
            "to_world": mi.ScalarTransform4f(
                np.array(old.world_transform().matrix).reshape(4, 4)
            ),
            "film": {**film, "rfilter": {"type": "box"}},
            "sampler": {"type": sampler},
        }
    )
