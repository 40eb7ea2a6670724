"""A loaded scene without its depth of field, or without the light that comes by way of other surfaces."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .lint import WRAPPERS
from .prepared import PreparedRender
from .renderer import Renderer
from .scene_file import SceneFile
from .variants import mitsuba

WITH_DEPTH = ("path", "volpath", "volpathmis")
"""Integrators of Mitsuba whose ``max_depth`` cuts off indirect light."""
PASSED = ("max_depth", "hide_emitters")  # what an integrator without indirect light takes from the scene's own
STOPPED_DOWN = 1e-6  # of the scene's aperture: what is left of it. Mitsuba refuses an aperture of 0


def without_depth_of_field(loaded: PreparedRender) -> PreparedRender:
    """The same, its thin lens stopped down to a point; the scene that was loaded is changed."""
    parameters = mitsuba().traverse(loaded.at_rest.sensor)
    parameters["aperture_radius"] = parameters["aperture_radius"] * STOPPED_DOWN
    parameters.update()
    return loaded


def without_indirect_light(loaded: PreparedRender) -> PreparedRender:
    """The same with the integrator of :func:`direct_integrator`, which must not be None."""
    scene = replace(loaded.at_rest, integrator=mitsuba().load_dict(direct_integrator(loaded.parsed.file)))
    return replace(loaded, scene=scene, renderer=Renderer(scene, loaded.camera, loaded.exposure, loaded.bands))


def direct_integrator(scene: SceneFile) -> dict[str, Any] | None:
    """The scene's integrator without indirect light, in Mitsuba's terms; None where it has no more to lose."""
    mi = mitsuba()
    name, given = "path", dict[str, Any]()
    for _, node in scene.children(scene.root):
        while node.type == mi.ObjectType.Integrator:
            name, given = node.props.plugin_name(), {key: node.props[key] for key in node.props if key in PASSED}
            inner = [one for _, one in scene.children(node.props) if one.type == node.type]
            if name not in WRAPPERS or not inner:
                break
            node = inner[0]
    if name in WRAPPERS:
        name, given = "path", {}
    if name not in WITH_DEPTH or 0 <= given.get("max_depth", -1) <= 2:
        return None
    return {"type": name, **given, "max_depth": 2}
