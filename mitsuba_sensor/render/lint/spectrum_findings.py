"""Checks of the spectra of a scene: those that end inside the bands, and values that cannot be.

Outside 360 to 830 nm Mitsuba's own emitters are zero by default, sun and sky outside 320 to 720 nm; a table is zero
outside its nodes. A reflectance above 1 makes light, and Mitsuba renders it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import NamedTuple, TypeAlias

import numpy as np

from ..infrared.materials import HELD_FROM_NM, materials
from ..infrared.rgb_colours import rgb_colours
from ..infrared.rules import ruled_colours
from ..samples import MITSUBA_NM
from ..scene.scene_edits import UNNAMED
from ..variants import MitsubaObject, values_of
from .finding import NAMED_MAX, Finding, Range, places
from .scene_spectra import INDICES, STRENGTHS, SUNS
from .subject import Subject

TOLERANCE = 1e-6  # of a reflectance of 1, in float32
SKIES = ("envmap", *SUNS)
FRACTIONS = (
    "reflectance",
    "diffuse_reflectance",
    "specular_reflectance",
    "specular_transmittance",
    "base_color",
    "albedo",
)
"""Properties of materials and media that are the share of the light that comes back."""
PERCENT = 100.0
COUNTS = 255.0
MICROMETRES_MAX = 20.0  # end of a table that is more likely in µm than in nm
PERCENT_MIN = 2.0  # largest value of a fraction that is more likely a mistake than a percentage
ENDS = ("wavelengths", "range")  # parameters that tell where a table ends
VALUES = ("value", "values")
LOADED_REMEDY = "load it with more data, or pass the scene as a path, as XML text or as a dict"

Found: TypeAlias = Iterator[Finding]


def incomplete(subject: Subject) -> Found:
    """Lights and materials whose spectra end inside the bands."""
    low_nm, high_nm = subject.band_nm
    lights = [(node, "light", data_nm) for node, data_nm in subject.spectra.lights]
    ending: dict[tuple[str, Range, str], list[MitsubaObject]] = {}
    for node, name, data_nm in chain(lights, subject.spectra.materials):
        if not subject.is_covered_by(data_nm):
            remedy = f"give it pairs of wavelength and value from {low_nm:g} to {high_nm:g} nm"
            if data_nm[1] < MICROMETRES_MAX:
                remedy = "if its wavelengths are in µm, multiply them by 1000: Mitsuba reads nm"
            elif (kind := node.props.plugin_name()) in SKIES:
                remedy = f"{kind!r} has no more data: add another light from {low_nm:g} to {high_nm:g} nm"
            ending.setdefault((name, data_nm, remedy), []).append(node)
    for (name, data_nm, remedy), nodes in ending.items():
        label = name if name == "light" else repr(name)
        yield _ending(
            subject, f"{label} in {places(len(nodes))}", subject.lines(nodes), data_nm, remedy
        )


def _ending(subject: Subject, what: str, where: str, data_nm: Range, remedy: str) -> Finding:
    """A spectrum that ends: black, but for the indices of a metal, without which everything is reflected."""
    outside = f"outside {data_nm[0]:.5g} to {data_nm[1]:.5g} nm"
    if what.split("'")[1:2] in ([name] for name in INDICES):
        what = f"{what} is 0 {outside}, where a metal then reflects everything or is NaN"
        return Finding("wrong", where, f"{what}; {subject.beyond(data_nm)}", remedy, data_nm)
    what = f"{what} is black {outside}; {subject.beyond(data_nm)}"
    return Finding("black", where, what, remedy, data_nm)


def metals(subject: Subject) -> Found:
    """Metals whose tables end inside the bands."""
    short: dict[tuple[str, Range], list[MitsubaObject]] = {}
    for node, material, data_nm in subject.spectra.metals:
        if not subject.is_covered_by(data_nm):
            short.setdefault((material, data_nm), []).append(node)
    for (material, data_nm), nodes in short.items():
        ends = f"{data_nm[0]:.5g} to {data_nm[1]:.5g} nm"
        what = f"Mitsuba's table of {material!r} in {places(len(nodes))} has {ends}; {subject.beyond(data_nm)}"
        remedy = (
            "its first and last values are held beyond; give eta and k if you know them there"
        )
        yield Finding("note", subject.lines(nodes), what, remedy, data_nm)


def colours(subject: Subject) -> Found:
    """What rgb colours are at wavelengths that nobody sees: a rule beyond 700 nm, guesses of Mitsuba below 360 nm."""
    scene, (low_nm, high_nm) = subject.scene, subject.band_nm
    by_material: dict[str | None, list[MitsubaObject]] = {}
    for colour, material in ruled_colours(scene, scene.edits.infrared, high_nm):
        by_material.setdefault(material and material.name, []).append(colour.node)
    for name, nodes in by_material.items():
        rule = f"keeps its value at {HELD_FROM_NM:g} nm"
        remedy = "give measured spectra, or the material, e.g. --infrared 'leaf_*=vegetation'"
        if name is not None:
            rule, remedy = f"is {name!r}", f"measured: {materials()[name].source}"
        rgb, data_nm = f"rgb in {places(len(nodes))}", (0.0, HELD_FROM_NM)
        what = f"beyond {HELD_FROM_NM:g} nm {rgb} {rule}; {subject.beyond(data_nm)}"
        yield Finding("note", subject.lines(nodes), what, remedy, data_nm, f"{rgb} {rule}")
    first_nm = MITSUBA_NM[0]
    nodes = [colour.node for colour in rgb_colours(scene)] if low_nm < first_nm else []
    if nodes:
        data_nm = (first_nm, math.inf)
        what = (
            f"rgb in {places(len(nodes))} is extrapolated below {first_nm:g} nm, to 0 or to 1"
        )
        what = f"{what}; {subject.beyond(data_nm)}"
        yield Finding("wrong", subject.lines(nodes), what, "give measured spectra", data_nm)


def textured_lights(subject: Subject) -> Found:
    """Lights whose strength is a texture of RGB: Mitsuba multiplies <rgb> and envmap by D65, and these by nothing."""
    of_lights = [one for one in rgb_colours(subject.scene) if one.role in STRENGTHS]
    if nodes := list({id(one.node): one.node for one in of_lights}.values()):
        what = (
            f"a texture as a light in {places(len(nodes))} is not multiplied by D65, as <rgb> is: its white is flat, "
            f"and it shines beyond {MITSUBA_NM[1]:g} nm"
        )
        remedy = "give the light <rgb> or <spectrum> where that matters"
        yield Finding("note", subject.lines(nodes), what, remedy)


def float_lights(subject: Subject) -> Found:
    """Floats that mean D65 (#1579)."""
    if nodes := subject.spectra.float_lights:
        what = f"a float in {places(len(nodes))} gives the spectrum of D65, not a flat one"
        remedy = 'write <spectrum name="radiance" value="..."/> for the same value at every wavelength'
        yield Finding("wrong", subject.lines(nodes), what, remedy)


class Extremes(NamedTuple):
    """The smallest and largest finite value of a spectrum in the bands.

    infinite_count, negative_count : how many values are NaN or infinite, and how many below 0.
    is_clamped : whether Mitsuba takes 0 or 1 for what is outside.
    """

    node: MitsubaObject
    name: str
    least: float
    largest: float
    infinite_count: int
    negative_count: int
    is_clamped: bool


def impossible_values(subject: Subject) -> Found:
    """Surfaces and media that return more light than they receive, negative light, and NaN."""
    surfaces = list(_extremes(subject, subject.spectra.surfaces))
    lights = list(_extremes(subject, subject.spectra.emitters))
    fractions = [one for one in (*surfaces, *lights) if one.name in FRACTIONS]
    strengths = [one for one in lights if one.name in STRENGTHS]
    large = [one for one in fractions if one.largest > 1 + TOLERANCE]
    bright = [one for one in strengths if one.largest > 1 + TOLERANCE and one.is_clamped]
    emitting = [one for one in large if not one.is_clamped]
    for where, name, same in _by_name(subject, emitting):
        largest = max(one.largest for one in same)
        what = f"{name} is as large as {largest:g}: more light is sent out than comes in"
        yield Finding("wrong", where, what, remedy_of_fraction(largest))
    clamped = [one for one in large if one.is_clamped]
    for where, name, same in _by_name(subject, clamped):
        largest = max(one.largest for one in same)
        what = f"{name} is as large as {largest:g}: Mitsuba takes 1 instead"
        yield Finding("wrong", where, what, remedy_of_fraction(largest))
    for where, name, same in _by_name(subject, bright):
        largest = max(one.largest for one in same)
        what = f"{name} is a picture as large as {largest:g}: Mitsuba takes 1 instead"
        yield Finding("wrong", where, what, f"divide it and all other lights by {largest:g}")
    negative = [one for one in (*fractions, *strengths) if one.least < 0]
    for where, name, same in _by_name(subject, negative):
        count, least = sum(one.negative_count for one in same), min(one.least for one in same)
        what = (
            f"{name} has {count} value(s) below 0, as small as {least:g}: no light is negative"
        )
        yield Finding("wrong", where, what, "give values of 0 and more")
    infinite = [one for one in (*surfaces, *lights) if one.infinite_count]
    for where, name, same in _by_name(subject, infinite):
        what = (
            f"{name} has {sum(one.infinite_count for one in same)} values that are not finite"
        )
        yield Finding("wrong", where, what, "give it finite values")


def _extremes(subject: Subject, nodes: Iterable[MitsubaObject]) -> Iterator[Extremes]:
    for node in nodes:
        for name, numbers in subject.spectra.numbers_of_node(node):
            values = numbers.between(*subject.band_nm)
            finite = values[np.isfinite(values)]
            ends = (float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf)))
            counts = (values.size - finite.size, int((finite < 0).sum()))
            is_clamped = values.ndim == 2 and values.shape[1] > 1
            yield Extremes(node, name, *ends, *counts, is_clamped)


def _by_name(
    subject: Subject, extremes: Iterable[Extremes]
) -> Iterator[tuple[str, str, list[Extremes]]]:
    """(lines, "'reflectance' in 2 places", these values) of each property."""
    groups: dict[str, list[Extremes]] = {}
    for one in extremes:
        groups.setdefault(one.name, []).append(one)
    for name, same in groups.items():
        nodes = [one.node for one in same]
        yield subject.lines(nodes), f"{name!r} in {places(len(same))}", same


def remedy_of_fraction(largest: float) -> str:
    """What to do with a fraction above 1."""
    if largest <= PERCENT_MIN or largest > COUNTS:
        return "give values from 0 to 1"
    if largest <= PERCENT:
        return "if it is in percent, divide it by 100"
    return "if it counts from 0 to 255, divide it by 255"


def loaded_spectra(subject: Subject, world: MitsubaObject) -> Found:
    """Spectra of a loaded scene, by its parameters; pictures and colours are not looked at."""
    short: dict[tuple[str, Range], list[str]] = {}
    large = list[Finding]()
    for key, value in values_of(world):
        *place, part = key.split(".")
        if part not in (*ENDS, *VALUES) or "film" in place or "Color3" in type(value).__name__:
            continue
        name = [part for part in place if part != "d65"][-1]
        numbers = np.ravel(np.array(value, dtype=np.float64))
        if part in ENDS and numbers.size:
            data_nm = (float(numbers.min()), float(numbers.max()))
            if not subject.is_covered_by(data_nm):
                short.setdefault((name, data_nm), []).append(".".join(place))
        largest = float(numbers.max(initial=0.0))
        if part in VALUES and name in FRACTIONS and largest > 1 + TOLERANCE:
            what = f"{name!r} is as large as {largest:g}: more light is sent out than comes in"
            remedy = remedy_of_fraction(largest)
            large.append(Finding("wrong", _named([".".join(place)]), what, remedy))
    for (name, data_nm), named in short.items():
        what = f"{name!r} in {places(len(named))}"
        yield _ending(subject, what, _named(named), data_nm, LOADED_REMEDY)
    yield from large


def _named(parameters: list[str]) -> str:
    """The names of the first few parameters; elements without an id have a new one in each run."""
    few = [UNNAMED.sub("an element without an id", name) for name in parameters[:NAMED_MAX]]
    more = f" and {len(parameters) - NAMED_MAX} more" if len(parameters) > NAMED_MAX else ""
    return ", ".join(dict.fromkeys(few)) + more
