"""Checks a scene, before rendering, for what differs from what its author probably expects; Mitsuba warns of nothing.

A check is a function that yields findings. Those of CHECKS read the parsed scene, those of CHECKS_OF_BUILT what Mitsuba
made of it. A new one goes into one of the two tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TypeAlias

from ...files.ply_colours import largest_colour
from ...optics.image_record import LARGE_PX, airy_diameter_px
from ..samples import SAMPLER
from ..scene.parsed_scene import POLARISING
from ..scene.scene_settings import FILM
from ..variants import MitsubaObject
from .built_checks import (
    aperture,
    clip_planes,
    depolarising,
    environments,
    far_shapes,
    media,
    microlenses,
    points,
    short_paths,
    spectra_of_loaded,
)
from .finding import Finding, most_serious_first, places
from .refusals import MESH_ATTRIBUTE
from .spectrum_findings import (
    colours,
    float_lights,
    impossible_values,
    incomplete,
    metals,
    textured_lights,
)
from .subject import Built, Subject

Found: TypeAlias = Iterator[Finding]

ADDING = ("aov", "moment", "stokes")
"""Integrators that add channels; with specfilm they corrupt memory (#1189)."""
WRAPPERS = (*ADDING, "raw_frame")  # the one inside them is rendered
SPECTRAL_RESPONSE = "srf"  # parameter of a sensor
POSITIONAL = ("point", "spot", "projector")
"""Emitters whose irradiance depends on a distance in scene units."""
ON_SHAPES = ("area", "directionalarea")  # emitters


def lint(subject: Subject) -> list[Finding]:
    """Findings in a parsed scene, most serious first."""
    return most_serious_first(chain.from_iterable(check(subject) for check in CHECKS))


def lint_built(findings: list[Finding], subject: Subject, built: Built) -> list[Finding]:
    """The same with those in what Mitsuba made of the scene."""
    more = chain.from_iterable(check(subject, built) for check in CHECKS_OF_BUILT)
    return most_serious_first([*findings, *more])


def units(subject: Subject) -> Found:
    """Emitters that are a point: their distance is taken in scene units (#1426)."""
    nodes = [n for n in subject.scene.nodes("Emitter") if n.props.plugin_name() in POSITIONAL]
    if not nodes or subject.unit_m == 1.0:
        return
    kinds = ", ".join(sorted({node.props.plugin_name() for node in nodes}))
    what = f"{kinds} light in {places(len(nodes))}"
    if subject.unit_m is None:
        what = f"{what} is right only if the scene unit is the metre, which is not known"
        yield Finding("note", subject.lines(nodes), what, "give scene_unit")
    else:
        what = (
            f"{what} takes distances in units of {subject.unit_m:g} m, as if they were metres"
        )
        remedy = f"multiply its intensity by {subject.unit_m**-2:g}"
        yield Finding("wrong", subject.lines(nodes), what, remedy)


def changes(subject: Subject) -> Found:
    """What was changed when the scene was parsed, and elements that polarise light."""
    scene = subject.scene
    for where, what, why in scene.changes:
        yield Finding("note", where, what, why)
    for node in scene.nodes("BSDF") if scene.ignore_polarization else ():
        if (kind := node.props.plugin_name()) in POLARISING:
            what = f"{kind!r} acts on unpolarised light alone: behind a second one the light is wrong"
            remedy = "its transmittance is that for unpolarised light"
            yield Finding("note", scene.where(node), what, remedy)


def integrators(subject: Subject) -> Found:
    """Integrators that hide emitters, or add channels."""
    scene = subject.scene
    for node in scene.nodes("Integrator"):
        kind, where = node.props.plugin_name(), scene.where(node)
        if kind in ADDING:
            inner = "the one inside it" if scene.children(node.props, "Integrator") else "path"
            what = f"integrator {kind!r} adds channels that the sensor does not use"
            yield Finding("note", where, what, f"integrator {kind!r} replaced by {inner}")
        if node.props.get("hide_emitters"):
            what = "hide_emitters makes visible emitters black"
            yield Finding("wrong", where, what, "leave it out: a sensor images lamps and sky")


def film(subject: Subject) -> Found:
    """What is replaced in film and sampler, and the effect of the film in plain Mitsuba."""
    scene = subject.scene
    node = scene.film()
    kind, where = (
        node.props.plugin_name() if node else "hdrfilm",
        scene.where(node or scene.sensor()),
    )
    if kind == "specfilm" and node.props.get("component_format", "float16") == "float16":
        what = "a specfilm stores float16 by default, and values above 65504 overflow"
        remedy = 'float32 taken; write <string name="component_format" value="float32"/>'
        yield Finding("fact", where, what, remedy)
    if kind not in ("specfilm", FILM):
        remedy = (
            f"film {kind!r} replaced by the spectral bands of the sensor (specfilm, float32)"
        )
        yield Finding("fact", where, f"film {kind!r} does not keep spectra", remedy)
    filters = scene.children(node.props, "ReconstructionFilter") if node else []
    wide = filters[0][1].props.plugin_name() if filters else "gaussian"  # Mitsuba's default
    if kind != FILM and wide != "box":
        what = f"filter {wide!r} is wider than a pixel and correlates the noise of neighbouring pixels"
        remedy = f"filter {wide!r} replaced by 'box', which is one pixel wide"
        yield Finding("fact", where, what, remedy)
    if node and any(name.startswith("crop") for name in node.props):
        what = "only the crop window of the film is rendered"
        yield Finding("note", where, what, "leave it out to render all")
    for _, sampler in scene.children(scene.sensor().props, "Sampler"):
        if (name := sampler.props.plugin_name()) != SAMPLER:
            what, remedy = (
                f"sampler {name!r} is noisier",
                f"sampler {name!r} replaced by {SAMPLER!r}",
            )
            yield Finding("fact", scene.where(sampler), what, remedy)


def sensors(subject: Subject) -> Found:
    """Parameters of the sensor without effect, and sensors that are not rendered."""
    scene, node = subject.scene, subject.scene.sensor()
    if any(name in node.props for name in ("shutter_open", "shutter_close")):
        what = "shutter_open and shutter_close change nothing in Mitsuba 3: no transform moves in time"
        yield Finding(
            "wrong", scene.where(node), what, "leave them out and give an exposure time"
        )
    if SPECTRAL_RESPONSE in node.props:
        what = f"{SPECTRAL_RESPONSE} of the sensor is a spectral response, and the camera has its own"
        remedy = f"{SPECTRAL_RESPONSE} replaced by that of the camera"
        yield Finding("note", scene.where(node), what, remedy)
    nodes = [node for _, node in scene.children(scene.root, "Sensor")]
    if len(nodes) > 1 and scene.chosen is None:
        what = f"the scene has {len(nodes)} sensors ({', '.join(scene.sensors())}); the first one was taken"
        remedy = "--sensor NAME takes another one, and --sensor all a frame of each"
        yield Finding("note", subject.lines(nodes[1:]), what, remedy)


def lost_lamps(subject: Subject) -> Found:
    """Emitters that shine from a shape and are in none."""
    for _, node in subject.scene.children(subject.scene.root, "Emitter"):
        if (kind := node.props.plugin_name()) in ON_SHAPES:
            what = f"emitter {kind!r} is in no shape and gives no light"
            remedy = "put it into the shape that shines"
            yield Finding("wrong", subject.scene.where(node), what, remedy)


def vertex_colours(subject: Subject) -> Found:
    """Meshes whose vertices have colours above 1, which Mitsuba takes for 1."""
    scene = subject.scene

    def takes_attribute(node: MitsubaObject) -> bool:
        nested = [child for _, child in scene.children(node.props)]
        return any(
            child.props.plugin_name() == MESH_ATTRIBUTE or takes_attribute(child)
            for child in nested
        )

    for node in scene.nodes("Shape"):
        if node.props.plugin_name() != "ply" or not takes_attribute(node):
            continue
        file = Path(str(scene.resolver.resolve(node.props.get("filename", ""))))
        largest = largest_colour(file) if file.is_file() else None
        if largest is not None and largest > 1:
            what = f"colours of vertices in {file.name!r} are as large as {largest:g}: Mitsuba takes 1 instead"
            remedy = "give values from 0 to 1: if they count from 0 to 255, divide them by 255"
            yield Finding("wrong", scene.where(node), what, remedy)


def diffraction(subject: Subject) -> Found:
    """Diffraction that is rendered, or that is not and would be seen."""
    if (camera := subject.camera) is None:
        return
    diameter_px = airy_diameter_px(camera)
    if camera.lens.diffraction:
        remedy = "rays are displaced by it, lens.diffraction = false leaves it out"
    elif diameter_px > LARGE_PX:
        remedy = "it is not rendered, lens.diffraction = true does"
    else:
        return
    what = f"at f/{camera.lens.f_number:g} the Airy disk is {diameter_px:.2g} pixels across"
    yield Finding("note", subject.scene.where(subject.scene.sensor()), what, remedy)


CHECKS: tuple[Callable[[Subject], Found], ...] = (
    incomplete,
    metals,
    colours,
    textured_lights,
    float_lights,
    impossible_values,
    units,
    changes,
    integrators,
    film,
    sensors,
    lost_lamps,
    vertex_colours,
    diffraction,
)
CHECKS_OF_BUILT: tuple[Callable[[Subject, Built], Found], ...] = (
    environments,
    points,
    clip_planes,
    far_shapes,
    short_paths,
    media,
    depolarising,
    spectra_of_loaded,
    microlenses,
    aperture,
)
