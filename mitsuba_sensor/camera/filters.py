"""Colour filters of a camera: their quantum efficiency, and the filter of each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import InputError, numbers
from ..core.band_average import photon_averages
from ..core.checks import require_pair
from ..stages.polarizers import efficiencies
from ..stages.stage import Datasheet

if TYPE_CHECKING:
    from ..stages.datasheet import CameraTable


def qe_of_filters(
    camera: Datasheet, wavelengths_nm: ArrayLike, bandwidths_nm: ArrayLike | None
) -> NDArray[np.float64]:
    """Return the quantum efficiency of every filter; see :meth:`Camera.qe`."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    curves = efficiencies(camera).values()

    def at(nm: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([np.interp(nm, points, curve, 0.0, 0.0) for curve in curves])

    centres = numbers("wavelengths_nm", wavelengths_nm, "wavelengths in nm, e.g. [550.0]")
    if bandwidths_nm is None:
        return at(centres)
    centres = np.atleast_1d(centres)
    widths = numbers("bandwidths_nm", bandwidths_nm, "one width in nm, or one per wavelength")
    if centres.ndim != 1 or widths.shape not in ((), (1,), centres.shape):
        raise InputError(
            f"bandwidths_nm has shape {widths.shape}, but wavelengths_nm {centres.shape}; pass one width per band."
        )
    return photon_averages(at, points, centres, np.broadcast_to(widths, centres.shape))


def band_seen_nm(table: CameraTable) -> tuple[float, float]:
    """Return the first and last wavelength that any filter detects [nm].  table : quantum_efficiency."""
    points, end = table.wavelengths_nm, len(table.wavelengths_nm) - 1
    seen = np.flatnonzero(np.max([*table.curves.values()], axis=0) > 0)
    first, last = (int(seen[0]), int(seen[-1])) if seen.size else (0, end)
    return points[max(first - 1, 0)], points[min(last + 1, end)]


def filter_numbers(
    tile: Sequence[Sequence[int]], shape: tuple[int, int], origin: tuple[int, int]
) -> NDArray[np.intp]:
    """Return the filter number of every pixel of a window, shape (H, W).  tile : filter numbers, by rows."""
    pattern = np.array(tile)
    shape = require_pair("shape", shape, "(rows, columns), e.g. (480, 640)")
    origin = require_pair("origin", origin, "(row, column) of the first pixel, e.g. (0, 0)")
    rows = (np.arange(shape[0]) + origin[0]) % pattern.shape[0]
    columns = (np.arange(shape[1]) + origin[1]) % pattern.shape[1]
    return pattern[np.ix_(rows, columns)]
