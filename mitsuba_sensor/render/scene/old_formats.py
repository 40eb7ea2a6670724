"""Converts parsed scenes of Mitsuba 0.3 to 2 where version 3 has the same thing under another name, or an obvious one.

Plugins and parameters are changed in the parsed nodes, after Mitsuba's own upgrade, which knows no more than parameters
in camelCase and offsets of textures. Each change is a note. What the parser refuses is changed before, in the text, see
:mod:`.old_text`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from ..variants import MitsubaObject, mitsuba
from .scene_edits import BLOCK_SIDE

Change: TypeAlias = tuple[MitsubaObject, str]  # a node, and what was changed in it

KEPT = (
    "max_depth",
    "rr_depth",
    "hide_emitters",
)  # parameters of an integrator that mean the same in 'path'
BIDIRECTIONAL = (
    "bdpt",
    "erpt",
    "mlt",
    "photonmapper",
    "ppm",
    "pssmlt",
    "sppm",
    "vpl",
    "volpath_simple",
)
AROUND_ANOTHER = ("adaptive", "irrcache", "multichannel")
RENAMED_PLUGINS = {
    "vertexcolors": "mesh_attribute",
    "grid3d": "gridvolume",
    "constant3d": "constvolume",
}
SUN_DEGREES, SMALLEST_SUN = (
    0.5358,
    0.01,
)  # Mitsuba's default aperture; of it, instead of a sun that is a point
FILTERS = {"trilinear": "bilinear", "ewa": "bilinear"}
DISTRIBUTIONS = {
    "phong": "beckmann",
    "as": "beckmann",
}  # of microfacets, with the same roughness
DROPPED = {  # type of node → parameters that change the picture not at all, or hardly
    "Integrator": ("strict_normals",),
    "Shape": ("max_smooth_angle", "collapse", "srgb"),
    "Texture": ("cache", "max_anisotropy"),
    "Emitter": ("cache", "gamma", "samples", "stretch", "extend", "resolution"),
    "BSDF": ("ext_eta", "specular_sampling_weight", "diffuse_sampling_weight"),
    "Medium": ("method", "step_size"),
}


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
                found += [
                    (node, f"{name!r} of {kind.lower()} left out")
                    for name in names
                    if name in node.props
                ]
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


def take_integrator(
    root: MitsubaObject, found: list[tuple[str, MitsubaObject]], kind: str
) -> list[Change]:
    """Put an integrator of this kind in the place of those of a scene. found : (name, node) of those."""
    for name, _ in found[1:]:
        del root[name]
    if not found:
        root["integrator"] = mitsuba().load_dict({"type": kind, "block_size": BLOCK_SIDE})
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
    if "gamma" in props:
        del props["gamma"]
        yield "'gamma' of a texture left out: pictures of 8 bits are read as sRGB, others as linear"
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
    renamed = {
        "intensity": {
            "area": "radiance",
            "constant": "radiance",
            "directional": "irradiance",
        }.get(kind)
    }
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
    if (
        "sigma_a" in props
        and "sigma_s" in props
        and all(isinstance(props[n], float) for n in ("sigma_a", "sigma_s"))
    ):
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
