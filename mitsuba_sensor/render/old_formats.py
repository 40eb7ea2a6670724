"""Converts scene files of Mitsuba 0.3 to 2.x where version 3 has the same thing under another name, or an obvious one.

Elements that the parser of Mitsuba 3 refuses are changed in the text, line by line, so that line numbers stay
(:func:`upgraded_text`); plugins and parameters are changed in the parsed nodes (:func:`upgrade`), after Mitsuba's own
upgrade, which knows no more than parameters in camelCase and offsets of textures. Each change is a note.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from ..core.units import BOLTZMANN_J_PER_K, LIGHT_SPEED_M_PER_S, PLANCK_J_S
from .variants import MitsubaObject, mitsuba

Attributes: TypeAlias = dict[str, str]
Change: TypeAlias = tuple[MitsubaObject, str]  # a node, and what was changed in it

CURRENT = (3, 0, 0)
RENAMED_TAGS = {"lookAt": "lookat", "luminaire": "emitter", "camera": "sensor"}
BLACKBODY_NM = range(300, 1201, 5)  # the table of a <blackbody>, linear in between: within 0.03 % at 2000 to 10 000 K
KEPT = ("max_depth", "rr_depth", "hide_emitters")  # parameters of an integrator that mean the same in 'path'
BIDIRECTIONAL = ("bdpt", "erpt", "mlt", "photonmapper", "ppm", "pssmlt", "sppm", "vpl", "volpath_simple")
AROUND_ANOTHER = ("adaptive", "irrcache", "multichannel")
RENAMED_PLUGINS = {"vertexcolors": "mesh_attribute", "grid3d": "gridvolume", "constant3d": "constvolume"}
SUN_DEGREES, SMALLEST_SUN = 0.5358, 0.01  # Mitsuba's default aperture; of it, instead of a sun that is a point
FILTERS = {"trilinear": "bilinear", "ewa": "bilinear"}
DISTRIBUTIONS = {"phong": "beckmann", "as": "beckmann"}  # of microfacets, with the same roughness
DROPPED = {  # type of node → parameters that change the picture not at all, or hardly
    "Integrator": ("strict_normals",),
    "Shape": ("max_smooth_angle", "collapse", "srgb"),
    "Texture": ("cache", "max_anisotropy", "gamma"),
    "Emitter": ("cache", "gamma", "samples", "stretch", "extend", "resolution"),
    "BSDF": ("ext_eta", "specular_sampling_weight", "diffuse_sampling_weight"),
    "Medium": ("method", "step_size"),
}


def version_of(text: str) -> tuple[int, ...]:
    """The format of a scene file, from its text; that of Mitsuba 3 where it names none."""
    found = re.search(r'<scene\s[^>]*?version\s*=\s*"([\d.]+)"', text)
    return tuple(int(part) for part in found[1].split(".") if part) if found else CURRENT


def version_name(text: str) -> str:
    """The same as it is written: 0.5.0."""
    return ".".join(map(str, version_of(text)))


def upgraded_text(text: str) -> tuple[str, list[str]]:
    """The text with the elements of Mitsuba 3, and the names of those that were changed."""
    text = re.sub(r"<!--.*?-->", lambda found: "\n" * found[0].count("\n"), text, flags=re.DOTALL)
    changed: list[str] = []

    def element(found: re.Match[str]) -> str:
        end, tag, inside, close = found.groups()
        attributes = dict(re.findall(r'([\w:]+)\s*=\s*"([^"]*)"', inside))
        new = (RENAMED_TAGS.get(tag, tag), attributes) if end else _element(tag, attributes)
        if new == (tag, attributes) or new is None:
            return found[0]
        if not end and tag not in changed:
            changed.append(tag)
        written = "".join(f' {name}="{value}"' for name, value in new[1].items())
        return f"<{end}{new[0]}{written}{close}>" + "\n" * found[0].count("\n")

    return re.sub(r'<(/?)(\w+)((?:\s+[\w:]+\s*=\s*"[^"]*")*)\s*(/?)>', element, text), changed


def _element(tag: str, given: Attributes) -> tuple[str, Attributes] | None:
    """An element in the terms of Mitsuba 3; None where nothing is known of it."""
    attributes = {name: value for name, value in given.items() if tag not in COLOURS or name != "intent"}
    if tag == "blackbody":
        return "spectrum", {"name": attributes.get("name", "radiance"), "value": _planck(attributes)}
    if tag in COLOURS and "value" in attributes:
        tag, attributes["value"] = COLOURS[tag](tag, attributes["value"])
    if tag == "lookAt" and "ox" in attributes:
        points = {"origin": "o", "target": "t", "up": "u"}
        attributes = {name: ", ".join(attributes.get(p + axis, "0") for axis in "xyz") for name, p in points.items()}
    return RENAMED_TAGS.get(tag, tag), attributes


def _rgb(tag: str, value: str) -> tuple[str, str]:
    """#rrggbb as three linear numbers, as Mitsuba 0.6 read it in an <rgb>."""
    return tag, " ".join(f"{part:.6g}" for part in _hexadecimal(value)) if value.startswith("#") else value


def _srgb(_: str, value: str) -> tuple[str, str]:
    """sRGB as linear rgb, by the curve of IEC 61966-2-1."""
    if not value.startswith("#") and not re.fullmatch(r"[\d.eE+\-,\s]+", value):
        return "rgb", value  # a parameter
    encoded = _hexadecimal(value) if value.startswith("#") else [float(x) for x in re.split(r"[,\s]+", value.strip())]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded]
    return "rgb", " ".join(f"{part:.6g}" for part in linear)


def _spectrum(tag: str, value: str) -> tuple[str, str]:
    """Three numbers without wavelengths are red, green and blue: Mitsuba 0.6 counted in three bins unless built
    otherwise."""
    numbers = re.split(r"[,\s]+", value.strip())
    return ("rgb", value) if len(numbers) == 3 and ":" not in value else (tag, value)


COLOURS: Mapping[str, Callable[[str, str], tuple[str, str]]] = {"rgb": _rgb, "srgb": _srgb, "spectrum": _spectrum}


def _hexadecimal(value: str) -> list[float]:
    """#rrggbb or #rgb, from 0 to 1."""
    digits = value[1:] if len(value) == 7 else "".join(digit * 2 for digit in value[1:])
    return [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]


def _planck(attributes: Attributes) -> str:
    """The table of a <blackbody temperature="5000k" scale="1">, W m⁻² sr⁻¹ nm⁻¹."""
    kelvin = float(attributes.get("temperature", "5000").strip().rstrip("kK"))
    scale = float(attributes.get("scale", attributes.get("multiplier", "1")))

    def radiance(nm: int) -> float:
        length_m = nm * 1e-9
        x = PLANCK_J_S * LIGHT_SPEED_M_PER_S / (length_m * BOLTZMANN_J_PER_K * kelvin)
        return scale * 2e-9 * PLANCK_J_S * LIGHT_SPEED_M_PER_S**2 / length_m**5 / math.expm1(x)

    return ", ".join(f"{nm}:{radiance(nm):.6g}" for nm in BLACKBODY_NM)


def upgrade(state: MitsubaObject) -> list[Change]:
    """Change the parsed nodes of old files in place; what was changed, node by node."""
    found: list[Change] = []
    types = mitsuba().ObjectType
    for node in state.nodes:
        if str(state.versions[node.file_index]) >= "3":
            continue
        name = node.props.plugin_name()
        if name != name.lower():
            node.props.set_plugin_name(name.lower())
            found.append((node, f"{name!r} is {name.lower()!r} now"))
        for kind, convert in CONVERSIONS.items():
            if node.type == getattr(types, kind):
                found += [(node, what) for what in convert(node, state)]
        for kind, names in DROPPED.items():
            if node.type == getattr(types, kind):
                found += [(node, f"{name!r} of {kind.lower()} left out") for name in names if name in node.props]
                _delete(node.props, names)
    return found


def _delete(props: MitsubaObject, names: tuple[str, ...]) -> None:
    for name in [name for name in props if name in names]:
        del props[name]


def _rename(props: MitsubaObject, old: str, new: str) -> None:
    value = props[old]
    del props[old]
    props[new] = value


def replace_integrator(props: MitsubaObject, kind: str) -> None:
    """Another integrator with the depth and the visible emitters of this one; integrators inside it are left out."""
    kept = KEPT if kind != "direct" else ("hide_emitters",)
    _delete(props, tuple(name for name in props if name not in kept))
    props.set_plugin_name(kind)


def take_integrator(root: MitsubaObject, found: list[tuple[str, MitsubaObject]], kind: str) -> list[Change]:
    """Put an integrator of this kind in the place of those of a scene. found : (name, node) of those."""
    for name, _ in found[1:]:
        del root[name]
    if not found:
        root["integrator"] = mitsuba().load_dict({"type": kind})
        return []
    node = found[0][1]
    old = node.props.plugin_name()
    replace_integrator(node.props, kind)
    return [(node, f"integrator {old!r} is replaced by {kind!r}, as asked")]


def _integrator(node: MitsubaObject, state: MitsubaObject) -> Iterator[str]:
    kind = node.props.plugin_name()
    if kind not in (*BIDIRECTIONAL, *AROUND_ANOTHER):
        return
    media = any(one.type == mitsuba().ObjectType.Medium for one in state.nodes)
    new = "volpath" if media else "path"
    replace_integrator(node.props, new)
    yield f"integrator {kind!r} is {new!r} now, which finds the same light, caustics more slowly"


def _plugin(node: MitsubaObject, _: MitsubaObject) -> Iterator[str]:
    kind = node.props.plugin_name()
    if kind not in RENAMED_PLUGINS:
        return
    node.props.set_plugin_name(RENAMED_PLUGINS[kind])
    if kind == "vertexcolors":
        node.props["name"] = "vertex_color"
    else:
        node.type = mitsuba().ObjectType.Volume
    yield f"{kind!r} is {RENAMED_PLUGINS[kind]!r} now"


def _texture(node: MitsubaObject, state: MitsubaObject) -> Iterator[str]:
    yield from _plugin(node, state)
    props = node.props
    yield from _values(props, "filter_type", FILTERS)
    wraps = [name for name in props if name in ("wrap_mode_u", "wrap_mode_v")]
    if wraps:
        mode = props[wraps[0]]
        _delete(props, tuple(wraps))
        props["wrap_mode"] = mode
        yield f"{wraps[0]!r} is 'wrap_mode' now"


def _bsdf(node: MitsubaObject, state: MitsubaObject) -> Iterator[str]:
    props, kind = node.props, node.props.plugin_name()
    yield from _values(props, "distribution", DISTRIBUTIONS)
    if kind not in ("bumpmap", "normalmap"):
        return
    reference = mitsuba().Properties.Type.ResolvedReference
    for name in [name for name in props if props.type(name) == reference]:
        child = state.nodes[props[name].index()]
        if child.type == mitsuba().ObjectType.Texture and child.props.plugin_name() == "bitmap":
            child.props["raw"] = True
            if kind == "normalmap" and name != "normalmap":
                _rename(props, name, "normalmap")
            yield f"the texture of a {kind} is read as numbers and not as colours"


def _values(props: MitsubaObject, name: str, new: Mapping[str, str]) -> Iterator[str]:
    """Change the value of a text parameter, where it is an old one."""
    if name in props and props[name] in new:
        old = props[name]
        props[name] = new[old]
        yield f"{name} {old!r} is {new[old]!r} now"


def _emitter(node: MitsubaObject, _: MitsubaObject) -> Iterator[str]:
    props, kind = node.props, node.props.plugin_name()
    if kind in ("sun", "sky"):
        props.set_plugin_name("sunsky")
        props["sky_scale" if kind == "sun" else "sun_scale"] = 0.0
        yield f"emitter {kind!r} is 'sunsky' without its {'sky' if kind == 'sun' else 'sun'} now"
    if props.plugin_name() == "sunsky":
        yield from _sunsky(props)
    renamed = {"intensity": {"area": "radiance", "constant": "radiance", "directional": "irradiance"}.get(kind)}
    for old, new in renamed.items():
        if new is not None and old in props:
            _rename(props, old, new)
            yield f"{old!r} of {kind!r} is {new!r} now"


def _sunsky(props: MitsubaObject) -> Iterator[str]:
    """One scale of sun and sky is two now; the radius of the sun is its aperture."""
    if "scale" in props:
        for name in ("sun_scale", "sky_scale"):
            props[name] = props.get(name, 1.0) * props["scale"]
        del props["scale"]
        yield "'scale' of the sky is 'sun_scale' and 'sky_scale' now"
    if "sun_radius_scale" in props:
        props["sun_aperture"] = SUN_DEGREES * max(props["sun_radius_scale"], SMALLEST_SUN)
        del props["sun_radius_scale"]
        yield "'sun_radius_scale' is 'sun_aperture' now"


def _medium(node: MitsubaObject, _: MitsubaObject) -> Iterator[str]:
    props = node.props
    if props.plugin_name() == "heterogeneous" and "density" in props:
        _rename(props, "density", "sigma_t")
        yield "'density' is 'sigma_t' now"
    if "sigma_a" in props and "sigma_s" in props and all(isinstance(props[n], float) for n in ("sigma_a", "sigma_s")):
        absorbed, scattered = props["sigma_a"], props["sigma_s"]
        _delete(props, ("sigma_a", "sigma_s"))
        props["sigma_t"] = absorbed + scattered
        props["albedo"] = scattered / (absorbed + scattered) if absorbed + scattered else 0.0
        yield "'sigma_a' and 'sigma_s' are 'sigma_t' and 'albedo' now"


CONVERSIONS: Mapping[str, Callable[[MitsubaObject, MitsubaObject], Iterator[str]]] = {
    "Integrator": _integrator,
    "Texture": _texture,
    "Volume": _plugin,
    "BSDF": _bsdf,
    "Emitter": _emitter,
    "Medium": _medium,
}
