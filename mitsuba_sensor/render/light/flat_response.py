"""Flat responses of a film: the boxes of bands, without a table.

A specfilm evaluates all its responses at the four wavelengths of every light path. Mitsuba's spectra read two nodes of
a table for each of them, which made a film of thirty bands 1.1 to 1.3 times slower than one of a few colour filters; a
box is only a comparison. Scalar variants keep Mitsuba's spectra, because Python would be run for every path there.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from ...core import Array
from ...core.llvm import drjit
from ..variants import MitsubaObject, mitsuba


def film_response(response: Mapping[str, object]) -> MitsubaObject:
    """A Mitsuba spectrum, as a response for a film: a flat one is compared with its ends, where code is compiled."""
    mi, flat = mitsuba(), response["type"] == "regular" and len(set(str(response["values"]).split(", "))) == 1
    spectrum = mi.load_dict(dict(response))
    return _flat_class(mi.variant())(spectrum) if flat and not mi.variant().startswith("scalar") else spectrum


@cache
def _flat_class(variant: str) -> MitsubaObject:
    """The spectrum's class; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Texture

    class FlatResponse(base):  # type: ignore[misc]
        """table : the same as one of Mitsuba's spectra."""

        def __init__(self, table: MitsubaObject) -> None:
            super().__init__(mi.Properties())
            self.table = table
            self.ends_nm, self.height = [float(nm) for nm in table.wavelength_range()], float(table.max())

        def eval(self, si: MitsubaObject, active: Array = True) -> Array:
            """Its height from one end to the other, both included, 0 elsewhere: as the table has it."""
            low_nm, high_nm = self.ends_nm
            inside = (si.wavelengths >= low_nm) & (si.wavelengths <= high_nm) & active
            return dr.select(inside, mi.UnpolarizedSpectrum(self.height), 0.0)

        def wavelength_range(self) -> MitsubaObject:
            """Where it begins and ends [nm]."""
            return self.table.wavelength_range()

        def spectral_resolution(self) -> float:
            """Distance of the nodes of the table [nm], from which the film takes those of its density."""
            return float(self.table.spectral_resolution())

        def mean(self) -> Array:
            """Its height."""
            return mi.Float(self.height)

        def max(self) -> float:
            """Its height."""
            return self.height

        def traverse(self, callback: MitsubaObject) -> None:
            """It has no parameters."""

        def to_string(self) -> str:
            """For people."""
            return f"FlatResponse[{self.table}]"

    return FlatResponse
