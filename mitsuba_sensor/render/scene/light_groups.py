"""Light groups: which emitters of a scene belong together, and a scene with the emitters of one group only.

Light is linear in the emitters, so a group is a render of the scene from which all other emitters are taken out. The
shape of an emitter that is taken out stays, and still blocks and reflects light.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Literal, NamedTuple, TypeAlias

from ...camera.camera import Camera
from ...core import InputError, nearest
from ...core.id_groups import as_options, groups_of_ids
from ..light.light_sum import OF_PHOTODIODES
from ..variants import MitsubaObject, mitsuba
from .scene_file import SceneFile

OTHER = "other"
"""Group of the emitters that no pattern names, and of those without an id."""

MOST_GROUPS = 16
GROUP_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
PATTERN_EXAMPLE = "`--light-groups lamps=lamp_* --light-groups sky=sky,moon` ({'lamps': 'lamp_*', 'sky': 'sky,moon'})"
EXAMPLE = "'auto', or {'sky': 'env', 'lamps': 'lamp_*'}"

AskedGroups: TypeAlias = Literal["auto"] | Mapping[str, tuple[str, ...]]
"""Patterns of emitter ids by the name of their group, or "auto"."""


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


def checked_light_groups(name: str, given: object) -> AskedGroups:
    """Patterns by group, or "auto".  given : "auto", texts NAME=PATTERN,PATTERN, or a dict. Raises
    InputError."""
    texts = [given] if isinstance(given, str) else given
    if isinstance(texts, list | tuple) and [*texts] == ["auto"]:
        return "auto"
    if isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts):
        given = _patterns_of_texts(texts)
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{name} is {given!r}; pass {EXAMPLE}.")
    groups = {str(group): _patterns(patterns) for group, patterns in given.items()}
    for group, patterns in groups.items():
        if not GROUP_NAME.fullmatch(group) or not patterns:
            raise InputError(
                f"{name} has {group!r}: {','.join(patterns)!r}; a group is a name of letters, digits, _ and -, and "
                f"the ids of its emitters, e.g. {EXAMPLE}."
            )
    _refuse_many(name, groups)
    return groups


def _patterns_of_texts(texts: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """["lamps=lamp_1", "lamps=lamp_2"] as {"lamps": ("lamp_1", "lamp_2")}."""
    groups = dict[str, tuple[str, ...]]()
    for text in texts:
        group, _, patterns = text.partition("=")
        name = group.strip()
        groups[name] = (*groups.get(name, ()), *_patterns(patterns))
    return groups


def _patterns(given: object) -> tuple[str, ...]:
    listed: Sequence[object] = (
        given if isinstance(given, list | tuple) else str(given).split(",")
    )
    return tuple(pattern for pattern in (str(part).strip() for part in listed) if pattern)


def _refuse_many(name: str, groups: Collection[str], ids: Sequence[str] = ()) -> None:
    """Raise InputError for more groups than there may be.  ids : of the emitters, for those that the scene suggests."""
    if len(groups) <= MOST_GROUPS:
        return
    suggested = groups_of_ids(dict.fromkeys(ids))
    example = f"e.g. {PATTERN_EXAMPLE} ({', '.join(groups)})"
    if 0 < len(suggested) <= MOST_GROUPS:
        example = f"as the ids of this scene suggest, `{as_options(suggested)}` ({suggested})"
    raise InputError(
        f"{name} makes {len(groups)} groups, each a render of its own; at most {MOST_GROUPS}: put several emitters "
        f"into one by patterns of their ids, {example}."
    )


def emitters_of(scene: SceneFile) -> list[PlacedEmitter]:
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
    scene: SceneFile, asked: AskedGroups | None, camera: Camera
) -> tuple[LightGroup, ...]:
    """What is rendered apart: light groups that are asked for, or the halves of the pupil for dual pixels; nothing
    where all is rendered at once. Raises InputError."""
    if asked is None:
        return PUPIL_HALVES if camera.sensor.dual_pixel else ()
    if camera.sensor.dual_pixel:
        raise InputError(
            f"light_groups are given, and {camera.name} has dual pixels, whose light is rendered by halves of the "
            "pupil; leave light_groups out, or set sensor.dual_pixel to false."
        )
    return light_groups_of(scene, asked)


def light_groups_of(scene: SceneFile, asked: AskedGroups) -> tuple[LightGroup, ...]:
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
    _refuse_many("light_groups", members, [name for one in emitters for name in one.names[-1:]])
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


def keep_emitters(scene: SceneFile, kept: Collection[int]) -> SceneFile:
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
