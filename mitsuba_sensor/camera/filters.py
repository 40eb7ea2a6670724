"""Colour filters of a camera: quantum efficiency at wavelengths and in bands, and which filter each pixel has."""

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
    """Quantum efficiency of every filter at (B,) wavelengths, (F, B); or averaged over bands, weighted by photons of a
    flat spectrum. With polarisers that of unpolarised light behind them."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    curves = efficiencies(camera).values()

    def at(nm: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([np.interp(nm, points, curve, 0.0, 0.0) for curve in curves])

    centres = numbers("wavelengths_nm", wavelengths_nm, "wavelengths in nm, e.g. [550.0]")
    if bandwidths_nm is None:
        return at(centres)
    centres = np.atleast_1d(centres)
    widths = numbers("bandwidths_nm", bandwidths_nm, "widths in nm, one or one each")
    if centres.ndim != 1 or widths.shape not in ((), (1,), centres.shape):
        raise InputError(
            f"bandwidths_nm has shape {widths.shape} and wavelengths_nm {centres.shape}; pass one width per band."
        )
    return photon_averages(at, points, centres, np.broadcast_to(widths, centres.shape))


def band_seen_nm(table: CameraTable) -> tuple[float, float]:
    """From the first to the last wavelength at which any filter sees anything [nm].  table : quantum_efficiency."""
    points, curves = table.wavelengths_nm, table.curves.values()
    seen = [i for i in range(len(points)) if any(curve[i] > 0 for curve in curves)]
    first, last = (seen[0], seen[-1]) if seen else (0, len(points) - 1)
    return points[max(first - 1, 0)], points[min(last + 1, len(points) - 1)]


def filter_numbers(
    tile: Sequence[Sequence[int]], shape: tuple[int, int], origin: tuple[int, int]
) -> NDArray[np.intp]:
    """Filter number of every pixel of a window, (H, W).  tile : rows of numbers that repeat over the sensor."""
    numbers_of_tile, what = np.array(tile), "(row, column) of the first pixel, e.g. (0, 0)"
    shape = require_pair("shape", shape, "(rows, columns), e.g. (480, 640)")
    origin = require_pair("origin", origin, what)
    rows = (np.arange(shape[0]) + origin[0]) % numbers_of_tile.shape[0]
    columns = (np.arange(shape[1]) + origin[1]) % numbers_of_tile.shape[1]
    return numbers_of_tile[np.ix_(rows, columns)]
