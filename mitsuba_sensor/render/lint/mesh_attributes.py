"""Attributes of meshes that materials and lights take: missing ones, and colours outside 0 to 1."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ...core import InputError, nearest
from ...files.ply_colours import largest_colour
from ..scene.scene_file import SceneFile
from ..variants import MitsubaObject, mitsuba
from .finding import Finding, lines_of

TEXTURE = "mesh_attribute"
TAKEN = re.compile(
    r'MeshAttribute\[\s*name = "([^"]*)"'
)  # in what Mitsuba prints of a material
PREFIXES = ("vertex_", "face_")


def refuse_missing_attributes(scene: SceneFile, world: MitsubaObject) -> None:
    """InputError for a shape without an attribute that its material or light takes.

    Scalar variants end in an error then, and the others render it black.
    """
    takers = [node for node in scene.nodes("Texture") if node.props.plugin_name() == TEXTURE]
    if not takers and scene.loaded is None:
        return
    for number, shape in enumerate(_shapes(world)):
        for name in TAKEN.findall(f"{shape.bsdf()} {shape.emitter()}"):
            if not shape.has_attribute(name):
                places = [node for node in takers if node.props.get("name", None) == name]
                where = f", {lines_of(scene, places)}" if places else ""
                what = f"shape {shape.id() or number!r} has no attribute {name!r}, which its material takes"
                raise InputError(
                    f"scene {scene.name!r}{where}: {what}; {_attributes(shape, name)}"
                )


def _shapes(world: MitsubaObject) -> list[MitsubaObject]:
    """The shapes of a scene, those in groups too."""
    owners = (entry[2] for entry in mitsuba().traverse(world).properties.values())
    meshes = {id(owner): owner for owner in owners if isinstance(owner, mitsuba().Mesh)}
    return [*world.shapes(), *meshes.values()]


def _attributes(shape: MitsubaObject, wanted: str) -> str:
    """What attributes a shape has."""
    names = [
        name
        for name, _ in mitsuba().traverse(shape)
        if name.startswith(PREFIXES) and shape.has_attribute(name)
    ]
    if not names:
        return "it has none: give the material a spectrum, or the mesh its attribute."
    return f"it has {', '.join(names)}.{nearest(wanted, names)}"


def colours_above_one(scene: SceneFile) -> Iterator[Finding]:
    """Meshes whose vertices have colours above 1, which Mitsuba takes for 1."""
    for node in scene.nodes("Shape"):
        if node.props.plugin_name() != "ply" or not _takes_attribute(scene, node):
            continue
        file = Path(str(scene.resolver.resolve(node.props.get("filename", ""))))
        largest = largest_colour(file) if file.is_file() else None
        if largest is not None and largest > 1:
            what = f"colours of vertices in {file.name!r} are as large as {largest:g}: Mitsuba takes 1 instead"
            remedy = "give values from 0 to 1: if they count from 0 to 255, divide them by 255"
            yield Finding("wrong", scene.where(node), what, remedy)


def _takes_attribute(scene: SceneFile, node: MitsubaObject) -> bool:
    """Whether anything nested in an element, or referred to by it, is an attribute of a mesh."""
    return any(
        child.props.plugin_name() == TEXTURE or _takes_attribute(scene, child)
        for _, child in scene.children(node.props)
    )
