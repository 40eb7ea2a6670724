"""Where the steps of the converter show: errors of rounding that neither noise nor shot noise hides."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.types import Float64Array

HARMONICS, CODES = 512, 8
"""Harmonics of the steps of the converter that are looked at, and codes over which electrons may keep step with one."""


def electrons_show(
    own_dn: Float64Array, sigma_e: Float64Array, dn_per_e: Float64Array, least_dn: Float64Array
) -> NDArray[np.bool_]:
    """Whether single electrons show in the codes of each pixel: whether they move the mean further than ``least_dn``.

    They do where they keep step with the codes, so that shot noise does not damp a harmonic of the steps.

    own_dn : σ of the noise behind the count.  sigma_e : σ of the count.  dn_per_e : of an electron.
    """
    shown = np.zeros(own_dn.size, bool)
    for harmonic in _harmonics_in_step(dn_per_e):
        error_dn = np.exp(-_damping(harmonic, own_dn, sigma_e, dn_per_e)) / (math.pi * harmonic)
        shown |= (error_dn > least_dn) & (harmonic * dn_per_e > 0.5)
    return shown


def rounding_error_dn(
    own_dn: Float64Array, sigma_e: Float64Array, dn_per_e: Float64Array
) -> Float64Array:
    """Largest error that rounding makes in the mean of a pixel, wherever it lies between two steps [DN]: that of the
    harmonic of the steps which is damped least (Widrow and Kollár, Quantization Noise, 2008, ch. 5)."""
    error = np.zeros(own_dn.size)
    for harmonic in (np.ones(own_dn.size), *_harmonics_in_step(dn_per_e)):
        damped = np.exp(-_damping(harmonic, own_dn, sigma_e, dn_per_e))
        error = np.maximum(error, damped / (math.pi * harmonic))
    return error


def _harmonics_in_step(dn_per_e: Float64Array) -> Iterator[Float64Array]:
    """The harmonic of the steps of the converter with which electrons keep step best, over 1, 2, … codes."""
    for codes in range(1, CODES + 1):
        harmonic = np.maximum(np.rint(codes / np.maximum(dn_per_e, 1e-9)), 1.0)
        yield np.where(harmonic <= HARMONICS, harmonic, 1.0)


def _damping(
    harmonic: Float64Array, own_dn: Float64Array, sigma_e: Float64Array, dn_per_e: Float64Array
) -> Float64Array:
    """Power of e by which a harmonic of the steps is damped: by noise behind the count, and by the count itself."""
    by_noise = 2 * (math.pi * harmonic * own_dn) ** 2
    return np.asarray(by_noise + sigma_e**2 * (1 - np.cos(2 * math.pi * harmonic * dn_per_e)))
