"""Which rule each RGB colour of a scene has beyond 700 nm, and the scene with these rules put into it."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from ...core import Float64Array, InputError, nearest
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba
from .held_texture import PARTS, PLUGIN, register_held_texture
from .materials import (
    HELD_FROM_NM,
    REFUSE,
    SEEN_TO_NM,
    AskedInfrared,
    Material,
    materials,
)
from .rgb_colours import REFLECTANCES, RgbColour, rgb_colours

STEP_NM = 1.0  # of the table of a colour
LOWEST_NM = 360.0  # of the range for which Mitsuba makes spectra of colours
MOST_NAMED = 8  # materials in a message


class RuledColour(NamedTuple):
    """A colour, and the measured material that it is beyond 700 nm; None: it keeps its value."""

    colour: RgbColour
    material: Material | None


def is_seen_beyond(high_nm: float) -> bool:
    """Whether bands that end there reach where an RGB colour says nothing."""
    return high_nm > SEEN_TO_NM


def ruled_colours(
    scene: ParsedScene, asked: AskedInfrared, high_nm: float
) -> list[RuledColour]:
    """The colours that bands which end at ``high_nm`` see beyond the visible, each with its rule. Raises
    InputError."""
    if not is_seen_beyond(high_nm):
        return []
    colours = rgb_colours(scene)
    if asked == REFUSE:
        _refuse(scene, colours, high_nm)
        return []
    patterns = asked if isinstance(asked, Mapping) else {}
    known = materials()
    used, ruled = set[str](), list[RuledColour]()
    for colour in colours:
        named = [pattern for pattern in patterns if _is_of(colour, pattern)]
        used.update(named)
        if len({patterns[pattern] for pattern in named}) > 1:
            both = " and ".join(map(repr, named))
            raise InputError(f"infrared: {colour.name} is named by {both}; name it once.")
        material = known[patterns[named[0]]] if named else None
        ruled.append(RuledColour(colour, material))
    for pattern in patterns:
        if pattern not in used:
            _refuse_pattern(pattern, colours)
    return ruled


def _is_of(colour: RgbColour, pattern: str) -> bool:
    is_reflectance = colour.role in REFLECTANCES
    return is_reflectance and any(fnmatchcase(name, pattern) for name in colour.ids)


def _refuse(scene: ParsedScene, colours: list[RgbColour], high_nm: float) -> None:
    if not colours:
        return
    names = list(
        dict.fromkeys(f"{colour.name} ({scene.where(colour.node)})" for colour in colours)
    )
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    raise InputError(
        f"infrared is 'refuse' and the bands extend to {high_nm:g} nm, where RGB says nothing of "
        f"{', '.join(names[:MOST_NAMED])}{more}; give them spectra, or materials, e.g. "
        "--infrared 'leaf_*=vegetation'."
    )


def _refuse_pattern(pattern: str, colours: list[RgbColour]) -> None:
    ids = sorted({name for colour in colours for name in colour.ids})
    has = f"those that have one are {', '.join(ids)}" if ids else "no RGB colour has an id"
    raise InputError(
        f"infrared: no material or shape with an RGB reflectance is named {pattern!r}; {has}."
        f"{nearest(pattern, ids)}"
    )


def apply_infrared(
    scene: ParsedScene, asked: AskedInfrared, low_nm: float, high_nm: float
) -> None:
    """Give the colours of a parsed scene their rules; its nodes are changed.  low_nm, high_nm : ends of the bands.

    A constant colour becomes a table, which every variant evaluates itself. Where parameters of the scene are set by
    name, it stays the colour that it is, inside a texture of ours, and keeps its name.
    """
    nodes_nm = np.arange(np.floor(min(low_nm, LOWEST_NM)), np.ceil(high_nm) + STEP_NM, STEP_NM)
    keeps_names = bool(scene.edits.traverse)
    textures = [
        colour
        for colour, _ in ruled_colours(scene, asked, high_nm)
        if keeps_names or not colour.is_constant
    ]
    first = _add_nodes(scene, len(textures))
    free = iter(range(first, first + len(textures)))
    for colour, material in ruled_colours(scene, asked, high_nm):
        value = colour.owner[colour.key]
        if colour.is_constant and not keeps_names:
            reflectance = _reflectance(value, material, nodes_nm)
            colour.owner[colour.key] = _spectrum(nodes_nm, reflectance)
            continue
        held = mitsuba().Properties(PLUGIN)
        inner, beyond = PARTS
        held[inner] = _texture(value) if colour.is_constant else value
        if material is not None:
            held[beyond] = _spectrum(nodes_nm, material.at(nodes_nm))
        number = next(free)
        scene.state.nodes[number].props = held
        colour.owner[colour.key] = mitsuba().Properties.ResolvedReference(number)


def _add_nodes(scene: ParsedScene, count: int) -> int:
    """Add textures of ours to the nodes of a scene; the number of the first.

    Nodes may move in memory then: what was taken of them before must not be used any more.
    """
    if count:
        register_held_texture()
    first = len(scene.state.nodes)
    for _ in range(count):
        node = mitsuba().parser.SceneNode()
        node.type = mitsuba().ObjectType.Texture
        scene.state.nodes.append(node)
    return first


def _reflectance(
    rgb: MitsubaObject, material: Material | None, wavelengths_nm: Float64Array
) -> Float64Array:
    """The spectrum that Mitsuba makes of a colour, up to 700 nm, and its rule beyond."""
    mi = mitsuba()
    square, slope, constant = (
        float(c) for c in mi.srgb_model_fetch(mi.ScalarColor3f(*(float(v) for v in rgb)))
    )
    up_to_nm = np.minimum(wavelengths_nm, HELD_FROM_NM)
    x = (square * up_to_nm + slope) * up_to_nm + constant
    values = 0.5 + 0.5 * x / np.sqrt(1 + x * x) if np.isfinite(x).all() else (x > 0) * 1.0
    if material is None:
        return np.asarray(values)
    beyond = wavelengths_nm > HELD_FROM_NM
    return np.where(beyond, material.at(wavelengths_nm), values)


def _spectrum(wavelengths_nm: Float64Array, values: Float64Array) -> MitsubaObject:
    """A Mitsuba spectrum of equidistant nodes."""
    return mitsuba().load_dict(
        {
            "type": "regular",
            "wavelength_min": float(wavelengths_nm[0]),
            "wavelength_max": float(wavelengths_nm[-1]),
            "values": ", ".join(map(repr, values.tolist())),
        }
    )


def _texture(rgb: MitsubaObject) -> MitsubaObject:
    """The texture that Mitsuba makes of a colour."""
    return mitsuba().load_dict({"type": "srgb", "color": [float(value) for value in rgb]})
