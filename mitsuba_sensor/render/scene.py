"""Loads any Mitsuba 3 scene file and replaces its film by one of spectral bands.

Film and sampler of the first sensor are replaced between parsing and building, so that any scene (rgb, any film or
filter) renders as spectral irradiance. Nothing else is changed, and notes say what was replaced.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Float64Array, InputError
from ..io.raw_files import require_plausible_picture
from ..optics.intrinsics import View
from ..sensor.camera import Camera
from ..sensor.sensor_size import check_on_sensor
from .bands import Bands, box_bands, response_film, restrict_wavelengths
from .film_size import WIDTH, film_size
from .guides import render_guides
from .lens_sensor import with_lens
from .lint import WRAPPERS, Finding, lint, lint_built, most_serious_first
from .noisy_pixels import NoisyPixels
from .passes import SAMPLER
from .plugins import built_in_sensor
from .scene_file import POLARISING, SceneFile, as_input_error, parse_scene, plain_message
from .scene_settings import FILM, SENSOR, SceneSettings, sensor_fields_of, settings_of
from .variants import MitsubaObject, mitsuba

SENSORS = ("perspective", "thinlens", "orthographic", SENSOR)
GUIDE_SEED = 1
FILM_ID = "sensor"  # id of the new film, by which its sensor is found in the built scene
SCALAR_ONLY = ("timed_sunsky",)  # Dr.Jit refuses to trace it, and every render of the process after that
PICTURES = ("bitmap", "envmap")  # whose file is one
WITH_FILES = ("Shape", "Texture", "Emitter", "Volume", "BSDF", "Medium", "PhaseFunction")
# Plugins that cannot be used, and what to do instead.
UNSUITABLE = {
    "depth": "computes no radiance; take --integrator path (integrator='path')",
    "ptracer": "starts its paths at the emitters and cannot write spectral bands; take --integrator path "
    "(integrator='path')",
} | dict.fromkeys(
    POLARISING, "acts on polarised light, which is not simulated; for unpolarised light take --ignore-polarization"
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene ready to render into bands.

    view : what its sensor images.  notes : what was replaced, what will be black.  findings : the same, one by one.
    sha256 : of the scene file, its includes and its parameters.  noisy : pixels that get more samples, or None.
    """

    mitsuba_scene: MitsubaObject
    integrator: MitsubaObject
    sensor: MitsubaObject
    view: View
    sha256: str
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    noisy: NoisyPixels | None = None

    def restrict_wavelengths(self, low_nm: float, high_nm: float) -> None:
        """From now on sample wavelengths between two edges of the bands only."""
        restrict_wavelengths(self.sensor.film(), low_nm, high_nm)

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """One pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], (rows, columns, channels)."""
        (columns, _), (x, y) = self.view.crop_size, self.view.crop_offset
        film, size, offset = self.sensor.film(), (columns, rows[1] - rows[0]), (x, y + rows[0])
        if tuple(film.crop_size()) != size or tuple(film.crop_offset()) != offset:
            parameters = mitsuba().traverse(self.sensor)
            parameters["film.crop_size"], parameters["film.crop_offset"] = list(size), list(offset)
            parameters.update()
        image = self._rendered(self.sensor, seed, samples).reshape(size[1], size[0], -1)
        if self.noisy is None:
            return image
        return self.noisy.averaged(image, self.sensor, rows, seed, samples, self._rendered)

    def _rendered(self, sensor: MitsubaObject, seed: int, samples: int) -> NDArray[np.float32]:
        try:
            image = self.integrator.render(self.mitsuba_scene, sensor=sensor, seed=seed, spp=samples)
        except RuntimeError as error:
            variant = mitsuba().variant()
            way_out = "" if variant.startswith("scalar") else f" in {variant}: try --variant scalar_spectral"
            first = plain_message(RuntimeError(str(error).split("\n\n")[0]))
            raise InputError(f"the scene cannot be rendered{way_out} ({first}).") from error
        return np.array(image, dtype=np.float32)

    def with_noisy(self, pixels: NoisyPixels) -> Scene:
        """The same with more samples for some pixels."""
        return replace(self, noisy=pixels, notes=(*self.notes, pixels.note))

    def guides(
        self, wavelengths_nm: Float64Array, rows: tuple[int, int], rays: int, number: int = 0
    ) -> NDArray[np.float32]:
        """Guides of a denoiser for rows [first, last) of the crop: see :func:`guides.render_guides`.  number : of the
        set of rays."""
        return render_guides(self, wavelengths_nm, GUIDE_SEED + number, rays, rows)


def load_scene(
    path: str | os.PathLike[str] | SceneFile,
    bands: Bands,
    parameters: Mapping[str, object],
    camera: Camera | None = None,
    scene_unit: str | float | None = None,
    *,
    width: int | None = None,
    sampler: str = SAMPLER,
) -> Scene:
    """Load ``path`` with a film of these bands; the variant must be set. Raises InputError.

    parameters, scene_unit, width : as for :func:`render`.  sampler : Mitsuba plugin that samples the light paths.
    camera : whose lens is used; by default the one that the scene file names, if any.
    """
    scene = path if isinstance(path, SceneFile) else parse_scene(path, parameters)
    with as_input_error(scene.path):
        return _load(scene, bands, camera, scene_unit, width, sampler)


def _load(
    scene: SceneFile,
    bands: Bands,
    camera: Camera | None,
    scene_unit: str | float | None,
    width: int | None,
    sampler: str,
) -> Scene:
    scene = replace(scene, state=mitsuba().parser.ParserState(scene.state))  # a copy, which is changed
    _refuse_unsuitable(scene)
    _refuse_missing_files(scene)
    settings = settings_of(scene)
    camera, metres = camera or settings.camera, settings.metres(scene_unit)
    findings, dark = lint(scene, bands.ends_nm, metres)
    if dark and not scene.edits.traverse:  # which may change the spectrum of an emitter
        why = f"{findings[0].what}; give it an emitter with a spectrum there"
        raise InputError(f"scene {scene.name!r} has no light in the bands: {why}.")
    _replace_camera(scene, replace(settings, unit_m=metres), camera)
    scene.edits.set_pose(scene.sensor().props, metres or 1.0)
    _replace_film(scene, bands, film_size(scene, camera, width), sampler)
    built = scene.build()
    world = built if scene.loaded is None else scene.loaded
    if not world.emitters():
        raise InputError(f'scene {scene.name!r} has no light; add an emitter, e.g. <emitter type="constant"/>.')
    sensor = next((one for one in built.sensors() if one.film().id() == FILM_ID), None)
    if sensor is None:
        raise InputError(f"scene {scene.name!r}: its sensor has a number that is NaN; correct fov and to_world.")
    integrator = getattr(world.integrator(), "inner", world.integrator()) or mitsuba().load_dict({"type": "path"})
    findings = most_serious_first([*findings, *lint_built(scene, world, sensor)])
    sensor, view, lens_notes = with_lens(sensor, _view(sensor, metres or 1.0), camera, metres or 1.0)
    if camera is not None:
        (columns, rows), (column, row) = view.crop_size, view.crop_offset
        check_on_sensor(f"the film of scene {scene.name!r}", (rows, columns), (row, column), camera)
    notes = (*(str(finding) for finding in findings), *lens_notes)
    return Scene(world, integrator, sensor, view, scene.digest(), notes, tuple(findings))


def inspect_scene(
    path: str | os.PathLike[str] | SceneFile,
    camera: Camera,
    parameters: Mapping[str, object],
    scene_unit: str | float | None = None,
) -> tuple[Finding, ...]:
    """Findings about a scene for ``camera``, without rendering; the variant must be set. The scene is built too, so
    that a missing mesh is an InputError here and not later."""
    bands = box_bands(camera, np.array(camera.band_nm, dtype=float))
    scene = path if isinstance(path, SceneFile) else parse_scene(path, parameters)
    findings, dark = lint(scene, bands.ends_nm, settings_of(scene).metres(scene_unit))
    return tuple(findings) if dark else load_scene(scene, bands, parameters, camera, scene_unit).findings


def _refuse_unsuitable(scene: SceneFile) -> None:
    """InputError for a sensor, integrator or material that cannot be rendered into spectral bands."""
    if (kind := scene.sensor().props.plugin_name()) not in SENSORS:
        many = ", ".join(SENSORS)
        raise InputError(f"scene {scene.name!r} has a sensor of type {kind!r}; it must be one of {many}.")
    for node in scene.nodes("Integrator", "BSDF"):
        if (kind := node.props.plugin_name()) in UNSUITABLE and not (scene.ignore_polarization and kind in POLARISING):
            raise InputError(f"scene {scene.name!r}, {scene.where(node)}: {kind!r} {UNSUITABLE[kind]}.")
    for node in scene.nodes("Emitter"):
        kind, variant = node.props.plugin_name(), mitsuba().variant()
        if kind in SCALAR_ONLY and not variant.startswith("scalar"):
            why = f"{kind!r} of Mitsuba 3.9.1 fails in {variant}; take --variant scalar_spectral"
            raise InputError(f"scene {scene.name!r}, {scene.where(node)}: {why}.")


def _refuse_missing_files(scene: SceneFile) -> None:
    """InputError that names all missing meshes, textures and tables."""
    missing = dict[str, str]()
    for node in scene.nodes(*WITH_FILES):
        name = node.props.get("filename", None)
        if not isinstance(name, str):
            continue
        file = Path(str(scene.resolver.resolve(name)))
        if not os.path.isfile(file):
            missing.setdefault(name, scene.where(node))
        elif node.props.plugin_name() in PICTURES:
            require_plausible_picture(file)
    if missing:
        named = ", ".join(f"{name} ({line})" for name, line in missing.items())
        files = f"{len(missing)} files" if len(missing) > 1 else "a file"
        where = "look in the folder of the scene, or name another with <path value=…/>"
        raise InputError(f"scene {scene.name!r} lacks {files}: {named}; {where}.")


def _replace_camera(scene: SceneFile, settings: SceneSettings, camera: Camera | None) -> None:
    """Replace a <sensor type="camera"> by Mitsuba's perspective or thinlens."""
    node = scene.sensor()
    if node.props.plugin_name() != SENSOR:
        return
    where = f"scene {scene.name!r}, {scene.where(node)}"
    if camera is None:
        raise InputError(f'{where}: a camera needs a <film type="{FILM}"> that names it, or --camera.')
    try:
        kind, view = built_in_sensor(settings, camera, film_size(scene, camera, None).get("width", WIDTH))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for name in sensor_fields_of(node.props):
        del node.props[name]
    node.props.set_plugin_name(kind)
    for name, value in view.items():
        node.props[name] = value


def _replace_film(scene: SceneFile, bands: Bands, size: dict[str, int], sampler: str) -> None:
    """Replace film and sampler of the first sensor; remove other sensors; unwrap integrators that add channels."""
    mi, node = mitsuba(), scene.sensor()
    _refuse_misspelt(scene)
    for name, _ in scene.children(node.props, "Film", "Sampler"):
        del node.props[name]
    with as_input_error(scene.path):
        node.props["film"] = response_film(bands.responses, {**size, "id": FILM_ID})
    node.props["sampler"] = mi.load_dict({"type": sampler})
    for name, child in scene.children(scene.root, "Sensor"):
        if child != node:
            del scene.root[name]
    for name, child in scene.children(scene.root, "Integrator"):
        if child.props.plugin_name() in WRAPPERS:
            inner = [child.props[key] for key, _ in scene.children(child.props, "Integrator")]
            scene.root[name] = inner[0] if inner else mi.load_dict({"type": "path"})
    scene.edits.fix_blocks(scene.root, scene.nodes("Integrator"))


def _refuse_misspelt(scene: SceneFile) -> None:
    """InputError for unknown types and parameters of film, filter and sampler, which Mitsuba never sees because they
    are replaced. Those of old formats may be unknown."""
    mi, versions = mitsuba(), [str(version) for version in scene.state.versions]  # none of a dict
    for node in scene.nodes("Film", "Sampler", "ReconstructionFilter"):
        kind, props = node.props.plugin_name(), node.props
        if kind == FILM or (versions and versions[node.file_index] < "3"):
            continue
        nested = [name for name, _ in scene.children(props)]
        own = {name: props[name] for name in props if name not in nested}
        channel = {"channel": {"type": "d65"}} if kind == "specfilm" else {}  # it needs one
        with as_input_error(scene.path, f"({scene.where(node)}) "):
            mi.load_dict({"type": kind, **own, **channel})


def _view(sensor: MitsubaObject, metres: float) -> View:
    """The view of a built sensor, whose fov_axis or focal_length Mitsuba has converted into x_fov; metres per unit."""
    parameters, film = mitsuba().traverse(sensor), sensor.film()

    def value(name: str, default: float) -> float:  # Dr.Jit scalars are arrays of one
        return float(np.ravel(parameters[name])[0]) if name in parameters else default

    def pair(vector: Array) -> tuple[int, int]:
        return int(vector[0]), int(vector[1])

    if 0 in pair(film.crop_size()):
        raise InputError(f"the film has {film.crop_size()[0]} × {film.crop_size()[1]} pixels; it needs at least 1 × 1.")
    return View(
        size=pair(film.size()),
        crop_size=pair(film.crop_size()),
        crop_offset=pair(film.crop_offset()),
        half_width=math.tan(math.radians(value("x_fov", 0.0)) / 2),
        principal_point=(value("principal_point_offset_x", 0.0), value("principal_point_offset_y", 0.0)),
        focus_m=value("focus_distance", math.inf) * metres,
        aperture_radius_m=value("aperture_radius", 0.0) * metres,
    )
