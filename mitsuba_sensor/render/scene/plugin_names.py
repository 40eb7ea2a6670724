"""Which plugins there are: files of Mitsuba, those that Python registers, and our own; and of which kind each is."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from ...core import InputError, nearest
from ..variants import MitsubaObject, mitsuba

OWN_PLUGINS = ("camera", "photosensor", "raw_frame")
SHARED = ("__init__", "common")  # modules of the folder of gradient integrators that are none
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def plugin_names() -> list[str]:
    """Names of the plugins of Mitsuba and of our own."""
    native = (file.stem for file in (_own_folder() / "plugins").iterdir())
    return sorted({*OWN_PLUGINS, *native, *gradient_integrators()})


def gradient_integrators() -> list[str]:
    """Names of the integrators that compute gradients, each a module of Mitsuba's in Python. Scalar variants do not
    register them."""
    modules = (
        file.stem for file in (_own_folder() / "python" / "ad" / "integrators").glob("*.py")
    )
    return sorted(name for name in modules if name not in SHARED)


PRIMAL = {
    "direct_projective": "direct",
    "prb": "path",
    "prb_basic": "path",
    "prb_projective": "path",
    "prbvolpath": "volpath",
}
"""Integrators for gradients, and the one that renders the same image."""


def remedy_for_unknown(kind: str) -> str:
    """What to write instead of a type that no plugin of this variant has, from the full stop or semicolon on."""
    if kind in gradient_integrators():
        same = f": {PRIMAL[kind]!r} gives the same image" if kind in PRIMAL else ""
        return f"; it computes gradients and needs an llvm or cuda variant{same}."
    return f".{nearest(kind, plugin_names())}"


def _own_folder() -> Path:
    return Path(str(mitsuba().__file__)).parent


def type_of_plugin(props: MitsubaObject) -> MitsubaObject:
    """The ObjectType of a plugin that Python registered, which only an object of it can tell; None if no plugin has
    this name, ObjectType.Unknown where it cannot be built without the elements inside it.

    props : of a node of a scene without foreign code.
    """
    mi = mitsuba()
    nested = mi.Properties.Type.ResolvedReference
    own = {name: props[name] for name in props if props.type(name) != nested}
    kind = props.plugin_name()
    try:
        plugin = mi.load_dict({"type": kind, **own})
    except RuntimeError as error:
        return None if f'Plugin "{kind}" not found' in str(error) else mi.ObjectType.Unknown
    for kind_of_node in mi.ObjectType:
        if isinstance(plugin, getattr(mi, kind_of_node.name, ())):
            return kind_of_node
    return mi.ObjectType.Unknown


_TEXTURES = (
    "color0 color1 filename filter_type wrap_mode raw to_uv value wavelengths temperature scale"
)
_TEXTURES += " wavelength_min wavelength_max bitmap data format accel"
_COLOURS = "reflectance diffuse_reflectance specular_reflectance specular_transmittance base_color weight opacity"
_SURFACES = "alpha alpha_u alpha_v distribution sample_visible int_ior ext_ior nonlinear material eta k roughness"
_PRINCIPLED = "anisotropic metallic spec_trans specular spec_tint sheen sheen_tint flatness clearcoat clearcoat_gloss"
_OF_SHAPES = "to_world flip_normals filename face_normals center radius p0 p1 flip_tex_coords shape_index"
_VIEW = "fov fov_axis focal_length near_clip far_clip to_world principal_point_offset_x principal_point_offset_y"
_SUN = "direction turbidity albedo latitude longitude timezone year month day hour minute second sun_scale sky_scale"
_INSIDE = "albedo sigma_t scale sample_emitters has_spectral_extinction"

NAMES = {
    "bsdf": f"{_COLOURS} {_SURFACES} {_PRINCIPLED} {_TEXTURES}",
    "emitter": f"radiance irradiance intensity scale filename to_world position cutoff_angle beam_width texture {_SUN}",
    "film": "width height crop_width crop_height crop_offset_x crop_offset_y sample_border compensate file_format "
    "pixel_format component_format rfilter",
    "integrator": "max_depth rr_depth hide_emitters emitter_samples bsdf_samples shading_samples aovs timeout",
    "medium": _INSIDE,
    "phase": "g albedo stddev S",
    "rfilter": "radius stddev lobes A B",
    "sampler": "sample_count seed jitter",
    "sensor": f"{_VIEW} aperture_radius focus_distance shutter_open shutter_close",
    "shape": _OF_SHAPES,
    "texture": _TEXTURES,
    "volume": "filename grid to_world value wrap_mode filter_type raw",
}


def meant(message: str) -> str:
    """`` Did you mean …?`` for the first parameter that Mitsuba's message says no plugin has asked for, or nothing."""
    found = re.search(
        r'unreferenced propert\w+ in (\w+) plugin of type "\w+": - \w+ "(\w+)"', message
    )
    return nearest(found[2], NAMES.get(found[1], "").split()) if found else ""


def refuse_foreign_plugins(name: str, state: MitsubaObject, resolver: MitsubaObject) -> None:
    """Raise InputError for a type that is no name, and for one whose code is not Mitsuba's own.

    Types that Python has registered have no file.  name : of the scene.  state : parsed, of which nothing is built.
    resolver : looks into Mitsuba's folder first.
    """
    own = Path(str(mitsuba().__file__)).resolve().parent / "plugins"
    for kind in sorted({node.props.plugin_name() for node in state.nodes}):
        if not re.fullmatch(r"[\w-]{0,64}", kind):
            raise InputError(
                f"scene {name!r} has an element of type {kind[:80]!r}, which is no name of a plugin."
            )
        code = Path(str(resolver.resolve(f"plugins/{kind}{SUFFIX}")))
        if code.exists() and code.resolve().parent != own:
            way_out = "move it away, or render with plain Mitsuba what you trust"
            raise InputError(
                f"scene {name!r} has type {kind!r}, and {code} is native code that would be run; {way_out}."
            )
