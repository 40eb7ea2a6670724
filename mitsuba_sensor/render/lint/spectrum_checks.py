"""Checks of the spectra of a scene: spectra that end inside the bands, and impossible values; and the fraction of the
photoelectrons that is detected where data end.

Mitsuba's emitters are zero outside 360 to 830 nm by default, sun and sky outside 320 to 720 nm; a table is zero outside
its nodes. Mitsuba renders reflectances above 1, which create light.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Caution
from ..light.irradiance import Irradiance
from ..light.photons import photons_per_irradiance
from ..samples import MITSUBA_NM
from ..scene.asked import HELD_FROM_NM, materials
from ..scene.scene_edits import UNNAMED
from ..variants import MitsubaObject, values_of
from .finding import NAMED_MAX, Built, Finding, Found, Subject, largest_share, places
from .infrared import rgb_colours, ruled_colours
from .spectra import INDICES, STRENGTHS, SUNS, Range, metals_of, values_of_part

TOLERANCE = 1e-6  # of a reflectance of 1, in float32
SKIES = ("envmap", *SUNS)
FRACTIONS = (
    *("reflectance", "diffuse_reflectance", "specular_reflectance", "specular_transmittance"),
    *("base_color", "albedo"),
)
"""Properties of materials and media that are fractions of the incident light."""
MICROMETRES_MAX = 20.0  # end of a table that is more likely in µm than in nm
PERCENT_MIN, PERCENT_MAX = 2.0, 100.0  # largest values that are more likely in percent
COUNTS_MAX = 255.0
SHARE_MIN = 1e-3  # of the photoelectrons of a filter; less is not reported


def incomplete(subject: Subject) -> Found:
    """Yield lights and materials whose spectra end inside the bands."""
    low_nm, high_nm = subject.band_nm
    spectra = [(node, "light", data_nm) for node, data_nm in subject.lights]
    spectra += [(x.node, repr(x.role), x.data_nm) for x in subject.properties if not x.is_light]
    ending: dict[tuple[str, Range, str], list[MitsubaObject]] = {}
    for node, name, data_nm in spectra:
        if not subject.is_covered_by(data_nm):
            remedy = f"give it pairs of wavelength and value from {low_nm:g} to {high_nm:g} nm"
            if data_nm[1] < MICROMETRES_MAX:
                remedy = "if its wavelengths are in µm, multiply them by 1000: Mitsuba reads nm"
            elif (kind := node.props.plugin_name()) in SKIES:
                remedy = f"{kind!r} has no other data: add another light from {low_nm:g} to {high_nm:g} nm"
            ending.setdefault((name, data_nm, remedy), []).append(node)
    for (name, data_nm, remedy), nodes in ending.items():
        yield _ending(subject, name, len(nodes), subject.lines(nodes), data_nm, remedy)


def _ending(
    subject: Subject, name: str, count: int, where: str, data_nm: Range, remedy: str
) -> Finding:
    """Return the finding of a spectrum that ends: black, or a metal without indices, which reflects everything."""
    is_index = name.strip("'") in INDICES
    ends = f"outside {data_nm[0]:.5g} to {data_nm[1]:.5g} nm"
    what = f"{name} in {places(count)} is {0 if is_index else 'black'} {ends}"
    if is_index:
        what += ", where a metal then reflects everything or is NaN"
    what = f"{what}; {subject.beyond(data_nm)}"
    return Finding("wrong" if is_index else "black", where, what, remedy, data_nm)


def metals(subject: Subject) -> Found:
    """Yield metals whose tables end inside the bands."""
    short: dict[tuple[str, Range], list[MitsubaObject]] = {}
    for node, table in metals_of(subject.scene):
        data_nm = float(table["wavelengths"][0]), float(table["wavelengths"][-1])
        if not subject.is_covered_by(data_nm):
            short.setdefault((node.props["material"], data_nm), []).append(node)
    for (material, data_nm), nodes in short.items():
        ends = f"{data_nm[0]:.5g} to {data_nm[1]:.5g} nm"
        table_of = f"Mitsuba's table of {material!r} in {places(len(nodes))}"
        what = f"{table_of} has {ends}; {subject.beyond(data_nm)}"
        remedy = (
            "its first and last values are held beyond; give eta and k there if you know them"
        )
        yield Finding("note", subject.lines(nodes), what, remedy, data_nm, f"{table_of} ends")


def colours(subject: Subject) -> Found:
    """Yield the rules of RGB colours beyond 700 nm, colours that Mitsuba extrapolates below 360 nm, and textures as
    lights, which Mitsuba does not multiply by D65 as it does <rgb> and envmap."""
    scene, (low_nm, high_nm) = subject.scene, subject.band_nm
    by_material: dict[str | None, list[MitsubaObject]] = {}
    for colour, material in ruled_colours(scene, subject.properties, high_nm):
        by_material.setdefault(material and material.name, []).append(colour.node)
    for name, nodes in by_material.items():
        rule = f"keeps its value at {HELD_FROM_NM:g} nm"
        remedy = (
            "give measured spectra, or the material, e.g. infrared={'leaf_*': 'vegetation'}"
        )
        if name is not None:
            rule, remedy = f"is {name!r}", f"measured: {materials()[name].source}"
        rgb, data_nm = f"rgb in {places(len(nodes))}", (0.0, HELD_FROM_NM)
        what = f"beyond {HELD_FROM_NM:g} nm {rgb} {rule}; {subject.beyond(data_nm)}"
        yield Finding("note", subject.lines(nodes), what, remedy, data_nm, f"{rgb} {rule}")
    all_colours, first_nm = rgb_colours(scene, subject.properties), MITSUBA_NM[0]
    if all_colours and low_nm < first_nm:
        nodes, data_nm = [colour.node for colour in all_colours], (first_nm, math.inf)
        what = (
            f"rgb in {places(len(nodes))} is extrapolated below {first_nm:g} nm, to 0 or to 1"
        )
        what = f"{what}; {subject.beyond(data_nm)}"
        yield Finding("wrong", subject.lines(nodes), what, "give measured spectra", data_nm)
    of_lamps = [x.node for x in all_colours if x.is_light and x.role in STRENGTHS]
    if lamps := list({id(node): node for node in of_lamps}.values()):
        what = (
            f"a texture as a light in {places(len(lamps))} is not multiplied by D65, unlike <rgb>: its white is flat, "
            f"and it shines beyond {MITSUBA_NM[1]:g} nm"
        )
        remedy = "give the light <rgb> or <spectrum> if that matters"
        yield Finding("note", subject.lines(lamps), what, remedy)


def float_lights(subject: Subject) -> Found:
    """Yield floats that mean D65 (#1579)."""
    strengths = [x for x in subject.properties if x.is_light and x.role in STRENGTHS]
    nodes = [x.node for x in strengths if x.is_number and x.parts[0].kind == "float"]
    if nodes:
        what = f"a float in {places(len(nodes))} gives the spectrum of D65, not a flat one"
        remedy = 'write <spectrum name="radiance" value="..."/> for the same value at every wavelength'
        yield Finding("wrong", subject.lines(nodes), what, remedy)


MORE_LIGHT = "{} is as large as {:g}: more light is sent out than comes in"
IMPOSSIBLE = {
    "large": MORE_LIGHT,
    "clamped": "{} is as large as {:g}: Mitsuba takes 1 instead",
    "bright": "{} is a picture as large as {:g}: Mitsuba takes 1 instead",
    "negative": "{} has {count} value(s) below 0, as small as {:g}: no light is negative",
    "infinite": "{} has {count} values that are not finite",
}
"""Fault → its description, with the worst value and the number of values."""


def impossible_values(subject: Subject) -> Found:
    """Yield surfaces and media that return more light than they receive, negative light, and NaN."""
    faults: dict[tuple[str, str], list[tuple[MitsubaObject, float, int]]] = {}
    for node, _, role, is_light, parts in subject.properties:
        is_fraction, is_strength = role in FRACTIONS, is_light and role in STRENGTHS
        for part in parts:
            values = values_of_part(subject.scene, part, subject.band_nm)
            finite = values[np.isfinite(values)]
            largest, least = finite.max(initial=-np.inf), finite.min(initial=np.inf)
            is_clamped = values.ndim == 2 and values.shape[1] > 1
            if largest > 1 + TOLERANCE and (is_fraction or (is_strength and is_clamped)):
                fault = "clamped" if is_clamped else "large"
                fault = "bright" if is_strength else fault
                faults.setdefault((fault, role), []).append((node, largest, 1))
            if least < 0 and (is_fraction or is_strength):
                count = int((finite < 0).sum())
                faults.setdefault(("negative", role), []).append((node, least, count))
            if count := values.size - finite.size:
                faults.setdefault(("infinite", role), []).append((node, 0.0, count))
    for (fault, role), hits in faults.items():
        nodes, worst, counts = zip(*hits, strict=True)
        value = float(max(worst, key=abs))
        name = f"{role!r} in {places(len(nodes))}"
        what = IMPOSSIBLE[fault].format(name, value, count=sum(counts))
        remedies = {
            "bright": f"divide it and all other lights by {value:g}",
            "negative": "give values of 0 and more",
            "infinite": "give it finite values",
        }
        remedy = remedies.get(fault) or _remedy_of_fraction(value)
        yield Finding("wrong", subject.lines(nodes), what, remedy)


def _remedy_of_fraction(largest: float) -> str:
    """Return what to do with a fraction above 1."""
    if largest <= PERCENT_MIN or largest > COUNTS_MAX:
        return "give values from 0 to 1"
    if largest <= PERCENT_MAX:
        return "if it is in percent, divide it by 100"
    return "if it ranges from 0 to 255, divide it by 255"


def spectra_of_loaded(subject: Subject, built: Built) -> Found:
    """Yield spectra of a loaded scene, by its parameters; images and colours are not checked."""
    short: dict[tuple[str, Range], list[str]] = {}
    for key, value in values_of(built.world) if subject.scene.loaded is not None else ():
        *place, part = key.split(".")
        is_end, is_value = part in ("wavelengths", "range"), part in ("value", "values")
        if not (is_end or is_value) or "film" in place or "Color3" in type(value).__name__:
            continue
        name = next((part for part in reversed(place) if part != "d65"), "")
        numbers = np.ravel(np.array(value, dtype=np.float64))
        ends = (float(numbers.min(initial=np.inf)), float(numbers.max(initial=0.0)))
        if is_end and not subject.is_covered_by(ends):
            short.setdefault((repr(name), ends), []).append(".".join(place))
        if is_value and name in FRACTIONS and ends[1] > 1 + TOLERANCE:
            what = MORE_LIGHT.format(repr(name), ends[1])
            yield Finding(
                "wrong", _named([".".join(place)]), what, _remedy_of_fraction(ends[1])
            )
    for (name, data_nm), named in short.items():
        remedy = "load it with more data, or pass the scene as a path, as XML text or as a dict"
        yield _ending(subject, name, len(named), _named(named), data_nm, remedy)


def _named(parameters: Sequence[str]) -> str:
    """Return the names of the first few parameters; elements without an id have a new name in each run."""
    few = [UNNAMED.sub("an element without an id", name) for name in parameters[:NAMED_MAX]]
    more = f" and {len(parameters) - NAMED_MAX} more" if len(parameters) > NAMED_MAX else ""
    return ", ".join(dict.fromkeys(few)) + more


class ElectronShare(NamedTuple):
    """The photoelectrons that are detected where data of the scene end.

    why : assumption about the scene there.  data_nm : the wavelengths with data.
    filter : the colour filter with the largest fraction.  share : largest possible fraction of its photoelectrons.
    dn : mean over all pixels of the frame [DN].
    """

    why: str
    data_nm: Range
    filter: str
    share: float
    dn: float

    def note(self, findings: Iterable[Finding]) -> str:
        """Return the sentence on this fraction.  findings : notes of the scene that it replaces."""
        low_nm, high_nm = self.data_nm
        ends = f"{low_nm:.5g} to {high_nm:.5g} nm".removeprefix("0 to ")
        note = (
            f"up to {100 * self.share:.1f} % of the photoelectrons of the {self.filter} pixels depend on "
            f"light beyond {ends.replace('to inf nm', 'nm and more')}, where {self.why}"
        )
        places = "; ".join(dict.fromkeys(finding.where for finding in findings))
        remedies = (finding.remedy for finding in findings)
        return "; ".join([f"{note} ({places})" if places else note, *dict.fromkeys(remedies)])


def with_notes_of_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Irradiance:
    """Return the light with its :class:`ElectronShare` values in the statistics and among its notes. They replace the
    notes on the same data of the scene, which only know how much of a flat spectrum the camera detects there."""
    ending: dict[Range, list[Finding]] = {}
    for finding in findings:
        if finding.data_nm is not None:
            ending.setdefault(finding.data_nm, []).append(finding)
    if not ending or light.filters is not None or light.rendered_for is None:
        return light  # filters are no bands
    notes, shares = [*light.statistics.notes], list[ElectronShare]()
    for data_nm, of_range in ending.items():
        share = _electron_share(light, camera, data_nm, of_range)
        replaced = [finding for finding in of_range if not finding.is_serious]
        notes = [note for note in notes if note not in {one.as_note for one in replaced}]
        if share.share > SHARE_MIN:
            shares.append(share)
            notes.append(Caution(share.note(replaced)))
    beyond_data = tuple(share._asdict() for share in shares)
    statistics = replace(light.statistics, notes=tuple(notes), beyond_data=beyond_data)
    return replace(light, statistics=statistics)


def _electron_share(
    light: Irradiance, camera: Camera, data_nm: Range, findings: Sequence[Finding]
) -> ElectronShare:
    """Return how many photoelectrons are detected outside a range at most: bands that reach beyond it count whole."""
    assert light.rendered_for is not None
    centres_nm = np.asarray(light.wavelengths_nm, dtype=np.float64)
    widths_nm = np.asarray(light.bandwidths_nm, dtype=np.float64)
    spectrum = light.data.mean(axis=(0, 1), dtype=np.float64)
    if not np.isfinite(spectrum).all():  # a copy of the data
        spectrum = light.data.mean(axis=(0, 1), dtype=np.float64, where=np.isfinite(light.data))
    exposure = light.rendered_for.exposure
    photons = photons_per_irradiance(camera, exposure, centres_nm, widths_nm) * spectrum
    electrons = np.atleast_2d(camera.qe(centres_nm, widths_nm)) * photons
    low_nm, high_nm = data_nm
    is_beyond = (centres_nm - widths_nm / 2 < low_nm) | (centres_nm + widths_nm / 2 > high_nm)
    name, share = largest_share(camera, electrons, is_beyond)
    beyond_e = electrons[camera.filter_names.index(name), is_beyond].sum()
    why = ", ".join(dict.fromkeys(finding.beyond for finding in findings))
    return ElectronShare(
        why, data_nm, name, share, float(beyond_e) * camera.system_gain_dn_per_e
    )
