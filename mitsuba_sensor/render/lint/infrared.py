"""Rules for RGB colours beyond 700 nm, and the scene with these rules.

A constant colour becomes a table. Other colours are wrapped in a texture plugin, because Mitsuba's textures cannot be
combined in this way: it has the value of another texture up to 700 nm, and that value or a measured spectrum above. In
compiled variants the cost is not measurable; scalar variants call Python for every ray, so a scene with only such
textures takes four times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from functools import cache
from typing import NamedTuple

import numpy as np

from ...core import Array, Float64Array, InputError, nearest
from ...core.llvm import drjit
from ..scene.asked import HELD_FROM_NM, REFUSE, Material, materials
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba
from .spectra import Part, Property, properties_of

RULES_FROM_NM = 720.0
"""Bands that end below this wavelength, e.g. with an infrared cut filter, keep Mitsuba's colours."""
REFLECTANCES = ("reflectance", "diffuse_reflectance", "base_color", "albedo")
"""Properties of a material that a measured reflectance replaces, without highlights."""
NO_COLOURS = ("eta", "k", "alpha", "alpha_u", "alpha_v", "roughness", "weight", "opacity")
"""Properties of materials in which an image is not a colour."""
RELIEFS = ("bumpmap", "normalmap")  # materials whose images are not colours
PICTURES = ("bitmap", "mesh_attribute", "srgb")
STEP_NM = 1.0  # of the table of a colour
LOWEST_NM = 360.0  # of Mitsuba's spectra of colours
MATERIALS_LISTED_MAX = 8  # in a message
PLUGIN = "held_beyond_700_nm"
PASSED_ON = (
    *("eval_1", "eval_1_grad", "eval_3", "is_spatially_varying", "max", "mean"),
    *("parameters_changed", "pdf_position", "pdf_spectrum", "resolution", "sample_position"),
    *("sample_spectrum", "spectral_resolution", "traverse", "wavelength_range"),
)
"""Methods that are passed on to the inner texture, whose parameters keep their names in mi.traverse."""


class Colour(NamedTuple):
    """An RGB colour or image.

    node : its material, medium or emitter.  role : the property that contains it.
    ids : of the material, and of the shapes and materials that contain it.
    """

    node: MitsubaObject
    role: str
    is_light: bool
    part: Part
    ids: frozenset[str]

    @property
    def name(self) -> str:
        """Name of its material in messages."""
        name = str(self.node.props.id()) or min(self.ids, default="")
        return repr(name) if name else f"a {self.node.props.plugin_name()}"


def rgb_colours(scene: ParsedScene, properties: Iterable[Property]) -> list[Colour]:
    """Return the colours of materials and media, and of textures in emitters; other emitters multiply D65."""
    ids, colours = _ids_of_nodes(scene), list[Colour]()
    for node, number, role, is_light, parts in properties:
        if node.props.plugin_name() in RELIEFS or role in NO_COLOURS:
            continue
        for part in parts:
            if part.kind == "rgb":
                is_colour = (part.is_inside or not is_light) and all(
                    0 <= x <= 1 for x in part.value
                )
            else:  # raw: roughness, normals and the like
                is_colour = part.kind in PICTURES and not part.props.get("raw", False)
            if is_colour:
                names = ids.get(number, frozenset())
                colours.append(Colour(node, role, is_light, part, names))
    return colours


def _ids_of_nodes(scene: ParsedScene) -> dict[int, frozenset[str]]:
    """Return the ids of each node and of the nodes that contain it, except the scene, by the number of the node."""
    ids = dict[int, frozenset[str]]()

    def visit(props: MitsubaObject, inherited: frozenset[str]) -> None:
        for name, child in scene.children(props):
            index = props[name].index()
            below = inherited | ({str(child.props.id())} - {""})
            if index not in ids or not below <= ids[index]:
                ids[index] = ids.get(index, frozenset()) | below
                visit(child.props, below)

    visit(scene.root, frozenset())
    return ids


def ruled_colours(
    scene: ParsedScene, properties: Iterable[Property], high_nm: float
) -> list[tuple[Colour, Material | None]]:
    """Return the colours that bands up to ``high_nm`` detect beyond the visible, each with its measured material, or
    None for a held value.  properties : of the scene.  Raises InputError."""
    asked = scene.edits.infrared
    if high_nm <= RULES_FROM_NM:
        return []
    colours = rgb_colours(scene, properties)
    if asked == REFUSE:
        _refuse(scene, colours, high_nm)
        return []
    used, ruled = set[str](), list[tuple[Colour, Material | None]]()
    for colour in colours:
        patterns = [
            pattern
            for pattern in asked
            if colour.role in REFLECTANCES and any(fnmatchcase(x, pattern) for x in colour.ids)
        ]
        used.update(patterns)
        if len({asked[pattern] for pattern in patterns}) > 1:
            both = " and ".join(map(repr, patterns))
            raise InputError(f"infrared: {colour.name} is named by {both}; name it once.")
        ruled.append((colour, materials()[asked[patterns[0]]] if patterns else None))
    for pattern in asked:
        if pattern not in used:
            ids = sorted({name for colour in colours for name in colour.ids})
            known = f"they are named {', '.join(ids)}" if ids else "no RGB colour has an id"
            raise InputError(
                f"infrared: no material or shape with an RGB reflectance is named {pattern!r}; {known}."
                f"{nearest(pattern, ids)}"
            )
    return ruled


def _refuse(scene: ParsedScene, colours: list[Colour], high_nm: float) -> None:
    if names := list(dict.fromkeys(f"{x.name} ({scene.where(x.node)})" for x in colours)):
        hidden = len(names) - MATERIALS_LISTED_MAX
        more = f" and {hidden} more" if hidden > 0 else ""
        raise InputError(
            f"infrared is 'refuse' and the bands extend to {high_nm:g} nm, where RGB does not define "
            f"{', '.join(names[:MATERIALS_LISTED_MAX])}{more}; give them spectra, or materials, e.g. "
            "infrared={'leaf_*': 'vegetation'}."
        )


def apply_infrared(scene: ParsedScene, low_nm: float, high_nm: float) -> None:
    """Apply the rules to the colours of a parsed scene; its nodes are changed.  low_nm, high_nm : ends of the bands.

    If parameters of the scene are set by name, a constant colour keeps its name inside a texture plugin.
    """
    nodes_nm = np.arange(np.floor(min(low_nm, LOWEST_NM)), np.ceil(high_nm) + STEP_NM, STEP_NM)
    keeps_names, mi = bool(scene.edits.traverse), mitsuba()
    first, colours = len(scene.state.nodes), ruled_colours(scene, properties_of(scene), high_nm)
    for colour, _ in colours:
        if keeps_names or colour.part.kind != "rgb":
            node = mi.parser.SceneNode()
            node.type = mi.ObjectType.Texture
            scene.state.nodes.append(node)
    # Searched again, because adding nodes moves all nodes in memory.
    for colour, material in ruled_colours(scene, properties_of(scene), high_nm):
        owner, key, is_constant = colour.part.owner, colour.part.key, colour.part.kind == "rgb"
        value = owner[key]
        if is_constant and not keeps_names:
            owner[key] = _spectrum(nodes_nm, _reflectance(value, material, nodes_nm))
            continue
        _register(mi.variant())
        held = mi.Properties(PLUGIN)
        if is_constant:
            value = mi.load_dict({"type": "srgb", "color": list(map(float, value))})
        held["texture"] = value
        if material is not None:
            held["beyond"] = _spectrum(nodes_nm, material.at(nodes_nm))
        scene.state.nodes[first].props = held
        owner[key] = mi.Properties.ResolvedReference(first)
        first += 1


def _reflectance(
    rgb: MitsubaObject, material: Material | None, wavelengths_nm: Float64Array
) -> Float64Array:
    """Return Mitsuba's spectrum of a colour up to 700 nm, and its rule above."""
    mi = mitsuba()
    colour = mi.ScalarColor3f(*map(float, rgb))
    square, slope, constant = map(float, mi.srgb_model_fetch(colour))
    up_to_nm = np.minimum(wavelengths_nm, HELD_FROM_NM)
    x = (square * up_to_nm + slope) * up_to_nm + constant
    values = 0.5 + 0.5 * x / np.sqrt(1 + x * x) if np.isfinite(x).all() else (x > 0) * 1.0
    if material is None:
        return np.asarray(values)
    beyond = wavelengths_nm > HELD_FROM_NM
    return np.where(beyond, material.at(wavelengths_nm), values)


def _spectrum(wavelengths_nm: Float64Array, values: Float64Array) -> MitsubaObject:
    """Return a Mitsuba spectrum of equidistant nodes."""
    return mitsuba().load_dict(
        {
            "type": "regular",
            "wavelength_min": float(wavelengths_nm[0]),
            "wavelength_max": float(wavelengths_nm[-1]),
            "values": ", ".join(map(repr, values.tolist())),
        }
    )


@cache
def _register(variant: str) -> None:
    """Register the texture in the present variant; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant

    class HeldTexture(mi.Texture):  # type: ignore[misc, name-defined]
        """props : contains the nested ``texture`` and, if needed, the spectrum ``beyond``."""

        def __init__(self, props: MitsubaObject) -> None:
            super().__init__(props)
            self.inner, self.beyond = props["texture"], props.get("beyond", None)

        def eval(self, si: MitsubaObject, active: Array = True) -> Array:
            """Return the values at the wavelengths of an interaction."""
            wavelengths_nm = type(si.wavelengths)(si.wavelengths)
            si.wavelengths = dr.minimum(wavelengths_nm, HELD_FROM_NM)
            values = self.inner.eval(si, active)
            si.wavelengths = wavelengths_nm
            if self.beyond is None:
                return values
            measured = self.beyond.eval(si, active)
            return dr.select(wavelengths_nm > HELD_FROM_NM, measured, values)

        def to_string(self) -> str:
            """Return a description."""
            return f"HeldTexture[{self.inner}]"

    for name in PASSED_ON:
        setattr(HeldTexture, name, _passed_on(name))
    mi.register_texture(PLUGIN, HeldTexture)


def _passed_on(name: str) -> Callable[..., object]:
    def method(self: MitsubaObject, *arguments: object) -> object:
        return getattr(self.inner, name)(*arguments)

    return method
