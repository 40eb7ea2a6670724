"""Checks a scene, before rendering, for what differs from what its author probably expects.

Outside 360 to 830 nm Mitsuba's own emitters are zero by default (d65, rgb and float emitters, environment maps, sun and
sky, blackbody); a table is zero outside its nodes. There are similar problems with units, clip planes, shutters and
integrators. Mitsuba warns of none of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Literal, TypeAlias

import numpy as np

from .passes import SAMPLER
from .scene_file import POLARISING, SceneFile
from .scene_settings import FILM
from .variants import MitsubaObject, mitsuba

ADDING = ("aov", "moment", "stokes")  # integrators that add channels; with specfilm they corrupt memory (#1189)
WRAPPERS = (*ADDING, "raw_frame")  # the one inside them is rendered
POSITIONAL = ("point", "spot", "projector")  # emitters whose irradiance depends on a distance in scene units
LOSS = 0.01  # of the radiance: what cut paths may lose without a finding
FLAT = 0.01  # thickness over width: patches on a plane do not illuminate each other
ROUNDING = 1e-5  # of float32 coordinates
ALBEDO = 0.5  # of a closed grey scene, to estimate the radiance that cut paths lose
MOST_LINES = 4  # named in one finding
ORDER = ("black", "wrong", "note")

Range: TypeAlias = tuple[float, float]
EVERYWHERE: Range = (-math.inf, math.inf)
MITSUBA_NM: Range = (360.0, 830.0)
LIMITED = ("d65", "blackbody")  # spectra that end with Mitsuba's range
SKIES = ("envmap", "sunsky", "timed_sunsky")
STRENGTHS = ("radiance", "irradiance", "intensity")  # of emitters; a float there is a factor on D65 (#1579)
TOLERANCE_NM = 1e-3


@dataclass(frozen=True)
class Finding:
    """One result of the check.

    level : "black", radiance that is missing; "wrong", a value with another meaning than expected; or "note".
    where : lines in the scene file.  what : description.  remedy : what to do, or what was done.
    """

    level: Literal["black", "wrong", "note"]
    where: str
    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what} ({self.where}); {self.remedy}"

    def to_dict(self) -> dict[str, str]:
        """Plain values, ready for JSON."""
        return asdict(self)


def lint(scene: SceneFile, band_nm: Range, unit_m: float | None) -> tuple[list[Finding], bool]:
    """Findings in a parsed scene for a sensor with this band, most serious first; and whether no light is in it."""
    spectra = SceneSpectra(scene)
    dark = not any(low < band_nm[1] and high > band_nm[0] for _, (low, high) in spectra.lights)
    others = (check(scene) for check in (_changes, _integrator, _film, _sensors))
    found = chain(_spectra(scene, spectra, *band_nm), _units(scene, unit_m), *others)
    return most_serious_first(found), bool(spectra.lights) and dark


def most_serious_first(findings: Iterable[Finding]) -> list[Finding]:
    """The findings, black before wrong before notes."""
    return sorted(findings, key=lambda finding: ORDER.index(finding.level))


def lint_built(scene: SceneFile, built: MitsubaObject, sensor: MitsubaObject) -> list[Finding]:
    """Findings that need the shapes: those without size, what the clip planes cut off, paths that end too early."""
    box, points = built.bbox(), _points(built)
    return [*points, *_clip_planes(scene, box, sensor), *_short_paths(scene, box)] if box.valid() else []


def _points(built: MitsubaObject) -> Iterator[Finding]:
    """Shapes of no size, which are not in the picture."""
    for number, shape in enumerate(built.shapes()):
        if (box := shape.bbox()).valid() and not np.ravel(box.extents()).any():
            what = f"a {shape.class_name().lower()} has no size and is not in the picture"
            yield Finding("note", f"shape {shape.id() or number!r}", what, "give it a radius or a scale above 0")


def _clip_planes(scene: SceneFile, box: MitsubaObject, sensor: MitsubaObject) -> Iterator[Finding]:
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


def _short_paths(scene: SceneFile, box: MitsubaObject) -> Iterator[Finding]:
    """An integrator that ends paths which still carry radiance; a flat scene has no longer paths."""
    sides = sorted(float(side) for side in np.ravel(box.extents()))
    for node in scene.nodes("Integrator"):
        depth = node.props.get("max_depth", 2 if node.props.plugin_name() == "direct" else -1)
        if depth >= 0 and ALBEDO**depth > LOSS and sides[0] > FLAT * sides[-1]:
            loss = f"which loses {ALBEDO**depth:.2g} of the radiance in a closed grey scene"
            remedy = "take 'path' with max_depth 16 or more, or without it"
            yield Finding("note", scene.where(node), f"light paths end after {depth} segments, {loss}", remedy)


def _lines(scene: SceneFile, nodes: list[MitsubaObject]) -> str:
    """``line 3``, ``lines 3, 9 and 4 more``; a look-up reads the file, so only the named ones are looked up."""
    lines = list(dict.fromkeys(scene.where(node).removeprefix("line ") for node in nodes[:MOST_LINES]))
    more = f" and {len(nodes) - MOST_LINES} more" if len(nodes) > MOST_LINES else ""
    return f"line{'s' * (len(lines) > 1)} {', '.join(lines)}{more}"


def _places(count: int) -> str:
    return f"{count} place{'s' * (count > 1)}"


def _spectra(scene: SceneFile, spectra: SceneSpectra, low_nm: float, high_nm: float) -> Iterator[Finding]:
    """Spectra that end inside the bands; rgb reflectances outside its range; floats, which mean D65 (#1579)."""
    named = [(n, "light", r) for n, r in spectra.lights] + [(n, f"{name!r}", r) for n, name, r in spectra.materials]
    incomplete: dict[tuple[str, float, float], list[MitsubaObject]] = {}
    for node, name, (low, high) in named:
        if low > low_nm + TOLERANCE_NM or high < high_nm - TOLERANCE_NM:
            incomplete.setdefault((name, low, high), []).append(node)
    for (name, low, high), nodes in incomplete.items():
        bands = f"the bands extend from {low_nm:g} to {high_nm:g} nm"
        what = f"{name} in {_places(len(nodes))} is black outside {low:g} to {high:g} nm; {bands}"
        remedy = f"give it pairs of wavelength and value from {low_nm:g} to {high_nm:g} nm"
        yield Finding("black", _lines(scene, nodes), what, remedy)
    low, high = MITSUBA_NM
    if spectra.colours and (low_nm < low or high_nm > high):
        what = f"rgb in {_places(len(spectra.colours))} is extrapolated outside {low:g} to {high:g} nm, to 0 or to 1"
        yield Finding("wrong", _lines(scene, spectra.colours), what, "give measured spectra")
    if spectra.float_lights:
        what = f"a float in {_places(len(spectra.float_lights))} gives the spectrum of D65, not a flat one"
        remedy = 'write <spectrum name="radiance" value="..."/> for the same value at every wavelength'
        yield Finding("wrong", _lines(scene, spectra.float_lights), what, remedy)


def _units(scene: SceneFile, unit_m: float | None) -> Iterator[Finding]:
    """Emitters that are a point: their distance is taken in scene units (#1426)."""
    nodes = [n for n in scene.nodes("Emitter") if n.props.plugin_name() in POSITIONAL]
    if not nodes or unit_m == 1.0:
        return
    kinds = ", ".join(sorted({n.props.plugin_name() for n in nodes}))
    if unit_m is None:
        what = "is right only if the scene unit is the metre, which is not known"
        yield Finding("note", _lines(scene, nodes), f"{kinds} light in {_places(len(nodes))} {what}", "give scene_unit")
        return
    what = f"{kinds} light in {_places(len(nodes))} takes distances in units of {unit_m:g} m, as if they were metres"
    yield Finding("wrong", _lines(scene, nodes), what, f"multiply its intensity by {unit_m**-2:g}")


def _changes(scene: SceneFile) -> Iterator[Finding]:
    """What was changed when the file was parsed, and elements that polarise light."""
    for where, (change, why) in scene.changes:
        yield Finding("note", where, change, why)
    for node in scene.nodes("BSDF") if scene.ignore_polarization else ():
        if (kind := node.props.plugin_name()) in POLARISING:
            what = f"{kind!r} acts on unpolarised light alone: behind a second one the light is wrong"
            yield Finding("note", scene.where(node), what, "its transmittance is that for unpolarised light")


def _integrator(scene: SceneFile) -> Iterator[Finding]:
    """Integrators that hide emitters, or add channels."""
    for node in scene.nodes("Integrator"):
        props, where, kind = node.props, scene.where(node), node.props.plugin_name()
        if kind in ADDING:
            inner = scene.children(props, "Integrator")
            remedy = f"integrator {kind!r} replaced by {'the one inside it' if inner else 'path'}"
            yield Finding("note", where, f"integrator {kind!r} adds channels that the sensor does not use", remedy)
        if props.get("hide_emitters"):
            what = "hide_emitters makes visible emitters black"
            yield Finding("wrong", where, what, "leave it out: a sensor images lamps and sky")


def _film(scene: SceneFile) -> Iterator[Finding]:
    """What load_scene replaces in film and sampler, and the effect of the film in plain Mitsuba."""
    film = scene.film()
    kind = film.props.plugin_name() if film else "hdrfilm"
    where = scene.where(film or scene.sensor())
    if kind == "specfilm" and film.props.get("component_format", "float16") == "float16":
        what = "a specfilm stores float16 by default, and values above 65504 overflow"
        yield Finding("note", where, what, 'float32 taken; write <string name="component_format" value="float32"/>')
    if kind not in ("specfilm", FILM):
        what = f"film {kind!r} does not keep spectra"
        remedy = f"film {kind!r} replaced by the spectral bands of the sensor (specfilm, float32)"
        yield Finding("note", where, what, remedy)
    filters = scene.children(film.props, "ReconstructionFilter") if film else []
    wide = filters[0][1].props.plugin_name() if filters else "gaussian"  # Mitsuba's default
    if kind != FILM and wide != "box":
        what = f"filter {wide!r} is wider than a pixel and correlates the noise of neighbouring pixels"
        yield Finding("note", where, what, f"filter {wide!r} replaced by 'box', which is one pixel wide")
    if film and any(name.startswith("crop") for name in film.props):
        yield Finding("note", where, "only the crop window of the film is rendered", "leave it out to render all")
    for _, sampler in scene.children(scene.sensor().props, "Sampler"):
        if (name := sampler.props.plugin_name()) != SAMPLER:
            what, remedy = f"sampler {name!r} is noisier", f"sampler {name!r} replaced by {SAMPLER!r}"
            yield Finding("note", scene.where(sampler), what, remedy)


def _sensors(scene: SceneFile) -> Iterator[Finding]:
    """The shutter of Mitsuba's sensor, which changes nothing, and sensors that are not rendered."""
    first = scene.sensor()
    if any(name in first.props for name in ("shutter_open", "shutter_close")):
        what = "shutter_open and shutter_close change nothing in Mitsuba 3: no transform moves in time"
        yield Finding("wrong", scene.where(first), what, "leave them out and give an exposure time")
    sensors = [node for _, node in scene.children(scene.root, "Sensor")]
    if len(sensors) > 1:
        what = f"the scene has {len(sensors)} sensors; the first one was taken"
        yield Finding("note", _lines(scene, sensors[1:]), what, "put the one you want first")


class SceneSpectra:
    """Spectra of the emitters and materials of a scene, and the wavelength range where each can be above zero.

    lights : (node, range) of every emitter.  materials : (node, name, range) of every property of a material.
    colours : nodes whose reflectance is an rgb colour or image, or whose radiance is an image; outside Mitsuba's range
        they are extrapolated.
    float_lights : nodes of emitters whose strength is one number.
    """

    def __init__(self, scene: SceneFile) -> None:
        self._mi, self._nodes = mitsuba(), scene.state.nodes
        emitters, surfaces = scene.nodes("Emitter"), scene.nodes("BSDF", "Medium")
        self.lights = [(n, self._of_light(n.props)) for n in emitters]
        self.float_lights = [n for n in emitters if any(isinstance(v, float) for v in _strengths(n.props))]
        self.materials = [(n, name, self._of_value(v, light=False)) for n in surfaces for name, v in n.props.items()]
        self.colours = [n for n in surfaces if any(self._is_colour(v) for _, v in n.props.items())]
        self.colours += [n for n in emitters if any(self._is_colour(v) for v in _strengths(n.props) if not _is_rgb(v))]

    def _of_light(self, props: MitsubaObject) -> Range:
        if props.plugin_name() in SKIES or any(isinstance(v, float) or _is_rgb(v) for v in _strengths(props)):
            return MITSUBA_NM  # rgb is multiplied by D65; rgb inside a texture is not, and unlimited
        ranges = [self._of_value(value, light=True) for _, value in props.items()]
        return min(ranges, key=lambda r: r[1] - r[0], default=EVERYWHERE)

    def _of_value(self, value: MitsubaObject, light: bool) -> Range:
        """Where a property can be above zero; everywhere if it is no spectrum or unlimited."""
        if (props := self._texture(value)) is not None:
            return self._of_texture(props, light)
        spectrum = hasattr(value, "is_uniform") and not value.is_uniform()  # the parser's spectrum, not the variant's
        return _ends(value.wavelengths) if spectrum else EVERYWHERE

    def _of_texture(self, props: MitsubaObject, light: bool) -> Range:
        kind, names = props.plugin_name(), list(props.keys())
        if kind == "irregular":
            nodes = props["wavelengths"] if "wavelengths" in names else ""
            return _ends([float(number) for number in str(nodes).replace(",", " ").split()])
        if {"wavelength_min", "wavelength_max"} <= set(names):
            return float(props["wavelength_min"]), float(props["wavelength_max"])
        inner = [self._of_value(value, light) for _, value in props.items()]
        inner += [MITSUBA_NM] if light and kind in LIMITED else []
        return (max(r[0] for r in inner), min(r[1] for r in inner)) if inner else EVERYWHERE

    def _is_colour(self, value: MitsubaObject) -> bool:
        """Whether a property of a material is an rgb colour or image, or a texture that contains one."""
        if (props := self._texture(value)) is None:
            return _is_rgb(value)
        is_image = props.plugin_name() == "bitmap" and not props.get("raw")  # raw: roughness, normals and the like
        return is_image or any(self._is_colour(inner) for _, inner in props.items())

    def _texture(self, value: MitsubaObject) -> MitsubaObject:
        if not isinstance(value, self._mi.Properties.ResolvedReference):
            return None
        node = self._nodes[value.index()]
        return node.props if node.type == self._mi.ObjectType.Texture else None


def _strengths(props: MitsubaObject) -> list[MitsubaObject]:
    return [props[name] for name in STRENGTHS if name in props]


def _is_rgb(value: MitsubaObject) -> bool:
    return "Color3" in type(value).__name__


def _ends(wavelengths_nm: list[float]) -> Range:
    return (float(min(wavelengths_nm)), float(max(wavelengths_nm))) if len(wavelengths_nm) else EVERYWHERE
