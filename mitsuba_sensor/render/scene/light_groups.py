"""Light groups: which emitters of a scene belong together, and a scene with the emitters of one group only.

Light is linear in the emitters, so a group is a render of the scene from which all other emitters are taken out. The
shape of an emitter that is taken out stays, and still blocks and reflects light.
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
"""Group of the emitters that no pattern names, and of those without an id."""


class PlacedEmitter(NamedTuple):
    """An emitter in a parsed scene.

    owner, key : properties of the scene or shape that has it, and its name there.
    names : the id of its shape and its own, as far as they have one.
    parameter_prefixes : how the names of its parameters in ``mi.traverse`` begin.
    """

    owner: MitsubaObject
    key: str
    names: tuple[str, ...]
    parameter_prefixes: tuple[str, ...]
    in_shape: bool


class LightGroup(NamedTuple):
    """A part of the light that is rendered by itself.

    emitters : their numbers in :func:`emitters_of`; None for all of them.  half_pupil : where it comes through one.
    """

    name: str
    emitters: frozenset[int] | None
    half_pupil: str | None = None

    def camera(self, camera: Camera) -> Camera:
        """The camera that the scene is loaded for."""
        if self.half_pupil is None:
            return camera
        halves = {"sensor.dual_pixel": False, "lens.half_pupil": self.half_pupil}
        return camera.replace(**halves)


PUPIL_HALVES = tuple(LightGroup(name, None, half) for half, name in OF_PHOTODIODES.items())
"""What the photodiodes of dual pixels see."""


def emitters_of(scene: ParsedScene) -> list[PlacedEmitter]:
    """The emitters of a scene, in the order of its nodes."""
    placed = list[PlacedEmitter]()
    for key, node in scene.children(scene.root, "Emitter"):
        own = _id(node)
        placed.append(PlacedEmitter(scene.root, key, own, _prefixes(own), in_shape=False))
    for shape in scene.nodes("Shape"):
        for key, node in scene.children(shape.props, "Emitter"):
            names = (*_id(shape), *_id(node))
            prefixes = (*_prefixes(_id(node)), *(f"{name}.emitter." for name in _id(shape)))
            placed.append(PlacedEmitter(shape.props, key, names, prefixes, in_shape=True))
    return placed


def _id(node: MitsubaObject) -> tuple[str, ...]:
    """The id of a node, or nothing."""
    return (str(node.props.id()),) if node.props.id() else ()


def _prefixes(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{name}." for name in names)


def parts_of_light(
    scene: ParsedScene, asked: AskedGroups | None, camera: Camera
) -> tuple[LightGroup, ...]:
    """What is rendered apart: light groups that are asked for, or the halves of the pupil for dual pixels; nothing
    where all is rendered at once. Raises InputError."""
    if asked is None:
        return PUPIL_HALVES if camera.sensor.dual_pixel else ()
    if camera.sensor.dual_pixel:
        raise InputError(
            f"light_groups are given, and {camera.name} has dual pixels, whose light is rendered by halves of the "
            "pupil; omit light_groups, or set sensor.dual_pixel to false."
        )
    return light_groups_of(scene, asked)


def light_groups_of(scene: ParsedScene, asked: AskedGroups) -> tuple[LightGroup, ...]:
    """The groups of a scene, each with at least one emitter. Raises InputError."""
    if scene.loaded is not None:
        raise InputError(
            "light_groups is given and the scene is loaded already, so that no emitter can be taken out; pass its "
            "file, its XML text or its dict."
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
    refuse_many("light_groups", members, [name for one in emitters for name in one.names[-1:]])
    order = [*patterns, *(name for name in members if name not in patterns)]
    return tuple(LightGroup(name, frozenset(members[name])) for name in order)


def _group_of(emitter: PlacedEmitter, patterns: Mapping[str, tuple[str, ...]]) -> str:
    """Name of the group of an emitter; its id where there are no patterns. Raises InputError where it is in two."""
    if not patterns:
        return _group_name(emitter.names[0]) if emitter.names else OTHER
    groups = [
        group
        for group, of_group in patterns.items()
        if any(fnmatchcase(name, pattern) for name in emitter.names for pattern in of_group)
    ]
    if len(groups) > 1:
        raise InputError(
            f"light_groups: emitter {emitter.names[0]!r} is in the groups {' and '.join(groups)}; an emitter is in "
            "one."
        )
    return groups[0] if groups else OTHER


def _group_name(emitter_id: str) -> str:
    """The id of an emitter as the name of a group: in a file of images a dot would separate layers."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", emitter_id)
    return name if GROUP_NAME.fullmatch(name) else f"emitter_{name}"


def keep_emitters(scene: ParsedScene, kept: Collection[int]) -> ParsedScene:
    """The scene with these emitters only; its nodes are changed.  kept : their numbers in :func:`emitters_of`."""
    taken_out = [
        emitter for number, emitter in enumerate(emitters_of(scene)) if number not in kept
    ]
    for emitter in taken_out:
        del emitter.owner[emitter.key]
        if emitter.in_shape and not scene.children(emitter.owner, "BSDF"):
            emitter.owner["black"] = mitsuba().load_dict(BLACK)
    prefixes = tuple(prefix for emitter in taken_out for prefix in emitter.parameter_prefixes)
    return replace(scene, edits=scene.edits.without_parameters(prefixes))


BLACK = {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.0}}
"""What Mitsuba gives to the shape of an emitter that has no BSDF."""
