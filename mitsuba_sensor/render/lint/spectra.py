"""Spectra of a parsed scene: their wavelength ranges, their values, and tables of metals.

Mitsuba 3.9's tables of metals extend from about 300 nm to between 590 and 900 nm. Outside, Mitsuba takes η = k = 0,
which reflects everything, or is NaN at normal incidence; here the first and last values are held.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from ...core import Float64Array
from ..samples import MITSUBA_NM
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba

Range: TypeAlias = tuple[float, float]
EVERYWHERE: Range = (-math.inf, math.inf)
SUN_NM: Range = (320.0, 720.0)  # of the model of sun and sky, measured with Mitsuba 3.9.1
SUNS = ("sunsky", "timed_sunsky")
LIMITED = ("d65", "blackbody", "envmap")  # plugins that end with Mitsuba's range
SPECTRA = (
    *("irregular", "regular", "bitmap", "envmap", "gridvolume", "mesh_attribute", "srgb"),
    *LIMITED,
)
"""Plugins that are spectra; all other plugins consist of spectra."""
STRENGTHS = ("radiance", "irradiance", "intensity")
"""Properties of emitters in which a float is a factor on D65 (#1579)."""
D65_BY_DEFAULT = (
    *("area", "constant", "directional", "directionalarea", "point", "projector", "spot"),
)
METALS = ("conductor", "roughconductor")  # materials that accept the name of a metal
INDICES = ("eta", "k")
FLOAT_PICTURES = (".exr", ".hdr", ".rgbe", ".pfm")  # only these have values above 1
ENDS = ("wavelength_min", "wavelength_max")


@dataclass(frozen=True, eq=False)
class Part:
    """A spectrum, a colour, a number or an image.

    owner, key : properties that contain it, and its name there.  is_inside : True if the owner is a texture.
    kind : type of its plugin; "rgb", "float" or "table" for a value.  props : of its plugin; None for a value.
    """

    owner: MitsubaObject
    key: str
    is_inside: bool
    kind: str
    props: MitsubaObject = None

    @property
    def value(self) -> MitsubaObject:
        """Value in the properties of its owner."""
        return self.owner[self.key]

    @cached_property
    def table(self) -> tuple[Float64Array | None, Float64Array]:
        """Wavelengths [nm], outside of which the spectrum is zero, and values; None and no values if unknown."""
        props, values = self.props, np.zeros(0)
        if props is None:
            numbers = np.ravel(np.array(getattr(self.value, "values", self.value), np.float64))
            is_table = self.kind == "table" and not self.value.is_uniform()
            return (np.array(self.value.wavelengths) if is_table else None), numbers
        if self.kind in ("irregular", "regular"):
            values = _listed(props.get("values", ""))
        if self.kind == "irregular":
            return _listed(props.get("wavelengths", "")), values
        if all(name in props for name in ENDS):
            first_nm, last_nm = (float(props[name]) for name in ENDS)
            return np.linspace(first_nm, last_nm, max(len(values), 2)), values
        return (np.array(MITSUBA_NM) if self.kind in LIMITED else None), values

    @property
    def data_nm(self) -> Range:
        """Range of wavelengths with values above zero."""
        nm, _ = self.table
        return EVERYWHERE if nm is None or not nm.size else (float(nm.min()), float(nm.max()))


class Property(NamedTuple):
    """A property of an emitter, a material or a medium.

    number : of the node in the parser's state.  parts : spectra of the property, including those in textures.
    """

    node: MitsubaObject
    number: int
    role: str
    is_light: bool
    parts: tuple[Part, ...]

    @property
    def is_number(self) -> bool:
        """True for a colour or a float directly in the element."""
        return not self.parts[0].is_inside and self.parts[0].kind in ("rgb", "float")

    @property
    def data_nm(self) -> Range:
        """Range of wavelengths in which all parts have values above zero."""
        lows, highs = zip(EVERYWHERE, *(part.data_nm for part in self.parts), strict=True)
        return max(lows), min(highs)


def properties_of(scene: ParsedScene) -> list[Property]:
    """Return the properties of emitters, materials and media that have spectra; an envmap is its radiance."""
    types, properties = mitsuba().ObjectType, list[Property]()
    for number, node in enumerate(scene.state.nodes):
        if node.type not in (types.Emitter, types.BSDF, types.Medium):
            continue
        is_light = node.type == types.Emitter
        if (kind := node.props.plugin_name()) == "envmap":
            whole = Part(node.props, "", False, kind, node.props)
            properties.append(Property(node, number, STRENGTHS[0], is_light, (whole,)))
        for role in node.props:
            if parts := tuple(_parts(scene, node.props, role)):
                properties.append(Property(node, number, role, is_light, parts))
    return properties


def _parts(
    scene: ParsedScene, owner: MitsubaObject, key: str, is_inside: bool = False
) -> Iterator[Part]:
    """Yield the spectra of a property, including those of a texture or volume."""
    mi, value = mitsuba(), owner[key]
    if isinstance(value, mi.Properties.ResolvedReference):
        node = scene.state.nodes[value.index()]
        if node.type not in (mi.ObjectType.Texture, mi.ObjectType.Volume):
            return
        props, kind = node.props, node.props.plugin_name()
        if kind in SPECTRA or all(name in props for name in ENDS):
            yield Part(owner, key, is_inside, kind, props)
            return
        for name in props:
            is_nested = isinstance(props[name], mi.Properties.ResolvedReference)
            if is_nested or name.startswith(("color", "value")):
                yield from _parts(scene, props, name, is_inside=True)
    elif "Color3" in type(value).__name__:
        yield Part(owner, key, is_inside, "rgb")
    elif isinstance(value, float):
        yield Part(owner, key, is_inside, "float")
    elif hasattr(value, "is_uniform"):  # the parser's spectrum, not the variant's
        yield Part(owner, key, is_inside, "table")


def light_range(emitter: MitsubaObject, properties: Sequence[Property]) -> Range:
    """Return the range of wavelengths of an emitter, by its properties; a colour or a float directly in the emitter is
    multiplied by D65."""
    kind = emitter.props.plugin_name()
    strengths = [x for x in properties if x.role in STRENGTHS]
    if kind in SUNS:
        return SUN_NM
    if kind in D65_BY_DEFAULT and not strengths:
        return MITSUBA_NM
    if any(x.is_number for x in strengths):
        return MITSUBA_NM
    ranges = (x.data_nm for x in properties)
    return min(ranges, key=lambda ends: ends[1] - ends[0], default=EVERYWHERE)


def values_of_part(scene: ParsedScene, part: Part, band_nm: Range) -> Float64Array:
    """Return the numbers of a part between two wavelengths, shape (N,) for a table or (pixels, channels) for an image;
    empty if unknown, and for a table with different numbers of values and wavelengths, which Mitsuba rejects."""
    if part.kind in ("bitmap", "envmap"):
        return _pixels(scene, part.props)
    if part.kind == "gridvolume":
        grid, file = part.props.get("grid", None), _file(scene, part.props)
        if grid is None and file.is_file():
            grid = mitsuba().VolumeGrid(str(file))
        return np.zeros(0) if grid is None else np.array([float(grid.max())])
    nm, values = part.table
    if nm is None:
        return values
    if not nm.size or nm.shape != values.shape:
        return np.zeros(0)
    ends = np.interp(band_nm, nm, values, left=0.0, right=0.0)
    return np.concatenate([values[(nm >= band_nm[0]) & (nm <= band_nm[1])], ends])


def _file(scene: ParsedScene, props: MitsubaObject) -> Path:
    return Path(str(scene.resolver.resolve(props.get("filename", ""))))


def _pixels(scene: ParsedScene, props: MitsubaObject) -> Float64Array:
    """Return the pixels of an image of floats, without transparency; empty for other images."""
    picture, file = props.get("bitmap", props.get("data", None)), _file(scene, props)
    if picture is None:
        if file.suffix.lower() not in FLOAT_PICTURES or not file.is_file():
            return np.zeros(0)
        picture = mitsuba().Bitmap(str(file))
    values = np.array(picture)
    if values.dtype.kind != "f":
        return np.zeros(0)
    channels = values.shape[2] if values.ndim == 3 else 1
    colours = channels - (channels in (2, 4))  # the last channel is transparency
    return values.reshape(-1, channels)[:, :colours]


def _listed(numbers: object) -> Float64Array:
    """Return the numbers of a text or a list; empty if one of them is not a number."""
    if isinstance(numbers, str):
        numbers = numbers.replace(",", " ").split()
    try:
        return np.array(numbers, dtype=float).ravel()
    except ValueError:
        return np.zeros(0)


def metal_table(material: object) -> dict[str, Float64Array] | None:
    """Return Mitsuba's table of a metal: wavelengths [nm], eta and k; None for a name without a table."""
    if not isinstance(material, str):
        return None
    mi = mitsuba()
    try:
        parameters = mi.traverse(mi.load_dict({"type": METALS[0], "material": material}))
    except RuntimeError:  # repeated with its place in the file when the scene is built
        return None
    names = {"wavelengths": "eta.wavelengths", "eta": "eta.values", "k": "k.values"}
    if names["wavelengths"] not in parameters:
        return None
    return {name: np.array(parameters[key], np.float64) for name, key in names.items()}


def metals_of(scene: ParsedScene) -> Iterator[tuple[MitsubaObject, dict[str, Float64Array]]]:
    """Yield the materials of a scene that name a metal, and its table."""
    for node in scene.nodes("BSDF"):
        is_named = not any(name in node.props for name in INDICES)
        if is_named and node.props.plugin_name() in METALS:
            table = metal_table(node.props.get("material", None))
            if table is not None:
                yield node, table


def continue_metals(scene: ParsedScene, low_nm: float, high_nm: float) -> None:
    """Replace the names of metals whose tables end between two wavelengths by tables with held ends."""
    for node, table in metals_of(scene):
        nm = table["wavelengths"]
        below = [low_nm] if low_nm < nm[0] else []
        above = [high_nm] if high_nm > nm[-1] else []
        if not below and not above:
            continue
        del node.props["material"]
        for name in INDICES:
            values = np.pad(table[name], (len(below), len(above)), mode="edge")
            texts = {"wavelengths": np.concatenate([below, nm, above]), "values": values}
            listed = {key: ", ".join(map(repr, x.tolist())) for key, x in texts.items()}
            node.props[name] = mitsuba().load_dict({"type": "irregular", **listed})
