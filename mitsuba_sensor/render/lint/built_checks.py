"""Checks of a scene that Mitsuba has built: its shapes, its sensor, its integrator."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ...core.llvm import drjit
from ...optics.f_number_law import chief_ray_deg, microlens_deg, slant_response
from ...optics.intrinsics import aperture_f_number
from ..variants import MitsubaObject, is_polarized, mitsuba
from .finding import Built, Finding, Found, Subject, places

DEPOLARISING = {
    "hair": "Hair",
    "measured": "Measured",
    "plastic": "SmoothPlastic",
    "principled": "Principled",
    "principledthin": "PrincipledThin",
    "roughdielectric": "RoughDielectric",
    "roughplastic": "RoughPlastic",
    "thindielectric": "ThinDielectric",
}
"""Materials with a reflecting surface that Mitsuba 3.9.1 renders without polarisation, and their classes.
tests/render/test_polarizers.py measures the degree of polarisation of every material at Brewster's angle, except
measured, which needs a file."""
ROUNDING = 1e-5  # of float32 coordinates
FLOAT32_REACH = 2000.0
"""Distance over (1 + p) at which a sphere or disk loses 1 % of its light, where p is the largest coordinate of its
surface. For a cylinder: distance² over radius × (1 + p).

Mitsuba intersects these shapes by a formula in float32, so the hit point misses the surface by 2⁻²⁴ × distance (a
cylinder: 2⁻²⁴ × distance² over radius). Rays leave from 1500 × 2⁻²⁴ × (1 + p) above the surface; if that is less, the
shape shadows itself. Measured with Mitsuba 3.9.1 in llvm_ad_rgb under a uniform sky, with radii of 0.01 to 100 and
centres at 0 and 100: 1 % is reached at 1900 to 2500 for spheres, 1250 to 2000 for disks, 1600 to 2200 for cylinders and
1000 to 1400 for distance fields (p of the box), which scalar variants also compute in float32. Rectangles, meshes and
curves are right at 100 000 radii. Distances count from near_clip.
"""
COMPUTED_BY_FORMULA = ("Sphere", "Disk", "Cylinder", "SDFGrid")
FROM_VACUUM = "PRBVolpathIntegrator"
VOLUMETRIC = ("VolumetricPathIntegrator", "VolpathMisIntegratorImpl", FROM_VACUUM)
"""Classes of volpath, volpathmis and prbvolpath. All other integrators of Mitsuba 3.9.1 ignore media, as
tests/render/test_lint.py measures."""
AXES = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
HITS_MAX = 16  # surfaces along one axis before the boundary of a medium
CORNER_LOSS_MIN = 0.02  # of the response of a pixel whose microlens is made for another angle
F_NUMBER_MIN = 0.5  # of a lens in air, by the sine condition


def points(subject: Subject, built: Built) -> Found:
    """Yield shapes without size, which are not in the image."""
    for number, shape in enumerate(built.world.shapes()):
        if (box := shape.bbox()).valid() and not np.ravel(box.extents()).any():
            what = f"a {shape.class_name().lower()} has no size and is not in the picture"
            remedy = "give it a radius or a scale above 0"
            yield Finding("note", f"shape {shape.id() or number!r}", what, remedy)


def clip_planes(subject: Subject, built: Built) -> Found:
    """Yield near_clip and far_clip planes that cut the bounding box of all shapes, by depths along the view in scene
    units. If the sensor is inside the box, only far_clip is checked."""
    parameters = mitsuba().traverse(built.sensor)
    where = subject.scene.where(subject.scene.sensor())
    depths = _depths_of_corners(built)
    if "near_clip" not in parameters or not depths.size:
        return
    near, far = float(parameters["near_clip"]), float(parameters["far_clip"])
    first, last = depths.min(), depths.max()
    if 0 < first < near * (1 - ROUNDING) or 0 < last < near:
        what = f"near_clip is {near:g} and the scene begins at {max(first, 0.0):.4g}: nearer surfaces are cut off"
        yield Finding("black", where, what, "give the sensor a smaller near_clip")
    if last > far * (1 + ROUNDING):
        what = f"far_clip is {far:g} and the scene extends to {last:.4g}: farther surfaces are cut off"
        yield Finding("black", where, what, "give the sensor a larger far_clip")


def _depths_of_corners(built: Built) -> Float64Array:
    """Return the depths along the view of the corners of the bounding box of all shapes; none without a box."""
    box, pose = built.world.bbox(), _pose(built)
    if not box.valid():
        return np.zeros(0)
    corners = np.array([np.ravel(box.corner(k)) for k in range(8)], dtype=float)
    axis = pose[:3, 2] / np.linalg.norm(pose[:3, 2])
    return np.asarray((corners - pose[:3, 3]) @ axis)


def _pose(built: Built) -> Float64Array:
    matrix = mitsuba().traverse(built.sensor)["to_world"].matrix
    return np.array(matrix, dtype=float).reshape(4, 4)


def far_shapes(subject: Subject, built: Built) -> Found:
    """Yield shapes that shadow themselves, because they are too far from the sensor for float32; see FLOAT32_REACH."""
    parameters, variant = mitsuba().traverse(built.sensor), mitsuba().variant()
    kinds = COMPUTED_BY_FORMULA[3:] if variant.startswith("scalar") else COMPUTED_BY_FORMULA
    depths = _depths_of_corners(built)
    if "near_clip" not in parameters or not depths.size:
        return
    sides = float(np.max(np.ravel(built.world.bbox().extents())))
    nearest, place = float(depths.min()) - sides, _pose(built)[:3, 3]
    far = dict[str, str]()  # name → kind
    is_clipped_enough = True  # by a near_clip before the scene
    for number, shape in enumerate(built.world.shapes()):
        if (kind := shape.class_name()) not in kinds:
            continue
        centre = np.ravel(shape.bbox().center()).astype(float)
        away, reach = float(np.linalg.norm(centre - place)), _float32_reach(shape, centre)
        if away - float(parameters["near_clip"]) > reach:
            far[f"shape {shape.id() or number!r}"] = kind.lower()
            is_clipped_enough &= away - nearest <= reach
    if not far:
        return
    remedies = [f"raise near_clip of the sensor to {nearest:.6g}"] * is_clipped_enough
    remedies += ["render in variant scalar_spectral"] * ("sdfgrid" not in far.values())
    what = (
        f"too far from the sensor for float32, in which {variant} computes: {places(len(far), 'shape')} "
        f"({', '.join(sorted({*far.values()}))}) will shadow themselves, mostly by 1 to 60 %"
    )
    remedy = ", or ".join([*remedies, "replace them by meshes"])
    yield Finding("wrong", next(iter(far)), what, remedy)


def _float32_reach(shape: MitsubaObject, centre: NDArray[np.float64]) -> float:
    """Return the distance from near_clip at which a shape loses 1 % of its light, in scene units."""
    largest = float(np.abs(centre).max())
    half = float(np.max(np.ravel(shape.bbox().extents()))) / 2
    kind = shape.class_name()
    if kind == "Cylinder":
        to_world = np.array(mitsuba().traverse(shape)["to_world"].matrix)
        radius = float(np.linalg.norm(to_world[:3, 0]))
        return math.sqrt(FLOAT32_REACH * radius * (1 + max(largest, radius)))
    if kind == "Disk":  # its middle is at its smallest coordinates
        return FLOAT32_REACH * (1 + max(largest - half, half / 20))
    return FLOAT32_REACH * (1 + max(largest, half)) / (2 if kind == "SDFGrid" else 1)


def media(subject: Subject, built: Built) -> Found:
    """Yield media without a shape, media that the integrator ignores, and sensors with a wrong medium."""
    scene, sensor = subject.scene, built.sensor
    owners = scene.nodes("Shape", "Sensor", "Emitter")
    used = [node for owner in owners for _, node in scene.children(owner.props, "Medium")]
    for node in (node for node in scene.nodes("Medium") if node not in used):
        what = "a medium belongs to no shape and has no effect"
        remedy = 'refer to it in a shape, <ref name="interior" id="…"/>'
        yield Finding("note", scene.where(node), what, remedy)
    nodes = [node for node in scene.nodes("Medium") if node in used]
    if not nodes and not any(shape.is_medium_transition() for shape in built.world.shapes()):
        return
    classes = {type(built.integrator).__name__, built.integrator.class_name()}
    where, take_volpath = scene.where(scene.sensor()), "use integrator='volpath'"
    if not classes & {*VOLUMETRIC}:
        kind = next((node.props.plugin_name() for node in scene.nodes("Integrator")), "path")
        if scene.loaded is not None:
            kind = built.integrator.class_name()
        what = f"integrator {kind!r} renders no media, so the medium in {places(len(nodes) or 1)} is ignored"
        lines = subject.lines(nodes) if nodes else scene.name
        yield Finding("wrong", lines, what, take_volpath)
    elif sensor.get_medium() is not None and FROM_VACUUM in classes:
        what = "the sensor is inside a medium, and integrator 'prbvolpath' begins in a vacuum"
        yield Finding("wrong", where, what, take_volpath)
    elif (around := _medium_around(built)) is not sensor.get_medium():
        if around is None:
            what = "the sensor refers to a medium and is outside of it"
            remedy = "remove the reference"
        else:
            what = "the sensor is inside a medium without a reference to it, and sees as through a vacuum"
            remedy = f'add <ref name="medium" id="{around.id()}"/> to the sensor'
        yield Finding("wrong", where, what, remedy)


def _medium_around(built: Built) -> MitsubaObject:
    """Return the medium around a sensor, by the first boundaries around it; without boundaries, the sensor's medium."""
    mi, dr, to_world = mitsuba(), drjit(), built.sensor.world_transform()
    outside = False
    for axis in AXES:
        direction = dr.normalize(mi.Vector3f(to_world @ mi.Vector3f(*axis)))
        ray = mi.Ray3f(to_world @ mi.Point3f(0, 0, 0), direction)
        for _ in range(HITS_MAX):
            hit = built.world.ray_intersect(ray)
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
    return None if outside else built.sensor.get_medium()


def depolarising(subject: Subject, built: Built) -> Found:
    """Yield materials whose reflection Mitsuba leaves unpolarised, if the camera or variant follows polarisation."""
    scene, camera = subject.scene, subject.camera
    polarised = camera is not None and scene.polarised_by(camera) is not None
    if scene.ignore_polarization or not (polarised or is_polarized()):
        return
    nodes = [node for node in scene.nodes("BSDF") if node.props.plugin_name() in DEPOLARISING]
    kinds, where = {node.props.plugin_name() for node in nodes}, subject.lines(nodes)
    if scene.loaded is not None:
        owners = (entry[2] for entry in mitsuba().traverse(built.world).properties.values())
        classes = {x.class_name() for x in owners if isinstance(x, mitsuba().BSDF)}
        kinds = {kind for kind, name in DEPOLARISING.items() if name in classes}
        where = scene.name
    if kinds:
        what = f"Mitsuba depolarises what {', '.join(map(repr, sorted(kinds)))} reflects and transmits"
        remedy = "take 'pplastic' for plastic and paint, 'dielectric' for glass and water, which keep its polarisation"
        yield Finding("wrong", where, what, remedy)


def microlenses(subject: Subject, built: Built) -> Found:
    """Yield the response of the farthest corner, if its chief ray misses the microlens. Raises InputError beyond the
    end of a table."""
    camera, view = subject.camera, built.view
    if camera is None or camera.pixel.angular_response is None:
        return
    reach = []
    for axis, first, count in zip(view.axis, view.crop_offset, view.crop_size, strict=True):
        reach.append(max(axis - first, first + count - axis))
    height_mm = np.array([math.hypot(*reach) * camera.pixel.pitch_x_um * 1e-3])
    response = float(slant_response(view, camera, height_mm)[0])
    if response > 1 - CORNER_LOSS_MIN:
        return
    chief = float(chief_ray_deg(view, camera, height_mm)[0])
    made_for = float(microlens_deg(camera, height_mm)[0])
    what = (
        f"the chief ray of the corner comes at {chief:.3g} degrees, its microlens is made for {made_for:.3g}, and its "
        f"pixel has {response:.3g} of the response, as in the picture"
    )
    remedy = "change pixel.microlens_cra_deg or lens.pupil_magnification for other angles"
    yield Finding("note", subject.scene.where(subject.scene.sensor()), what, remedy)


def aperture(subject: Subject, built: Built) -> Found:
    """Yield a thin lens with an impossibly large aperture, e.g. in metres instead of millimetres. It determines the
    blur; the camera's f-number determines the light. A smaller film counts as a preview of the sensor."""
    if (camera := subject.camera) is None:
        return
    of_film = aperture_f_number(built.view, camera)
    if of_film is None:
        return
    of_blur = of_film * max(camera.sensor.columns / built.view.size[0], 1.0)
    if of_blur < F_NUMBER_MIN:
        of_light = camera.lens.f_number
        what = f"aperture_radius blurs as f/{of_blur:.2g}, but the light is for the camera's f/{of_light:g}"
        remedy = f"multiply aperture_radius, which is in scene units, by {of_blur / of_light:.2g} for the same f-number"
        yield Finding("note", subject.scene.where(subject.scene.sensor()), what, remedy)
