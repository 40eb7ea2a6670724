"""Spectrum of the light that falls on a scene."""

from __future__ import annotations

from typing import NamedTuple

from .types import Float64Array


class Illuminant(NamedTuple):
    """wavelengths_nm, power : (B,) middles of bands of equal width, and relative power per wavelength in them;
    light groups of one scene have the same unit.
    """

    wavelengths_nm: Float64Array
    power: Float64Array
