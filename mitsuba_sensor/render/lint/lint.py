"""Checks a scene, before rendering, for what differs from what its author probably expects.

Spectra that end or cannot be, units, clip planes, shutters, integrators. Mitsuba warns of none of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...optics.image_record import LARGE_PX, airy_diameter_px
from ..samples import SAMPLER
from ..scene.polarizer_rays import polarised_by
from ..scene.scene_file import POLARISING, SceneFile
from ..scene.scene_sensors import sensors_of
from ..scene.scene_settings import FILM
from ..variants import MitsubaObject, is_polarized, mitsuba
from .finding import Finding, lines_of, most_serious_first, places
from .media import media_findings
from .mesh_attributes import colours_above_one
from .scene_spectra import SceneSpectra
from .spectrum_findings import Band, spectrum_findings

ADDING = (
    "aov",
    "moment",
    "stokes",
)  # integrators that add channels; with specfilm they corrupt memory (#1189)
WRAPPERS = (*ADDING, "raw_frame")  # the one inside them is rendered
SPECTRAL_RESPONSE = "srf"  # parameter of a sensor
POSITIONAL = (
    "point",
    "spot",
    "projector",
)  # emitters whose irradiance depends on a distance in scene units
ON_SHAPES = ("area", "directionalarea")  # emitters
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
"""Materials with a reflecting surface that Mitsuba 3.9.1 renders without polarisation, and their classes. tests/render/
test_polarizers.py measures the degree of polarisation of every material at Brewster's angle; measured, which needs a
file of measurements, is from its source."""
LOSS = 0.01  # of the radiance: what cut paths may lose without a finding
FLAT = 0.01  # thickness over width: patches on a plane do not illuminate each other
ROUNDING = 1e-5  # of float32 coordinates
FLOAT32_REACH = 2000.0
"""Distance over (1 + p), from which on at least 1 % of the light of a sphere or disk is missing, p being the largest
coordinate of its surface; of a cylinder, distance² over radius × (1 + p).

Where Mitsuba intersects a shape by a formula in float32, the hit point misses the surface by 2⁻²⁴ × distance, that of a
cylinder by 2⁻²⁴ × distance² over radius. Rays leave it from 1500 × 2⁻²⁴ × (1 + p) above it; where that is less, the
shape shadows itself. Measured with Mitsuba 3.9.1 in llvm_ad_rgb under a uniform sky, with radii of 0.01 to 100 and
centres at 0 and 100: 1 % is reached at 1900 to 2500 for spheres, 1250 to 2000 for disks, 1600 to 2200 for cylinders and
1000 to 1400 for distance fields (p of the box), which scalar variants compute in float32 too. Rectangles, meshes and
curves are right at 100 000 radii. Distances count from near_clip.
"""
COMPUTED_BY_FORMULA = ("Sphere", "Disk", "Cylinder", "SDFGrid")
ALBEDO = 0.5  # of a closed grey scene, to estimate the radiance that cut paths lose


def lint(scene: SceneFile, band: Band, unit_m: float | None) -> tuple[list[Finding], bool]:
    """Findings in a parsed scene for a sensor with this band, most serious first; and whether no light is in it."""
    spectra = SceneSpectra(scene)
    dark = not any(
        low < band.high_nm and high > band.low_nm for _, (low, high) in spectra.lights
    )
    others = (
        check(scene)
        for check in (_changes, _integrator, _film, _sensors, _lost_lamps, colours_above_one)
    )
    spread = _point_spread(scene, band.camera)
    found = chain(
        spectrum_findings(scene, spectra, band), _units(scene, unit_m), *others, spread
    )
    return most_serious_first(found), bool(spectra.lights) and dark


def lint_built(
    scene: SceneFile,
    built: MitsubaObject,
    sensor: MitsubaObject,
    integrator: MitsubaObject,
    camera: Camera | None,
) -> list[Finding]:
    """Findings that need the shapes: those without size, what the clip planes cut off, paths that end too early, media
    that are left out, materials that depolarise; and environment maps that are not finite."""
    box, points, skies = built.bbox(), _points(built), _environments(scene, built)
    shapes = (
        [
            *points,
            *_clip_planes(scene, box, sensor),
            *_far_shapes(built, sensor),
            *_short_paths(scene, box),
        ]
        if box.valid()
        else []
    )
    media = media_findings(scene, built, sensor, integrator)
    return [*skies, *shapes, *media, *_depolarising(scene, built, camera)]


def _environments(scene: SceneFile, built: MitsubaObject) -> Iterator[Finding]:
    """Environment maps with pixels that are not finite: by chance, or wherever light is looked for, nothing is lit."""
    environment = built.environment()
    parameters = {} if environment is None else mitsuba().traverse(environment)
    values = np.asarray(parameters["data"]) if "data" in parameters else np.zeros(1)
    if not np.isfinite(values.sum()) and (bad := int((~np.isfinite(values)).sum())):
        where = lines_of(
            scene, [n for n in scene.nodes("Emitter") if n.props.plugin_name() == "envmap"]
        )
        what = f"the environment map has {bad} values that are not finite, and the light of others is lost too"
        yield Finding("wrong", where, what, "give it finite values")


def _depolarising(
    scene: SceneFile, built: MitsubaObject, camera: Camera | None
) -> Iterator[Finding]:
    """Materials whose reflection Mitsuba leaves unpolarised, where the polarisation of light is seen."""
    polarised = camera is not None and polarised_by(scene, camera) is not None
    if scene.ignore_polarization or not (polarised or is_polarized()):
        return
    nodes = [one for one in scene.nodes("BSDF") if one.props.plugin_name() in DEPOLARISING]
    kinds, where = {one.props.plugin_name() for one in nodes}, lines_of(scene, nodes)
    if scene.loaded is not None:
        owners = (entry[2] for entry in mitsuba().traverse(built).properties.values())
        classes = {one.class_name() for one in owners if isinstance(one, mitsuba().BSDF)}
        kinds = {kind for kind, name in DEPOLARISING.items() if name in classes}
        where = scene.name
    if kinds:
        what = f"Mitsuba depolarises what {', '.join(map(repr, sorted(kinds)))} reflects and transmits"
        remedy = (
            "take 'pplastic' for plastic and paint, 'dielectric' for glass and water, which keep its "
            "polarisation"
        )
        yield Finding("wrong", where, what, remedy)


def _points(built: MitsubaObject) -> Iterator[Finding]:
    """Shapes of no size, which are not in the picture."""
    for number, shape in enumerate(built.shapes()):
        if (box := shape.bbox()).valid() and not np.ravel(box.extents()).any():
            what = f"a {shape.class_name().lower()} has no size and is not in the picture"
            yield Finding(
                "note",
                f"shape {shape.id() or number!r}",
                what,
                "give it a radius or a scale above 0",
            )


def _clip_planes(
    scene: SceneFile, box: MitsubaObject, sensor: MitsubaObject
) -> Iterator[Finding]:
    """What near_clip and far_clip cut off the bounding box of all shapes, by depths along the view in scene units; of a
    sensor inside the box no near depth is known, and only far_clip is checked."""
    parameters, where = mitsuba().traverse(sensor), scene.where(scene.sensor())
    if "near_clip" not in parameters:
        return
    near, far = float(parameters["near_clip"]), float(parameters["far_clip"])
    to_world = np.array(parameters["to_world"].matrix, dtype=float).reshape(4, 4)
    axis = to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])
    corners = np.array([np.ravel(box.corner(k)) for k in range(8)], dtype=float)
    depths = (corners - to_world[:3, 3]) @ axis
    first, last = depths.min(), depths.max()
    if 0 < first < near * (1 - ROUNDING) or 0 < last < near:
        what = f"near_clip is {near:g} and the scene begins at {max(first, 0.0):.4g}: nearer parts are cut off"
        yield Finding("black", where, what, "give the sensor a smaller near_clip")
    if last > far * (1 + ROUNDING):
        what = f"far_clip is {far:g} and the scene extends to {last:.4g}: farther parts are cut off"
        yield Finding("black", where, what, "give the sensor a larger far_clip")


def _far_shapes(built: MitsubaObject, sensor: MitsubaObject) -> Iterator[Finding]:
    """Shapes that shadow themselves because they are too far from the sensor for float32; see FLOAT32_REACH."""
    parameters, variant, box = mitsuba().traverse(sensor), mitsuba().variant(), built.bbox()
    kinds = COMPUTED_BY_FORMULA[3:] if variant.startswith("scalar") else COMPUTED_BY_FORMULA
    shapes = [pair for pair in enumerate(built.shapes()) if pair[1].class_name() in kinds]
    if "near_clip" not in parameters or not shapes:
        return
    pose = np.array(parameters["to_world"].matrix, dtype=float).reshape(4, 4)
    axis = pose[:3, 2] / np.linalg.norm(pose[:3, 2])
    corners = np.array([np.ravel(box.corner(k)) for k in range(8)], dtype=float)
    sides = float(np.max(np.ravel(box.extents())))
    nearest = float(((corners - pose[:3, 3]) @ axis).min()) - sides
    far, beyond = dict[str, str](), False  # name → kind
    for number, shape in shapes:
        centre = np.ravel(shape.bbox().center()).astype(float)
        away, reach = float(np.linalg.norm(centre - pose[:3, 3])), _float32_reach(shape, centre)
        if away - float(parameters["near_clip"]) > reach:
            far[f"shape {shape.id() or number!r}"] = shape.class_name()
            beyond = beyond or away - nearest > reach
    if not far:
        return
    remedies = [] if beyond else [f"raise near_clip of the sensor to {nearest:.6g}"]
    if "SDFGrid" not in far.values():
        remedies.append("render in variant scalar_spectral")
    remedies.append("replace them by meshes")
    kinds_there = ", ".join(sorted({kind.lower() for kind in far.values()}))
    what = (
        f"too far from the sensor for float32, in which {variant} computes: {places(len(far), 'shape')} "
        f"({kinds_there}) will shadow themselves, mostly by 1 to 60 %"
    )
    yield Finding("wrong", next(iter(far)), what, ", or ".join(remedies))


def _float32_reach(shape: MitsubaObject, centre: NDArray[np.float64]) -> float:
    """Distance from near_clip at which 1 % of the light of a shape is missing, in scene units."""
    largest, half = (
        float(np.abs(centre).max()),
        float(np.max(np.ravel(shape.bbox().extents()))) / 2,
    )
    kind = shape.class_name()
    if kind == "Cylinder":
        radius = float(
            np.linalg.norm(np.array(mitsuba().traverse(shape)["to_world"].matrix)[:3, 0])
        )
        return float(np.sqrt(FLOAT32_REACH * radius * (1 + max(largest, radius))))
    if kind == "Disk":  # its middle is at its smallest coordinates
        return FLOAT32_REACH * (1 + max(largest - half, half / 20))
    return FLOAT32_REACH * (1 + max(largest, half)) / (2 if kind == "SDFGrid" else 1)


def _short_paths(scene: SceneFile, box: MitsubaObject) -> Iterator[Finding]:
    """An integrator that ends paths which still carry radiance; a flat scene has no longer paths."""
    sides = sorted(float(side) for side in np.ravel(box.extents()))
    for node in scene.nodes("Integrator"):
        kind = node.props.plugin_name()
        usual = 2 if kind.startswith("direct") else 6 if kind.startswith("prb") else -1
        depth = node.props.get("max_depth", usual)
        if depth >= 0 and ALBEDO**depth > LOSS and sides[0] > FLAT * sides[-1]:
            loss = f"which loses {ALBEDO**depth:.2g} of the radiance in a closed grey scene"
            remedy = "give it a max_depth of 16 or more, or none"
            if kind.startswith("direct"):
                remedy = "take 'path'"
            elif kind.startswith("prb"):
                remedy = "give it a max_depth of 16 or more"
            yield Finding(
                "note",
                scene.where(node),
                f"light paths end after {depth} segments, {loss}",
                remedy,
            )


def _units(scene: SceneFile, unit_m: float | None) -> Iterator[Finding]:
    """Emitters that are a point: their distance is taken in scene units (#1426)."""
    nodes = [n for n in scene.nodes("Emitter") if n.props.plugin_name() in POSITIONAL]
    if not nodes or unit_m == 1.0:
        return
    kinds = ", ".join(sorted({n.props.plugin_name() for n in nodes}))
    if unit_m is None:
        what = "is right only if the scene unit is the metre, which is not known"
        yield Finding(
            "note",
            lines_of(scene, nodes),
            f"{kinds} light in {places(len(nodes))} {what}",
            "give scene_unit",
        )
        return
    what = f"{kinds} light in {places(len(nodes))} takes distances in units of {unit_m:g} m, as if they were metres"
    yield Finding(
        "wrong", lines_of(scene, nodes), what, f"multiply its intensity by {unit_m**-2:g}"
    )


def _changes(scene: SceneFile) -> Iterator[Finding]:
    """What was changed when the file was parsed, and elements that polarise light."""
    for where, (change, why) in scene.changes:
        yield Finding("note", where, change, why)
    for node in scene.nodes("BSDF") if scene.ignore_polarization else ():
        if (kind := node.props.plugin_name()) in POLARISING:
            what = f"{kind!r} acts on unpolarised light alone: behind a second one the light is wrong"
            yield Finding(
                "note",
                scene.where(node),
                what,
                "its transmittance is that for unpolarised light",
            )


def _integrator(scene: SceneFile) -> Iterator[Finding]:
    """Integrators that hide emitters, or add channels."""
    for node in scene.nodes("Integrator"):
        props, where, kind = node.props, scene.where(node), node.props.plugin_name()
        if kind in ADDING:
            inner = scene.children(props, "Integrator")
            remedy = (
                f"integrator {kind!r} replaced by {'the one inside it' if inner else 'path'}"
            )
            yield Finding(
                "note",
                where,
                f"integrator {kind!r} adds channels that the sensor does not use",
                remedy,
            )
        if props.get("hide_emitters"):
            what = "hide_emitters makes visible emitters black"
            yield Finding("wrong", where, what, "leave it out: a sensor images lamps and sky")


def _lost_lamps(scene: SceneFile) -> Iterator[Finding]:
    """Emitters that shine from a shape and are in none."""
    for _, node in scene.children(scene.root, "Emitter"):
        if (kind := node.props.plugin_name()) in ON_SHAPES:
            what = f"emitter {kind!r} is in no shape and gives no light"
            yield Finding("wrong", scene.where(node), what, "put it into the shape that shines")


def _point_spread(scene: SceneFile, camera: Camera | None) -> Iterator[Finding]:
    """Diffraction that is rendered, or that is not and would be seen."""
    if camera is None:
        return
    diameter_px, lens = airy_diameter_px(camera), camera.lens
    what = f"at f/{lens.f_number:g} the Airy disk is {diameter_px:.2g} pixels across"
    if lens.diffraction:
        remedy = "rays are displaced by it, lens.diffraction = false leaves it out"
    elif diameter_px > LARGE_PX:
        remedy = "it is not rendered, lens.diffraction = true does"
    else:
        return
    yield Finding("note", scene.where(scene.sensor()), what, remedy)


def _film(scene: SceneFile) -> Iterator[Finding]:
    """What load_scene replaces in film and sampler, and the effect of the film in plain Mitsuba."""
    film = scene.film()
    kind = film.props.plugin_name() if film else "hdrfilm"
    where = scene.where(film or scene.sensor())
    if kind == "specfilm" and film.props.get("component_format", "float16") == "float16":
        what = "a specfilm stores float16 by default, and values above 65504 overflow"
        yield Finding(
            "fact",
            where,
            what,
            'float32 taken; write <string name="component_format" value="float32"/>',
        )
    if kind not in ("specfilm", FILM):
        what = f"film {kind!r} does not keep spectra"
        remedy = (
            f"film {kind!r} replaced by the spectral bands of the sensor (specfilm, float32)"
        )
        yield Finding("fact", where, what, remedy)
    filters = scene.children(film.props, "ReconstructionFilter") if film else []
    wide = filters[0][1].props.plugin_name() if filters else "gaussian"  # Mitsuba's default
    if kind != FILM and wide != "box":
        what = f"filter {wide!r} is wider than a pixel and correlates the noise of neighbouring pixels"
        yield Finding(
            "fact", where, what, f"filter {wide!r} replaced by 'box', which is one pixel wide"
        )
    if film and any(name.startswith("crop") for name in film.props):
        yield Finding(
            "note",
            where,
            "only the crop window of the film is rendered",
            "leave it out to render all",
        )
    for _, sampler in scene.children(scene.sensor().props, "Sampler"):
        if (name := sampler.props.plugin_name()) != SAMPLER:
            what, remedy = (
                f"sampler {name!r} is noisier",
                f"sampler {name!r} replaced by {SAMPLER!r}",
            )
            yield Finding("fact", scene.where(sampler), what, remedy)


def _sensors(scene: SceneFile) -> Iterator[Finding]:
    """The shutter of Mitsuba's sensor, which changes nothing, and sensors that are not rendered."""
    first = scene.sensor()
    if any(name in first.props for name in ("shutter_open", "shutter_close")):
        what = "shutter_open and shutter_close change nothing in Mitsuba 3: no transform moves in time"
        yield Finding(
            "wrong", scene.where(first), what, "leave them out and give an exposure time"
        )
    if SPECTRAL_RESPONSE in first.props:
        what = f"{SPECTRAL_RESPONSE} of the sensor is a spectral response, and the camera has its own"
        yield Finding(
            "note",
            scene.where(first),
            what,
            f"{SPECTRAL_RESPONSE} replaced by that of the camera",
        )
    sensors = [node for _, node in scene.children(scene.root, "Sensor")]
    if len(sensors) > 1 and scene.chosen is None:
        names = ", ".join(sensors_of(scene))
        what = f"the scene has {len(sensors)} sensors ({names}); the first one was taken"
        remedy = "--sensor NAME takes another one, and --sensor all a frame of each"
        yield Finding("note", lines_of(scene, sensors[1:]), what, remedy)
