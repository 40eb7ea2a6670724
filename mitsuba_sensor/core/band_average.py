"""Averages of curves over spectral bands; exact for piecewise linear curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .types import Float64Array

Curves = Callable[[Float64Array], Float64Array]
HALF = (3 / 5) ** 0.5 / 2  # three-point Gauss rule, exact for polynomials of degree 5
NODES, WEIGHTS = np.array([0.5 - HALF, 0.5, 0.5 + HALF]), np.array([5.0, 8.0, 5.0]) / 18


def band_integrals(
    curves: Curves, points_nm: Float64Array, low_nm: Float64Array, high_nm: Float64Array
) -> Float64Array:
    """Return ∫ curves(λ) dλ from ``low_nm`` to ``high_nm``, shape (B,) each: shape (…, B).

    curves : maps (N,) wavelengths to (…, N); polynomials of degree 5 or less between neighbouring ``points_nm``.
    """
    places = np.unique(np.concatenate([points_nm, low_nm, high_nm]))
    widths = np.diff(places)
    at_nm = places[:-1, None] + widths[:, None] * NODES
    values = np.asarray(curves(at_nm.ravel()))
    pieces = (values.reshape(*values.shape[:-1], -1, NODES.size) @ WEIGHTS) * widths
    start = np.zeros((*pieces.shape[:-1], 1))
    total = np.concatenate([start, np.cumsum(pieces, axis=-1)], axis=-1)
    first, last = np.searchsorted(places, low_nm), np.searchsorted(places, high_nm)
    return np.asarray(total[..., last] - total[..., first])


def photon_averages(
    curves: Curves, points_nm: Float64Array, centres_nm: Float64Array, widths_nm: Float64Array
) -> Float64Array:
    """Return means over bands, weighted by the photons of a flat spectrum: ∫ curves·λ dλ / (λ_c·Δλ), (…, B)."""
    low, high = centres_nm - widths_nm / 2, centres_nm + widths_nm / 2
    return band_integrals(lambda nm: curves(nm) * nm, points_nm, low, high) / (
        centres_nm * (high - low)
    )
