"""Loads any Mitsuba 3 scene and replaces its film by a film of spectral bands.

Film and sampler of one sensor are replaced between parsing and building, so any scene (RGB, any film or filter) renders
as spectral irradiance. Nothing else changes, and notes report each replacement.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.sensor_size import check_on_sensor
from ...core import InputError
from ...optics.intrinsics import View
from ..light.bands import (
    Bands,
    box_bands,
    response_film,
    restrict_wavelengths,
)
from ..light.brightness import LAMP_CD_PER_M2_MAX, brightest_lamp, cd_per_m2
from ..lint.checks import SPECTRAL_RESPONSE, WRAPPERS, lint, lint_built
from ..lint.finding import Built, Finding, Subject, lines_of
from ..lint.infrared import apply_infrared
from ..lint.refusals import (
    refuse_missing_attributes,
    refuse_missing_files,
    refuse_misspelt,
    refuse_unsuitable,
)
from ..lint.spectra import continue_metals
from ..samples import SAMPLER
from ..scene.light_groups import keep_emitters
from ..scene.mitsuba_errors import plain_message
from ..scene.parse_scene import SceneInput, parse
from ..scene.parsed_scene import WIDTH, ParsedScene
from ..scene.scene_settings import (
    FILM,
    SENSOR,
    SceneSettings,
    built_in_sensor,
    sensor_fields_of,
)
from ..variants import MitsubaObject, mitsuba
from .displaced_rays import with_displaced_rays
from .half_pupil import with_half_pupil
from .lens_sensor import with_lens
from .polarizer_rays import with_polarizers
from .weight_noise import WeightCounter, weight_counter

FILM_ID = "sensor"  # id of the new film, which identifies its sensor in the built scene


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene ready to render into bands.

    sharp : the sensor without the point spread, for rays through the centre of each pixel.
    view : field of view of the sensor.  notes, findings : replacements, and spectra that are black.
    sha256 : hash of the scene file, its includes and its parameters.
    weights : counter of the weights of displaced rays, for additional channels.
    polarizers : fingerprint of the polarisers of the sensor, or None.
    """

    mitsuba_scene: MitsubaObject
    integrator: MitsubaObject
    sensor: MitsubaObject
    sharp: MitsubaObject
    view: View
    sha256: str
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    weights: WeightCounter | None = None
    polarizers: str | None = None

    @cached_property
    def brightest_lamp_cd_per_m2(self) -> float | None:
        """Highest luminance of the area lights [cd/m²]; None without area lights."""
        return brightest_lamp(self.mitsuba_scene)

    def restrict_wavelengths(self, low_nm: float, high_nm: float) -> None:
        """Sample only wavelengths between two edges of the bands from this point."""
        restrict_wavelengths(self.sensor.film(), low_nm, high_nm)

    def time_sampling(self) -> None:
        """Return None: nothing moves."""

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """Return a pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], shape (rows, columns,
        channels)."""
        (columns, _), (x, y) = self.view.crop_size, self.view.crop_offset
        film, size, offset = self.sensor.film(), (columns, rows[1] - rows[0]), (x, y + rows[0])
        if tuple(film.crop_size()) != size or tuple(film.crop_offset()) != offset:
            parameters = mitsuba().traverse(self.sensor)
            parameters["film.crop_size"] = list(size)
            parameters["film.crop_offset"] = list(offset)
            parameters.update()

        def image_of(sensor: MitsubaObject) -> NDArray[np.float32]:
            return self._image(sensor, seed, samples)

        image = (
            image_of(self.sensor)
            if self.weights is None
            else self.weights.rendered(self.sensor, samples, image_of)
        )
        return image.reshape(size[1], size[0], -1)

    def _image(self, sensor: MitsubaObject, seed: int, samples: int) -> NDArray[np.float32]:
        try:
            image = self.integrator.render(
                self.mitsuba_scene, sensor=sensor, seed=seed, spp=samples
            )
        except RuntimeError as error:
            variant = mitsuba().variant()
            remedy = "integrator='path' ('volpath' if it has media)"
            if not variant.startswith("scalar"):
                remedy += " or variant='scalar_spectral'"
            first = plain_message(RuntimeError(str(error).split("\n\n")[0]))
            raise InputError(
                f"the scene cannot be rendered in {variant} ({first}); try {remedy}."
            ) from error
        return np.array(image, dtype=np.float32)


def load_scene(
    scene: SceneInput | ParsedScene,
    bands: Bands,
    parameters: Mapping[str, object],
    camera: Camera | None = None,
    scene_unit: str | float | None = None,
    *,
    width: int | None = None,
    sampler: str = SAMPLER,
    emitters: Collection[int] | None = None,
) -> Scene:
    """Return a loaded scene with a film of these bands; the variant must be set. Raises InputError.

    parameters, scene_unit, width : as for :func:`render`.  sampler : Mitsuba plugin that samples the light paths.
    camera : camera with the lens. Default: the camera that the scene file names, if any.
    emitters : of a light group, by index in :func:`render.scene.light_groups.emitters_of`. Default: all.
    """
    if not isinstance(scene, ParsedScene):
        scene = parse(scene, {"parameters": parameters})
    with scene.mitsuba_errors():
        return _load(scene, bands, camera, scene_unit, width, sampler, emitters)


def _load(
    scene: ParsedScene,
    bands: Bands,
    camera: Camera | None,
    scene_unit: str | float | None,
    width: int | None,
    sampler: str,
    emitters: Collection[int] | None,
) -> Scene:
    mi = mitsuba()
    scene = replace(scene, state=mi.parser.ParserState(scene.state))  # a copy, which is changed
    refuse_unsuitable(scene)
    refuse_missing_files(scene)
    settings = scene.settings
    camera, metres = camera or settings.camera, settings.metres(scene_unit)
    subject = Subject(scene, bands.ends_nm, camera, metres)
    findings = lint(subject)
    # A parameter may change the spectrum of an emitter.
    if subject.is_dark and not scene.edits.traverse:
        why = f"{findings[0].what}; give it an emitter with a spectrum there"
        raise InputError(f"scene {scene.name!r} has no light in the bands: {why}.")
    _replace_camera(scene, replace(settings, unit_m=metres), camera)
    scene.edits.set_pose(scene.sensor().props, metres or 1.0)
    _replace_film(scene, bands, scene.film_size(camera, width), sampler)
    if emitters is not None:
        scene = keep_emitters(scene, emitters)
    continue_metals(scene, *bands.ends_nm)
    apply_infrared(scene, *bands.ends_nm)
    built = scene.build()
    world, integrator = built, built.integrator()
    if scene.loaded is not None:
        world, integrator = scene.loaded.scene, scene.loaded.integrator
    if not world.emitters():
        raise InputError(
            f'scene {scene.name!r} has no light; add an emitter, e.g. <emitter type="constant"/>.'
        )
    refuse_missing_attributes(scene, world)
    sensor = next((x for x in built.sensors() if x.film().id() == FILM_ID), None)
    if sensor is None:
        raise InputError(
            f"scene {scene.name!r}: its sensor has a number that is NaN; correct fov and to_world."
        )
    integrator = getattr(integrator, "inner", integrator) or mi.load_dict({"type": "path"})
    unit_m = metres or 1.0
    sharp, view, lens_notes = with_lens(sensor, view_of_sensor(sensor, unit_m), camera, unit_m)
    findings = lint_built(
        findings, replace(subject, scene=scene), Built(world, sensor, integrator, view)
    )
    half, half_notes = with_half_pupil(sharp, view, camera)
    spread, spread_notes = with_displaced_rays(half, view, camera)
    sensor, polarizers = with_polarizers(spread, scene, camera)
    if camera is not None:
        (columns, rows), (column, row) = view.crop_size, view.crop_offset
        film = f"the film of scene {scene.name!r}"
        check_on_sensor(film, (rows, columns), (row, column), camera)
    as_notes = (finding.as_note for finding in findings if finding.level != "fact")
    return Scene(
        world,
        integrator,
        sensor,
        sharp,
        view,
        scene.digest(),
        (*as_notes, *lens_notes, *half_notes, *spread_notes),
        tuple(findings),
        weights=weight_counter(sensor, bands),
        polarizers=polarizers,
    )


def inspect_scene(
    scene: SceneInput | ParsedScene,
    camera: Camera,
    parameters: Mapping[str, object],
    scene_unit: str | float | None = None,
) -> tuple[Finding, ...]:
    """Return findings about a scene for this camera without rendering; the variant must be set. The scene is built, so
    a missing mesh raises InputError here."""
    bands = box_bands(camera, np.array(camera.band_nm, dtype=float))
    if not isinstance(scene, ParsedScene):
        scene = parse(scene, {"parameters": parameters})
    subject = Subject(scene, bands.ends_nm, camera, scene.settings.metres(scene_unit))
    if subject.is_dark:
        return tuple(lint(subject))
    loaded = load_scene(scene, bands, {}, camera, scene_unit)
    luminance = loaded.brightest_lamp_cd_per_m2
    if luminance is None:
        return loaded.findings
    lamps = [node for node in scene.nodes("Emitter") if node.props.plugin_name() == "area"]
    brightest = Finding(
        "note" if luminance > LAMP_CD_PER_M2_MAX else "fact",
        lines_of(scene, lamps),
        f"the brightest lamp has {cd_per_m2(luminance)}",
        "luminance=500 scales all light, so the image has a median of 500 cd/m²",
    )
    return (*loaded.findings, brightest)


def _replace_camera(scene: ParsedScene, settings: SceneSettings, camera: Camera | None) -> None:
    """Replace a <sensor type="camera"> by Mitsuba's perspective or thinlens sensor."""
    node = scene.sensor()
    if node.props.plugin_name() != SENSOR:
        return
    where = f"scene {scene.name!r}, {scene.where(node)}"
    if camera is None:
        raise InputError(
            f'{where}: a camera needs a <film type="{FILM}"> that names it, or camera=.'
        )
    try:
        columns = scene.film_size(camera, None).get("width", WIDTH)
        kind, view = built_in_sensor(settings, camera, columns)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for name in sensor_fields_of(node.props):
        del node.props[name]
    node.props.set_plugin_name(kind)
    for name, value in view.items():
        node.props[name] = value


def _replace_film(scene: ParsedScene, bands: Bands, size: dict[str, int], sampler: str) -> None:
    """Replace film and sampler of the sensor; remove other sensors; unwrap integrators that add channels."""
    mi, node = mitsuba(), scene.sensor()
    refuse_misspelt(scene)
    for name, _ in scene.children(node.props, "Film", "Sampler"):
        del node.props[name]
    if SPECTRAL_RESPONSE in node.props:  # the film has the response of the camera
        del node.props[SPECTRAL_RESPONSE]
    with scene.mitsuba_errors():
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


def view_of_sensor(sensor: MitsubaObject, metres: float) -> View:
    """Return the view of a built sensor, whose fov_axis or focal_length is x_fov now.  metres : per scene unit."""
    parameters, film = mitsuba().traverse(sensor), sensor.film()

    def value(name: str, default: float) -> float:  # Dr.Jit scalars are arrays of one
        return float(np.ravel(parameters[name])[0]) if name in parameters else default

    size, crop_size, offset = (
        (int(pair[0]), int(pair[1]))
        for pair in (film.size(), film.crop_size(), film.crop_offset())
    )
    if 0 in crop_size:
        raise InputError(
            f"the film has {crop_size[0]} × {crop_size[1]} pixels; it needs at least 1 × 1."
        )
    return View(
        size=size,
        crop_size=crop_size,
        crop_offset=offset,
        half_width=math.tan(math.radians(value("x_fov", 0.0)) / 2),
        principal_point=(
            value("principal_point_offset_x", 0.0),
            value("principal_point_offset_y", 0.0),
        ),
        focus_m=value("focus_distance", math.inf) * metres,
        aperture_radius_m=value("aperture_radius", 0.0) * metres,
    )
