"""Spectra of a scene that Mitsuba has loaded, by its parameters: those that end, and values above 1."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...core import Float64Array
from ..scene.scene_edits import UNNAMED
from ..variants import MitsubaObject, mitsuba
from .finding import MOST_LINES, Finding, Range, places
from .spectrum_findings import FRACTIONS, INDICES, Band, remedy_of_fraction

TOLERANCE = 1e-6  # of a reflectance of 1, in float32
ENDS = ("wavelengths", "range")  # what tells where a table ends: its wavelengths, or the first and last
VALUES = ("value", "values")
ANOTHER = "load it with more data, or pass the scene as a path, as XML text or as a dict"


class Parameter(NamedTuple):
    """A parameter of a loaded scene.

    place : its name in ``mi.traverse`` without the last part.  name : what the spectrum is for.
    part : the last part.  numbers : (N,).
    """

    place: str
    name: str
    part: str
    numbers: Float64Array


def loaded_findings(world: MitsubaObject, band: Band) -> Iterator[Finding]:
    """Findings about the spectra of a loaded scene; pictures and colours are not looked at."""
    parameters = list(_spectra(world))
    short: dict[tuple[str, Range], list[str]] = {}
    for parameter in parameters:
        if parameter.part in ENDS and parameter.numbers.size:
            data_nm = (float(parameter.numbers.min()), float(parameter.numbers.max()))
            if not band.is_inside(data_nm):
                short.setdefault((parameter.name, data_nm), []).append(parameter.place)
    for (name, data_nm), named in short.items():
        where = f"outside {data_nm[0]:.5g} to {data_nm[1]:.5g} nm; {band.beyond(data_nm)}"
        if name in INDICES:
            what = f"{name!r} in {places(len(named))} is 0, which reflects everything or is NaN, {where}"
            yield Finding("wrong", _named(named), what, ANOTHER, data_nm)
        else:
            what = f"{name!r} in {places(len(named))} is black {where}"
            yield Finding("black", _named(named), what, ANOTHER, data_nm)
    for parameter in parameters:
        largest = float(parameter.numbers.max(initial=0.0))
        if parameter.part in VALUES and parameter.name in FRACTIONS and largest > 1 + TOLERANCE:
            what = f"{parameter.name!r} is as large as {largest:g}: more light is sent out than comes in"
            yield Finding("wrong", _named([parameter.place]), what, remedy_of_fraction(largest))


def _spectra(world: MitsubaObject) -> Iterator[Parameter]:
    """The parameters of spectra, without those of films and without colours, whose numbers are no values."""
    for key, value in mitsuba().traverse(world):
        parts = key.split(".")
        is_colour = "Color3" in type(value).__name__
        if parts[-1] in (*ENDS, *VALUES) and "film" not in parts and not is_colour:
            names = [part for part in parts[:-1] if part != "d65"]
            numbers = np.ravel(np.array(value, dtype=np.float64))
            yield Parameter(".".join(parts[:-1]), names[-1], parts[-1], numbers)


def _named(parameters: list[str]) -> str:
    """The names of the first few parameters; elements without an id have a new one in each run."""
    few = [UNNAMED.sub("an element without an id", name) for name in parameters[:MOST_LINES]]
    more = f" and {len(parameters) - MOST_LINES} more" if len(parameters) > MOST_LINES else ""
    return ", ".join(dict.fromkeys(few)) + more
