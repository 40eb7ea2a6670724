"""Spectra of a parsed scene: where each can be above zero, the numbers that it is made of, and the tables of metals.

The tables of the metals that Mitsuba 3.9 knows by name extend from about 300 to between 590 and 900 nm. Outside them
it takes η = k = 0, which reflects everything, or is NaN at normal incidence; here their first and last values are held.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core import Float64Array
from ..infrared.rgb_colours import is_rgb
from ..samples import MITSUBA_NM
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba
from .finding import Range

EVERYWHERE: Range = (-math.inf, math.inf)
SUN_NM: Range = (320.0, 720.0)  # of the model of sun and sky, as measured with Mitsuba 3.9.1
LIMITED = ("d65", "blackbody")  # spectra that end with Mitsuba's range
SUNS = ("sunsky", "timed_sunsky")
STRENGTHS = ("radiance", "irradiance", "intensity")
"""Of emitters; a float there is a factor on D65 (#1579)."""
D65_BY_DEFAULT = (
    "area",
    "constant",
    "directional",
    "directionalarea",
    "point",
    "projector",
    "spot",
)
METALS = ("conductor", "roughconductor")  # materials that take the name of a metal
INDICES = ("eta", "k")
FLOAT_PICTURES = (
    ".exr",
    ".hdr",
    ".rgbe",
    ".pfm",
)  # those of 8 and 16 bits have no value above 1


class MetalTable(NamedTuple):
    """Wavelengths [nm], η and k of a metal, (N,) each."""

    wavelengths_nm: Float64Array
    eta: Float64Array
    k: Float64Array

    @property
    def ends_nm(self) -> Range:
        """Its first and its last wavelength."""
        return float(self.wavelengths_nm[0]), float(self.wavelengths_nm[-1])


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
    """Replace the names of metals whose tables end between two wavelengths by tables whose ends are held.

    nodes : the materials of a parsed scene, which are changed.
    """
    for node in nodes:
        props = node.props
        if props.plugin_name() not in METALS or any(name in props for name in INDICES):
            continue
        table = metal_table(props.get("material", None))
        if table is None or (table.ends_nm[0] <= low_nm and table.ends_nm[1] >= high_nm):
            continue
        first_nm, last_nm = table.ends_nm
        below, above = [low_nm] * (low_nm < first_nm), [high_nm] * (high_nm > last_nm)
        wavelengths_nm = np.concatenate([below, table.wavelengths_nm, above])
        del props["material"]
        for name in INDICES:
            values = np.pad(getattr(table, name), (len(below), len(above)), mode="edge")
            texts = {"wavelengths": wavelengths_nm, "values": values}
            listed = {key: ", ".join(map(repr, x.tolist())) for key, x in texts.items()}
            props[name] = mitsuba().load_dict({"type": "irregular", **listed})


class Numbers(NamedTuple):
    """What a property of an emitter, a material or a medium is made of: a table, or a picture.

    values : (N,), or pixels (N, channels) without transparency.
    wavelengths_nm : of a table, which is 0 outside; None for one value everywhere.
    """

    values: Float64Array
    wavelengths_nm: Float64Array | None = None

    def between(self, low_nm: float, high_nm: float) -> Float64Array:
        """The values that there are between two wavelengths: at its own, and at the two ends."""
        if self.wavelengths_nm is None:
            return self.values
        inside = (self.wavelengths_nm >= low_nm) & (self.wavelengths_nm <= high_nm)
        ends = np.interp(
            [low_nm, high_nm], self.wavelengths_nm, self.values, left=0.0, right=0.0
        )
        return np.concatenate([self.values[inside], ends])


class SceneSpectra:
    """Spectra of the emitters and materials of a scene, and the range where each can be above zero.

    lights : (node, range) of every emitter.
    materials : (node, name, range) of every property of a material or medium.
    metals : (node, name of the metal, range of its table).
    float_lights : nodes of emitters whose strength is one number.
    """

    def __init__(self, scene: ParsedScene) -> None:
        self._mi, self._scene = mitsuba(), scene
        self.emitters, self.surfaces = scene.nodes("Emitter"), scene.nodes("BSDF", "Medium")
        self.lights = [(node, self._of_light(node.props)) for node in self.emitters]
        self.float_lights = [
            node
            for node in self.emitters
            if any(isinstance(value, float) for value in _strengths(node.props))
        ]
        self.materials = [
            (node, name, self._of_value(value, False))
            for node in self.surfaces
            for name, value in node.props.items()
        ]
        self.metals = list[tuple[MitsubaObject, str, Range]]()
        for node in self.surfaces:
            material = node.props.get("material", None)
            if (
                node.props.plugin_name() in METALS
                and (table := metal_table(material)) is not None
            ):
                self.metals.append((node, material, table.ends_nm))

    def numbers_of_node(self, node: MitsubaObject) -> Iterator[tuple[str, Numbers]]:
        """Each property of an emitter, a material or a medium, and what it is made of; the picture of an envmap is its
        radiance."""
        if node.props.plugin_name() == "envmap":
            yield from (("radiance", picture) for picture in self._picture(node.props))
        for name in node.props:
            yield from ((name, numbers) for numbers in self._numbers(node.props[name]))

    def _numbers(self, value: MitsubaObject) -> Iterator[Numbers]:
        """Tables and pictures that a property is made of, those of textures and volumes in it too."""
        if (props := self._nested(value)) is not None:
            yield from self._numbers_of(props)
        elif hasattr(value, "is_uniform"):  # the parser's spectrum, not the variant's
            yield from _table(value.values, None if value.is_uniform() else value.wavelengths)
        elif isinstance(value, float):
            yield from _table([value])
        elif is_rgb(value):
            yield from _table([float(number) for number in value])

    def _numbers_of(self, props: MitsubaObject) -> Iterator[Numbers]:
        kind = props.plugin_name()
        if kind == "bitmap":
            yield from self._picture(props)
        elif kind == "gridvolume":
            grid, file = props.get("grid", None), self._file(props)
            if grid is None and file.is_file():
                grid = self._mi.VolumeGrid(str(file))
            if grid is not None:
                yield from _table([float(grid.max())])
        elif kind == "irregular":
            yield from _table(
                _listed(props.get("values", "")), _listed(props.get("wavelengths", ""))
            )
        elif kind == "regular":
            values, ends_nm = _listed(props.get("values", "")), _given_ends(props)
            if ends_nm is not None and math.isfinite(ends_nm[1] - ends_nm[0]):
                yield from _table(values, np.linspace(*ends_nm, len(values)).tolist())
        else:
            for name in props:
                if name.startswith(("color", "value")) or self._nested(props[name]) is not None:
                    yield from self._numbers(props[name])

    def _file(self, props: MitsubaObject) -> Path:
        return Path(str(self._scene.resolver.resolve(props.get("filename", ""))))

    def _picture(self, props: MitsubaObject) -> Iterator[Numbers]:
        """The pixels of a picture that can be outside 0 to 1."""
        picture, file = props.get("bitmap", props.get("data", None)), self._file(props)
        if picture is None:
            if file.suffix.lower() not in FLOAT_PICTURES or not file.is_file():
                return
            picture = self._mi.Bitmap(str(file))
        values = np.array(picture)
        if values.dtype.kind == "f" and values.size:
            channels = values.shape[2] if values.ndim == 3 else 1
            colours = channels - (channels in (2, 4))  # the last one of these is transparency
            yield Numbers(values.reshape(-1, channels)[:, :colours])

    def _of_light(self, props: MitsubaObject) -> Range:
        kind, strengths = props.plugin_name(), _strengths(props)
        if kind in SUNS:
            return SUN_NM
        if (
            kind == "envmap"
            or (kind in D65_BY_DEFAULT and not strengths)
            or any(isinstance(value, float) or is_rgb(value) for value in strengths)
        ):
            return MITSUBA_NM  # rgb is multiplied by D65; rgb inside a texture is not, and unlimited
        ranges = [self._of_value(value, light=True) for _, value in props.items()]
        return min(ranges, key=lambda r: r[1] - r[0], default=EVERYWHERE)

    def _of_value(self, value: MitsubaObject, light: bool) -> Range:
        """Where a property can be above zero; everywhere if it is no spectrum or unlimited."""
        props = self._nested(value)
        if props is None:
            is_table = hasattr(value, "is_uniform") and not value.is_uniform()
            return _ends(value.wavelengths) if is_table else EVERYWHERE
        kind = props.plugin_name()
        if kind == "irregular":
            return _ends(_listed(props.get("wavelengths", "")))
        if (ends_nm := _given_ends(props)) is not None:
            return ends_nm
        inner = [self._of_value(nested, light) for _, nested in props.items()]
        inner += [MITSUBA_NM] if light and kind in LIMITED else []
        return (max(r[0] for r in inner), min(r[1] for r in inner)) if inner else EVERYWHERE

    def _nested(self, value: MitsubaObject) -> MitsubaObject:
        """The properties of a texture or volume; None of anything else."""
        if not isinstance(value, self._mi.Properties.ResolvedReference):
            return None
        node, types = self._scene.state.nodes[value.index()], self._mi.ObjectType
        return node.props if node.type in (types.Texture, types.Volume) else None


def _table(values: list[float], wavelengths_nm: list[float] | None = None) -> Iterator[Numbers]:
    """The table, if both have the same length; Mitsuba refuses others, and says why."""
    if wavelengths_nm is None:
        yield Numbers(np.array(values, dtype=np.float64))
    elif 0 < len(values) == len(wavelengths_nm):
        yield Numbers(
            np.array(values, dtype=np.float64), np.array(wavelengths_nm, dtype=np.float64)
        )


def _listed(numbers: object) -> list[float]:
    """Numbers that are written in one text, or a list already; none where one of them is no number."""
    try:
        if isinstance(numbers, str):
            return [float(number) for number in numbers.replace(",", " ").split()]
        return [float(number) for number in np.ravel(np.array(numbers)).tolist()]
    except ValueError:
        return []


def _given_ends(props: MitsubaObject) -> Range | None:
    """First and last wavelength of a spectrum that has them as parameters."""
    names = ("wavelength_min", "wavelength_max")
    if not all(name in props for name in names):
        return None
    return float(props[names[0]]), float(props[names[1]])


def _strengths(props: MitsubaObject) -> list[MitsubaObject]:
    return [props[name] for name in STRENGTHS if name in props]


def _ends(wavelengths_nm: list[float]) -> Range:
    if not len(wavelengths_nm):
        return EVERYWHERE
    return float(min(wavelengths_nm)), float(max(wavelengths_nm))
