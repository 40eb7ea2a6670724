"""Refractive indices of the metals that Mitsuba knows by name, continued where its tables end.

The tables of Mitsuba 3.9 extend from about 300 to between 590 and 900 nm. Outside it takes η = k = 0,
which reflects everything, or is NaN at normal incidence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core import Float64Array
from ..variants import MitsubaObject, mitsuba
from .finding import Range

METALS = ("conductor", "roughconductor")  # materials that take the name of a metal
PARTS = ("eta", "k")


class MetalTable(NamedTuple):
    """Wavelengths [nm], η and k of a metal, (N,) each."""

    wavelengths_nm: Float64Array
    eta: Float64Array
    k: Float64Array

    @property
    def ends_nm(self) -> Range:
        """Its first and its last wavelength."""
        return float(self.wavelengths_nm[0]), float(self.wavelengths_nm[-1])

    def continued(self, low_nm: float, high_nm: float) -> MetalTable:
        """The table with its first and its last values held as far as two wavelengths."""
        first, last = self.ends_nm
        below, above = [low_nm] * (low_nm < first), [high_nm] * (high_nm > last)
        edges = (len(below), len(above))
        wavelengths_nm = np.concatenate([below, self.wavelengths_nm, above])
        eta, k = (np.pad(values, edges, mode="edge") for values in (self.eta, self.k))
        return MetalTable(wavelengths_nm, eta, k)


def metal_table(material: object) -> MetalTable | None:
    """Mitsuba's table of a metal; None for a name that it does not know, or that has none ("none")."""
    if not isinstance(material, str):
        return None
    mi = mitsuba()
    try:
        parameters = mi.traverse(mi.load_dict({"type": METALS[0], "material": material}))
    except RuntimeError:  # said again, with its place in the file, when the scene is built
        return None
    if "eta.wavelengths" not in parameters:
        return None
    names = ("eta.wavelengths", "eta.values", "k.values")
    return MetalTable(*(np.array(parameters[name], dtype=np.float64) for name in names))


def continue_metals(nodes: list[MitsubaObject], low_nm: float, high_nm: float) -> None:
    """Replace the names of metals whose tables end between two wavelengths by tables that do not.

    nodes : the materials of a parsed scene, which are changed.
    """
    for node in nodes:
        props = node.props
        if props.plugin_name() not in METALS or any(name in props for name in PARTS):
            continue
        table = metal_table(props.get("material", None))
        if table is None or (table.ends_nm[0] <= low_nm and table.ends_nm[1] >= high_nm):
            continue
        longer = table.continued(low_nm, high_nm)
        del props["material"]
        for name in PARTS:
            props[name] = _spectrum(longer.wavelengths_nm, getattr(longer, name))


def _spectrum(wavelengths_nm: Float64Array, values: Float64Array) -> MitsubaObject:
    """A Mitsuba spectrum of these points, linear in between."""
    texts = {"wavelengths": wavelengths_nm, "values": values}
    listed = {name: ", ".join(map(repr, numbers.tolist())) for name, numbers in texts.items()}
    return mitsuba().load_dict({"type": "irregular", **listed})
