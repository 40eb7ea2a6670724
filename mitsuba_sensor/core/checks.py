"""Checks of what comes through the front door, shared by the rooms for light and for electrons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .exposure import Exposure


def check_types(camera: Any, exposure: Any, optional: bool = False) -> None:
    """Raise InputError for a name or a number where a Camera or an Exposure belongs.

    optional : whether either may be None.
    """
    if not hasattr(camera, "quantum_efficiency") and not (optional and camera is None):
        raise InputError(f"camera is {camera!r}; pass a Camera, e.g. load_camera('konnik_table1').")
    if not isinstance(exposure, Exposure) and not (optional and exposure is None):
        raise InputError(f"exposure is {exposure!r}; pass an Exposure, e.g. Exposure(time_s=0.1).")


def numbers(name: str, values: Any, way_out: str) -> NDArray[np.float64]:
    """``values`` as float64; InputError for text, complex numbers, ragged lists and None."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray("ragged")
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} is not numeric; pass {way_out}.")
    return np.asarray(array, dtype=np.float64)


def first_given(*values: Any) -> Any:
    """The first value that is not None; None if all are."""
    return next((value for value in values if value is not None), None)
