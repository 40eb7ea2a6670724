"""Media that a render leaves out, because its integrator or its sensor does not know them."""

from __future__ import annotations

from collections.abc import Iterator

from ...core.llvm import drjit
from ..scene.scene_file import SceneFile
from ..variants import MitsubaObject, mitsuba
from .finding import Finding, lines_of, places

FROM_VACUUM = "PRBVolpathIntegrator"
VOLUMETRIC = ("VolumetricPathIntegrator", "VolpathMisIntegratorImpl", FROM_VACUUM)
"""Classes of volpath, volpathmis and prbvolpath. All other integrators of Mitsuba 3.9.1 leave media out, as
tests/render/test_media.py measures."""
TAKE_VOLPATH = "take 'volpath' (--integrator volpath)"
OWNERS = ("Shape", "Sensor", "Emitter")
AXES = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
HITS_MAX = 16  # surfaces that are no boundary of a medium, along one axis


def media_findings(
    scene: SceneFile, world: MitsubaObject, sensor: MitsubaObject, integrator: MitsubaObject
) -> Iterator[Finding]:
    """Media under an integrator that renders none, around a sensor without a reference, and of no shape.

    integrator : that renders the scene.
    """
    owners = scene.nodes(*OWNERS)
    used = [node for one in owners for _, node in scene.children(one.props, "Medium")]
    for node in (one for one in scene.nodes("Medium") if one not in used):
        what = "a medium belongs to no shape and changes nothing"
        remedy = 'refer to it in a shape, <ref name="interior" id="…"/>'
        yield Finding("note", scene.where(node), what, remedy)
    nodes = [node for node in scene.nodes("Medium") if node in used]
    if not nodes and not any(shape.is_medium_transition() for shape in world.shapes()):
        return
    classes = {type(integrator).__name__, integrator.class_name()}
    if not classes & {*VOLUMETRIC}:
        where = lines_of(scene, nodes) if nodes else scene.name
        kind = next((one.props.plugin_name() for one in scene.nodes("Integrator")), "path")
        if scene.loaded is not None:
            kind = integrator.class_name()
        what = f"integrator {kind!r} renders no media, and the medium in {places(len(nodes) or 1)} is left out"
        yield Finding("wrong", where, what, TAKE_VOLPATH)
    elif sensor.get_medium() is not None and FROM_VACUUM in classes:
        what = "the sensor is inside a medium, and integrator 'prbvolpath' begins in a vacuum"
        yield Finding("wrong", scene.where(scene.sensor()), what, TAKE_VOLPATH)
    elif (around := _medium_around(world, sensor)) is not sensor.get_medium():
        if around is None:
            what = "the sensor refers to a medium and is outside of it"
            remedy = "leave the reference out"
        else:
            what = "the sensor is inside a medium without a reference to it, and sees as through a vacuum"
            remedy = f'add <ref name="medium" id="{around.id()}"/> to the sensor'
        yield Finding("wrong", scene.where(scene.sensor()), what, remedy)


def _medium_around(world: MitsubaObject, sensor: MitsubaObject) -> MitsubaObject:
    """The medium in which a sensor is, by the first boundaries around it; where there is none, that of the sensor."""
    mi, dr, to_world = mitsuba(), drjit(), sensor.world_transform()
    outside = False
    for axis in AXES:
        direction = dr.normalize(mi.Vector3f(to_world @ mi.Vector3f(*axis)))
        ray = mi.Ray3f(to_world @ mi.Point3f(0, 0, 0), direction)
        for _ in range(HITS_MAX):
            hit = world.ray_intersect(ray)
            if not dr.all(hit.is_valid()):
                break
            if dr.all(hit.is_medium_transition()):
                medium = hit.target_medium(-ray.d)
                medium = medium[0] if dr.is_array_v(medium) else medium
                if medium is not None:
                    return medium
                outside = True
                break
            ray = hit.spawn_ray(ray.d)
    return None if outside else sensor.get_medium()
