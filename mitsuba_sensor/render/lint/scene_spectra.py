"""Spectra of a parsed scene: where each can be above zero, and the numbers that it is made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core import Float64Array
from ..infrared.rgb_colours import is_rgb
from ..scene.scene_file import SceneFile
from ..variants import MitsubaObject, mitsuba
from .finding import Range
from .metal_tables import METALS, metal_table

EVERYWHERE: Range = (-math.inf, math.inf)
MITSUBA_NM: Range = (360.0, 830.0)
SUN_NM: Range = (320.0, 720.0)  # of the model of sun and sky, as measured with Mitsuba 3.9.1
LIMITED = ("d65", "blackbody")  # spectra that end with Mitsuba's range
SUNS = ("sunsky", "timed_sunsky")
STRENGTHS = (
    "radiance",
    "irradiance",
    "intensity",
)  # of emitters; a float there is a factor on D65 (#1579)
D65_BY_DEFAULT = (
    "area",
    "constant",
    "directional",
    "directionalarea",
    "point",
    "projector",
    "spot",
)
FLOAT_PICTURES = (
    ".exr",
    ".hdr",
    ".rgbe",
    ".pfm",
)  # those of 8 and 16 bits have no value above 1


class Table(NamedTuple):
    """Values of a spectrum at wavelengths, 0 outside; or, without wavelengths, at all of them."""

    values: Float64Array
    wavelengths_nm: Float64Array | None = None

    def between(self, low_nm: float, high_nm: float) -> Float64Array:
        """The values that it has between two wavelengths: at its own, and at the two ends."""
        if self.wavelengths_nm is None:
            return self.values
        inside = (self.wavelengths_nm >= low_nm) & (self.wavelengths_nm <= high_nm)
        ends = np.interp(
            [low_nm, high_nm], self.wavelengths_nm, self.values, left=0.0, right=0.0
        )
        return np.concatenate([self.values[inside], ends])


class Picture(NamedTuple):
    """The pixels of a texture, (N, channels) without transparency."""

    values: Float64Array


class SceneSpectra:
    """Spectra of the emitters and materials of a scene, and the range where each can be above zero.

    emitters, surfaces : nodes of lights, and of materials and media.
    lights : (node, range) of every emitter.
    materials : (node, name, range) of every property of a material.
    metals : (node, name of the metal, range of its table).
    float_lights : nodes of emitters whose strength is one number.
    """

    def __init__(self, scene: SceneFile) -> None:
        self._mi, self._scene = mitsuba(), scene
        self.emitters, self.surfaces = scene.nodes("Emitter"), scene.nodes("BSDF", "Medium")
        self.lights = [(node, self._of_light(node.props)) for node in self.emitters]
        self.float_lights = [
            n for n in self.emitters if any(isinstance(v, float) for v in _strengths(n.props))
        ]
        self.materials = [
            (n, name, self._of_value(v, False))
            for n in self.surfaces
            for name, v in n.props.items()
        ]
        self.metals = list(_metals(scene))

    def numbers_of_node(self, node: MitsubaObject) -> Iterator[tuple[str, Table | Picture]]:
        """Each property of an emitter, a material or a medium, and what it is made of; the picture of an envmap is its
        radiance."""
        if node.props.plugin_name() == "envmap":
            yield from (("radiance", picture) for picture in self._picture(node.props))
        for name in node.props:
            yield from ((name, numbers) for numbers in self.numbers(node.props[name]))

    def numbers(self, value: MitsubaObject) -> Iterator[Table | Picture]:
        """Tables and pictures that a property is made of, those of textures and volumes in it too."""
        if (props := self._nested(value)) is not None:
            yield from self._numbers_of(props)
        elif hasattr(value, "is_uniform"):  # the parser's spectrum, not the variant's
            yield from _table(value.values, None if value.is_uniform() else value.wavelengths)
        elif isinstance(value, float):
            yield from _table([value])
        elif is_rgb(value):
            yield from _table([float(number) for number in value])

    def _numbers_of(self, props: MitsubaObject) -> Iterator[Table | Picture]:
        kind = props.plugin_name()
        if kind == "bitmap":
            yield from self._picture(props)
        elif kind == "gridvolume":
            yield from self._grid(props)
        elif kind in ("irregular", "regular") and "values" in props:
            values = _listed(props["values"])
            yield from _table(values, self._wavelengths_of(props, len(values)))
        else:
            for name in props:
                if name.startswith(("color", "value")) or self._nested(props[name]) is not None:
                    yield from self.numbers(props[name])

    def _wavelengths_of(self, props: MitsubaObject, count: int) -> list[float]:
        if props.plugin_name() == "irregular":
            return _listed(props.get("wavelengths", ""))
        first, last = (
            float(props.get(name, 0.0)) for name in ("wavelength_min", "wavelength_max")
        )
        if not math.isfinite(last - first):
            return []
        wavelengths_nm: list[float] = np.linspace(first, last, count).tolist()
        return wavelengths_nm

    def _picture(self, props: MitsubaObject) -> Iterator[Picture]:
        """The pixels of a picture that can be outside 0 to 1."""
        picture = props.get("bitmap", props.get("data", None))
        if picture is None:
            file = Path(str(self._scene.resolver.resolve(props.get("filename", ""))))
            if file.suffix.lower() not in FLOAT_PICTURES or not file.is_file():
                return
            picture = self._mi.Bitmap(str(file))
        values = np.array(picture)
        if values.dtype.kind == "f" and values.size:
            channels = values.shape[2] if values.ndim == 3 else 1
            colours = channels - (channels in (2, 4))  # the last one of these is transparency
            yield Picture(values.reshape(-1, channels)[:, :colours])

    def _grid(self, props: MitsubaObject) -> Iterator[Table]:
        """The largest value of a volume."""
        grid = props.get("grid", None)
        if grid is None:
            file = self._scene.resolver.resolve(props.get("filename", ""))
            grid = self._mi.VolumeGrid(str(file)) if Path(str(file)).is_file() else None
        if grid is not None:
            yield from _table([float(grid.max())])

    def _of_light(self, props: MitsubaObject) -> Range:
        kind, strengths = props.plugin_name(), _strengths(props)
        if kind in SUNS:
            return SUN_NM
        is_d65 = kind in D65_BY_DEFAULT and not strengths
        if (
            kind == "envmap"
            or is_d65
            or any(isinstance(v, float) or is_rgb(v) for v in strengths)
        ):
            return MITSUBA_NM  # rgb is multiplied by D65; rgb inside a texture is not, and unlimited
        ranges = [self._of_value(value, light=True) for _, value in props.items()]
        return min(ranges, key=lambda r: r[1] - r[0], default=EVERYWHERE)

    def _of_value(self, value: MitsubaObject, light: bool) -> Range:
        """Where a property can be above zero; everywhere if it is no spectrum or unlimited."""
        if (props := self._nested(value)) is not None:
            return self._of_texture(props, light)
        spectrum = hasattr(value, "is_uniform") and not value.is_uniform()
        return _ends(value.wavelengths) if spectrum else EVERYWHERE

    def _of_texture(self, props: MitsubaObject, light: bool) -> Range:
        kind, names = props.plugin_name(), list(props.keys())
        if kind == "irregular":
            return _ends(_listed(props.get("wavelengths", "")))
        if {"wavelength_min", "wavelength_max"} <= set(names):
            return float(props["wavelength_min"]), float(props["wavelength_max"])
        inner = [self._of_value(value, light) for _, value in props.items()]
        inner += [MITSUBA_NM] if light and kind in LIMITED else []
        return (max(r[0] for r in inner), min(r[1] for r in inner)) if inner else EVERYWHERE

    def _nested(self, value: MitsubaObject) -> MitsubaObject:
        """The properties of a texture or volume; None of anything else."""
        if not isinstance(value, self._mi.Properties.ResolvedReference):
            return None
        node, types = self._scene.state.nodes[value.index()], self._mi.ObjectType
        return node.props if node.type in (types.Texture, types.Volume) else None


def _metals(scene: SceneFile) -> Iterator[tuple[MitsubaObject, str, Range]]:
    for node in scene.nodes("BSDF"):
        material = node.props.get("material", None)
        if node.props.plugin_name() in METALS and (table := metal_table(material)) is not None:
            yield node, material, table.ends_nm


def _table(values: list[float], wavelengths_nm: list[float] | None = None) -> Iterator[Table]:
    """The table, if both have the same length; Mitsuba refuses others, and says why."""
    if wavelengths_nm is None:
        yield Table(np.array(values, dtype=np.float64))
    elif 0 < len(values) == len(wavelengths_nm):
        yield Table(
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


def _strengths(props: MitsubaObject) -> list[MitsubaObject]:
    return [props[name] for name in STRENGTHS if name in props]


def _ends(wavelengths_nm: list[float]) -> Range:
    return (
        (float(min(wavelengths_nm)), float(max(wavelengths_nm)))
        if len(wavelengths_nm)
        else EVERYWHERE
    )
