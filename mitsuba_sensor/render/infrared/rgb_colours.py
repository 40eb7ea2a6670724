"""The RGB colours of a parsed scene: constant ones, pictures and colours of meshes, and the materials they are of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba

REFLECTANCES = ("reflectance", "diffuse_reflectance", "base_color", "albedo")
"""Properties of a material that a measured reflectance replaces; its highlights are no part of the measurement."""

NO_COLOURS = ("eta", "k", "alpha", "alpha_u", "alpha_v", "roughness", "weight", "opacity")
"""Properties of materials where a picture is no colour."""
RELIEFS = ("bumpmap", "normalmap")  # materials whose pictures are none
PICTURES = ("bitmap", "mesh_attribute", "srgb")


class RgbColour(NamedTuple):
    """A colour in a parsed scene.

    node : the material, medium or emitter that it belongs to.
    owner, key : the properties that hold it, which may be those of a texture inside, and its name there.
    role : the property of the material that it is a part of.
    ids : of the material, and of the shapes and materials that hold it.
    """

    node: MitsubaObject
    owner: MitsubaObject
    key: str
    role: str
    ids: frozenset[str]

    @property
    def is_constant(self) -> bool:
        """Whether it is three numbers."""
        return is_rgb(self.owner[self.key])

    @property
    def name(self) -> str:
        """What messages call its material."""
        own = self.node.props.id()
        if own:
            return repr(str(own))
        return repr(min(self.ids)) if self.ids else f"a {self.node.props.plugin_name()}"


def rgb_colours(scene: ParsedScene) -> list[RgbColour]:
    """Colours of the materials and media, and those of pictures in emitters: other emitters are times D65."""
    mi, ids = mitsuba(), _ids_of_nodes(scene)
    kinds = (mi.ObjectType.BSDF, mi.ObjectType.Medium, mi.ObjectType.Emitter)
    colours = list[RgbColour]()
    for index, node in enumerate(scene.state.nodes):
        is_emitter, kind = node.type == mi.ObjectType.Emitter, node.props.plugin_name()
        if node.type not in kinds or kind in (*RELIEFS, "envmap"):  # that one is times D65
            continue
        for role in node.props:
            if role in NO_COLOURS or (is_emitter and is_rgb(node.props[role])):
                continue
            for owner, key in _colours_of(scene, node.props, role):
                colours.append(RgbColour(node, owner, key, role, ids.get(index, frozenset())))
    return colours


def is_rgb(value: object) -> bool:
    """Whether a property is three numbers of a colour."""
    return "Color3" in type(value).__name__


def _colours_of(
    scene: ParsedScene, owner: MitsubaObject, key: str
) -> Iterator[tuple[MitsubaObject, str]]:
    """Where the colours of a property stand: there, or in the textures and volumes nested in it."""
    if is_rgb(owner[key]):
        if min(owner[key]) >= 0 and max(owner[key]) <= 1:
            yield owner, key
        return
    mi = mitsuba()
    if owner.type(key) != mi.Properties.Type.ResolvedReference:
        return
    node = scene.state.nodes[owner[key].index()]
    if node.type == mi.ObjectType.Texture and node.props.plugin_name() in PICTURES:
        if not node.props.get("raw", False):  # raw: roughness, normals and the like
            yield owner, key
    elif node.type in (mi.ObjectType.Texture, mi.ObjectType.Volume):
        for inner in node.props:
            yield from _colours_of(scene, node.props, inner)


def _ids_of_nodes(scene: ParsedScene) -> dict[int, frozenset[str]]:
    """Ids by the number of a node: its own, and those of the nodes that hold it, but for the scene itself."""
    ids = dict[int, frozenset[str]]()

    def visit(props: MitsubaObject, inherited: frozenset[str]) -> None:
        for name, child in scene.children(props):
            index = props[name].index()
            own = {str(child.props.id())} if child.props.id() else set[str]()
            below = inherited | own
            if not below <= ids.get(index, frozenset()) or index not in ids:
                ids[index] = ids.get(index, frozenset()) | below
                visit(child.props, below)

    visit(scene.root, frozenset())
    return ids
