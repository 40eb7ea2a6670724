"""Light groups: emitters of a scene that belong together, and the scene with the emitters of one group only.

Light is linear in the emitters, so a group is a render of the scene without all other emitters. The shape of a removed
emitter remains, and still blocks and reflects light.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import NamedTuple

from ...camera.camera import Camera
from ...core import InputError, nearest
from ..light.light_sum import OF_PHOTODIODES
from ..variants import MitsubaObject, mitsuba
from .asked import GROUP_NAME, AskedGroups, refuse_many
from .parsed_scene import ParsedScene

OTHER = "other"
"""Group of the emitters that no pattern names, and of emitters without an id."""


class PlacedEmitter(NamedTuple):
    """An emitter in a parsed scene.

    owner, key : properties of the scene or shape that contains the emitter, and its name there.
    names : ids of the shape and the emitter, if they have one.
    parameter_prefixes : prefixes of its parameter names in ``mi.traverse``.
    """

    owner: MitsubaObject
    key: str
    names: tuple[str, ...]
    parameter_prefixes: tuple[str, ...]
    in_shape: bool


class LightGroup(NamedTuple):
    """Light that is rendered separately.

    emitters : indices in :func:`emitters_of`; None for all emitters.  half_pupil : name of the half, or None.
    """

    name: str
    emitters: frozenset[int] | None
    half_pupil: str | None = None

    def camera(self, camera: Camera) -> Camera:
        """Return the camera with the half-pupil of this group."""
        if self.half_pupil is None:
            return camera
        halves = {"sensor.dual_pixel": False, "lens.half_pupil": self.half_pupil}
        return camera.replace(**halves)


PUPIL_HALVES = tuple(LightGroup(name, None, half) for half, name in OF_PHOTODIODES.items())
"""The light of the two photodiodes of dual pixels."""


def emitters_of(scene: ParsedScene) -> list[PlacedEmitter]:
    """Return the emitters of a scene in the order of its nodes."""
    placed = list[PlacedEmitter]()
    for shape in (None, *scene.nodes("Shape")):
        owner = scene.root if shape is None else shape.props
        shape_id = str(owner.id()) if shape is not None else ""
        for key, node in scene.children(owner, "Emitter"):
            emitter_id = str(node.props.id())
            names = tuple(name for name in (shape_id, emitter_id) if name)
            prefixes = [f"{emitter_id}."] * bool(emitter_id)
            prefixes += [f"{shape_id}.emitter."] * bool(shape_id)
            placed.append(PlacedEmitter(owner, key, names, tuple(prefixes), shape is not None))
    return placed


def parts_of_light(
    scene: ParsedScene, asked: AskedGroups | None, camera: Camera
) -> tuple[LightGroup, ...]:
    """Return the light that is rendered separately: requested light groups, or the halves of the pupil for dual pixels;
    nothing if the light is rendered as a whole. Raises InputError."""
    if asked is None:
        return PUPIL_HALVES if camera.sensor.dual_pixel else ()
    if camera.sensor.dual_pixel:
        raise InputError(
            f"light_groups are given, but {camera.name} has dual pixels, whose light is rendered by halves of the "
            "pupil; omit light_groups, or set sensor.dual_pixel to false."
        )
    return light_groups_of(scene, asked)


def light_groups_of(scene: ParsedScene, asked: AskedGroups) -> tuple[LightGroup, ...]:
    """Return the groups of a scene, each with at least one emitter. Raises InputError."""
    if scene.loaded is not None:
        raise InputError(
            "light_groups is given, but the scene is loaded already, so no emitter can be removed; pass its file, its "
            "XML text or its dict."
        )
    patterns: Mapping[str, tuple[str, ...]] = {} if asked == "auto" else asked
    emitters = emitters_of(scene)
    members: dict[str, set[int]] = {}
    for number, emitter in enumerate(emitters):
        members.setdefault(_group_of(emitter, patterns), set()).add(number)
    for group, of_group in patterns.items():
        if group not in members:
            known = sorted({name for emitter in emitters for name in emitter.names})
            has = f"its emitters are {', '.join(known)}" if known else "no emitter has an id"
            named = ", ".join(of_group)
            raise InputError(
                f"light_groups: no emitter is named {named} ({group}); {has}.{nearest(named, known)}"
            )
    refuse_many("light_groups", members, [name for x in emitters for name in x.names[-1:]])
    order = [*patterns, *(name for name in members if name not in patterns)]
    return tuple(LightGroup(name, frozenset(members[name])) for name in order)


def _group_of(emitter: PlacedEmitter, patterns: Mapping[str, tuple[str, ...]]) -> str:
    """Return the name of an emitter's group; its id without patterns. Raises InputError for an emitter in two
    groups."""
    if not patterns:
        return _group_name(emitter.names[0]) if emitter.names else OTHER
    groups = [
        group
        for group, of_group in patterns.items()
        if any(fnmatchcase(name, pattern) for name in emitter.names for pattern in of_group)
    ]
    if len(groups) > 1:
        raise InputError(
            f"light_groups: emitter {emitter.names[0]!r} is in the groups {' and '.join(groups)}; name it in one group."
        )
    return groups[0] if groups else OTHER


def _group_name(emitter_id: str) -> str:
    """Return the id of an emitter as the name of a group: in image files a dot would separate layers."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", emitter_id)
    return name if GROUP_NAME.fullmatch(name) else f"emitter_{name}"


def keep_emitters(scene: ParsedScene, kept: Collection[int]) -> ParsedScene:
    """Return the scene with these emitters only; its nodes are changed.  kept : indices in :func:`emitters_of`."""
    removed = [
        emitter for number, emitter in enumerate(emitters_of(scene)) if number not in kept
    ]
    for emitter in removed:
        del emitter.owner[emitter.key]
        if emitter.in_shape and not scene.children(emitter.owner, "BSDF"):
            emitter.owner["black"] = mitsuba().load_dict(BLACK)
    prefixes = tuple(prefix for emitter in removed for prefix in emitter.parameter_prefixes)
    return replace(scene, edits=scene.edits.without_parameters(prefixes))


BLACK = {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.0}}
"""Mitsuba's default material for the shape of an emitter."""
