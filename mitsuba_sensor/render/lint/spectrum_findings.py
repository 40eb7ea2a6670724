"""Findings about the spectra of a scene: those that end inside the bands, and values that cannot be.

Outside 360 to 830 nm Mitsuba's own emitters are zero by default, sun and sky outside 320 to 720 nm; a
table is zero outside its nodes. A reflectance above 1 makes light, and Mitsuba renders it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Float64Array
from ..infrared.materials import HELD_FROM_NM, materials
from ..infrared.rgb_colours import rgb_colours
from ..infrared.rules import ruled_colours
from ..scene.scene_edits import UNNAMED
from ..scene.scene_file import SceneFile
from ..variants import MitsubaObject, values_of
from .electron_share import share_of_flat_light
from .finding import MOST_LINES, Finding, Range, lines_of, places
from .scene_spectra import MITSUBA_NM, STRENGTHS, SUNS, Picture, SceneSpectra

TOLERANCE_NM = 1e-3
TOLERANCE = 1e-6  # of a reflectance of 1, in float32
SKIES = ("envmap", *SUNS)
INDICES = ("eta", "k")  # of metals: without them everything is reflected
FRACTIONS: tuple[str, ...] = ("reflectance", "diffuse_reflectance", "specular_reflectance")
FRACTIONS += ("specular_transmittance", "base_color", "albedo")
"""Properties of materials and media that are the share of the light that comes back."""
PERCENT, COUNTS = 100.0, 255.0
LONGEST_UM = 20.0  # end of a table that is more likely in µm than in nm
LEAST_PERCENT = (
    2.0  # the largest value of a fraction that is more likely a mistake than a percentage
)
ENDS = (
    "wavelengths",
    "range",
)  # what tells where a table ends: its wavelengths, or the first and last
VALUES = ("value", "values")
GIVE_MATERIALS = "give measured spectra, or the material, e.g. --infrared 'leaf_*=vegetation'"
ANOTHER = "load it with more data, or pass the scene as a path, as XML text or as a dict"


class Band(NamedTuple):
    """The wavelengths of all bands together, and the camera that they are for, where it is known."""

    low_nm: float
    high_nm: float
    camera: Camera | None = None

    def is_inside(self, data_nm: Range) -> bool:
        """Whether there are data in the whole band."""
        return (
            data_nm[0] <= self.low_nm + TOLERANCE_NM
            and data_nm[1] >= self.high_nm - TOLERANCE_NM
        )

    def beyond(self, data_nm: Range) -> str:
        """Where the bands are, and how much the camera detects where there are no data."""
        extent = f"the bands extend from {self.low_nm:g} to {self.high_nm:g} nm"
        if self.camera is None:
            return extent
        return extent + share_of_flat_light(self.camera, (self.low_nm, self.high_nm), data_nm)


def spectrum_findings(scene: SceneFile, spectra: SceneSpectra, band: Band) -> Iterator[Finding]:
    """Spectra that end inside the bands, floats that mean D65, and values that cannot be."""
    checks = (_incomplete, _metals, _colours, _textured_lights, _float_lights, _impossible)
    return chain.from_iterable(check(scene, spectra, band) for check in checks)


def _incomplete(scene: SceneFile, spectra: SceneSpectra, band: Band) -> Iterator[Finding]:
    lights = [(node, "light", data_nm) for node, data_nm in spectra.lights]
    incomplete: dict[tuple[str, Range, str], list[MitsubaObject]] = {}
    for node, name, data_nm in chain(lights, spectra.materials):
        if not band.is_inside(data_nm):
            key = (name, data_nm, _more_data(node, data_nm, band))
            incomplete.setdefault(key, []).append(node)
    for (name, data_nm, remedy), nodes in incomplete.items():
        label = name if name == "light" else repr(name)
        where = f"outside {data_nm[0]:g} to {data_nm[1]:g} nm"
        if name in INDICES:
            what = f"{label} in {places(len(nodes))} is 0 {where}, where a metal then reflects everything or is NaN"
            yield Finding(
                "wrong",
                lines_of(scene, nodes),
                f"{what}; {band.beyond(data_nm)}",
                remedy,
                data_nm,
            )
        else:
            what = f"{label} in {places(len(nodes))} is black {where}; {band.beyond(data_nm)}"
            yield Finding("black", lines_of(scene, nodes), what, remedy, data_nm)


def _more_data(node: MitsubaObject, data_nm: Range, band: Band) -> str:
    """What to do about a spectrum that ends."""
    if data_nm[1] < LONGEST_UM:
        return "if its wavelengths are in µm, multiply them by 1000: Mitsuba reads nm"
    if (kind := node.props.plugin_name()) in SKIES:
        return f"{kind!r} has no more data: add another light from {band.low_nm:g} to {band.high_nm:g} nm"
    return f"give it pairs of wavelength and value from {band.low_nm:g} to {band.high_nm:g} nm"


def _metals(scene: SceneFile, spectra: SceneSpectra, band: Band) -> Iterator[Finding]:
    short: dict[tuple[str, Range], list[MitsubaObject]] = {}
    for node, material, data_nm in spectra.metals:
        if not band.is_inside(data_nm):
            short.setdefault((material, data_nm), []).append(node)
    for (material, data_nm), nodes in short.items():
        ends = f"{data_nm[0]:.5g} to {data_nm[1]:.5g} nm"
        what = f"Mitsuba's table of {material!r} in {places(len(nodes))} has {ends}; {band.beyond(data_nm)}"
        remedy = (
            "its first and last values are held beyond; give eta and k if you know them there"
        )
        yield Finding("note", lines_of(scene, nodes), what, remedy, data_nm)


def _colours(scene: SceneFile, spectra: SceneSpectra, band: Band) -> Iterator[Finding]:
    """What rgb colours are at wavelengths that nobody sees: a rule beyond 700 nm, guesses of Mitsuba below 360 nm."""
    by_material: dict[str | None, list[MitsubaObject]] = {}
    for colour, material in ruled_colours(scene, scene.edits.infrared, band.high_nm):
        by_material.setdefault(material and material.name, []).append(colour.node)
    for name, nodes in by_material.items():
        rule, remedy = f"keeps its value at {HELD_FROM_NM:g} nm", GIVE_MATERIALS
        if name is not None:
            rule, remedy = f"is {name!r}", f"measured: {materials()[name].source}"
        rgb = f"rgb in {places(len(nodes))}"
        data_nm = (0.0, HELD_FROM_NM)
        what = f"beyond {HELD_FROM_NM:g} nm {rgb} {rule}; {band.beyond(data_nm)}"
        yield Finding("note", lines_of(scene, nodes), what, remedy, data_nm, f"{rgb} {rule}")
    low, _ = MITSUBA_NM
    colours = [colour.node for colour in rgb_colours(scene)] if band.low_nm < low else []
    if colours:
        what = f"rgb in {places(len(colours))} is extrapolated below {low:g} nm, to 0 or to 1"
        what = f"{what}; {band.beyond((low, math.inf))}"
        yield Finding(
            "wrong", lines_of(scene, colours), what, "give measured spectra", (low, math.inf)
        )


def _textured_lights(scene: SceneFile, spectra: SceneSpectra, _: Band) -> Iterator[Finding]:
    """Lights whose strength is a texture of RGB: Mitsuba multiplies <rgb> and envmap by D65, and these by nothing."""
    colours = [one for one in rgb_colours(scene) if one.role in STRENGTHS]
    if nodes := list({id(one.node): one.node for one in colours}.values()):
        what = (
            f"a texture as a light in {places(len(nodes))} is not multiplied by D65, as <rgb> is: its white is flat, "
            f"and it shines beyond {MITSUBA_NM[1]:g} nm"
        )
        remedy = "give the light <rgb> or <spectrum> where that matters"
        yield Finding("note", lines_of(scene, nodes), what, remedy)


def _float_lights(scene: SceneFile, spectra: SceneSpectra, _: Band) -> Iterator[Finding]:
    """Floats that mean D65 (#1579)."""
    if spectra.float_lights:
        what = f"a float in {places(len(spectra.float_lights))} gives the spectrum of D65, not a flat one"
        remedy = 'write <spectrum name="radiance" value="..."/> for the same value at every wavelength'
        yield Finding("wrong", lines_of(scene, spectra.float_lights), what, remedy)


class Extremes(NamedTuple):
    """The smallest and largest finite value of a spectrum in the bands.

    not_finite, negative : how many values are NaN or infinite, and how many below 0.
    is_clamped : whether Mitsuba takes 0 or 1 for what is outside.
    """

    node: MitsubaObject
    name: str
    least: float
    largest: float
    not_finite: int
    negative: int
    is_clamped: bool


def _extremes(
    nodes: Iterable[MitsubaObject], spectra: SceneSpectra, band: Band
) -> Iterator[Extremes]:
    for node in nodes:
        for name, numbers in spectra.numbers_of_node(node):
            if isinstance(numbers, Picture):
                values, is_clamped = numbers.values, numbers.values.shape[1] > 1
            else:
                values, is_clamped = numbers.between(band.low_nm, band.high_nm), False
            finite = values[np.isfinite(values)]
            ends = (float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf)))
            counts = (values.size - finite.size, int((finite < 0).sum()))
            yield Extremes(node, name, *ends, *counts, is_clamped)


def _impossible(scene: SceneFile, spectra: SceneSpectra, band: Band) -> Iterator[Finding]:
    """Surfaces and media that return more light than they receive, negative light, and NaN."""
    surfaces = list(_extremes(spectra.surfaces, spectra, band))
    lights = list(_extremes(spectra.emitters, spectra, band))
    fractions = [values for values in (*surfaces, *lights) if values.name in FRACTIONS]
    strengths = [values for values in lights if values.name in STRENGTHS]
    for is_clamped in (False, True):
        effect = (
            "Mitsuba takes 1 instead" if is_clamped else "more light is sent out than comes in"
        )
        too_large = [
            v for v in fractions if v.largest > 1 + TOLERANCE and v.is_clamped == is_clamped
        ]
        for name, same in _by_name(too_large):
            largest = max(values.largest for values in same)
            what = f"{name!r} in {places(len(same))} is as large as {largest:g}: {effect}"
            yield Finding("wrong", _lines(scene, same), what, remedy_of_fraction(largest))
    clamped = [v for v in strengths if v.largest > 1 + TOLERANCE and v.is_clamped]
    for name, same in _by_name(clamped):
        largest = max(values.largest for values in same)
        what = f"{name!r} in {places(len(same))} is a picture as large as {largest:g}: Mitsuba takes 1 instead"
        remedy = f"divide it and all other lights by {largest:g}"
        yield Finding("wrong", _lines(scene, same), what, remedy)
    for name, same in _by_name(
        [values for values in (*fractions, *strengths) if values.least < 0]
    ):
        least = min(values.least for values in same)
        count = sum(values.negative for values in same)
        few = f"{count} value(s) below 0, as small as {least:g}"
        what = f"{name!r} in {places(len(same))} has {few}: no light is negative"
        yield Finding("wrong", _lines(scene, same), what, "give values of 0 and more")
    for name, same in _by_name(
        [values for values in (*surfaces, *lights) if values.not_finite]
    ):
        what = f"{name!r} in {places(len(same))} has {sum(v.not_finite for v in same)} values that are not finite"
        yield Finding("wrong", _lines(scene, same), what, "give it finite values")


def _by_name(extremes: Iterable[Extremes]) -> Iterator[tuple[str, list[Extremes]]]:
    groups: dict[str, list[Extremes]] = {}
    for values in extremes:
        groups.setdefault(values.name, []).append(values)
    yield from groups.items()


def _lines(scene: SceneFile, extremes: Iterable[Extremes]) -> str:
    return lines_of(scene, [values.node for values in extremes])


def remedy_of_fraction(largest: float) -> str:
    """What to do with a fraction above 1."""
    if largest <= LEAST_PERCENT or largest > COUNTS:
        return "give values from 0 to 1"
    if largest <= PERCENT:
        return "if it is in percent, divide it by 100"
    return "if it counts from 0 to 255, divide it by 255"


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
    for key, value in values_of(world):
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
