"""Names of the parameters of Mitsuba's plugins, by kind of plugin: what a misspelt one may have meant.

Source: the tables of parameters in the documentation of Mitsuba 3.9. What a plugin accepts, Mitsuba alone decides.
"""

from __future__ import annotations

import re

from ...core import nearest

_TEXTURES = "color0 color1 filename filter_type wrap_mode raw to_uv value wavelengths temperature scale"
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
    found = re.search(r'unreferenced propert\w+ in (\w+) plugin of type "\w+": - \w+ "(\w+)"', message)
    return nearest(found[2], NAMES.get(found[1], "").split()) if found else ""
