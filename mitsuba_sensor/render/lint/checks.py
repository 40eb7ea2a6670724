"""Checks a scene before rendering for what its author probably does not expect; Mitsuba itself gives no warnings.

A check is a function that yields findings. CHECKS read the parsed scene, CHECKS_OF_BUILT the built one. Add a new check
to one of the two tables.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from pathlib import Path

from ...files.ply_colours import largest_colour
from ..samples import SAMPLER
from ..scene.parsed_scene import POLARISING
from ..scene.scene_settings import FILM
from ..variants import MitsubaObject
from . import built_checks, spectrum_checks
from .finding import Built, Finding, Found, Subject, most_serious_first, places
from .refusals import MESH_ATTRIBUTE

ADDING = ("aov", "moment", "stokes")
"""Integrators that add channels; with specfilm they corrupt memory (#1189)."""
WRAPPERS = (*ADDING, "raw_frame")  # the integrator inside them is rendered
SPECTRAL_RESPONSE = "srf"  # parameter of a sensor
POSITIONAL = ("point", "spot", "projector")
"""Emitters whose irradiance depends on a distance in scene units."""
ON_SHAPES = ("area", "directionalarea")  # emitters


def lint(subject: Subject) -> list[Finding]:
    """Return the findings in a parsed scene, most serious first."""
    return most_serious_first(chain.from_iterable(check(subject) for check in CHECKS))


def lint_built(findings: list[Finding], subject: Subject, built: Built) -> list[Finding]:
    """Return these findings and those in the built scene."""
    more = chain.from_iterable(check(subject, built) for check in CHECKS_OF_BUILT)
    return most_serious_first([*findings, *more])


def units(subject: Subject) -> Found:
    """Yield point emitters, whose distances Mitsuba takes in scene units (#1426)."""
    nodes = [n for n in subject.scene.nodes("Emitter") if n.props.plugin_name() in POSITIONAL]
    if not nodes or subject.unit_m == 1.0:
        return
    kinds = ", ".join(sorted({node.props.plugin_name() for node in nodes}))
    what, where = f"{kinds} light in {places(len(nodes))}", subject.lines(nodes)
    if subject.unit_m is None:
        what = f"{what} is right only if the scene unit is the metre, but the unit is unknown"
        yield Finding("note", where, what, "give scene_unit")
    else:
        what = (
            f"{what} takes distances in units of {subject.unit_m:g} m, as if they were metres"
        )
        yield Finding("wrong", where, what, f"multiply its intensity by {subject.unit_m**-2:g}")


def changes(subject: Subject) -> Found:
    """Yield changes made by the parser, and replacements made before the scene is built."""
    scene, sensor, film = subject.scene, subject.scene.sensor(), subject.scene.film()
    for where, what, why in scene.changes:
        yield Finding("note", where, what, why)
    for node in scene.nodes("BSDF") if scene.ignore_polarization else ():
        if (kind := node.props.plugin_name()) in POLARISING:
            what = f"{kind!r} is rendered for unpolarised light: after a second polariser the light is wrong"
            remedy = "omit ignore_polarization to follow the polarisation"
            yield Finding("note", scene.where(node), what, remedy)
    kind = film.props.plugin_name() if film else "hdrfilm"
    filters = scene.children(film.props, "ReconstructionFilter") if film else []
    wide = filters[0][1].props.plugin_name() if filters else "gaussian"  # Mitsuba's default
    replaced = [f"spectral bands in float32 instead of film {kind!r}"] * (
        kind not in ("specfilm", FILM)
    )
    replaced += [f"'box' instead of filter {wide!r}"] * (kind != FILM and wide != "box")
    samplers = [node.props.plugin_name() for _, node in scene.children(sensor.props, "Sampler")]
    replaced += [
        f"{SAMPLER!r} instead of sampler {name!r}" for name in samplers if name != SAMPLER
    ]
    if replaced:
        what, where = (
            "film settings are replaced, because the sensor needs the separate spectrum of each pixel",
            scene.where(film or sensor),
        )
        yield Finding("fact", where, what, ", ".join(replaced))
    if film and any(name.startswith("crop") for name in film.props):
        what = "only the crop window of the film is rendered"
        yield Finding("note", scene.where(film), what, "remove it to render the whole film")
    if SPECTRAL_RESPONSE in sensor.props:
        what = f"the camera has a spectral response, so {SPECTRAL_RESPONSE} of the sensor is ignored"
        remedy = f"remove {SPECTRAL_RESPONSE}, or change the camera's quantum_efficiency"
        yield Finding("note", scene.where(sensor), what, remedy)


def without_effect(subject: Subject) -> Found:
    """Yield elements and parameters without effect, or that remove light from the sensor."""
    scene, sensor = subject.scene, subject.scene.sensor()
    for node in scene.nodes("Integrator"):
        kind, where = node.props.plugin_name(), scene.where(node)
        if kind in ADDING:
            nested = scene.children(node.props, "Integrator")
            inner = "the integrator inside it" if nested else "path"
            what = f"integrator {kind!r} adds channels that the sensor does not use"
            yield Finding("note", where, what, f"integrator {kind!r} replaced by {inner}")
        if node.props.get("hide_emitters"):
            what = "hide_emitters makes visible emitters black"
            yield Finding("wrong", where, what, "remove it: a sensor sees lamps and sky")
    if any(name in sensor.props for name in ("shutter_open", "shutter_close")):
        what = "shutter_open and shutter_close change nothing in Mitsuba 3: no transform moves in time"
        yield Finding(
            "wrong", scene.where(sensor), what, "remove them and give an exposure time"
        )
    nodes = [node for _, node in scene.children(scene.root, "Sensor")]
    if len(nodes) > 1 and scene.chosen is None:
        what = f"the scene has {len(nodes)} sensors ({', '.join(scene.sensors())}), and the first was taken"
        remedy = "sensor='NAME' takes another sensor, sensor='all' takes a frame of each"
        yield Finding("note", subject.lines(nodes[1:]), what, remedy)
    for _, node in scene.children(scene.root, "Emitter"):
        if (kind := node.props.plugin_name()) in ON_SHAPES:
            what = f"emitter {kind!r} is in no shape and gives no light"
            yield Finding("wrong", scene.where(node), what, "put it into the shape that shines")


def vertex_colours(subject: Subject) -> Found:
    """Yield meshes with vertex colours above 1, which Mitsuba takes as 1."""
    scene = subject.scene

    def takes_attribute(node: MitsubaObject) -> bool:
        nested = (child for _, child in scene.children(node.props))
        return any(
            x.props.plugin_name() == MESH_ATTRIBUTE or takes_attribute(x) for x in nested
        )

    for node in scene.nodes("Shape"):
        if node.props.plugin_name() != "ply" or not takes_attribute(node):
            continue
        file = Path(str(scene.resolver.resolve(node.props.get("filename", ""))))
        largest = largest_colour(file) if file.is_file() else None
        if largest is not None and largest > 1:
            what = f"vertex colours in {file.name!r} are as large as {largest:g}: Mitsuba takes 1 instead"
            remedy = "give values from 0 to 1; if they range from 0 to 255, divide them by 255"
            yield Finding("wrong", scene.where(node), what, remedy)


CHECKS: tuple[Callable[[Subject], Found], ...] = (
    spectrum_checks.incomplete,
    spectrum_checks.metals,
    spectrum_checks.colours,
    spectrum_checks.float_lights,
    spectrum_checks.impossible_values,
    units,
    changes,
    without_effect,
    vertex_colours,
)
CHECKS_OF_BUILT: tuple[Callable[[Subject, Built], Found], ...] = (
    spectrum_checks.spectra_of_loaded,
    built_checks.points,
    built_checks.clip_planes,
    built_checks.far_shapes,
    built_checks.media,
    built_checks.depolarising,
    built_checks.microlenses,
    built_checks.aperture,
)
